"""Lemmas 1 and 2, (12) to (15), (23): the reduction to disagreements, and what rho then measures."""

import numpy as np
from jaxtyping import Float, Shaped

from amini.claims.claim import Finding, PaperClaim
from amini.claims.example import TABLE_1, A, B, C, claim, cycle, loop
from lockstep.check.numbers import Matrix, exactly, eye, inverse
from lockstep.check.system.disagreement import Disagreement
from lockstep.check.system.loop import Loop, build_loop
from lockstep.lmi.analysis.certificate_sdp import AffineF, least_rho, solve_sdp


def _lemmas() -> Finding:
    L = exactly(cycle().laplacian)
    one = exactly(np.eye(1))
    identities = {size: np.kron(exactly(np.eye(size)), one) for size in (2, 3, 4)}
    commutes = [
        (
            np.kron(L, identities[rows]) @ np.kron(identities[3], M)
            == np.kron(identities[3], M) @ np.kron(L, identities[4])
        ).all()
        for rows, M in ((2, exactly(C)), (4, exactly(A)))
    ]
    return Finding("both sides equal L (x) C and L (x) A, entry by entry over the rationals", all(commutes))


def _C_r() -> Finding:
    loops = loop(exact_arithmetic=True)
    d = loops.d
    pseudo_inverse = d.T.T @ inverse(d.T @ d.T.T)
    C_r = np.kron(d.L @ pseudo_inverse, exactly(C))
    whole = C_r @ np.kron(d.T, eye(4, d.T)) == np.kron(d.L, exactly(C))
    return Finding("C_r (L_hat (x) I) = L (x) C over the rationals", bool(whole.all()))


def _reduction() -> Finding:
    exact_loop = loop(exact_arithmetic=True)
    gains = TABLE_1["theorem_1"]
    K = exactly(gains.blocks)
    lift = _lift(exact_loop.d.T)
    left, right = lift @ _full_matrix(K), exact_loop.A_cl(K) @ lift
    return Finding(
        "with the gains of Table 1, diag(L_hat (x) I, I) times the matrix of (12) is A_cl times"
        " diag(L_hat (x) I, I), over the rationals; both are affine in the gains, so with errors too, and L_hat_n takes"
        " h and xi to h_r and xi_r",
        bool((left == right).all()),
    )


def _lift(T: Matrix) -> Matrix:
    """Return diag(T (x) I_4, I_6), which takes (x, x_C) to x_cl."""
    rows, columns = 4 * T.shape[0], 4 * T.shape[1]
    lift = exactly(np.zeros((rows + 6, columns + 6)))
    lift[:rows, :columns] = np.kron(T, eye(4, T))
    lift[rows:, columns:] = eye(6, T)
    return lift


def _full_matrix(K: Shaped[np.ndarray, "3 3 4"]) -> Matrix:
    """Return the matrix of (12) without gain errors."""
    L = exactly(cycle().laplacian)
    M = exactly(np.zeros((18, 18)))
    A_, B_, C_ = exactly(A), exactly(B), exactly(C)
    for i in range(3):
        x, c = slice(4 * i, 4 * i + 4), slice(12 + 2 * i, 14 + 2 * i)
        M[x, x] = M[x, x] + A_
        M[x, c], M[c, c] = B_ @ K[i][2:, :2], K[i][:2, :2]
        for j in range(3):
            y = slice(4 * j, 4 * j + 4)
            M[x, y] = M[x, y] + L[i, j] * (B_ @ K[i][2:, 2:] @ C_)
            M[c, y] = M[c, y] + L[i, j] * (K[i][:2, 2:] @ C_)
    return M


def _rows_matter() -> Finding:
    K = TABLE_1["corollary_1"].blocks
    plant = loop().plant
    values = []
    for row in range(3):
        T = np.delete(cycle().laplacian, row, axis=0)
        right = np.vstack([np.linalg.inv(T[:, :2]), np.zeros((1, 2))])
        L = cycle().laplacian
        values.append(_rho(build_loop(plant, Disagreement(T, right, np.eye(2), L, L @ right), 2), K))
    orthonormal = _rho(loop(coordinates="orthonormal"), K)
    shown = ", ".join(f"{value:.4g}" for value in values)
    return Finding(
        f"gains of Corollary 1: {shown} without row 1, 2, 3 of L; {orthonormal:.4g} in orthonormal coordinates, where"
        " it is the gain from disagreement to disagreement",
        max(values) > 1.01 * min(values)
        and abs(values[2] - 12.153) < 0.01
        and abs(orthonormal - 13.23) < 0.01,
    )


def _rho(one: Loop, K: Float[np.ndarray, "3 3 4"]) -> float:
    found = least_rho(one, K, claim())
    return float("inf") if found is None else found.rho


SLOWER = 20
"""By what A_C is divided, so that the disturbance (19) puts on x_C is felt."""


def _charged() -> Finding:
    K = TABLE_1["corollary_1"].blocks.copy()
    K[:, :2, :2] /= SLOWER
    usual, wide = _rho(loop(), K), _rho_on_everything(K)
    return Finding(
        f"gains of Corollary 1 with A_C / {SLOWER}: rho = {usual:.3g} for disturbances that enter x_r, {wide:.3g} as"
        " charged in (19), on x_C too",
        wide > 1.05 * usual,
    )


def _rho_on_everything(K: Float[np.ndarray, "3 3 4"]) -> float:
    """Return the least rho with P in the place of P E: the disturbance of (19) enters all of x_Cl."""
    import cvxpy as cp

    one = loop()
    form = AffineF(one, K, claim())
    n_x, n_d = one.E.shape
    P, m, r2 = cp.Variable((n_x, n_x), symmetric=True), cp.Variable(3), cp.Variable()
    keep = [*range(n_x), *range(n_x + n_d, len(form.constant))]
    square = np.ix_(keep, keep)
    F = form.constant[square] + sum(m[k] * form.slopes[k][square] for k in range(3))
    half = np.eye(len(keep), n_x) @ P @ form.Z[:, keep]
    side = np.eye(len(keep), n_x) @ P
    whole = cp.bmat([[F + half + half.T, side], [side.T, -r2 * np.eye(n_x)]])
    solved = solve_sdp(cp.Problem(cp.Minimize(r2), [P >> 0, m >= 0, (whole + whole.T) / 2 << 0]))
    return float(np.sqrt(r2.value)) if solved else float("nan")


CLAIMS = (
    PaperClaim("lemmas", "Lemmas 1 and 2", "L_q C = C L_n and L_n A = A L_n.", "proved", _lemmas),
    PaperClaim("c-r", "(14), C_r", "C_r = C L_n L_hat_n^+ gives C_r x_r = C L_n x.", "proved", _C_r),
    PaperClaim("reduction", "(12), (15)", "(12) reduces to (15) by x_r = L_hat_n x.", "proved", _reduction),
    PaperClaim(
        "rho-of-rows",
        "(14), (23)",
        "rho belongs to the network and its gains, whichever row of L is removed.",
        "refuted",
        _rows_matter,
    ),
    PaperClaim(
        "rho-charged",
        "(15), (19)",
        "The rho of (19) is that of (15), whose disturbance enters x_r only.",
        "refuted",
        _charged,
    ),
)
