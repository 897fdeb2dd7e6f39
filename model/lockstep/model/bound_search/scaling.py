"""Diagonal scalings of a vector nonlinearity that make its bound tight.

|D_w^-1 J D_v| <= alpha says more the larger det(D_v)/det(D_w) is at the same alpha, so the scaling minimises
alpha * gm(D_w) / gm(D_v) over sampled slopes (gm: geometric mean). It is a choice, not a claim: the bound is
proved afterwards for the scaling chosen.
"""

import numpy as np
from jaxtyping import Float

from lockstep.check.bound.objective import Objective
from lockstep.model.bound_search.point_slopes import PointSlopes
from lockstep.model.bound_search.sampling import Points

LARGEST_RATIO = 16.0
SAMPLES = 400


def choose_scaling(objective: Objective, points: Points) -> tuple[list[float], list[float]]:
    """Return (D_w, D_v) of one block; ones for a single row, whose bound is the norm of a gradient."""
    rows, columns = len(objective.slopes), len(objective.slopes[0])
    ones = [1.0] * rows, [1.0] * columns
    if rows == 1:
        return ones
    J = PointSlopes(objective).jacobians(points[:, :: max(1, points.shape[1] // SAMPLES)])
    J = J if objective.narrow is objective.slopes else J.transpose(0, 2, 1)
    J = J[np.isfinite(J).all(axis=(1, 2)) & (np.abs(J) < 1e100).all(axis=(1, 2))]
    if not len(J):
        return ones
    # an import of a tenth of a second, needed by vector nonlinearities only
    from scipy.optimize import minimize

    limit = np.log(LARGEST_RATIO)
    start = np.concatenate([_levels(np.sqrt((J**2).sum(axis=2)).max(axis=0)), np.zeros(columns)])
    start = np.clip(start, -limit, limit)
    found = minimize(
        _measure,
        start,
        args=(J,),
        method="Nelder-Mead",
        bounds=[(-limit, limit)] * (rows + columns),
        options={"maxiter": 400, "fatol": 1e-4, "xatol": 1e-3},
    )
    if not _measure(found.x, J) < _measure(np.zeros(rows + columns), J) - 1e-2:
        return ones
    return _short(np.exp(found.x[:rows])), _short(np.exp(found.x[rows:]))


def _levels(sizes: Float[np.ndarray, " rows"]) -> Float[np.ndarray, " rows"]:
    logs = np.log(np.maximum(sizes, 1e-300))
    return np.asarray(logs - logs.max())


def _measure(logs: Float[np.ndarray, " scales"], J: Float[np.ndarray, "points rows columns"]) -> float:
    """log(alpha gm(D_w)/gm(D_v)), with a slight pull to ones where the slopes do not decide."""
    rows = J.shape[1]
    w, v = logs[:rows], logs[rows:]
    scaled = J * np.exp(v[None, None, :] - w[None, :, None])
    alpha = float(np.linalg.norm(scaled, ord=2, axis=(1, 2)).max())
    return float(np.log(max(alpha, 1e-300)) + w.mean() - v.mean() + 1e-3 * (logs**2).sum())


def _short(values: Float[np.ndarray, " scales"]) -> list[float]:
    """Three significant digits are as good, and readable."""
    return [float(f"{x:.3g}") for x in values]
