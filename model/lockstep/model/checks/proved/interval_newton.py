"""All zeros of a system e(z) = 0 on a box: interval Newton's method in Krawczyk's form with branch and bound.

For a box Y with middle m and C near the inverse of the Jacobian at m,
K = m - C e(m) + (I - C J(Y)) (Y - m). Every zero in Y lies in K; if K lies inside Y there is exactly one zero of e in Y
(Krawczyk 1969; Neumaier, Interval Methods for Systems of Equations, 1990, theorems 5.1.7 and 5.1.8). J(Y) encloses
Clarke's generalised Jacobian, so kinks are allowed. Y is a box a little larger than the one that is looked at, so that a
zero on a face is not missed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from lockstep.check.bound import intervals
from lockstep.check.bound.enclosure import Boxes, Program
from lockstep.check.bound.intervals import Interval
from lockstep.check.expression.node import Node, variable
from lockstep.check.expression.traversal import substitute
from lockstep.model.checks.proved.interval_algebra.matrices import middle, product, stacked, thin
from lockstep.model.checks.proved.vector_field import jacobian

BATCH = 256
LARGER = 0.1
"""How much larger than the box the box of the test is, as a part of its width."""

SMALLEST = 1e-9
"""Part of the width of the domain below which a box is not cut any more."""

ROUNDING = 1e-12
"""The same, as a part of the size of the numbers."""

End = Annotated[np.ndarray, " unknowns"]


@dataclass
class EnclosedZeros:
    """What is known of the zeros: (lower, upper) of a box with exactly one zero each, boxes left open, boxes looked at."""

    found: list[tuple[End, End]] = field(default_factory=list)
    open: list[tuple[End, End]] = field(default_factory=list)
    boxes: int = 0


class System:
    """e(z) = 0 with at least as many equations as unknowns; z_k is variable `unknowns[k]` of the nodes.

    Newton's method takes the first equations, as many as there are unknowns: what it finds may fail the others.
    """

    def __init__(
        self,
        equations: Sequence[Node],
        unknowns: Sequence[int],
        extra: Callable[[Boxes, Boxes], np.ndarray],
        defined: Callable[[Boxes, Boxes], np.ndarray],
    ) -> None:
        """Take the equations; `extra` tells which boxes hold no point that counts, `defined` on which e has a value."""
        names = {variable(j): variable(k) for k, j in enumerate(unknowns)}
        self.size = len(unknowns)
        nodes = substitute(equations, names)
        slopes = [x for row in jacobian(nodes, self.size) for x in row]
        self.count, self.extra, self.defined = len(nodes), extra, defined
        self.values, self.slopes = Program(nodes), Program([*slopes])

    def zeros(self, lower: End, upper: End, boxes: int) -> EnclosedZeros:
        """Return the zeros on a finite box, within a budget of boxes."""
        result = EnclosedZeros()
        known: list[tuple[End, End]] = []
        low, high = lower[:, None].copy(), upper[:, None].copy()
        width = upper - lower
        least = np.maximum(SMALLEST * width, ROUNDING * np.maximum(1.0, np.abs(lower + upper)))
        while low.shape[1] and result.boxes < boxes:
            taken = slice(max(0, low.shape[1] - BATCH), None)
            part, low, high = (low[:, taken], high[:, taken]), low[:, : taken.start], high[:, : taken.start]
            result.boxes += part[0].shape[1]
            more = self._step(part, width, least, result, known)
            low, high = np.hstack([low, more[0]]), np.hstack([high, more[1]])
        result.open += list(zip(low.T, high.T, strict=True))
        return result

    def _step(
        self, part: Interval, width: End, least: End, result: EnclosedZeros, known: list[tuple[End, End]]
    ) -> Interval:
        """Look at boxes: drop those without a zero, record zeros, return the halves of the others."""
        part = _chosen(part, ~self._without_zero(part) & ~self.extra(*part))
        part = _chosen(part, ~_covered(part, known))
        if not part[0].shape[1]:
            return part
        reach = np.maximum(LARGER * (part[1] - part[0]), least[:, None])
        around = part[0] - reach, part[1] + reach
        image, regular = self._krawczyk(around)
        defined = np.asarray(self.defined(*around) & regular)
        apart = defined & ((image[0] > part[1]) | (image[1] < part[0])).any(axis=0)
        inside = defined & ((image[0] > around[0]) & (image[1] < around[1])).all(axis=0)
        for i in np.flatnonzero(inside & ~apart):
            self._record((image[0][:, i], image[1][:, i]), (around[0][:, i], around[1][:, i]), result, known)
        still = ~apart & ~inside
        left, shrunk, usable = _chosen(part, still), _chosen(image, still), defined[still]
        met = np.maximum(left[0], shrunk[0]), np.minimum(left[1], shrunk[1])
        left = np.where(usable, met[0], left[0]), np.where(usable, met[1], left[1])
        small = np.asarray((part[1] - part[0] <= least[:, None]).all(axis=0))[still]
        result.open += [(left[0][:, i], left[1][:, i]) for i in np.flatnonzero(small)]
        return self._halves(_chosen(left, ~small), width)

    def _without_zero(self, part: Interval) -> np.ndarray:
        """Return which boxes an equation has no zero on: by its range, or by its range as a mean value form."""
        values = self.values.on_boxes(*part)
        centre = _middles(part)
        at = self.values.on_boxes(centre, centre)
        slopes = stacked(self.slopes.on_boxes(*part), self.count)
        offset = intervals.down(part[0] - centre), intervals.up(part[1] - centre)
        with np.errstate(all="ignore"):
            mean = product(slopes, (offset[0][:, None], offset[1][:, None]))
            free = np.zeros(part[0].shape[1], dtype=bool)
            usable = self.defined(*part)
            for k, value in enumerate(values):
                form = intervals.add(at[k], (mean[0][k, 0], mean[1][k, 0]))
                free |= (value[0] > 0) | (value[1] < 0) | (usable & ((form[0] > 0) | (form[1] < 0)))
        return free

    def _krawczyk(self, around: Interval) -> tuple[Interval, np.ndarray]:
        """Return K, and where it is one: C has to be invertible, which K inside Y implies."""
        size, rows = self.size, slice(0, self.size)
        slopes = stacked(self.slopes.on_boxes(*around), self.count)
        slopes = slopes[0][rows], slopes[1][rows]
        centre = _middles(around)
        at = self.values.on_boxes(centre, centre)[:size]
        value = np.array([v[0] for v in at])[:, None], np.array([v[1] for v in at])[:, None]
        inverse = np.linalg.pinv(middle(slopes))
        C = thin(inverse)
        eye = np.broadcast_to(np.eye(size)[:, :, None], slopes[0].shape)
        with np.errstate(all="ignore"):
            rest = intervals.subtract((eye, eye), product(C, slopes))
            offset = intervals.down(around[0] - centre)[:, None], intervals.up(around[1] - centre)[:, None]
            step = intervals.subtract(product(rest, offset), product(C, value))
            image = intervals.add((centre, centre), (step[0][:, 0], step[1][:, 0]))
        finite = np.isfinite(image[0]).all(axis=0) & np.isfinite(image[1]).all(axis=0)
        return image, np.asarray(finite)

    def _record(
        self,
        image: tuple[End, End],
        around: tuple[End, End],
        result: EnclosedZeros,
        known: list[tuple[End, End]],
    ) -> None:
        """Record a zero unless it is one that is known: its box is shrunk until it lies in or apart from theirs."""
        low, high = image
        for _ in range(20):
            better, _ = self._krawczyk((low[:, None], high[:, None]))
            closer = np.maximum(low, better[0][:, 0]), np.minimum(high, better[1][:, 0])
            if not (closer[1] - closer[0]).sum() < 0.9 * (high - low).sum():
                break
            low, high = closer
        for other_low, other_high in known:
            if ((other_low <= low) & (high <= other_high)).all():
                return
        for one_low, one_high in result.found:
            if ((around[0] <= one_low) & (one_high <= around[1])).all():
                known.append(around)
                return
        if any(((low <= one[1]) & (one[0] <= high)).all() for one in result.found):
            result.open.append((low, high))  # one zero or two: their boxes touch
            return
        known.append(around)
        result.found.append((low, high))

    def _halves(self, part: Interval, width: End) -> Interval:
        """Cut each box where the equations vary most along it."""
        low, high = part
        if not low.shape[1]:
            return part
        slopes = stacked(self.slopes.on_boxes(low, high), self.count)
        with np.errstate(all="ignore"):
            vary = intervals.magnitude(slopes) * (high - low)[None]
            vary = np.where(np.isfinite(vary), vary, 1e200)
            score = (vary / (vary.max(axis=1, keepdims=True) + 1e-300)).max(axis=0)
            part_of = (high - low) / np.where(width > 0, width, 1.0)[:, None]
        score = np.where(part_of >= part_of.max(axis=0) / 16, score + 1e-3 * part_of, -1.0)
        chosen, boxes = score.argmax(axis=0), np.arange(low.shape[1])
        cut = 0.5 * low[chosen, boxes] + 0.5 * high[chosen, boxes]
        first, second = high.copy(), low.copy()
        first[chosen, boxes], second[chosen, boxes] = cut, cut
        return np.hstack([low, second]), np.hstack([first, high])


def _chosen(part: Interval, mask: np.ndarray) -> Interval:
    return part[0][:, mask], part[1][:, mask]


def _middles(part: Interval) -> np.ndarray:
    return np.asarray(np.clip(0.5 * part[0] + 0.5 * part[1], part[0], part[1]))


def _covered(part: Interval, known: Sequence[tuple[End, End]]) -> np.ndarray:
    """Return which boxes lie where the only zero is known already."""
    inside = np.zeros(part[0].shape[1], dtype=bool)
    for low, high in known:
        inside |= ((low[:, None] <= part[0]) & (part[1] <= high[:, None])).all(axis=0)
    return inside
