"""What every design needs: a spanning tree, (A, B_i) stabilisable, (A, C) detectable.

The paper assumes (A, B_i) controllable and (A, C) observable under (2). Less is enough. In coordinates in which the modes
that no input moves stand last, A = [A_1, A_12; 0, A_2] and B_i = [B_1; 0]: they obey x_2' = A_2 x_2 with any gains, so A_2
has to be stable, and nothing else is asked of it. The same holds of modes that no output shows, with (A', C'). What phi adds
to them is a matter of the certificate.
"""

from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np
from jaxtyping import Float

from lockstep.check.bound.decide import decide_offset
from lockstep.check.bound.slopes import SlopeProblem
from lockstep.check.errors import ProblemError, demand
from lockstep.model.agents.agent import Agent
from lockstep.model.agents.unbounded_slope import no_bound
from lockstep.model.bound_search import UNFINISHED, search_bound
from lockstep.model.control.pbh import Controllability, Observability, controllability, observability
from lockstep.model.graphs.graph import Graph
from lockstep.model.loop_transformation.centring import GROWING, NO_SLOPES


def check_assumptions(graph: Graph, agent: Agent, agents_B: Sequence[Float[np.ndarray, "n m"]]) -> None:
    """Refuse a network that cannot agree with any controllers of the form (9).

    Raises:
        ProblemError: no spanning tree; a term in t alone without a value; a pair that is not stabilisable or not detectable,
            with a mode that is lost and does not decay.
    """
    graph.check_spanning_tree()
    given = decide_offset(agent.exact.offset_needs)
    expected = "terms in t alone that have a value at every t >= 0"
    demand(given.proved, given.reason, "[agent.dynamics]", expected)
    unstable = agent.observability().unstable_eigenvalue
    if unstable is not None:
        lost = f"(A, C) is not detectable: no output shows the mode at {_mode(unstable)}"
        without, domain = _lost_slopes(agent, lambda A: observability(A, agent.lure.C))
        expected = "outputs that show every mode that does not decay by itself"
        remedy = f"{domain}measure one more state"
        raise ProblemError(f"{without}{lost}", where="[agent.outputs]", expected=expected, remedy=remedy)
    tested: list[np.ndarray] = []
    for k, B in enumerate(agents_B, start=1):
        if not any((other == B).all() for other in tested):
            tested.append(B)
            _check_stabilisable(agent, k, B)


def _check_stabilisable(agent: Agent, k: int, B: Float[np.ndarray, "n m"]) -> None:
    unstable = controllability(agent.lure.A, B).unstable_eigenvalue
    if unstable is not None:
        pair = "(A, B)" if (agent.lure.B == B).all() else f"(A, B_{k})"
        lost = f"{pair} is not stabilisable: no input moves the mode at {_mode(unstable)}"
        without, domain = _lost_slopes(agent, lambda A: controllability(A, B))
        expected = "inputs that move every mode that does not decay by itself"
        remedy = f"{domain}add an input, or leave the state out"
        raise ProblemError(f"{without}{lost}", where="[agent.dynamics]", expected=expected, remedy=remedy)


def _at_the_origin(agent: Agent) -> Float[np.ndarray, "n n"]:
    """Return df/dx at x = 0, or A where there is none."""
    lure, v = agent.lure, ca.SX.sym("v", len(agent.lure.H))
    slopes = np.asarray(ca.evalf(ca.substitute(ca.jacobian(lure.phi(v, 0.0), v), v, ca.DM.zeros(v.shape))))
    return lure.A + lure.G @ slopes @ lure.H if np.isfinite(slopes).all() else lure.A


def _lost_slopes(agent: Agent, modes: Callable[..., Controllability | Observability]) -> tuple[str, str]:
    """Say, before what is lost and as the first remedy, where A may lack what phi does.

    That is sqrt(x) or q/h without a domain, whose slopes have no middle to move into A; or sin(x), whose slopes are around
    zero on the whole line, though no mode is lost at the origin. Where nothing is moved into A, since the file says so, no
    domain helps.

    Raises:
        ProblemError: no finite slopes on the domain of the file: sqrt(1 + x) where it reaches -1.
    """
    if not agent.centre:
        counts = modes(_at_the_origin(agent)).unstable_eigenvalue is None
        return (
            "",
            "name neither `centre = false` nor [design] alpha, and slopes of phi count in A; or " * counts,
        )
    endless = np.isinf(agent.box).any(axis=1) & agent.lure.H.any(axis=0)
    free = ", ".join(np.array(agent.states)[endless])
    finite = agent.centring.reason not in (NO_SLOPES, GROWING)
    if agent.domain and not finite:
        bound = search_bound(SlopeProblem.of(agent.exact.phi, agent.argument_box))
        if not np.isfinite(bound.alpha) and bound.reason != UNFINISHED:
            raise no_bound(bound, agent)
    if not free or (finite and modes(_at_the_origin(agent)).unstable_eigenvalue is not None):
        return "", ""
    where = f" of {free}" if agent.domain else ""
    slopes = "slopes that are not around zero" if finite else "finite slopes"
    remedy = f"give [agent.domain]{where}, a box where the nonlinearity has {slopes}: their middle then counts in A; or "
    return f"without a domain{where} nothing of the nonlinearity counts in A, and ", remedy


def _mode(s: complex) -> str:
    shown = f"{s.real:.6g}" if s.imag == 0 else f"{s.real:.6g} +- {abs(s.imag):.6g}i"
    if s.real < 0:
        return f"the eigenvalue {shown} of A, which rounding cannot tell from one that does not decay"
    return f"the eigenvalue {shown} of A, which does not decay by itself"
