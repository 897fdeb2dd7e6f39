"""A swarm: one agent's model many times over, sampled controllers, and whom each agent hears.

    x_i' = A x_i + B_i u_i + G phi(H x_i, t) + offset(t) + xi_i,     u held between the steps of
    (x_C+, u_i) = [A B; C D] (x_C, r_i),     r_i = sum_j a_ij (y_i - y_j)

in the arithmetic that ships: gains and weights rounded, every sum from left to right.
"""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from lockstep.check.errors import ProblemError
from lockstep.check.sampled.discretise import Real, clipped_at, rounded_to, sampled_table
from lockstep.model.agents.agent import Agent
from lockstep.swarm.neighbours import NeighbourLists

if TYPE_CHECKING:
    from lockstep.lmi.document import Stored


@dataclass(frozen=True, eq=False)
class SwarmLoop:
    """Args.

    agent: the model of all;  neighbours: who hears whom;  order: n_C.
    tables: (1 or N, n_C + m, n_C + q), [A B; C D] in the arithmetic of the controllers: one for all, or one each.
    B: (1 or N, n, m), likewise.
    period: T in s;  delay: periods between sampling y and applying u, 0 or 1;  real: of the arithmetic.
    R, Q: what rho weighs disagreements and controllers with.
    limits: (m, 2), where the controllers clip u, in their arithmetic; empty: nowhere.

    Raises:
        ProblemError: parts that do not fit.
    """

    agent: Agent
    neighbours: NeighbourLists
    order: int
    tables: Float[np.ndarray, "T k l"]
    B: Float[np.ndarray, "b n m"]
    period: float
    real: Real
    R: Float[np.ndarray, "n n"]
    Q: Float[np.ndarray, "n_C n_C"]
    delay: int = 0
    limits: Float[np.ndarray, "k 2"] = field(default_factory=lambda: np.zeros((0, 2)))

    def __post_init__(self) -> None:
        n, m, q, N, order = self.agent.n, self.agent.m, self.agent.q, self.neighbours.N, self.order
        tables = np.asarray(self.tables, dtype=self.real)
        B = np.asarray(self.B, dtype=float)
        for name, array, shape in (("tables", tables, (order + m, order + q)), ("B", B, (n, m))):
            if array.shape[1:] != shape or len(array) not in (1, N):
                raise ProblemError(
                    f"`{name}` of {' x '.join(map(str, array.shape))}",
                    where="swarm",
                    expected=f"1 or {N} of {shape[0]} x {shape[1]}",
                )
            object.__setattr__(self, name, array)
        rounded_to(self.real, self.neighbours.weight, "weights")

    @property
    def N(self) -> int:
        """Number of agents."""
        return self.neighbours.N

    @property
    def weights(self) -> Float[np.ndarray, " E"]:
        """The weights as the controllers have them."""
        return np.asarray(rounded_to(self.real, self.neighbours.weight, "weights"), dtype=self.real)


def swarm_of_design(stored: "Stored", neighbours: NeighbourLists | None = None) -> SwarmLoop:
    """Return the swarm of a design, on its own graph or on another one.

    Args:
        stored: the design.
        neighbours: another graph, of any size: then all agents of the design must have the same gains and the same B.

    Raises:
        ProblemError: gains that differ, for a graph that is not the design's; or a gain that cannot be sampled.
    """
    problem, gains = stored.problem, stored.gains
    table = problem.controller
    B = np.array(problem.agents_B())
    blocks, alike = gains.blocks, bool((gains.blocks == gains.blocks[0]).all())
    one_B = bool((B[0] == B).all())
    if neighbours is None:
        neighbours = NeighbourLists.from_graph(problem.graph())
    elif not (alike and one_B) and neighbours.N != gains.N:
        raise ProblemError(
            f"a graph of {neighbours.N} agents for {gains.N} controllers that are not all the same",
            where="swarm",
            expected="a design whose agents all have the same gains and the same B",
            remedy='use method = "modal"',
        )
    many = range(1 if alike else len(blocks))
    tables = [sampled_table(gains, i, table.period, table.discretization, table.real) for i in many]
    return SwarmLoop(
        problem.agent(),
        neighbours,
        gains.order,
        np.array(tables, dtype=table.real),
        B[:1] if one_B else B,
        table.period,
        table.real,
        problem.state_weight(problem.agent().n),
        problem.controller_weight(gains.order),
        table.delay,
        clipped_at(table.real, problem.sides) if problem.has_limits else np.zeros((0, 2)),
    )
