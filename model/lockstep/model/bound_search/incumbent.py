"""The largest slope reached so far: a point (v, t) and what is proved there."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lockstep.model.bound_search.point_slopes import PointSlopes
from lockstep.model.bound_search.sampling import sample_points


@dataclass
class Incumbent:
    """Points are tried in the domain [lower, upper] of v and t; `slope` is -1 until one is proved."""

    at: PointSlopes
    lower: Float[np.ndarray, " variables"]
    upper: Float[np.ndarray, " variables"]
    slope: float = -1.0
    point: Float[np.ndarray, " variables"] | None = None

    def sample(self, kinks: list[list[float]], *, polish: bool) -> None:
        """Look for a large slope over the whole domain."""
        points = sample_points(self.at, self.lower, self.upper, kinks, polish=polish)
        slopes = self.at.estimate(points)
        best = np.flatnonzero((slopes >= 0) & (slopes >= slopes.max() * (1.0 - 1e-12)))
        if not best.size:
            return
        # Several, because at a kink nothing is proved.
        for i in {int(best[0]), int(best[best.size // 2]), int(best[-1]), int(np.argmax(slopes))}:
            self.try_point(points[:, i])

    def try_point(self, point: Float[np.ndarray, " variables"]) -> None:
        """Prove the slope at a point (v, t, ...) of the domain, and keep it if it is the largest."""
        point = point[: self.at.variables]
        lower, upper = self.lower, self.upper
        if not (np.isfinite(point) & (point >= lower) & (point <= upper)).all():
            return
        slope = self.at.reached(point)
        if slope > self.slope:
            self.slope, self.point = slope, point
        elif not self.slope > 0:
            self._try_beside(point)

    def _try_beside(self, point: Float[np.ndarray, " variables"]) -> None:
        """At a kink no slope is proved; beside it one is."""
        lower, upper = self.lower, self.upper
        generator = np.random.default_rng(0)
        used = np.array([k in self.at.used for k in range(point.size)])
        for _ in range(4):
            offset = used * 1e-10 * np.maximum(1.0, np.abs(point)) * generator.standard_normal(point.shape)
            # A step that would leave the domain goes the other way.
            other = np.where(
                (point + offset < lower) | (point + offset > upper), point - offset, point + offset
            )
            other = np.clip(other, lower, upper)
            slope = self.at.reached(other)
            if slope > self.slope:
                self.slope, self.point = slope, other
