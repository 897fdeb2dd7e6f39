"""What every certificate must satisfy once the gains are eliminated: two projected inequalities of one agent.

Whatever the controllers are, F < 0 (see `inequality`) with P > 0 and multiplier M leaves, for P_d the block of P on x_d
and P_* that of P^-1, with C_perp, B_perp bases of subspaces of ker C_0 and ker [B_1 ... B_N]_0',

    (I (x) C_perp)' (He(P_d (I (x) A)) + I (x) (R - rho^2 C_s' D_nu^-2 C_s) + M (x) alpha^2 H'H) (I (x) C_perp),  bordered by
                                                          P_d (I (x) D_xi) over -rho^2 I, by P_d (I (x) G) over -M (x) I  < 0,
    (I (x) B_perp)' (He((I (x) A) P_*) + I (x) (rho^-2 D_xi D_xi' - B_u W^-1 B_u') + M^-1 (x) G G') (I (x) B_perp),  bordered
                                    by P_* (I (x) R) over -I (x) R, by P_* (I (x) alpha H') over -M^-1 (x) I              < 0,
    [P_d I; I P_*] >= 0

(Gahinet and Apkarian, Int. J. Robust Nonlinear Control 4, 1994). D_xi scales the disturbance of each state, D_nu the noise
of the outputs C_s, and C_0 are the outputs without noise: on nu = -D_nu^-1 C_s x the controllers see nothing. Of ker C_0 that
subspace is taken on which what is known in the end is 0, too (`known`): on all of it no dual point is strict. W weighs the
inputs of B_u, and B_0 are those that weigh nothing. Q, delta, the order and any limit on the gains only add to F, and
controllers that share all relative outputs and all inputs are allowed, so nothing is lost by leaving these out.

M is symmetric and positive definite whatever the pair weights m_ij >= 0 are. Let M v = mu v, |v| = 1: restricted to
v (x) R^n, all three keep their form with (v' (x) I) P_d (v (x) I), likewise P_*, and the scalars mu and 1/mu for M and M^-1;
B_u W^-1 B_u' becomes that of the columns c_i B_i, c = T'v. With |c| = 1, which is so where the metric is (T T')^-1, it is
at most that of all columns, and that of B where all agents have it; in other coordinates no input counts as weighed.
So any certificate, with any pair weights, on any graph, gives one for a single agent, with a number mu > 0. Divided by rho
(P_d / rho, mu / rho, P_* rho for P_d, mu, P_*), these are two `Side`s,

    He(e Psi flow) + constant + mu slope < 0,     He(e Phi flow_*) + constant_* + slope_* / mu < 0,     e = [I; 0],
    Psi = C_perp'P_d,   Phi = B_perp'P_*.

This holds in any coordinates T whose metric S is (T T')^-1 or I, and for the modes of `modes`. It does not hold for
multipliers of another kind than M. Where single slopes have bounds of their own, phi(v) = J v with |J_kl| <= r_kl and
|J| <= alpha is one of the nonlinearities of the claim: F of A + G J H without phi is less than F, so these sides with
A + G J H and alpha = 0 hold for each such J.
"""

from typing import Annotated, NamedTuple

import numpy as np
from flint import fmpq, fmpq_mat

from lockstep.check.continuous.inequality import Performance
from lockstep.check.continuous.stability import is_stable
from lockstep.check.numbers import Matrix, Vector, exactly, eye, inverse, zeros
from lockstep.check.system.loop import Plant

NEARLY = fmpq(1, 2**20)
"""1/s: what grows no faster fades. Less would be known for certain; whatever is taken as known, what is proved is proved."""


class Side(NamedTuple):
    """He(e Psi flow) + constant + mu slope < 0 with Psi = kernel'P_d, P_d symmetric, e = [I; 0], in rationals.

    rows: (c, n), independent, with this kernel;  kernel: (n, k);  flow: (n, size);  constant, slope: (size, size).
    """

    rows: Matrix
    kernel: Matrix
    flow: Matrix
    constant: Matrix
    slope: Matrix

    @property
    def k(self) -> int:
        """Columns of the kernel."""
        return int(self.kernel.shape[1])

    @property
    def size(self) -> int:
        """Rows of the inequality; 0 where the kernel has no columns, so that it says nothing."""
        return int(self.flow.shape[1]) if self.k else 0


class Projected(NamedTuple):
    """Both sides, and the off-diagonal block C_perp'B_perp of what couples them."""

    primal: Side
    dual: Side

    @property
    def coupling(self) -> Matrix:
        """C_perp'B_perp, of [C_perp'P_d C_perp, C_perp'B_perp; *, B_perp'P_* B_perp] >= 0."""
        product: Matrix = self.primal.kernel.T @ self.dual.kernel
        return product


class FloorAgent(NamedTuple):
    """One agent in rationals, without phi where it has none or is linear; alpha; and what rho is a gain to and from."""

    plant: Plant
    alpha: fmpq
    performance: Performance


def with_rho(agent: FloorAgent, rho: fmpq, *, primal_phi: bool = True, dual_phi: bool = True) -> Projected:
    """Return the two sides at a given rho > 0.

    primal_phi, dual_phi: whether the border of phi is kept; without it the condition is weaker.
    """
    plant, alpha, performance = agent
    A, B, G, H, R = plant.A, plant.B, plant.G, alpha * plant.H, exactly(performance.R)
    own = B[:1] if all((B[0] == one).all() for one in B) else B
    free, weighed = _inputs(own, exactly(performance.W))
    quiet, noisy = _split(plant.C, exactly(performance.outputs) ** 2)
    D_xi = np.diag(exactly(performance.states)) if len(performance.states) else eye(len(A), A)
    D_xi = D_xi[:, np.any(D_xi != 0, axis=0)]
    border, G_in = (D_xi, rho * eye(D_xi.shape[1], A)), G if primal_phi else G[:, :0]
    quiet = known(quiet, A, np.hstack([D_xi, G_in]))
    primal = side(A, quiet, R / rho - rho * noisy, H.T @ H, border, G_in)
    head, H_out = D_xi @ D_xi.T / rho - rho * weighed, H.T if dual_phi else H.T[:, :0]
    return Projected(primal, side(A.T, free, head, G @ G.T, (R / rho, R / rho), H_out))


def known(C: Matrix, A: Matrix, E: Matrix) -> Matrix:
    """Return rows c of what is known in the end: of C, c A of each known c with c E = 0, and what E never drives if it fades.

    Of a disturbance at the rate v of a place p that is measured, the place and the rate are known; so is f, f' = v - f, and
    f' = v + f is not:

    >>> from lockstep.check.numbers import exactly
    >>> A, E = exactly(np.array([[0.0, 1, 0], [-4, -1, 0], [0, 1, -1]])), exactly(np.array([[0.0], [1], [0]]))
    >>> known(exactly(np.eye(3)[:1]), A, E).tolist(), known(exactly(np.eye(3)[2:]), A, np.abs(A)).tolist()
    ([[1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 0, 1]])
    >>> known(exactly(np.eye(3)[:1]), A + 2 * np.outer(A[2] == -1, A[2] == -1), E).tolist()
    [[1, 0, 0], [0, 1, 0]]
    """
    rows, before = row_space_and_kernel(C)[0], -1
    while before < len(rows) < len(A):
        before, size, idle = len(rows), -1, _left_kernel(E)
        # The largest set of rows with idle E = 0 and idle A in the span of it and of what is known; of it y = idle x, and y'.
        while size != len(idle):
            size, kernel = len(idle), row_space_and_kernel(np.vstack([rows, idle]))[1]
            idle = _left_kernel(idle @ A @ kernel) @ idle
        new, k = row_space_and_kernel(rows)[1], len(A) - len(rows)
        both = row_space_and_kernel(np.hstack([idle @ new, idle @ A @ new]))[0]
        falls = is_stable(both[:, k:] @ left_inverse(both[:, :k].T).T - NEARLY * eye(len(both), A))
        more = [_left_kernel(rows @ E) @ rows @ A, idle if falls else idle[:0]]
        rows = row_space_and_kernel(np.vstack([rows, *more]))[0]
    return rows


def _left_kernel(M: Matrix) -> Matrix:
    return row_space_and_kernel(M.T)[1].T


def _inputs(B: tuple[Matrix, ...], W: Matrix) -> tuple[Matrix, Matrix]:
    """Return [B_1 ... B_N]_0' and sum_i B_i W^-1 B_i' of the others; W is diagonal, or positive definite and weighs all."""
    if np.array_equal(W, np.diag(np.diag(W))):
        return _split(np.hstack(B).T, np.tile(np.diag(W), len(B)))
    return B[0].T[:0], sum((one @ inverse(W) @ one.T for one in B), zeros(len(B[0]), len(B[0]), B[0]))


def _split(rows: Matrix, weights: Vector) -> tuple[Matrix, Matrix]:
    """Return the rows whose weight is 0, and sum_k c_k'c_k / w_k over the others; no weights are as many of 0."""
    w = weights if len(weights) else zeros(1, len(rows), rows)[0]
    some = w != 0
    return rows[~some], rows[some].T @ (rows[some] / w[some][:, None])


def side(A: Matrix, C: Matrix, head: Matrix, slope: Matrix, border: tuple[Matrix, Matrix], G: Matrix) -> Side:
    """Assemble [C_perp'(He(P_d A) + head + mu slope)C_perp, C_perp'P_d E, C_perp'P_d G; *, -corner, 0; *, 0, -mu I]."""
    rows, kernel = row_space_and_kernel(C)
    E, corner = border
    k, p, r = kernel.shape[1], E.shape[1], G.shape[1]
    constant, by_mu = zeros(k + p + r, k + p + r, A), zeros(k + p + r, k + p + r, A)
    constant[:k, :k], constant[k : k + p, k : k + p] = kernel.T @ head @ kernel, -corner
    by_mu[:k, :k], by_mu[k + p :, k + p :] = kernel.T @ slope @ kernel, -eye(r, A)
    return Side(rows, kernel, np.hstack([A @ kernel, E, G]), constant, by_mu)


def row_space_and_kernel(C: Annotated[np.ndarray, "q n"]) -> tuple[Matrix, Matrix]:
    """Return a basis of the rows of C and one of its kernel, as columns.

    >>> from lockstep.check.numbers import exactly
    >>> rows, kernel = row_space_and_kernel(exactly(np.array([[1.0, 2.0], [2.0, 4.0]])))
    >>> rows.tolist(), kernel.tolist()
    ([[1, 2]], [[-2], [1]])
    """
    n = C.shape[1]
    if not C.size:
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


def left_inverse(kernel: Matrix) -> Matrix:
    """Return kernel^+ = (kernel'kernel)^-1 kernel'; exact for rationals."""
    return inverse(kernel.T @ kernel) @ kernel.T if kernel.shape[1] else kernel.T
