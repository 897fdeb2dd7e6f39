"""The upper bound of mu by D scaling: the least beta with M* X_z M < beta^2 X_w for a positive X that commutes with Delta.

Two ways to a D. `balanced`: Osborne's iteration, then descent on log sigma(D M D^-1), which is convex in log D: quick, for
every frequency. `improved_scales`: the generalised eigenvalue problem itself, by Clarabel: with beta fixed the X of the
largest margin, then the least beta of that X, until nothing is gained.

What a solver returns is a proposal. `decide` puts it to the proof: the Hermitian matrix beta^2 X_w - M* X_z M of the doubles
of M, X and beta, each taken exactly, as a real symmetric one of twice the size, is positive definite or not.
"""

from typing import Any

import numpy as np
from jaxtyping import Complex, Float

from lockstep.check.numbers import exactly
from lockstep.check.psd import Definiteness, decide_positive_definite
from lockstep.lmi.analysis.certificate_sdp import solve_sdp
from lockstep.lmi.robustness.blocks import Structure

ROUNDS = 12
"""Of Osborne's iteration."""

MARGIN = 1e-9
"""Part by which a computed beta is raised before it is decided: what rounding may cost."""

Scales = list[Complex[np.ndarray, "k k"]]


def osborne(M: Complex[np.ndarray, "c r"], structure: Structure) -> Float[np.ndarray, " blocks"]:
    """Return the logarithms of d, one number for each block, for which the Frobenius norm of D M D^-1 is least."""
    z, w = structure.of_z, structure.of_w
    size = np.array([[np.linalg.norm(M[a, b]) for b in w] for a in z])
    log_d = np.zeros(len(z))
    for _ in range(ROUNDS):
        for i in range(len(z)):
            d = np.exp(log_d)
            row = np.linalg.norm(np.delete(d[i] * size[i] / d, i))
            column = np.linalg.norm(np.delete(d * size[:, i] / d[i], i))
            if row > 0 and column > 0:
                log_d[i] += np.clip(np.log(column / row) / 2, -20, 20)
    return log_d


def balanced(M: Complex[np.ndarray, "c r"], structure: Structure) -> Float[np.ndarray, " blocks"]:
    """Return d for which sigma(D M D^-1) is small."""
    from scipy.optimize import minimize

    z, w, log_d = structure.of_z, structure.of_w, osborne(M, structure)

    def value(log_d: np.ndarray) -> tuple[float, np.ndarray]:
        scaled = _scaled(M, structure, np.exp(log_d))
        U, s, V = np.linalg.svd(scaled)
        if s[0] == 0:
            return -700.0, 0 * log_d
        slope = [np.sum(abs(U[a, 0]) ** 2) - np.sum(abs(V[0, b]) ** 2) for a, b in zip(z, w, strict=True)]
        return float(np.log(s[0])), np.array(slope)

    found = minimize(value, log_d, jac=True, method="L-BFGS-B", options={"maxiter": 50})
    log_d = found.x if found.fun < value(log_d)[0] else log_d
    return np.asarray(np.exp(log_d - log_d[-1]))


def scaled_norm(
    M: Complex[np.ndarray, "c r"], structure: Structure, d: Float[np.ndarray, " blocks"]
) -> float:
    """Return sigma(D M D^-1)."""
    return float(np.linalg.norm(_scaled(M, structure, d), 2))


def _scaled(M: np.ndarray, structure: Structure, d: np.ndarray) -> np.ndarray:
    left = np.repeat(d, [b.columns for b in structure.blocks])
    right = np.repeat(d, [b.rows for b in structure.blocks])
    return np.asarray(left[:, None] * M / right)


def scales_from_numbers(structure: Structure, d: Float[np.ndarray, " blocks"]) -> Scales:
    """Return the X_i = d_i^2 I (repeated blocks), d_i^2 (full ones)."""
    return [
        value**2 * np.eye(b.rows if b.repeated else 1, dtype=complex)
        for b, value in zip(structure.blocks, d, strict=True)
    ]


def least_beta(M: Complex[np.ndarray, "c r"], structure: Structure, X: Scales) -> float:
    """Return the least beta with M* X_z M <= beta^2 X_w, in doubles."""
    from scipy.linalg import eigh

    X_z, X_w = _whole(structure, X)
    return float(np.sqrt(max(eigh(M.conj().T @ X_z @ M, X_w, eigvals_only=True)[-1], 0.0)))


def improved_scales(
    M: Complex[np.ndarray, "c r"], structure: Structure, X: Scales, rounds: int = 8
) -> Scales:
    """Return a better X than the one given, by semidefinite programs."""
    import cvxpy as cp

    beta = least_beta(M, structure, X)
    # Scaled by the given X the optimum is near I: a well-conditioned program.
    roots = [np.linalg.cholesky(x).conj().T for x in X]
    root_z, root_w = _whole(structure, roots)
    scaled = root_z @ M @ np.linalg.inv(root_w) / (beta or 1.0)
    shape = [b.rows if b.repeated else 1 for b in structure.blocks]
    unknown = [cp.Variable((k, k), hermitian=True) for k in shape]
    margin, level = cp.Variable(), cp.Parameter(nonneg=True)
    r, c = scaled.shape[1], scaled.shape[0]
    S_w = sum(
        _embed(x, b, place, r)
        for x, b, place in zip(unknown, _of(structure, "w"), structure.of_w, strict=True)
    )
    S_z = sum(
        _embed(x, b, place, c)
        for x, b, place in zip(unknown, _of(structure, "z"), structure.of_z, strict=True)
    )
    left = level * S_w - scaled.conj().T @ S_z @ scaled
    limits: list[Any] = [x >> 1e-4 * np.eye(len(x0)) for x, x0 in zip(unknown, X, strict=True)]
    limits += [x << 1e4 * np.eye(len(x0)) for x, x0 in zip(unknown, X, strict=True)]
    program = cp.Problem(cp.Maximize(margin), [left >> margin * np.eye(r), margin <= 1, *limits])
    best, least = X, beta
    for _ in range(rounds):
        level.value = (least / (beta or 1.0)) ** 2
        if not solve_sdp(program) or any(bool(x.value is None) for x in unknown):
            break
        now = [
            root.conj().T @ ((x.value + x.value.conj().T) / 2) @ root
            for root, x in zip(roots, unknown, strict=True)
        ]
        reached = least_beta(M, structure, now)
        if not reached < least * (1 - 1e-7):
            break
        best, least = now, reached
    return best


def decide(M: Complex[np.ndarray, "c r"], structure: Structure, X: Scales, beta: float) -> Definiteness:
    """Decide beta^2 X_w - M* X_z M > 0 for these doubles, exactly: then mu(M) < beta, since X > 0 is asked for too."""
    X_z, X_w = _whole(structure, [(x + x.conj().T) / 2 for x in X])
    for x in X:
        held = decide_positive_definite(_real(exactly(x.real), exactly((x.imag - x.imag.T) / 2)))
        if not held.positive:
            return held
    R, I = exactly(M.real), exactly(M.imag)
    left, wide = _real(R, I), _real(exactly(X_z.real), exactly(X_z.imag))
    level = exactly(np.array([[beta]]))[0, 0]
    return decide_positive_definite(
        level * level * _real(exactly(X_w.real), exactly(X_w.imag)) - left.T @ wide @ left
    )


def _real(R: np.ndarray, I: np.ndarray) -> np.ndarray:
    """Return [R -I; I R]: positive definite if and only if R + i I is."""
    return np.block([[R, -I], [I, R]])


def _whole(structure: Structure, X: Scales) -> tuple[np.ndarray, np.ndarray]:
    """Return X_z and X_w."""
    from scipy.linalg import block_diag

    z = [x if b.repeated else np.kron(np.eye(b.columns), x) for b, x in zip(structure.blocks, X, strict=True)]
    w = [x if b.repeated else np.kron(np.eye(b.rows), x) for b, x in zip(structure.blocks, X, strict=True)]
    return block_diag(*z), block_diag(*w)


def _of(structure: Structure, side: str) -> list[tuple[bool, int]]:
    return [(b.repeated, b.columns if side == "z" else b.rows) for b in structure.blocks]


def _embed(x: Any, block: tuple[bool, int], place: slice, size: int) -> Any:
    """Return a block of X as the part of the whole it is."""
    repeated, width = block
    selection = np.eye(size)[:, place]
    if repeated:
        return selection @ x @ selection.T
    import cvxpy as cp

    return cp.real(x[0, 0]) * (selection @ np.eye(width) @ selection.T)
