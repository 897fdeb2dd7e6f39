"""Controllers that run in steps: anything that takes outputs and messages and gives an input.

`SampledControllers` holds one stepper per agent and what they need from a network: who hears whom, the period, and
when the input takes effect. A stepper may be the compiled C, its bit-exact reference, or `ExactStepper` here, the same
policy in doubles: a message that does not arrive is replaced by the last one, and a neighbour never heard counts as
the agent itself.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from jaxtyping import Float

from lockstep.check.errors import ProblemError, demand
from lockstep.check.system.loop import Gains
from lockstep.model.graphs.graph import Graph

OK, CLIPPED = 0, 8
"""What a good step says: all of u is applied, or an entry met its limit, which is."""


class Stepper(Protocol):
    """One agent's controller as a program."""

    @property
    def memory(self) -> Float[np.ndarray, " n_C"]:
        """Its state before the next step."""
        ...

    def init(self) -> None:
        """Go to the state before the first step."""
        ...

    def step(
        self, y: Float[np.ndarray, " q"], neighbour_y: Float[np.ndarray, "nn q"], received: int
    ) -> tuple[int, Float[np.ndarray, " m"]]:
        """Take own and neighbours' outputs, bit j of `received` for row j; return (`OK`, `CLIPPED` or a fault, u)."""
        ...


@dataclass(frozen=True, eq=False)
class SampledControllers:
    """steppers: one per agent;  sources: whom each hears, from 0, in the order of its rows;  period: in s;

    delay: periods between sampling y and applying u;  real: the type the steppers take y in.
    """

    steppers: Sequence[Stepper]
    sources: tuple[tuple[int, ...], ...]
    period: float
    delay: Literal[0, 1] = 0
    real: Literal["float32", "float64"] = "float64"

    def __post_init__(self) -> None:
        where = "sampled controllers"
        found = f"{len(self.steppers)} steppers for {len(self.sources)} lists of sources"
        demand(len(self.steppers) == len(self.sources), found, where)
        if any(not 0 <= j < len(self.sources) for heard in self.sources for j in heard):
            raise ProblemError("a source is no agent", where=where, expected=f"0 to {len(self.sources) - 1}")
        demand(0 < self.period < math.inf, f"the period is {self.period!r}", where, "seconds above 0")
        demand(self.delay in (0, 1), f"the delay is {self.delay!r}", where, "0 or 1 periods")

    @property
    def N(self) -> int:
        """Number of agents."""
        return len(self.sources)

    def init(self) -> None:
        """Bring every controller to the state before its first step."""
        for stepper in self.steppers:
            stepper.init()


class ExactStepper:
    """x+ = A x + B r, u = C x + D r, r = sum_j a_j (y - y_j), in doubles."""

    def __init__(
        self, K: Float[np.ndarray, "k l"], order: int, weights: Float[np.ndarray, " nn"], outputs: int
    ) -> None:
        self._K, self._order, self._weights, self._outputs = K, order, weights, outputs
        self.init()

    @property
    def memory(self) -> Float[np.ndarray, " n_C"]:
        """x before the next step."""
        return self._x.copy()

    def init(self) -> None:
        """Set x = 0, nobody heard."""
        self._x = np.zeros(self._order)
        self._held: list[np.ndarray | None] = [None] * len(self._weights)

    def step(
        self, y: Float[np.ndarray, " q"], neighbour_y: Float[np.ndarray, "nn q"], received: int
    ) -> tuple[int, Float[np.ndarray, " m"]]:
        """Take a step; there are no faults."""
        r = np.zeros(self._outputs)
        for j, weight in enumerate(self._weights):
            if received >> j & 1:
                self._held[j] = neighbour_y[j].copy()
            held = self._held[j]
            if held is not None:
                r += weight * (y - held)
        with np.errstate(over="ignore", invalid="ignore"):
            out = self._K @ np.concatenate([self._x, r])
        self._x = out[: self._order]
        return OK, out[self._order :]


def exact_controllers(
    graph: Graph, sampled: Gains, period: float, *, delay: Literal[0, 1] = 0
) -> SampledControllers:
    """Return controllers that step gains in doubles.

    Args:
        graph: who hears whom.
        sampled: the gains of x+ = A x + B r, u = C x + D r, already discretised.
        period: in s.
        delay: periods between sampling y and applying u.
    """
    heard = sources_of(graph)
    steppers = [
        ExactStepper(block, sampled.order, graph.adjacency[i, list(heard[i])], sampled.D[0].shape[1])
        for i, block in enumerate(sampled.blocks)
    ]
    return SampledControllers(steppers, heard, period, delay)


def sources_of(graph: Graph) -> tuple[tuple[int, ...], ...]:
    """Return whom each agent hears, counted from 0, in ascending order: the order of the C's mask bits."""
    return tuple(tuple(int(j) for j in np.flatnonzero(row)) for row in graph.adjacency)
