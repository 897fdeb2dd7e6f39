"""What every certificate must satisfy once the gains are eliminated: two projected inequalities of one agent.

Whatever the controllers are, F < 0 (see `inequality`) with P > 0 and multiplier M leaves, for X the block of P on x_d
and Y that of P^-1, with N_C, N_B bases of ker C and ker [B_1 ... B_N]',

    (I (x) N_C)' (He(X (I (x) A)) + I (x) R + M (x) alpha^2 H'H) (I (x) N_C),  bordered by X over -rho^2 I, by
                                                                               X (I (x) G) over -M (x) I        < 0,
    (I (x) N_B)' (He((I (x) A) Y) + rho^-2 I + M^-1 (x) G G') (I (x) N_B),     bordered by Y (I (x) R) over -I (x) R,
                                                                               by Y (I (x) alpha H') over -M^-1 (x) I < 0,
    [X I; I Y] >= 0

(Gahinet and Apkarian, Int. J. Robust Nonlinear Control 4, 1994). Q, delta, the order and any limit on the gains only add
to F, and controllers that share all relative outputs and all inputs are allowed, so nothing is lost by leaving these out.

M is symmetric and positive definite whatever the pair weights m_ij >= 0 are. Let M v = mu v, |v| = 1: restricted to
v (x) R^n, all three keep their form with X = (v' (x) I) X (v (x) I), likewise Y, and the scalars mu and 1/mu for M and M^-1.
So any certificate, with any pair weights, on any graph, gives one for a single agent, with a number mu > 0. Divided by rho
(X / rho, mu / rho, Y rho for X, mu, Y), these are two `Side`s,

    He(e Psi S) + constant + mu slope < 0,     He(e Phi S_*) + constant_* + slope_* / mu < 0,     Psi = N_C'X, Phi = N_B'Y.

This holds in any coordinates T whose metric S is (T T')^-1 or I, and for the modes of `modes`. It does not hold for
multipliers of another kind than M, but for `Claim.alpha_of_floor`: with new ones, these sides are to be stated anew.
"""

from typing import Annotated, NamedTuple

import numpy as np
from flint import fmpq, fmpq_mat

from lockstep.check.numbers import Matrix, eye, inverse, zeros
from lockstep.check.system.loop import Plant


class Side(NamedTuple):
    """He(e Psi S) + constant + mu slope < 0 with Psi = N'X, X symmetric, e = [I; 0], in rationals.

    rows: (c, n), independent, with kernel N;  N: (n, k);  S: (n, size);  constant, slope: (size, size).
    """

    rows: Matrix
    N: Matrix
    S: Matrix
    constant: Matrix
    slope: Matrix

    @property
    def k(self) -> int:
        """Columns of N."""
        return int(self.N.shape[1])

    @property
    def size(self) -> int:
        """Rows of the inequality; 0 where N has no columns, so that it says nothing."""
        return int(self.S.shape[1]) if self.k else 0


class Projected(NamedTuple):
    """Both sides, and the off-diagonal block N_C'N_B of what couples them."""

    primal: Side
    dual: Side

    @property
    def coupling(self) -> Matrix:
        """N_C'N_B, of [N_C'X N_C, N_C'N_B; *, N_B'Y N_B] >= 0."""
        product: Matrix = self.primal.N.T @ self.dual.N
        return product


def with_rho(
    plant: Plant, alpha: fmpq, R: Matrix, rho: fmpq, *, phi_in_primal: bool = True, phi_in_dual: bool = True
) -> Projected:
    """Return the two sides at a given rho > 0, from the rationals of a plant.

    phi_in_primal, phi_in_dual: whether the border of phi is kept; without it the condition is weaker.
    """
    B, H, I = np.hstack(plant.B), alpha * plant.H, eye(len(plant.A), plant.A)
    G, H_out = _kept(plant.G, phi_in_primal), _kept(H.T, phi_in_dual)
    primal = side(plant.A, plant.C, R / rho, H.T @ H, (I, rho * I), G)
    dual = side(plant.A.T, B.T, I / rho, plant.G @ plant.G.T, (R / rho, R / rho), H_out)
    return Projected(primal, dual)


def _kept(columns: Matrix, kept: bool) -> Matrix:
    return columns if kept else columns[:, :0]


def side(A: Matrix, C: Matrix, head: Matrix, slope: Matrix, border: tuple[Matrix, Matrix], G: Matrix) -> Side:
    """Assemble [N'(He(X A) + head + mu slope)N, N'X E, N'X G; *, -corner, 0; *, 0, -mu I]."""
    rows, N = row_space_and_kernel(C)
    E, corner = border
    k, p, r = N.shape[1], E.shape[1], G.shape[1]
    constant, by_mu = zeros(k + p + r, k + p + r, A), zeros(k + p + r, k + p + r, A)
    constant[:k, :k], constant[k : k + p, k : k + p] = N.T @ head @ N, -corner
    by_mu[:k, :k], by_mu[k + p :, k + p :] = N.T @ slope @ N, -eye(r, A)
    return Side(rows, N, np.hstack([A @ N, E, G]), constant, by_mu)


def row_space_and_kernel(C: Annotated[np.ndarray, "q n"]) -> tuple[Matrix, Matrix]:
    """Return a basis of the rows of C and one of its kernel, as columns.

    >>> from lockstep.check.numbers import exactly
    >>> rows, kernel = row_space_and_kernel(exactly(np.array([[1.0, 2.0], [2.0, 4.0]])))
    >>> rows.tolist(), kernel.tolist()
    ([[1, 2]], [[-2], [1]])
    """
    n = C.shape[1]
    if not len(C):
        return C, eye(n, C)
    reduced, rank = fmpq_mat(C.tolist()).rref()
    rows = np.array(reduced.tolist(), dtype=object).reshape(len(C), n)[:rank]
    pivots = [next(j for j in range(n) if row[j] != 0) for row in rows]
    free = [j for j in range(n) if j not in pivots]
    kernel = zeros(n, len(free), C)
    for column, j in enumerate(free):
        kernel[j, column] = fmpq(1)
        for row, pivot in zip(rows, pivots, strict=True):
            kernel[pivot, column] = -row[j]
    return rows, kernel


def left_inverse(N: Matrix) -> Matrix:
    """Return (N'N)^-1 N'; exact for rationals."""
    return inverse(N.T @ N) @ N.T if N.shape[1] else N.T
