"""One coordinate chart of the search: the objective and its derivatives over boxes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from lockstep.check.bound import intervals
from lockstep.check.bound.enclosure import Boxes, Program
from lockstep.check.bound.intervals import INF, Interval
from lockstep.check.bound.objective import Objective
from lockstep.check.bound.regularity import Conditions
from lockstep.check.bound.unbounded.tails import Pattern, bounded_on_tails, on_tails
from lockstep.check.expression.derivative import derivative


@dataclass(frozen=True)
class Enclosure:
    """Per box: the ranges of the objective and its derivatives, its value at the middle, if it is defined."""

    value: Interval
    slopes: list[Interval]
    middle: Boxes
    at_middle: Interval
    defined: Annotated[np.ndarray, " boxes"]


class Chart:
    """The objective in the coordinates of one pattern of tails."""

    def __init__(
        self, objective: Objective, conditions: Conditions, searched: list[int], pattern: Pattern
    ) -> None:
        self.pattern, self.searched, self.objective = pattern, searched, objective
        value = on_tails([objective.value], pattern)[0]
        slopes = [derivative([value], k, of_slopes=True)[0] for k in searched]
        self.program = Program(bounded_on_tails([value, *slopes], pattern))
        self.point_program = Program(self.program.outputs[:1])
        self.conditions = conditions.changed(lambda nodes: on_tails(nodes, pattern))

    def enclose(self, lower: Boxes, upper: Boxes) -> Enclosure:
        """Return the enclosure over each box: interval evaluation met with the mean value form."""
        middle = middles(lower, upper)
        found = self.program.on_boxes(lower, upper)
        at_middle = self.point_program.on_boxes(middle, middle)[0]
        defined = np.ones(lower.shape[1], dtype=bool)
        for held in self.conditions.on_boxes(lower, upper):
            defined &= held
        with np.errstate(all="ignore"):
            mean = self._mean_value(lower, upper, middle, at_middle, found[1:])
            value = intervals.meet(found[0], mean)
        return Enclosure(value, found[1:], middle, at_middle, defined)

    def _mean_value(
        self, lower: Boxes, upper: Boxes, middle: Boxes, at_middle: Interval, slopes: list[Interval]
    ) -> Interval:
        """f(x) in f(c) + sum df_k(X) (X_k - c_k)."""
        total = at_middle
        for k, slope in zip(self.searched, slopes, strict=True):
            low = intervals.down(lower[k] - middle[k])
            high = intervals.up(upper[k] - middle[k])
            thin = lower[k] == upper[k]
            offset = np.where(thin, 0.0, low), np.where(thin, 0.0, high)
            total = intervals.add(total, intervals.multiply(slope, offset))
        return total


def middles(lower: Boxes, upper: Boxes) -> Boxes:
    """Return a finite point of each box, its middle where it has one."""
    with np.errstate(all="ignore"):
        middle = lower + 0.5 * (upper - lower)
        # An infinite or overflowing width: 0 if inside, else the end nearer to it.
        nearest = np.clip(0.0, lower, upper)
        return np.asarray(np.clip(np.where(np.isfinite(middle), middle, nearest), lower, upper))


def to_v(point: Annotated[np.ndarray, " variables"], pattern: Pattern) -> Annotated[np.ndarray, " variables"]:
    """Return the point in the original coordinates (rounded: a new point, not an image)."""
    moved = point.copy()
    for k, side in enumerate(pattern):
        if side:
            moved[k] = side / point[k] if point[k] else side * INF
    return moved
