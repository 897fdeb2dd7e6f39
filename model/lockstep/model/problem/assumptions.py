"""What the paper assumes under (2) and (1): a spanning tree, (A, B_i) controllable, (A, C) observable."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from lockstep.model.agent import Agent
from lockstep.model.errors import ProblemError
from lockstep.model.graph import Graph
from lockstep.model.pbh import controllability


def check_assumptions(graph: Graph, agent: Agent, agents_B: Sequence[Float[np.ndarray, "n m"]]) -> None:
    """Refuse a network that cannot agree, or that the method's assumptions do not cover.

    Raises:
        ProblemError: no spanning tree; a pair that is not observable or not controllable, with the mode that
            is lost, and whether it decays by itself (detectable, stabilisable) or not.
    """
    graph.check_spanning_tree()
    check = agent.observability()
    if not check.observable:
        raise ProblemError(
            f"(A, C) is not observable: no output shows the mode at {_mode(check.eigenvalue)}, "
            + _consequence(check.unstable_eigenvalue, "detectable"),
            where="[agent.outputs]",
            expected="an observable pair, as the paper assumes under (2)",
            remedy="measure one more state",
        )
    tested: list[np.ndarray] = []
    for k, B in enumerate(agents_B, start=1):
        if not any((other == B).all() for other in tested):
            tested.append(B)
            _check_controllable(agent, k, B)


def _check_controllable(agent: Agent, k: int, B: Float[np.ndarray, "n m"]) -> None:
    check = controllability(agent.lure.A, B)
    if not check.controllable:
        pair = "(A, B)" if (agent.lure.B == B).all() else f"(A, B_{k})"
        raise ProblemError(
            f"{pair} is not controllable: no input moves the mode at {_mode(check.eigenvalue)}, "
            + _consequence(check.unstable_eigenvalue, "stabilisable"),
            where="[agent.dynamics]",
            expected="a controllable pair, as the paper assumes under (2)",
            remedy="add an input, or leave the state out",
        )


def _mode(s: complex) -> str:
    shown = f"{s.real:.6g}" if s.imag == 0 else f"{s.real:.6g} +- {abs(s.imag):.6g}i"
    return f"the eigenvalue {shown} of A"


def _consequence(unstable: complex | None, word: str) -> str:
    if unstable is None:
        return f"which decays by itself (the pair is {word})"
    return f"and {_mode(unstable)} does not decay by itself (the pair is not {word} either)"
