"""Enclosure of expression graphs over boxes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import reduce
from typing import Annotated, Any

import numpy as np

from lockstep.check.bound import functions, intervals
from lockstep.check.bound.intervals import Interval
from lockstep.check.expression.node import Node
from lockstep.check.expression.traversal import order

Boxes = Annotated[np.ndarray, "variables boxes"]


class Program:
    """Expressions in evaluation order; `on_boxes` encloses them."""

    def __init__(self, outputs: Sequence[Node]) -> None:
        self.outputs = tuple(outputs)
        self.nodes = order(self.outputs)

    def on_boxes(self, lower: Boxes, upper: Boxes) -> list[Interval]:
        """Return an enclosure of each output over each box."""
        with np.errstate(all="ignore"):
            values = self.trace(lower, upper)
        return [values[n] for n in self.outputs]

    def trace(self, lower: Boxes, upper: Boxes) -> dict[Node, Interval]:
        """Return the enclosure of every node over each box."""
        values: dict[Node, Interval] = {}
        shape = np.empty(lower.shape[1])
        for node in self.nodes:
            if node.op == "variable":
                index: Any = node.data
                values[node] = lower[index], upper[index]
            elif node.op == "inner_end":
                index = node.data
                values[node] = upper[index], upper[index]
            else:
                values[node] = _enclosure(node, [values[a] for a in node.args], shape)
        return values


def _enclosure(node: Node, args: list[Interval], like: np.ndarray) -> Interval:
    if node.op == "constant":
        return _number(node.data, like)
    if node.op == "truth":
        return np.full_like(like, bool(node.data)), np.full_like(like, bool(node.data))
    if node.op in _OF_ARGUMENTS:
        return _OF_ARGUMENTS[node.op](*args)
    of_node = _OF_NODE.get(node.op)
    return of_node(node, args) if of_node else functions.increasing(node.op, args[0])


def _number(value: Fraction, like: np.ndarray) -> Interval:
    low, high = functions.number_around(value)
    return np.full(like.shape, low), np.full(like.shape, high)


def _linear(node: Node, args: list[Interval]) -> Interval:
    (offset, coefficients), like = node.data, args[0][0]
    terms = [intervals.multiply(_number(c, like), x) for c, x in zip(coefficients, args, strict=True)]
    return reduce(intervals.add, [*terms, _number(offset, like)])


def _monomial(node: Node, args: list[Interval]) -> Interval:
    powers = (intervals.power(x, exponent) for x, exponent in zip(args, node.data, strict=True))
    return reduce(intervals.multiply, powers)


def _decreasing(term: Interval, slope: Interval, end: Interval) -> Interval:
    """A positive term, the sign of its derivative in the tail variable, and the term at the tail's inner end.

    On the tail s in (0, e] a term that grows with s is at most its value at e.
    """
    bounded = slope[0] >= 0
    return np.where(bounded, np.maximum(term[0], 0.0), term[0]), np.where(
        bounded, np.minimum(term[1], end[1]), term[1]
    )


def _truth(true: Any, false: Any) -> Interval:
    return np.where(true, 1.0, 0.0), np.where(false, 0.0, 1.0)


def _positive(node: Node, args: list[Interval]) -> Interval:
    low, high = args[0]
    if not node.data:
        return _truth(low > 0, high <= 0)
    pinned = (low == 0) & (high == 0)
    return _truth((low >= 0) & ~pinned, (high <= 0) & ~pinned)


def _choose(node: Node, args: list[Interval]) -> Interval:
    (true, possible), a, b = args
    open_hull = intervals.everything(a[0]) if node.data else intervals.hull(a, b)
    cases = [true == 1, possible == 0]
    return np.select(cases, [a[0], b[0]], open_hull[0]), np.select(cases, [a[1], b[1]], open_hull[1])


_OF_ARGUMENTS: dict[str, Callable[..., Interval]] = {
    "sin": functions.sin,
    "cos": functions.cos,
    "tan": functions.tan,
    "acos": functions.acos,
    "cosh": functions.cosh,
    "sech2": functions.sech2,
    "sqrt": intervals.root,
    "fabs": intervals.absolute,
    "hypot": functions.hypot,
    "direction": functions.direction,
    "atan2": functions.atan2,
    "fmin": lambda x, y: (np.minimum(x[0], y[0]), np.minimum(x[1], y[1])),
    "fmax": lambda x, y: (np.maximum(x[0], y[0]), np.maximum(x[1], y[1])),
    "and": lambda x, y: (np.minimum(x[0], y[0]), np.minimum(x[1], y[1])),
    "not": lambda x: (1 - x[1], 1 - x[0]),
    "decreasing": _decreasing,
}
_OF_NODE: dict[str, Callable[[Node, list[Interval]], Interval]] = {
    "linear": _linear,
    "monomial": _monomial,
    "real_power": lambda node, args: functions.real_power(args[0], node.data),
    "positive": _positive,
    "choose": _choose,
}
