"""Points at which slopes are looked for, in floating point; what is found is proved afterwards."""

import math

import numpy as np
from jaxtyping import Float

from lockstep.model.bound_search.point_slopes import PointSlopes

COUNT = 2000
SEED = 20  # any: the points are the same in every run
Points = Float[np.ndarray, "variables points"]


def sample_points(
    slopes: PointSlopes,
    lower: Float[np.ndarray, " variables"],
    upper: Float[np.ndarray, " variables"],
    kinks: list[list[float]],
    *,
    polish: bool,
) -> Points:
    """Return points of the domain, the best refined if `polish`; variables without a part in it stay at 0."""
    generator = np.random.default_rng(SEED)
    size = slopes.variables
    lower, upper = lower[:size], upper[:size]
    points = np.zeros((size, COUNT))
    for k in sorted(slopes.used):
        points[k] = _along(generator, lower[k], upper[k], kinks[k] if k < len(kinks) else [])
    points = np.clip(points, lower[:, None], upper[:, None])
    return _polished(generator, slopes, points, lower, upper) if polish else points


def _along(generator: np.random.Generator, low: float, high: float, kinks: list[float]) -> np.ndarray:
    special = [x for x in (0.0, low, high) if math.isfinite(x)]
    special += [y for x in kinks for y in (math.nextafter(x, -math.inf), math.nextafter(x, math.inf))]
    special += [x + d for x in kinks for d in (-1e-3, 1e-3)]
    if math.isfinite(low) and math.isfinite(high):
        spread = low + (high - low) * generator.random(COUNT)
    else:
        far = 10.0 ** generator.uniform(-3, 8, COUNT) * generator.choice([-1.0, 1.0], COUNT)
        near = generator.uniform(-8, 8, COUNT)
        spread = np.where(generator.random(COUNT) < 0.3, far, near)
        if math.isfinite(low):
            spread = low + np.abs(spread)
        elif math.isfinite(high):
            spread = high - np.abs(spread)
    chosen = generator.random(COUNT) < min(0.3, 0.02 * len(special))
    picked = generator.choice(np.array(special or [0.0]), COUNT)
    values = np.where(chosen, picked, spread)
    values[: len(special)] = special[:COUNT]
    return values


def _polished(
    generator: np.random.Generator, slopes: PointSlopes, points: Points, lower: np.ndarray, upper: np.ndarray
) -> Float[np.ndarray, "variables best"]:
    """Search around the best points with shrinking steps."""
    width = np.where(np.isfinite(upper - lower), upper - lower, 2.0)[:, None]
    found = slopes.estimate(points)
    best = points[:, np.argsort(-found, kind="stable")[:8]]
    reach = 0.2
    while reach > 1e-9:
        local = width + np.where(np.isfinite(upper - lower)[:, None], 0.0, np.abs(best))
        moved = [best + reach * local * generator.standard_normal(best.shape) for _ in range(16)]
        # Half of the moves change one variable only.
        mask = [generator.random(best.shape) < 0.5 for _ in moved]
        some = (np.where(m, x, best) for m, x in zip(mask, moved, strict=True))
        tried = np.clip(np.concatenate([best, *some], axis=1), lower[:, None], upper[:, None])
        best = tried[:, np.argsort(-slopes.estimate(tried), kind="stable")[:8]]
        reach *= 0.6
    return best
