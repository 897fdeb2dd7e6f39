"""Whether a symmetric matrix S(x, t) of exact expressions is positive definite at every point of a box, by branch and bound.

A box is done where the enclosure of S on it (interval evaluation met with the mean value form) is positive definite
(`matrices.positive_definite`). At the middle of a box a direction q with q' S q < 0 in interval arithmetic refutes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lockstep.check.bound import intervals
from lockstep.check.bound.enclosure import Boxes, Program
from lockstep.check.bound.intervals import Interval
from lockstep.check.bound.regularity import Conditions
from lockstep.check.bound.unbounded.periodicity import reduce_to_period
from lockstep.check.expression.node import Node
from lockstep.check.verdict import Verdict
from lockstep.model.checks.proved.interval_algebra.matrices import (
    middle,
    positive_definite,
    product,
    stacked,
    thin,
)
from lockstep.model.checks.proved.vector_field import Ends, Matrix, at_points, jacobian

BOXES = 20_000
BATCH = 128
SHORT = 30
"""Operations of expressions whose boxes count as one."""
FAR = 2.0**20
"""Ranges without an end are cut up to here; beyond, a box is left as it is."""


class Question:
    """S > 0 on a box?"""

    def __init__(
        self,
        S: Sequence[Sequence[Node]],
        conditions: Conditions,
        lower: Ends,
        upper: Ends,
        tighter: Callable[[Interval, list[Interval]], list[Interval]] | None = None,
    ) -> None:
        """Take the matrix, what has to hold for it to have a value (part of the question) and the box.

        `tighter` may turn enclosures of the entries over boxes into better ones.
        """
        self.size, self.tighter = len(S), tighter
        self.nodes = [node for row in S for node in row]
        self.conditions = conditions.open_on(lower[:, None], upper[:, None])
        outputs = [*self.nodes, *self.conditions.nodes]
        self.lower, self.upper = reduce_to_period(outputs, lower, upper)
        self.searched = sorted(frozenset[int]().union(*(node.variables for node in outputs)))
        other = [k for k in range(len(self.lower)) if k not in self.searched]
        self.lower[other] = self.upper[other] = np.clip(0.0, self.lower[other], self.upper[other])
        self.width = np.where(np.isfinite(self.upper - self.lower), self.upper - self.lower, FAR)
        self.domain = lower, upper
        self.values = Program(self.nodes)

    @cached_property
    def slopes(self) -> Program:
        """The derivatives of the entries; a kink of an entry has none."""
        count = len(self.lower)
        rows = jacobian(self.nodes, count, of_slopes=True)
        return Program([row[k] for k in self.searched for row in rows])

    @cached_property
    def weight(self) -> float:
        """How many boxes one counts as: the longer the expressions, the more."""
        return max(1.0, (len(self.values.nodes) + len(self.slopes.nodes)) / SHORT + (self.size / 4) ** 3)

    def decide(self, boxes: int = BOXES) -> Verdict:
        """Return "proved", "refuted" with a `point` of (x, t), a `direction` and the `value` q' S q, or "undecided"."""
        low, high = self.lower[:, None], self.upper[:, None]
        used = 0.0
        while low.shape[1]:
            if used + min(low.shape[1], BATCH) * self.weight > boxes:
                return Verdict("undecided", f"{boxes} boxes do not suffice", {"boxes": used})
            taken = max(0, low.shape[1] - BATCH)
            part, low, high = (low[:, taken:], high[:, taken:]), low[:, :taken], high[:, :taken]
            used += part[0].shape[1] * self.weight
            held, slopes = self._held(part)
            part = part[0][:, ~held], part[1][:, ~held]
            if not part[0].shape[1]:
                continue
            witness = self._witness(part)
            if witness is not None:
                return Verdict("refuted", "a point and a direction", {**witness, "boxes": used})
            halves = self._halves(part, slopes[:, ~held])
            if halves is None:
                return Verdict("undecided", "a box is too small to be cut", {"boxes": used})
            low, high = np.hstack([low, halves[0]]), np.hstack([high, halves[1]])
        return Verdict("proved", "positive definite on every box", {"boxes": used})

    def _held(self, part: Interval) -> tuple[np.ndarray, np.ndarray]:
        """Return on which boxes it is shown, and how much S varies along each variable."""
        values = self.values.on_boxes(*part)
        defined = np.ones(part[0].shape[1], dtype=bool)
        for one in self.conditions.on_boxes(*part):
            defined &= one
        vary = np.zeros((len(self.searched), part[0].shape[1]))
        with np.errstate(all="ignore"):
            centre = _middles(part)
            form = self.values.on_boxes(centre, centre)
            slopes = self.slopes.on_boxes(*part)
            for i, k in enumerate(self.searched):
                thin_side = part[0][k] == part[1][k]
                offset = (
                    np.where(thin_side, 0.0, intervals.down(part[0][k] - centre[k])),
                    np.where(thin_side, 0.0, intervals.up(part[1][k] - centre[k])),
                )
                own = slopes[i * len(values) : (i + 1) * len(values)]
                form = [
                    intervals.add(f, intervals.multiply(s, offset)) for f, s in zip(form, own, strict=True)
                ]
                for s in own:
                    size = intervals.magnitude(s) * (part[1][k] - part[0][k])
                    vary[i] += np.where(np.isfinite(size), size, 1e200)
            met = [intervals.meet(v, f) for v, f in zip(values, form, strict=True)]
            matrix = stacked(met if self.tighter is None else self.tighter(part, met), self.size)
            if self.size == 1:  # only its lower end counts
                matrix = matrix[0], matrix[0]
            finite = np.isfinite(matrix[0]).all(axis=(0, 1)) & np.isfinite(matrix[1]).all(axis=(0, 1))
            held = defined & finite
            if held.any():
                held[held] = positive_definite((matrix[0][..., held], matrix[1][..., held]))
        return held, vary

    def _witness(self, part: Interval) -> dict[str, object] | None:
        """Return the point among the middles where S has the most negative direction, if that is certain."""
        centre = _middles(part)
        centre = np.clip(centre, self.domain[0][:, None], self.domain[1][:, None])
        good = np.ones(centre.shape[1], dtype=bool)
        for one in self.conditions.on_boxes(centre, centre):
            good &= one
        matrix = stacked(self.values.on_boxes(centre, centre), self.size)
        at = middle(matrix)
        values, vectors = np.linalg.eigh(0.5 * (at + at.swapaxes(1, 2)))
        q = thin(vectors[:, :, :1])
        turned = (q[0].swapaxes(0, 1),) * 2
        with np.errstate(all="ignore"):
            form = product(product(turned, matrix), q)[1][0, 0]
        best = int(np.argmin(np.where(good, values[:, 0], np.inf)))
        if not good[best] or not form[best] < 0:
            return None
        point, direction = centre[:, best].tolist(), vectors[best, :, 0].tolist()
        return {"point": point[:-1], "t": point[-1], "direction": direction, "value": float(form[best])}

    def _halves(self, part: Interval, vary: np.ndarray) -> Interval | None:
        """Cut each box along the variable along which S varies most; None where one cannot be cut."""
        low, high = part
        score = np.full(low.shape, -1.0)
        for i, k in enumerate(self.searched):
            cuttable = np.nextafter(low[k], np.inf) < high[k]
            share = np.where(
                np.isfinite(high[k] - low[k]), (high[k] - low[k]) / max(self.width[k], 1e-300), 4.0
            )
            cuttable &= (share > 1e-9) & ~((low[k] >= FAR) | (high[k] <= -FAR))
            score[k] = np.where(cuttable, vary[i] + 1e-9 * share, -1.0)
        if (score.max(axis=0) < 0).any():
            return None
        chosen, boxes = score.argmax(axis=0), np.arange(low.shape[1])
        cut = _cut(low[chosen, boxes], high[chosen, boxes])
        first, second = high.copy(), low.copy()
        first[chosen, boxes], second[chosen, boxes] = cut, cut
        return np.hstack([low, second]), np.hstack([first, high])


def _cut(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return a point between the ends: the middle, or twice as far out where an end is infinite."""
    with np.errstate(all="ignore"):
        middle = 0.5 * low + 0.5 * high
        out = np.where(
            np.isinf(low) & np.isinf(high), 0.0, np.where(np.isinf(high), 2 * low + 1, 2 * high - 1)
        )
        out = np.where(np.isinf(high) & (low < 0), np.maximum(out, 0.0), out)
        out = np.where(np.isinf(low) & (high > 0), np.minimum(out, 0.0), out)
    return np.where(np.isfinite(middle), middle, out)


def _middles(part: tuple[Boxes, Boxes]) -> Ends:
    """Return a finite point of each box."""
    with np.errstate(all="ignore"):
        centre = 0.5 * part[0] + 0.5 * part[1]
    return np.asarray(np.where(np.isfinite(centre), centre, np.clip(0.0, part[0], part[1])))


TOLERANCES = (1e-3, 1e-2, 0.1, 0.5)
"""Of a level that is to be proved: how far above what is reached, relative to the size of the values."""


@dataclass(frozen=True)
class Supremum:
    """The least upper bound of a quantity over a box: `reached` at `point` of (x, t), and `proved`, None if none was."""

    reached: float
    point: list[float]
    proved: float | None


def least_level(
    ask: Callable[[float], Question],
    reached: float,
    point: Sequence[float],
    size: float,
    boxes: int = BOXES,
    tolerances: Sequence[float] = TOLERANCES,
) -> Supremum:
    """Return the least level for which the question is proved, searched from what is reached upwards.

    Args:
        ask: the question whether the quantity is below a level everywhere.
        reached, point: the largest value seen, and where.
        size: of the quantity, what tolerances are relative to.
        boxes: for all questions together.
        tolerances: in the order in which they are tried.
    """
    at, left = list(point), boxes
    for k, tolerance in enumerate(tolerances):
        for _ in range(3):
            level = float(f"{reached + tolerance * max(size, abs(reached)):.8g}")
            verdict = ask(level).decide(left // (len(tolerances) - k))
            left -= int(verdict.figures["boxes"])
            if verdict.proved:
                return Supremum(reached, at, level)
            if verdict.status == "undecided":
                break
            reached = level - float(verdict.figures["value"])
            at = [*verdict.figures["point"], verdict.figures["t"]]
    return Supremum(reached, at, None)


def largest_eigenvalue(rows: Matrix, points: Boxes) -> tuple[float, list[float], float]:
    """Return the largest eigenvalue of a symmetric matrix among points and near the best, where, and the largest norm."""
    lower, upper = points.min(axis=1, keepdims=True), points.max(axis=1, keepdims=True)
    random = np.random.default_rng(1)
    best, where, size, radius = -np.inf, points[:, 0], 0.0, upper - lower
    for _ in range(12):
        values = at_points(rows, points)
        values = values[good := np.isfinite(values).all(axis=(1, 2))]
        if len(values):
            eigen = np.linalg.eigvalsh(0.5 * (values + values.swapaxes(1, 2)))
            size = max(size, float(np.abs(eigen).max()))
            top = int(eigen[:, -1].argmax())
            if eigen[top, -1] > best:
                best, where = float(eigen[top, -1]), points[:, good][:, top]
        radius = radius / 3
        near = where[:, None] + radius * random.uniform(-1, 1, size=(len(where), 100))
        points = np.clip(near, lower, upper)
    return best, where.tolist(), size
