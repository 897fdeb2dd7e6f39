"""What every design needs: a spanning tree, (A, B_i) stabilisable, (A, C) detectable.

The paper assumes (A, B_i) controllable and (A, C) observable under (2). Less is enough. In coordinates in which the modes
that no input moves stand last, A = [A_1, A_12; 0, A_2] and B_i = [B_1; 0]: they obey x_2' = A_2 x_2 with any gains, so A_2
has to be stable, and nothing else is asked of it. The same holds of modes that no output shows, with (A', C'). What phi adds
to them is a matter of the certificate.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from lockstep.check.errors import ProblemError
from lockstep.model.agents.agent import Agent
from lockstep.model.control.pbh import controllability
from lockstep.model.graphs.graph import Graph
from lockstep.model.loop_transformation.centring import GROWING, NO_SLOPES


def check_assumptions(graph: Graph, agent: Agent, agents_B: Sequence[Float[np.ndarray, "n m"]]) -> None:
    """Refuse a network that cannot agree with any controllers of the form (9).

    Raises:
        ProblemError: no spanning tree; a pair that is not stabilisable or not detectable, with a mode that is lost and
            does not decay.
    """
    graph.check_spanning_tree()
    unstable = agent.observability().unstable_eigenvalue
    if unstable is not None:
        found = f"(A, C) is not detectable: no output shows the mode at {_mode(unstable)}"
        expected = "outputs that show every mode that does not decay by itself"
        remedy = f"{_unseen_slopes(agent)}measure one more state"
        raise ProblemError(found, where="[agent.outputs]", expected=expected, remedy=remedy)
    tested: list[np.ndarray] = []
    for k, B in enumerate(agents_B, start=1):
        if not any((other == B).all() for other in tested):
            tested.append(B)
            _check_stabilisable(agent, k, B)


def _check_stabilisable(agent: Agent, k: int, B: Float[np.ndarray, "n m"]) -> None:
    unstable = controllability(agent.lure.A, B).unstable_eigenvalue
    if unstable is not None:
        pair = "(A, B)" if (agent.lure.B == B).all() else f"(A, B_{k})"
        found = f"{pair} is not stabilisable: no input moves the mode at {_mode(unstable)}"
        expected = "inputs that move every mode that does not decay by itself"
        remedy = f"{_unseen_slopes(agent)}add an input, or leave the state out"
        raise ProblemError(found, where="[agent.dynamics]", expected=expected, remedy=remedy)


def _unseen_slopes(agent: Agent) -> str:
    """Say where A may lack what phi does, as sqrt(x) or q/h without a domain, whose slopes have no middle to move into A."""
    if agent.centring.reason not in (NO_SLOPES, GROWING):
        return ""
    free = ", ".join(
        state for state, sides in zip(agent.states, agent.box, strict=True) if np.isinf(sides).any()
    )
    where = f" of {free}" if agent.domain else ""
    return f"give [agent.domain]{where}, a box where the nonlinearity has finite slopes: their middle then counts in A; or "


def _mode(s: complex) -> str:
    shown = f"{s.real:.6g}" if s.imag == 0 else f"{s.real:.6g} +- {abs(s.imag):.6g}i"
    if s.real < 0:
        return f"the eigenvalue {shown} of A, which rounding cannot tell from one that does not decay"
    return f"the eigenvalue {shown} of A, which does not decay by itself"
