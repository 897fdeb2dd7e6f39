"""Small semidefinite programs with many solves: min c'x subject to M_0 + sum_k x_k M_k >= 0 for some blocks.

Clarabel is called directly: stating such a program in cvxpy takes ten times as long as solving it. Nothing is believed.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

Block = tuple[Float[np.ndarray, "n n"], Float[np.ndarray, "k n n"]]
"""M_0 and the M_k, symmetric."""


@dataclass(frozen=True)
class SdpSolution:
    """x, its value c'x, and the multiplier Z_b >= 0 of each block: dvalue = -sum_b <Z_b, dM_b> for a change dM_b."""

    x: Float[np.ndarray, " k"]
    value: float
    duals: tuple[Float[np.ndarray, "n n"], ...]


def minimise(
    cost: Float[np.ndarray, " k"], blocks: Sequence[Block], accuracy: float = 1e-8
) -> SdpSolution | None:
    """Solve the program; None where the solver finds no solution.

    >>> one, zero = np.ones((1, 1)), np.zeros((1, 1))
    >>> found = minimise(np.ones(1), [(-2 * one, one[None])])
    >>> round(found.value, 5), round(float(found.duals[0][0, 0]), 5)
    (2.0, 1.0)
    """
    import clarabel
    from scipy.sparse import csc_matrix

    rows, sides, units = [], [], []
    for constant, slopes in blocks:
        i, j = _triangle(len(constant))
        # By congruence, so that the largest entry of a row is about 1: without it the solver fails at its first step.
        d = np.maximum(
            np.abs(slopes).max(axis=(0, 2), initial=0.0), np.abs(constant).max(axis=1, initial=0.0)
        )
        d = 1 / np.sqrt(np.where(d > 0, d, 1.0))
        constant, slopes = constant * np.outer(d, d), slopes * np.outer(d, d)
        units.append(np.outer(d, d))
        scale = np.where(i == j, 1.0, np.sqrt(2.0))
        rows.append(-(slopes[:, i, j] * scale).T)
        sides.append(constant[i, j] * scale)
    cones = [clarabel.PSDTriangleConeT(len(constant)) for constant, _ in blocks]
    settings = clarabel.DefaultSettings()
    settings.verbose, settings.max_threads = False, 1
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = accuracy
    A, b, k = np.vstack(rows), np.concatenate(sides), len(cost)
    if not (np.isfinite(A).all() and np.isfinite(b).all()):
        return None
    solved = clarabel.DefaultSolver(csc_matrix((k, k)), cost, csc_matrix(A), b, cones, settings).solve()
    if str(solved.status) not in ("Solved", "AlmostSolved"):
        return None
    duals, at = [], 0
    for (constant, _), unit in zip(blocks, units, strict=True):
        i, j = _triangle(len(constant))
        Z = np.zeros(constant.shape)
        Z[i, j] = np.array(solved.z[at : at + len(i)]) / np.where(i == j, 1.0, np.sqrt(2.0))
        duals.append((Z + Z.T - np.diag(np.diag(Z))) * unit)
        at += len(i)
    x = np.array(solved.x)
    return SdpSolution(x, float(cost @ x), tuple(duals))


def symmetric_basis(n: int) -> Float[np.ndarray, "k n n"]:
    """Return E_ij + E_ji (E_ii on the diagonal) for the upper triangle, by columns: P = sum_k x_k E_k."""
    i, j = _triangle(n)
    basis = np.zeros((len(i), n, n))
    basis[np.arange(len(i)), i, j] = basis[np.arange(len(i)), j, i] = 1.0
    return basis


def _triangle(n: int) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Return the indices (i, j), i <= j, of the upper triangle, column by column."""
    j, i = np.tril_indices(n)
    return i, j


def square_root_factor(square: Float[np.ndarray, "n n"], nothing: float = 1e-13) -> Float[np.ndarray, "n k"]:
    """Return F of full column rank with F F' = the square, but for eigenvalues of at most so small a part of the largest."""
    values, vectors = np.linalg.eigh(square)
    kept = values > nothing * max(float(values.max(initial=0.0)), 1e-300)
    return np.asarray(vectors[:, kept] * np.sqrt(values[kept]))
