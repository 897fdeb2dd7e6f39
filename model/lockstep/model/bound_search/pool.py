"""Boxes that wait, and how they are cut."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from lockstep.check.bound.program import Boxes
from lockstep.check.bound.rounding import INF
from lockstep.check.bound.tails import Pattern


@dataclass
class Pool:
    """Boxes of one chart that are not done: their sides, upper bound, depth and next split."""

    lower: Boxes
    upper: Boxes
    bound: Float[np.ndarray, " boxes"]
    depth: Float[np.ndarray, " boxes"]
    split: Int[np.ndarray, " boxes"]

    @classmethod
    def empty(cls, variables: int) -> Pool:
        """Return no boxes."""
        return cls(
            np.empty((variables, 0)),
            np.empty((variables, 0)),
            np.empty(0),
            np.empty(0),
            np.empty(0, dtype=int),
        )

    def take(self, chosen: np.ndarray) -> Pool:
        """Return the chosen boxes."""
        return Pool(
            self.lower[:, chosen],
            self.upper[:, chosen],
            self.bound[chosen],
            self.depth[chosen],
            self.split[chosen],
        )

    def join(self, other: Pool) -> Pool:
        """Return these boxes and the others."""
        return Pool(
            np.concatenate([self.lower, other.lower], axis=1),
            np.concatenate([self.upper, other.upper], axis=1),
            np.concatenate([self.bound, other.bound]),
            np.concatenate([self.depth, other.depth]),
            np.concatenate([self.split, other.split]),
        )


@dataclass(frozen=True)
class Cutter:
    """Cuts an infinite range into a middle and tails from `far` on, a finite one at a kink or in half."""

    kinks: list[list[float]]
    far: float

    def split(self, pattern: Pattern, taken: Pool) -> list[tuple[Pattern, Boxes, Boxes, np.ndarray]]:
        """Return (pattern, lower, upper, depth) of the parts of the boxes, each cut in its own direction."""
        parts: dict[Pattern, list[tuple[np.ndarray, np.ndarray, float]]] = {}
        for i in range(taken.bound.size):
            k, lower, upper = int(taken.split[i]), taken.lower[:, i], taken.upper[:, i]
            for side, low, high in self._cut(pattern, k, lower[k], upper[k]):
                new_pattern = pattern if side == 0 else (*pattern[:k], side, *pattern[k + 1 :])
                new_lower, new_upper = lower.copy(), upper.copy()
                new_lower[k], new_upper[k] = low, high
                parts.setdefault(new_pattern, []).append((new_lower, new_upper, taken.depth[i] + 1))
        return [(p, *_stacked(part)) for p, part in parts.items()]

    def _cut(self, pattern: Pattern, k: int, low: float, high: float) -> list[tuple[int, float, float]]:
        """Return the pieces (side, low, high) of one range; side 0 keeps the chart."""
        if math.isinf(low) or math.isinf(high):
            return self._cut_off_tails(low, high)
        kink = self.kink_inside(k, low, high) if pattern[k] == 0 else None
        middle = kink if kink is not None else 0.5 * low + 0.5 * high
        if not low < middle < high:
            middle = math.nextafter(low, high)
        # `splittable` has seen to it that a double lies between them.
        return [(0, low, middle), (0, middle, high)]

    def _cut_off_tails(self, low: float, high: float) -> list[tuple[int, float, float]]:
        below = min(-self.far, 2.0 * high) if math.isinf(low) else low
        above = max(self.far, 2.0 * low) if math.isinf(high) else high
        pieces = [(0, below, above)]
        if math.isinf(low):
            pieces.append((-1, 0.0, math.nextafter(-1.0 / below, INF)))
        if math.isinf(high):
            pieces.append((1, 0.0, math.nextafter(1.0 / above, INF)))
        return pieces

    def kink_inside(self, k: int, low: float, high: float) -> float | None:
        """Return a kink of variable k strictly between the two numbers, if there is one."""
        inside = [x for x in self.kinks[k] if low < x < high]
        return inside[len(inside) // 2] if inside else None

    def holds_kink(self, k: int, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
        """Return which boxes have a kink of variable k inside."""
        inside = np.zeros(lower.shape, dtype=bool)
        for x in self.kinks[k]:
            inside |= (lower < x) & (x < upper)
        return inside


def splittable(lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Return where a double lies strictly between the ends."""
    return np.asarray(np.nextafter(lower, INF) < upper)


def _stacked(part: list[tuple[np.ndarray, np.ndarray, float]]) -> tuple[Boxes, Boxes, np.ndarray]:
    lowers, uppers, depths = zip(*part, strict=True)
    return np.stack(lowers, axis=1), np.stack(uppers, axis=1), np.array(depths)
