"""Minimising what is smooth but for kinks: a quasi-Newton method with a line search.

It asks for the weak Wolfe conditions, which hold on one side of a kink (Lewis and Overton, Nonsmooth optimization via
quasi-Newton methods, Math. Program. 141, 2013).
"""

from collections.abc import Callable

import numpy as np

from lockstep.lmi.shapes import Vector

Objective = Callable[[Vector], tuple[float, Vector]]


def descend(objective: Objective, x: Vector, iterations: int, settled: float = 0.0) -> Vector:
    """Minimise by BFGS with a weak Wolfe line search; stop where no step of it improves.

    Args:
        objective: its value and slope, infinite outside of its domain.
        x: where to start.
        iterations: at most so many.
        settled: stop where the slope along the next step is no more than this.
    """
    value, slope = objective(x)
    inverse_hessian = np.eye(len(x)) * 0.1 / max(float(np.linalg.norm(slope)), 1e-12)
    for _ in range(iterations):
        direction = -inverse_hessian @ slope
        if slope @ direction >= -settled:
            return x
        step = _weak_wolfe(objective, x, value, slope, direction)
        if step is None:
            return x
        x_new, value, new_slope = step
        s, y = x_new - x, new_slope - slope
        x, slope = x_new, new_slope
        if s @ y > 1e-14:
            turn = np.eye(len(x)) - np.outer(s, y) / (s @ y)
            inverse_hessian = turn @ inverse_hessian @ turn.T + np.outer(s, s) / (s @ y)
    return x


def _weak_wolfe(
    objective: Objective, x: Vector, value: float, slope: Vector, direction: Vector
) -> tuple[Vector, float, Vector] | None:
    """Bracket a step with enough decrease (1e-4) and enough rise of the slope (0.9); None if 30 trials find
    no decrease."""
    low, high, t, slant = 0.0, np.inf, 1.0, float(slope @ direction)
    best = None
    for _ in range(30):
        trial = x + t * direction
        new_value, new_slope = objective(trial)
        if not np.isfinite(new_value) or new_value > value + 1e-4 * t * slant:
            high = t
        else:
            best = (trial, new_value, new_slope)
            if new_slope @ direction >= 0.9 * slant:
                return best
            low = t
        t = (low + high) / 2 if np.isfinite(high) else 2 * t
    return best
