"""Sampled controllers in doubles: the policy of the C, a message that does not arrive being replaced by the last one."""

from typing import Literal

import numpy as np
from jaxtyping import Float

from lockstep.check.system.loop import Gains
from lockstep.model.graphs.graph import Graph
from lockstep.model.simulation.sampled_controllers import OK, SampledControllers


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
