"""Units in which the numbers of a plant are near one: of time, states, inputs, outputs and the nonlinearity.

They bring the entries of A, B, C, G, H and R nearest to one, by least squares on their logarithms (Curtis and Reid, On the
automatic scaling of matrices for Gaussian elimination, 1972).
"""

import numpy as np
from jaxtyping import Float

from lockstep.check.system.loop import Plant

WEAK = 1e-2
"""The weight of "R is near one" in the least squares: it decides what the entries leave open."""


def natural_units(
    plant: Plant, alpha: float, R: Float[np.ndarray, "n n"], *, rounded: bool = True, tau: float | None = None
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " m"], Float[np.ndarray, " q"], float, float]:
    """Return X, S_u, S_y, tau and g: rounded to powers of two, or as the least squares have them.

    Args:
        plant: in doubles.
        alpha: of its nonlinearity.
        R: (n, n) weight of the disagreement.
        rounded: whether they are rounded to powers of two.
        tau: the unit of time, where it is known: S_u is then that which moves some state by one in it, whatever lags behind
            u on the way, which near-one numbers of B would let shrink with the lag.
    """
    n, m, q, r, _ = plant.sizes
    state, inputs, outputs = range(n), range(n, n + m), range(n + m, n + m + q)
    time, g = n + m + q, n + m + q + 1
    rows: list[Float[np.ndarray, " unknowns"]] = []
    wanted: list[float] = []

    def near_one(size: float, *signs: tuple[int, int], weight: float = 1.0) -> None:
        """Ask for |size| 2^(sum of sign times exponent) near one."""
        if size:
            rows.append(np.zeros(g + 1))
            wanted.append(-weight * float(np.log2(abs(size))))
            for place, sign in signs:
                rows[-1][place] += weight * sign

    for i in range(n):
        for j in range(n):
            near_one(float(plant.A[i, j]), (time, 1), (state[i], 1), (state[j], -1))
        for B in plant.B:
            for k in range(m):
                near_one(float(B[i, k]), (time, 1), (state[i], 1), (inputs[k], 1))
        for k in range(q):
            near_one(float(plant.C[k, i]), (outputs[k], 1), (state[i], -1))
        for k in range(r):
            near_one(float(alpha * plant.G[i, k]), (time, 1), (state[i], 1), (g, -1))
        for k in range(len(plant.H)):
            near_one(float(plant.H[k, i]), (g, 1), (state[i], -1))
        near_one(float(np.sqrt(R[i, i])), (state[i], -1), weight=WEAK)
    # Weighed so that the others do not move it: what is left is a ten-thousandth of their logarithms.
    near_one(0.0 if tau is None else 1 / tau, (time, 1), weight=1 / WEAK**2)
    exponents = np.asarray(np.linalg.lstsq(np.array(rows), np.array(wanted), rcond=None)[0])
    found = 2.0 ** (np.round(exponents) if rounded else exponents)
    ends = found[: n + m + q]
    X, S_u, S_y = ends[:n], ends[n : n + m], ends[n + m :]
    return X, S_u if tau is None else _moving(plant, X, tau, S_u), S_y, float(found[time]), float(found[g])


def _moving(
    plant: Plant, X: Float[np.ndarray, " n"], tau: float, usual: Float[np.ndarray, " m"]
) -> Float[np.ndarray, " m"]:
    """Return the inputs that held for tau, from rest, move some state by one in units of X: the mean over agents they move.

    The `usual` one of an input that moves none.
    """
    with np.errstate(all="ignore"):
        found = np.array([(X[:, None] * np.abs(step_response(tau, plant.A, B))).max(axis=0) for B in plant.B])
    sized = (found > 0) & np.isfinite(found)
    count = np.maximum(sized.sum(axis=0), 1)
    mean = np.exp(-np.log(np.where(sized, found, 1.0)).sum(axis=0) / count)
    return np.where(sized.any(axis=0), mean, usual)


def step_response(
    t: float, A: Float[np.ndarray, "n n"], B: Float[np.ndarray, "n m"]
) -> Float[np.ndarray, "n m"]:
    """Return where inputs of one that are held for t seconds bring x' = A x + B u from rest: the integral of e^(A s) ds B."""
    from scipy.linalg import expm

    n, m = B.shape
    return np.asarray(expm(t * np.vstack([np.hstack([A, B]), np.zeros((m, n + m))]))[:n, n:])
