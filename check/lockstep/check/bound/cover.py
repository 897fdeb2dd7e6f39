"""Boxes that cover a domain: how they are enclosed, shrunk to a face and cut, for the search and the decision alike.

A box is enclosed by interval evaluation met with the mean value form; where a derivative has one sign the box shrinks
to a face (monotonicity). What is cut depends on nothing but the box (Hansen & Walster 2004, chapters 11 and 12).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from lockstep.check.bound import intervals
from lockstep.check.bound.enclosure import Boxes
from lockstep.check.bound.intervals import INF
from lockstep.check.bound.objective import Objective
from lockstep.check.bound.unbounded.charts import Chart, Enclosure, to_v
from lockstep.check.bound.unbounded.tails import Pattern
from lockstep.check.expression.node import Node, linear_terms
from lockstep.check.expression.traversal import order

HALVINGS = 40  # a box 2^-40 of its domain in every direction without an enclosure has none to be found
LARGEST_KINK = 1e100
PerBox = Annotated[np.ndarray, " boxes"]
Part = tuple[Pattern, Boxes, Boxes, PerBox]
"""Boxes of one chart: its pattern, their lower and upper ends, and how often each was cut."""


@dataclass
class Pool:
    """Boxes of one chart that are not done: their sides, upper bound, depth and the variable to cut (-1: none)."""

    lower: Boxes
    upper: Boxes
    bound: PerBox
    depth: PerBox
    split: PerBox

    def take(self, chosen: np.ndarray) -> Pool:
        """Return the chosen boxes."""
        return Pool(*(x[..., chosen] for x in vars(self).values()))

    def join(self, other: Pool) -> Pool:
        """Return these boxes and the others."""
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return Pool(*(np.concatenate(pair, axis=-1) for pair in pairs))


@dataclass(frozen=True)
class Examined:
    """What one look at boxes has given.

    pool: the boxes, shrunk, with their bounds;  left_out: what shrinking has left out is no larger than this;
    enclosures: those of the boxes, and of the shrunk ones among them.
    """

    pool: Pool
    left_out: float
    enclosures: list[Enclosure]


class Cover:
    """The domain of v, t and angles of one objective, its charts, and what can be done with boxes of it."""

    def __init__(
        self,
        objective: Objective,
        lower: Annotated[np.ndarray, " variables"],
        upper: Annotated[np.ndarray, " variables"],
    ) -> None:
        self.objective = objective
        lower = np.concatenate([lower, [a for a, _ in objective.angles]])
        upper = np.concatenate([upper, [b for _, b in objective.angles]])
        self.count = len(lower)
        self.conditions = objective.conditions.open_on(lower[:, None], upper[:, None])
        needed = objective.value.variables.union(*(n.variables for n in self.conditions.nodes))
        self.searched = sorted(needed)
        fixed = [k for k in range(self.count) if k not in needed]
        lower[fixed] = upper[fixed] = np.clip(0.0, lower, upper)[fixed]
        self.lower, self.upper = lower, upper
        self.cutter = Cutter.of(objective.value, self.count)
        self._charts: dict[Pattern, Chart] = {}

    @property
    def root(self) -> Part:
        """The whole domain as one box."""
        return (0,) * self.count, self.lower[:, None], self.upper[:, None], np.zeros(1)

    def chart(self, pattern: Pattern) -> Chart:
        """Return the objective in the coordinates of a pattern of tails."""
        if pattern not in self._charts:
            self._charts[pattern] = Chart(self.objective, self.conditions, self.searched, pattern)
        return self._charts[pattern]

    def examine(self, part: Part, level: float) -> Examined:
        """Enclose boxes and shrink them for the question whether the slope is above `level` there."""
        pattern, lower, upper, depth = part
        chart = self.chart(pattern)
        lower, upper = lower.copy(), upper.copy()
        found = chart.enclose(lower, upper)
        shrunk, left_out = self._shrink(pattern, lower, upper, found, level)
        bound, enclosures = self._bound(found), [found]
        if shrunk.any():
            again = chart.enclose(lower[:, shrunk], upper[:, shrunk])
            bound[shrunk] = np.minimum(bound[shrunk], self._bound(again))
            enclosures.append(again)
        split = self._directions(pattern, lower, upper, found)
        return Examined(Pool(lower, upper, bound, depth, split), left_out, enclosures)

    def stuck(self, pool: Pool) -> np.ndarray:
        """Return which boxes cannot be cut, or are as small as boxes get and still have no finite enclosure."""
        small = pool.depth >= HALVINGS * max(1, len(self.searched))
        return np.asarray((pool.split < 0) | (np.isinf(pool.bound) & small))

    def slope_at(self, point: Annotated[np.ndarray, " variables"]) -> float:
        """Return a slope provably reached at a point of (v, t, angles): a lower bound of |J| there, -1 if none is."""
        here = point[:, None]
        if not all(held.all() for held in self.objective.conditions.on_boxes(here, here)):
            return -1.0
        low, high = self.chart((0,) * self.count).point_program.on_boxes(here, here)[0]
        if not self.objective.squared:
            return float(intervals.mignitude((low, high))[0])
        return float(intervals.root((np.maximum(low, 0.0), np.maximum(high, 0.0)))[0][0])

    def middle_above(
        self, pattern: Pattern, found: Enclosure, level: float
    ) -> Annotated[np.ndarray, " variables"] | None:
        """Return the middle with the largest slope, in the coordinates of v, if that may be above the level."""
        lowest = intervals.mignitude(found.at_middle)
        best = int(np.argmax(lowest))
        if lowest[best] <= (level * level if self.objective.squared else level):
            return None
        point = to_v(found.middle[:, best], pattern)
        return point if np.isfinite(point).all() else None

    def _bound(self, found: Enclosure) -> PerBox:
        with np.errstate(all="ignore"):
            top = intervals.magnitude(found.value)
            if self.objective.squared:
                top = intervals.root((np.zeros_like(top), np.maximum(found.value[1], 0.0)))[1]
        return np.where(found.defined, top, INF)

    def _shrink(
        self, pattern: Pattern, lower: Boxes, upper: Boxes, found: Enclosure, level: float
    ) -> tuple[np.ndarray, float]:
        """Move to the face where |f| is largest, in every variable in which f is monotone."""
        low, high = found.value
        usable = found.defined & np.isfinite(low) & np.isfinite(high)
        if self.objective.squared:  # never below 0, whatever the enclosure says
            upward, downward, left_out = usable & (high > level * level), np.zeros_like(usable), 0.0
        else:
            upward = usable & (-low <= level) & (high > level)
            downward = usable & (high <= level) & (-low > level)
            sides = np.where(upward, -low, np.where(downward, high, 0.0))
            left_out = float(sides.max(initial=0.0))  # no larger than the level
        shrunk = np.zeros_like(usable)
        for k, slope in zip(self.searched, found.slopes, strict=True):
            rising, falling = slope[0] >= 0, slope[1] <= 0
            flat = rising & falling & usable & (lower[k] < upper[k])
            lower[k], upper[k] = (np.where(flat, found.middle[k], end[k]) for end in (lower, upper))
            to_top = (upward & rising) | (downward & falling)
            to_bottom = (upward & falling) | (downward & rising)
            wide = lower[k] < upper[k]
            to_top &= wide & np.isfinite(upper[k])
            # s = 0 stands for infinity, which is a limit and not a point.
            to_bottom &= wide & np.isfinite(lower[k]) & ~to_top & ((lower[k] > 0) | (pattern[k] == 0))
            lower[k] = np.where(to_top, upper[k], lower[k])
            upper[k] = np.where(to_bottom, lower[k], upper[k])
            shrunk |= to_top | to_bottom | flat
        return shrunk, left_out

    def _directions(self, pattern: Pattern, lower: Boxes, upper: Boxes, found: Enclosure) -> np.ndarray:
        """Return the variable to cut: the one whose slope times width is largest."""
        scores = np.full((self.count, lower.shape[1]), -1.0)
        root = self._root_width(pattern)
        with np.errstate(all="ignore"):
            for k, slope in zip(self.searched, found.slopes, strict=True):
                width = upper[k] - lower[k]
                relative = np.where(np.isinf(width), 4.0, width / root[k] if root[k] > 0 else 0.0)
                score = intervals.magnitude(slope) * width
                blind = ~np.isfinite(score) | ~found.defined
                kinked = self.cutter.holds_kink(k, lower[k], upper[k]) & (pattern[k] == 0)
                score = np.where(blind, 1e300 * (relative + 8.0 * kinked), score + 1e-12 * relative)
                splittable = np.nextafter(lower[k], INF) < upper[k]
                scores[k] = np.where(splittable, score, -1.0)
        return np.where(scores.max(axis=0) < 0, -1, np.argmax(scores, axis=0))

    def _root_width(self, pattern: Pattern) -> np.ndarray:
        width = self.upper - self.lower
        finite = np.where(np.isfinite(width), width, 2.0 * self.cutter.far)
        return np.where(np.array(pattern) != 0, 1.0 / self.cutter.far, finite)


@dataclass(frozen=True)
class Cutter:
    """Cuts an infinite range into a middle and tails from `far` on, a finite one at a kink or in half."""

    kinks: list[list[float]]
    far: float

    @classmethod
    def of(cls, value: Node, count: int) -> Cutter:
        """Cut at the values where a condition on one of `count` variables changes; tails are beyond all of them."""
        kinks = breakpoints(value, count)
        mantissa, exponent = math.frexp(max(1.0, *(2.0 * abs(x) for xs in kinks for x in xs), 0.0))
        return cls(kinks, math.ldexp(1.0, exponent - (mantissa == 0.5)))

    def split(self, pattern: Pattern, taken: Pool) -> list[Part]:
        """Return the parts of the boxes, each cut in its own direction."""
        parts: dict[Pattern, list[tuple[np.ndarray, np.ndarray, float]]] = {}
        for i in range(taken.bound.size):
            k, lower, upper = int(taken.split[i]), taken.lower[:, i], taken.upper[:, i]
            for side, low, high in self._cut(pattern, k, lower[k], upper[k]):
                new_pattern = pattern if side == 0 else (*pattern[:k], side, *pattern[k + 1 :])
                new_lower, new_upper = lower.copy(), upper.copy()
                new_lower[k], new_upper[k] = low, high
                parts.setdefault(new_pattern, []).append((new_lower, new_upper, taken.depth[i] + 1))
        return [
            (p, *(np.stack(x, axis=-1) for x in zip(*part, strict=True)))  # type: ignore[misc]
            for p, part in parts.items()
        ]

    def _cut(self, pattern: Pattern, k: int, low: float, high: float) -> list[tuple[int, float, float]]:
        """Return the pieces (side, low, high) of one range; side 0 keeps the chart."""
        if math.isinf(low) or math.isinf(high):
            return self._cut_off_tails(low, high)
        inside = [] if pattern[k] else [x for x in self.kinks[k] if low < x < high]
        middle = inside[len(inside) // 2] if inside else 0.5 * low + 0.5 * high
        if not low < middle < high:
            middle = math.nextafter(low, high)
        # `_directions` has seen to it that a double lies between them.
        return [(0, low, middle), (0, middle, high)]

    def _cut_off_tails(self, low: float, high: float) -> list[tuple[int, float, float]]:
        below = min(-self.far, 2.0 * high) if math.isinf(low) else low
        above = max(self.far, 2.0 * low) if math.isinf(high) else high
        left = [(-1, 0.0, math.nextafter(-1.0 / below, INF))] if math.isinf(low) else []
        right = [(1, 0.0, math.nextafter(1.0 / above, INF))] if math.isinf(high) else []
        return [(0, below, above), *left, *right]

    def holds_kink(self, k: int, lower: PerBox, upper: PerBox) -> np.ndarray:
        """Return which boxes have a kink of variable k inside."""
        kinks = np.array(self.kinks[k])[:, None]
        return np.asarray(((lower < kinks) & (kinks < upper)).any(axis=0))


def breakpoints(value: Node, count: int) -> list[list[float]]:
    """Return, per variable, the values at which a condition that is linear in it alone changes."""
    found: list[set[float]] = [set() for _ in range(count)]
    for node in order([value]):
        if node.op == "positive":
            offset, terms = linear_terms(node.args[0])
            if len(terms) == 1 and terms[0][1].op == "variable":
                index: Any = terms[0][1].data
                if abs(offset / terms[0][0]) < LARGEST_KINK:
                    found[index].add(float(-offset / terms[0][0]))
    return [sorted(x) for x in found]
