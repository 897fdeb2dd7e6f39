"""The floor: no controllers, however clever and however connected, can certify a smaller rho than this.

Give one centralised controller of full order, with no limit on its gains, all relative outputs and all
inputs, and ask the same inequality of it. In orthonormal coordinates the disagreement is N - 1 copies of one
agent, and a multiplier M = V diag(mu_k) V' turns into one number mu per copy, so the floor is that of a
single agent,

    min over mu > 0 of the least rho for x' = A x + B u + G w + xi, y = C x,
    with the weights x'R x and mu (alpha^2 |H x|^2 - |w|^2).

For a fixed mu this is the full-order H-infinity problem, convex once the gains are eliminated (Gahinet and
Apkarian, A linear matrix inequality approach to H-infinity control, Int. J. Robust Nonlinear Control 4,
1994): with N_B, N_C bases of the null spaces of B' and C,

    N_C' (A'X + X A + R + mu alpha^2 H'H) N_C, X G, X bordered by -diag(mu I, rho^2 I)              < 0,
    N_B' (A Y + Y A' + G G'/mu + s I) N_B bordered by Y R^(1/2), alpha Y H' over -diag(I, I/mu)     < 0,
    [X I; I Y] >= 0,  s >= 1 / rho^2,

the last written as a cone, so that one semidefinite program gives the least rho. With different B_i every
agent is given all of them. The figure comes from a solver and is not proved: it says how much there may be
left to gain.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float

from lockstep.lmi.solve import run
from lockstep.model.loop import Plant
from lockstep.model.network import Network

MU_GRID = np.logspace(-3, 4, 9)
"""Where mu is looked for first; golden section between the neighbours of the best one does the rest."""

REFINEMENTS = 10
"""Steps of golden section: the bracket shrinks to 1 % of a decade, rho to about 0.1 %."""


def floor_rho(network: Network, alpha: float, R: Float[np.ndarray, "n n"]) -> float:
    """Return the floor in orthonormal coordinates; infinite where not even that controller is found."""
    plant = network.plant
    if not plant.G.shape[1] or alpha == 0:
        return _least_rho(plant, 0.0, R, 1.0)

    def value(log_mu: float) -> float:
        return _least_rho(plant, alpha, R, float(np.exp(log_mu)))

    grid = np.log(MU_GRID)
    values = [value(point) for point in grid]
    best = int(np.argmin(values))
    if not np.isfinite(values[best]):
        return float("inf")
    return _golden(value, grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)], values[best])


def _least_rho(plant: Plant, alpha: float, R: Float[np.ndarray, "n n"], mu: float) -> float:
    import cvxpy as cp
    from scipy.linalg import null_space, sqrtm

    A, C, G, H = plant.A, plant.C, plant.G, alpha * plant.H
    n, r, v = len(A), G.shape[1], H.shape[0]
    N_B, N_C = null_space(np.hstack(plant.B).T), null_space(C)
    X, Y = cp.Variable((n, n), symmetric=True), cp.Variable((n, n), symmetric=True)
    r2, s = cp.Variable(), cp.Variable()
    root = np.real(sqrtm(R))
    primal = _bordered(
        N_C, A.T @ X + X @ A + R + mu * H.T @ H, [(X @ G, mu * np.eye(r)), (X, r2 * np.eye(n))]
    )
    dual = _bordered(
        N_B,
        A @ Y + Y @ A.T + G @ G.T / mu + s * np.eye(n),
        [(Y @ root, np.eye(n)), (Y @ H.T, np.eye(v) / mu)],
    )
    conditions = [primal << 0, dual << 0, cp.bmat([[X, np.eye(n)], [np.eye(n), Y]]) >> 0, s >= cp.inv_pos(r2)]
    if not run(cp.Problem(cp.Minimize(r2), conditions)) or r2.value is None:
        return float("inf")
    return float(np.sqrt(max(float(r2.value), 0.0)))


def _bordered(basis: Float[np.ndarray, "n k"], head: Any, sides: list[tuple[Any, Any]]) -> Any:
    """Return [basis' head basis, basis' side ...; *, -square ...], symmetrised; empty sides are left out."""
    import cvxpy as cp

    kept = [(basis.T @ side, square) for side, square in sides if side.shape[1]]
    rows = [[basis.T @ head @ basis, *[side for side, _ in kept]]]
    for i, (side, square) in enumerate(kept):
        rows.append(
            [
                side.T,
                *[
                    -square if i == j else np.zeros((square.shape[0], other.shape[0]))
                    for j, (_, other) in enumerate(kept)
                ],
            ]
        )
    whole = cp.bmat(rows)
    return (whole + whole.T) / 2


def _golden(value: Callable[[float], float], low: float, high: float, least: float) -> float:
    """Return the least value met by golden section on [low, high]."""
    ratio = (np.sqrt(5.0) - 1) / 2
    a, b = high - ratio * (high - low), low + ratio * (high - low)
    f_a, f_b = value(a), value(b)
    for _ in range(REFINEMENTS):
        least = min(least, f_a, f_b)
        if f_a < f_b:
            high, b, f_b = b, a, f_a
            a = high - ratio * (high - low)
            f_a = value(a)
        else:
            low, a, f_a = a, b, f_b
            b = low + ratio * (high - low)
            f_b = value(b)
    return float(min(least, f_a, f_b))
