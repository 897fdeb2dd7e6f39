"""A point inside the certificate inequality, from multipliers alone: what a solver takes its units from.

For given gains, multipliers w and rho, F < 0 of `inequality` is a Riccati inequality in P. With Z = [A_cl, B] and the rest
of F in blocks [Q_w, S; S', -D], the solution of

    A_cl' P + P A_cl + Q_w + (P B + S) D^-1 (P B + S)' = 0

for weights that are larger by a part of them puts P inside by as much (Lancaster and Rodman, Algebraic Riccati Equations,
1995, ch. 9). In the units of such a point, where P = I and the diagonal of F is -1, the semidefinite programs have numbers
near one however far apart the poles of the loop are. In those of a Lyapunov equation the solver made no progress where the
fast ones are 10^5 times the slow ones, and rho is that of the slow ones whatever the gains.
"""

from itertools import product

import numpy as np
from jaxtyping import Float

from lockstep.lmi.shapes import Multipliers

ROOMS = (0.1, 1.0)
"""By how much the multipliers are raised; the weights R and Q by a little less, so that F is homogeneous in them."""

SHARE = 0.8
"""The part of that by which R and Q are raised."""

OVER = (1.5, 4.0)
"""By how much rho is raised."""

LEAST = 1e-6
"""Multipliers are at least this part of the largest one: at zero there is nothing to take a unit from."""


def strictly_feasible_point(
    Z: Float[np.ndarray, "n_x n_F"],
    constant: Float[np.ndarray, "n_F n_F"],
    slopes: Float[np.ndarray, "w n_F n_F"],
    w: Multipliers,
    *,
    rooms: tuple[float, ...] = ROOMS,
    over: tuple[float, ...] = OVER,
) -> tuple[Float[np.ndarray, "n_x n_x"], Multipliers, Float[np.ndarray, "n_F n_F"]] | None:
    """Return P > 0 and multipliers with F < 0, and F, near multipliers that a loop has a rho with; None if none is found.

    Args:
        Z, constant, slopes: F = J P Z + (J P Z)' + constant + sum_k w_k slopes_k, J = [I; 0].
        w: the multipliers, rho^2 the last.
        rooms, over: by how much the multipliers and rho are raised, tried in this order.
    """
    first = np.maximum(w, LEAST * w[:-1].max(initial=0.0))
    for room, factor in product(rooms, over):
        raised = np.append((1 + room) * first[:-1], factor**2 * first[-1])
        rest = np.tensordot(raised, slopes, 1)
        P = _storage(Z, (1 + SHARE * room) * constant + rest)
        if P is None:
            continue
        F = constant + rest
        F[: len(P)] += P @ Z
        F[:, : len(P)] += (P @ Z).T
        if np.linalg.eigvalsh(P)[0] > 0 > np.linalg.eigvalsh(F)[-1]:
            return P, raised, F
    return None


def _storage(
    Z: Float[np.ndarray, "n_x n_F"], rest: Float[np.ndarray, "n_F n_F"]
) -> Float[np.ndarray, "n_x n_x"] | None:
    """Return the smallest P of the Riccati equation, or None where it has none."""
    from scipy.linalg import solve_continuous_are

    n = len(Z)
    try:
        P = solve_continuous_are(Z[:, :n], Z[:, n:], rest[:n, :n], rest[n:, n:], s=rest[:n, n:])
    except (np.linalg.LinAlgError, ValueError):
        return None
    return np.asarray((P + P.T) / 2)
