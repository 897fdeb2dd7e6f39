"""The slope of an objective at points: estimated in floating point for the search, and proved at a single one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from functools import reduce
from typing import Any

import numpy as np
from jaxtyping import Float

from lockstep.check.bound import intervals
from lockstep.check.bound.enclosure import Program
from lockstep.check.bound.intervals import INF
from lockstep.check.bound.objective import Objective
from lockstep.check.expression.node import Node

LARGEST = 1e150


class PointSlopes:
    """|J|_2 of one block at points (v, t)."""

    def __init__(self, objective: Objective) -> None:
        self.objective = objective
        self.variables, self.used = objective.variables, objective.used
        self._program = Program([x for row in objective.narrow for x in row])

    def jacobians(
        self, points: Float[np.ndarray, "variables points"]
    ) -> Float[np.ndarray, "points rows columns"]:
        """Return the block (transposed if it has more rows than columns) at each point, in floating point."""
        flat = np.stack(estimates(self._program, points))
        rows = len(self.objective.narrow)
        return np.moveaxis(flat.reshape(rows, -1, points.shape[1]), -1, 0)

    def estimate(self, points: Float[np.ndarray, "variables points"]) -> Float[np.ndarray, " points"]:
        """Return the floating-point slope at points (v, t), -1 where it has no value."""
        J = self.jacobians(points)
        usable = np.isfinite(J).all(axis=(1, 2)) & (np.abs(J) < LARGEST).all(axis=(1, 2))
        norms = np.full(points.shape[1], -1.0)
        if usable.any():
            norms[usable] = _norms(J[usable])
        return norms

    def reached(self, point: Float[np.ndarray, " variables"]) -> float:
        """Return a slope provably reached at (v, t), a lower bound of |J|_2 there; -1 if none is proved."""
        here = point[:, None]
        if not all(held.all() for held in self.objective.conditions.on_boxes(here, here)):
            return -1.0
        entries = self._program.on_boxes(here, here)
        columns = len(self.objective.narrow[0])
        J = [entries[i : i + columns] for i in range(0, len(entries), columns)]
        with np.errstate(all="ignore"):
            middle = np.array([[0.5 * low[0] + 0.5 * high[0] for low, high in row] for row in J])
            return _lower_norm(J, middle) if np.isfinite(middle).all() else -1.0


def _norms(J: Float[np.ndarray, "points rows columns"]) -> Float[np.ndarray, " points"]:
    if 1 in J.shape[1:]:
        return np.asarray(np.sqrt((J**2).sum(axis=(1, 2))))
    return np.asarray(np.linalg.norm(J, ord=2, axis=(1, 2)))


def _lower_norm(J: Sequence[Sequence[intervals.Interval]], middle: np.ndarray) -> float:
    """|J| >= |J'u| / |u| for any u; the best u of the middle is taken."""
    if middle.size == 1:
        return float(intervals.mignitude(J[0][0])[0])
    u = np.linalg.svd(middle)[0][:, 0]
    unit = [(np.array([x]), np.array([x])) for x in u]
    squares = [intervals.power(_dot(unit, column), 2) for column in zip(*J, strict=True)]
    length = [intervals.power(x, 2) for x in unit]
    ratio = intervals.multiply(_total(squares), intervals.inverse(_total(length)))
    return float(intervals.root(ratio)[0][0]) if len(u) > 1 else float(intervals.root(_total(squares))[0][0])


def _dot(u: Sequence[intervals.Interval], x: Sequence[intervals.Interval]) -> intervals.Interval:
    if len(u) == 1:
        return x[0]
    return _total([intervals.multiply(a, b) for a, b in zip(u, x, strict=True)])


def _total(terms: Sequence[intervals.Interval]) -> intervals.Interval:
    total: intervals.Interval = reduce(intervals.add, terms)
    return total


def estimates(program: Program, points: Float[np.ndarray, "variables points"]) -> list[np.ndarray]:
    """Return floating-point values of a program's outputs at points: nothing is proved by them."""
    values: dict[Node, np.ndarray] = {}
    with np.errstate(all="ignore"):
        for node in program.nodes:
            value = _estimate(node, [values[a] for a in node.args], points)
            values[node] = np.broadcast_to(np.asarray(value, dtype=np.float64), points.shape[1:])
    return [values[n] for n in program.outputs]


_FLOATING: Mapping[str, Callable[..., Any]] = {
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan": np.arctan,
    "atan2": np.arctan2,
    "hypot": np.hypot,
    "fmin": np.minimum,
    "fmax": np.maximum,
    "fabs": np.abs,
    "sech2": lambda x: 1 / np.cosh(x) ** 2,
    "direction": lambda x, y: x / np.hypot(x, y),
    "positive": lambda x: x > 0,
    "not": np.logical_not,
    "and": np.logical_and,
    "choose": np.where,
    "decreasing": lambda term, *_: term,
    **{f.__name__: f for f in (np.exp, np.log, np.sin, np.cos, np.tan, np.sinh, np.cosh, np.tanh, np.sqrt)},
}


def _float(value: Fraction) -> float:
    try:
        return float(value)
    except OverflowError:
        return INF if value > 0 else -INF


def _estimate(node: Node, args: list[np.ndarray], points: np.ndarray) -> Any:
    data: Any = node.data
    if node.op in ("variable", "inner_end"):
        return points[data]
    if node.op in ("constant", "truth"):
        return np.full(points.shape[1], _float(Fraction(data)))
    if node.op == "linear":
        return _float(data[0]) + sum(_float(c) * x for c, x in zip(data[1], args, strict=True))
    if node.op == "monomial":
        return np.prod([np.power(x, float(p)) for x, p in zip(args, data, strict=True)], axis=0)
    if node.op == "real_power":
        return np.power(args[0], _float(data))
    return _FLOATING[node.op](*args)
