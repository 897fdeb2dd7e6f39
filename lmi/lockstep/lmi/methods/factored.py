"""Semidefinite conditions of a nonlinear program: each matrix is L L', L a lower triangle kept as a vector by columns.

M > 0 becomes smooth by a factor of its own, D M D = L L' with D a fixed scaling and the diagonal of L bounded away from 0.
"""

from typing import Any

import casadi as ca
import numpy as np
from jaxtyping import Float

FACTOR_FLOOR = 3e-3
"""Least diagonal of L_F, with D F_r D near a unit diagonal: keeps the factor's equations regular at the
optimum, where F_r is singular. The certificate afterwards recovers the few tenths of a per cent this
costs."""

BARRIER_START = 1e-2
"""IPOPT's first barrier weight. Measured on five starts of the arms, 400 iterations each: 0.1 certified one
of them, 1e-2 four (rho 3.34 to 3.79), 1e-4 three, the adaptive strategy two."""


LEAST_SECONDS = 0.1
"""The shortest time IPOPT is given: it refuses to be given none."""


def ipopt(name: str, program: dict[str, Any], iterations: int, seconds: float | None = None) -> Any:
    """Return IPOPT for a program in CasADi's terms, silent; a limit that is a count gives one answer for one input.

    With `seconds`, a limit of wall-clock time as well: then the answer depends on the machine.
    """
    options: Any = {
        "ipopt.max_iter": iterations,
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "print_time": False,
        "show_eval_warnings": False,
        "ipopt.mu_strategy": "monotone",
        "ipopt.mu_init": BARRIER_START,
        "ipopt.tol": 1e-5,
        "ipopt.acceptable_tol": 1e-4,
    }
    if seconds is not None:
        options["ipopt.max_wall_time"] = max(seconds, LEAST_SECONDS)
    return ca.nlpsol(name, "ipopt", program, options)


def sparse(matrix: Float[np.ndarray, "a b"]) -> ca.DM:
    """Return a matrix of which only what is not zero is stored."""
    return ca.sparsify(ca.DM(matrix))


def triangle(n: int) -> int:
    """Return the number of entries on and below the diagonal.

    >>> triangle(3)
    6
    """
    return n * (n + 1) // 2


def diagonal(n: int) -> list[int]:
    """Return where the diagonal of a lower triangle stored column by column is."""
    return [j * n - j * (j - 1) // 2 for j in range(n)]


def symmetric(upper: ca.SX, n: int) -> ca.SX:
    """Return the symmetric matrix of an upper triangle, row by row."""
    matrix = ca.SX(n, n)
    for k, (i, j) in enumerate(zip(*np.triu_indices(n), strict=True)):
        matrix[int(i), int(j)] = matrix[int(j), int(i)] = upper[k]
    return matrix


def factor_residual(factor: ca.SX, matrix: ca.SX) -> ca.SX:
    """Return the lower triangle of L L' - matrix, column by column."""
    n = matrix.shape[0]
    L = ca.SX(n, n)
    places = [(i, j) for j in range(n) for i in range(j, n)]
    for k, (i, j) in enumerate(places):
        L[i, j] = factor[k]
    residual = L @ L.T - matrix
    return ca.vertcat(*[residual[i, j] for i, j in places])


def factor(matrix: Float[np.ndarray, "n n"]) -> Float[np.ndarray, " l"]:
    """Return the Cholesky factor of the nearest matrix with eigenvalues from 1e-3 up, column by column."""
    values, vectors = np.linalg.eigh((matrix + matrix.T) / 2)
    L = np.linalg.cholesky((vectors * np.maximum(values, 1e-3)) @ vectors.T)
    return np.concatenate([L[j:, j] for j in range(len(L))]) if len(L) else np.zeros(0)


def unit_diagonal(matrix: Float[np.ndarray, "n n"]) -> Float[np.ndarray, " n"]:
    """Return d with diag(d) M diag(d) of unit diagonal, for a diagonal that is not too small."""
    return np.asarray(1.0 / np.sqrt(np.maximum(np.abs(np.diag(matrix)), 1e-8)))
