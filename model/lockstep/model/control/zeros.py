"""The zeros of (A, B, C, 0) from u to y: the s at which an input e^(s t) can leave the output at zero.

They are the s where the rank of [A - s I, B; C, 0] drops. A controller moves poles, never zeros: one with
Re s > 0 limits what any controller can do about disturbances (Skogestad and Postlethwaite, Multivariable
Feedback Control, section 5). For a pair that is controllable and observable these invariant zeros are the
transmission zeros.

The system is reduced by orthogonal transformations to one with as many inputs as outputs and an invertible D,
which has the same zeros; there they are generalised eigenvalues (the method of Emami-Naeini and Van Dooren,
Automatica 18, 1982). States that the outputs show must be zero on a zero trajectory; that they stay zero is a
new equation in place of the old one, until no equation is new. Then the same for the dual system.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

Block = Float[np.ndarray, "_ _"]
System = tuple[Block, Block, Block, Block]


@dataclass(frozen=True)
class Zeros:
    """The finite invariant zeros of one system, with multiplicity."""

    values: tuple[complex, ...]
    """By decreasing real part."""
    tolerance: float
    """Real parts below this, in the unit of A, cannot be told from 0."""
    residual: float
    """The largest singular value of the scaled [A - s I, B; C, 0] that vanishes at a zero: 0 to rounding."""

    @property
    def right_half_plane(self) -> tuple[complex, ...]:
        """Those with Re s > 0, beyond rounding."""
        return tuple(z for z in self.values if z.real > self.tolerance)

    @property
    def imaginary_axis(self) -> tuple[complex, ...]:
        """Those with Re s = 0, to rounding."""
        return tuple(z for z in self.values if abs(z.real) <= self.tolerance)


def zeros_of(A: Float[np.ndarray, "n n"], B: Float[np.ndarray, "n m"], C: Float[np.ndarray, "q n"]) -> Zeros:
    """Return the invariant zeros of x' = A x + B u, y = C x, square or not.

    >>> A, B, C = np.array([[0.0, 1.0], [-2.0, -3.0]]), np.array([[0.0], [1.0]]), np.array([[-1.0, 1.0]])
    >>> np.round(zeros_of(A, B, C).values, 12).tolist()
    [(1+0j)]
    """
    from scipy.linalg import matrix_balance

    balanced, (scale, _) = matrix_balance(A, permute=False, separate=True)
    size = float(np.linalg.norm(balanced, 2)) or 1.0
    a, b, c = balanced / size, _unit(B / scale[:, None], 0), _unit(C * scale, 1)
    # The rounding of an orthogonal step on matrices of norm one, with room for decimals that would cancel.
    rank_tolerance = 100 * max(a.shape[0], 1) * float(np.finfo(float).eps)
    reduced = _reduced(a, b, c, np.zeros((c.shape[0], b.shape[1])), rank_tolerance)
    square = _dual(_reduced(*_dual(reduced), rank_tolerance))
    values = _finite(*square)
    residual = _residual(a, b, c, values)
    # A zero of multiplicity k is known to the k-th root of the rounding error: two is the common case.
    tolerance = 10 * rank_tolerance ** (1 / 2 if _repeated(values) else 1)
    ordered = sorted((size * complex(z) for z in values), key=lambda z: (-z.real, abs(z.imag), -z.imag))
    return Zeros(tuple(ordered), tolerance * size, residual)


def _unit(matrix: Block, axis: int) -> Block:
    """Return columns (axis 0) or rows (axis 1) of length one: zeros do not depend on the units of u and y."""
    lengths = np.linalg.norm(matrix, axis=axis, keepdims=True)
    return np.asarray(matrix / np.where(lengths > 0, lengths, 1.0))


def _dual(system: System) -> System:
    A, B, C, D = system
    return A.T, C.T, B.T, D.T


def _reduced(A: Block, B: Block, C: Block, D: Block, tolerance: float) -> System:
    """Return a system with the same zeros whose D has full row rank."""
    while True:
        # Outputs that no input reaches at once: rotate them to the bottom, C_0 x = 0 on a zero trajectory.
        U, rank = _row_space(D, tolerance)
        C, D = U.T @ C, (U.T @ D)[:rank]
        C_0, C = C[rank:], C[:rank]
        V, seen = _row_space(C_0.T, tolerance)
        if seen == 0:
            return A, B, C, D
        # In coordinates V, C_0 x = 0 says that the first `seen` states are 0; that they stay so is an output.
        A, B, C = V.T @ A @ V, V.T @ B, C @ V
        C, D = np.vstack([A[:seen, seen:], C[:, seen:]]), np.vstack([B[:seen], D])
        A, B = A[seen:, seen:], B[seen:]


def _row_space(D: Block, tolerance: float) -> tuple[Block, int]:
    """Return an orthogonal U and the rank of D: the first `rank` columns of U span the columns of D."""
    if not D.size:
        return np.eye(D.shape[0]), 0
    U, values, _ = np.linalg.svd(D)
    return U, int((values > tolerance).sum())


def _finite(A: Block, B: Block, C: Block, D: Block) -> Complex[np.ndarray, " zeros"]:
    """Return the eigenvalues of A - B D^-1 C, the zeros where D is invertible, without the inverse."""
    from scipy.linalg import eigvals

    n, m = A.shape[0], B.shape[1]
    if n == 0:
        return np.zeros(0, dtype=complex)
    # An orthogonal W with [C D] W = [0 *] spans the trajectories with y = 0.
    W = np.linalg.svd(np.hstack([C, D]))[2].T[:, m:] if m else np.eye(n)
    return np.asarray(eigvals(np.hstack([A, B]) @ W, W[:n]), dtype=complex)


def _residual(A: Block, B: Block, C: Block, values: Complex[np.ndarray, " zeros"]) -> float:
    """Return by how much the rank of [A - s I, B; C, 0] fails to drop at the zeros."""
    n, corner = A.shape[0], np.zeros((C.shape[0], B.shape[1]))

    def spectrum(s: complex) -> Float[np.ndarray, " k"]:
        pencil = np.block([[A - s * np.eye(n), B], [C, corner]])
        return np.asarray(np.linalg.svd(pencil, compute_uv=False) / max(1.0, abs(s)))

    if not len(values):
        return 0.0
    # The rank at a point that is no zero; three points so that none of them is one by chance.
    usual = max(int((spectrum(s) > 1e-10).sum()) for s in (0.37 + 0.61j, 0.83 - 0.29j, -0.53 + 0.17j))
    return max(float(spectrum(complex(z))[usual - 1]) for z in values) if usual else 0.0


def _repeated(values: Complex[np.ndarray, " zeros"]) -> bool:
    """Whether two zeros are so near that rounding may have split a double one."""
    gaps = [abs(a - b) for i, a in enumerate(values) for b in values[:i]]
    return bool(gaps) and bool(min(gaps) < 1e-5)
