"""Positive definite matrices by their triangular factors, as equations of a nonlinear program.

A lower triangle is a vector, column by column, as CasADi stores it.
"""

import casadi as ca
import numpy as np
from jaxtyping import Float


def triangle(n: int) -> int:
    """Return the number of entries on and below the diagonal."""
    return n * (n + 1) // 2


def sparse(matrix: Float[np.ndarray, "a b"]) -> ca.DM:
    """Return a matrix of which only what is not zero is stored."""
    return ca.sparsify(ca.DM(matrix))


def symmetric(lower: ca.SX, n: int) -> ca.SX:
    """Return the symmetric matrix of a lower triangle."""
    return ca.tril2symm(ca.SX(ca.Sparsity.lower(n), lower))


def symmetric_value(lower: Float[np.ndarray, " l"], n: int) -> Float[np.ndarray, "n n"]:
    """Return the same in numbers."""
    return np.array(ca.tril2symm(ca.DM(ca.Sparsity.lower(n), lower)))


def lower_triangle(matrix: Float[np.ndarray, "n n"]) -> Float[np.ndarray, " l"]:
    """Return the lower triangle column by column, as CasADi stores it."""
    return np.concatenate([matrix[j:, j] for j in range(len(matrix))])


def factor_residual(factor: ca.SX, matrix: ca.SX) -> ca.SX:
    """Return the lower triangle of L L' - matrix, column by column."""
    below = ca.Sparsity.lower(matrix.shape[0])
    L = ca.SX(below, factor)
    residual: ca.SX = ca.project(ca.densify(ca.mtimes(L, L.T) - matrix), below).nz[:]
    return residual


def nearest_factor(matrix: Float[np.ndarray, "n n"]) -> Float[np.ndarray, " l"]:
    """Return the Cholesky factor of the nearest matrix with eigenvalues from 1e-3 up, column by column."""
    values, vectors = np.linalg.eigh((matrix + matrix.T) / 2)
    return lower_triangle(np.linalg.cholesky((vectors * np.maximum(values, 1e-3)) @ vectors.T))
