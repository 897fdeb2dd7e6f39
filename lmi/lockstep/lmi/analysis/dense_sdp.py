"""Semidefinite programs of large cones and few unknowns: an interior-point method whose factor is as large as the unknowns.

    minimise c'x    subject to  S = B - sum_k x_k A_k >= 0,
    maximise -B.Z   subject to  A_k.Z = -c_k,  Z >= 0,              in blocks S_j, Z_j.

The direction is that of Helmberg, Rendl, Vanderbei and Wolkowicz (SIAM J. Optim. 6, 1996), with Mehrotra's predictor and
corrector. S Z = mu I is linearised as

    dZ = mu S^-1 - Z - sym(S^-1 dS Z) - sym(S^-1 dS dZ of the predictor),    dS = B - A x - S - A dx,

and A dZ = -c - A Z leaves H dx = r with H_kl = sum_j A_jk . sym(S_j^-1 A_jl Z_j), positive definite. A sparse solver
factors a matrix with a row for each entry of each S_j: with 470 unknowns, a cone of 58 rows and eight of 26 that takes
twenty times as long. cvxpy states the programs here as anywhere; nothing is believed, as of any solver.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float, Int

from lockstep.lmi.shapes import Vector

if TYPE_CHECKING:
    import cvxpy as cp

Blocks = list[Float[np.ndarray, "n n"]]

ITERATIONS = 60
"""At most; 25 are usual."""

BACK = 0.95
"""The part of the longest step that is taken."""

FEASIBLE, ACCURATE = 1e-6, 1e-8
"""Residuals of a solution relative to B and c, and the gap at which one is accurate whatever its value is."""

LARGE = 1e6
"""Where S.Z is so many times as large as at first, there is no solution."""

LEAST = 1e-40
"""Of the diagonal of H, against its largest: an unknown that counts for less is left where it is."""

SHIFTS = (0.0, 1e-15, 1e-13, 1e-11, 1e-9)
"""What is added to the unit diagonal of H, the first with which it is definite."""


@dataclass(frozen=True, eq=False)
class Cone:
    """S = B - sum_k x_k A_k of the unknowns k that occur;  rows: these, sparse, a column each;  stack: dense."""

    occurs: Int[np.ndarray, " k"]
    rows: Any
    stack: Float[np.ndarray, "k n n"]
    B: Float[np.ndarray, "n n"]

    def A(self, x: Vector) -> Float[np.ndarray, "n n"]:
        """Return sum_k x_k A_k."""
        return np.asarray((self.rows @ x[self.occurs]).reshape(self.B.shape))

    def curvature(
        self, inverse: Float[np.ndarray, "n n"], Z: Float[np.ndarray, "n n"]
    ) -> Float[np.ndarray, "k k"]:
        """Return A_k . (S^-1 A_l Z), symmetric once its two halves are averaged."""
        moved = inverse @ self.stack @ Z
        return np.asarray(self.rows.T @ moved.reshape(len(moved), self.B.size).T)


def run_dense(problem: "cp.Problem", near: float = ACCURATE) -> bool:
    """Solve a program of equalities, inequalities and semidefinite conditions; tell whether it is solved.

    Args:
        problem: what to solve; its variables have the values then.
        near: the gap at which it is, relative to the value.
    """
    import cvxpy as cp

    data, chain, inverse = problem.get_problem_data(cp.CLARABEL, solver_opts={})
    x, steps = _solution(data["A"], data["b"], data["c"], data["dims"], near)
    if x is None:
        return False
    # No dual point is kept; cvxpy before 1.9.1 unpacks one all the same.
    z, value = np.zeros(len(data["b"])), float(data["c"] @ x)
    answer = SimpleNamespace(x=x, z=z, status="Solved", obj_val=value, solve_time=0.0, iterations=steps)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        problem.unpack_results(answer, chain, inverse)
    return True


def _solution(
    A: Any, b: Float[np.ndarray, " r"], c: Vector, dims: Any, near: float
) -> tuple[Vector | None, int]:
    """Solve Clarabel's form, A x + s = b, zeros before numbers before triangles, and count the steps; few equalities."""
    import scipy.sparse as sp
    from scipy.linalg import qr

    A, equal = sp.csr_array(A), dims.zero
    E = A[:equal].toarray()
    # Unknowns that the equalities give: x[given] = known - W x[free].
    given = np.sort(qr(E, pivoting=True, mode="r")[1][:equal]) if equal else np.zeros(0, dtype=int)
    free = np.setdiff1d(np.arange(len(c)), given)
    W = np.linalg.solve(E[:, given], np.column_stack([E[:, free], b[:equal]]))
    W, known = W[:, :-1], W[:, -1]
    rest = A[equal:]
    inner = sp.csr_array(rest[:, free] - rest[:, given] @ sp.csr_array(W))
    cones = _cones(inner, b[equal:] - rest[:, given] @ known, [1] * dims.nonneg + list(dims.psd))
    found, iterations = minimised(cones, c[free] - c[given] @ W, near)
    if found is None:
        return None, iterations
    x = np.zeros(len(c))
    x[free], x[given] = found, known - W @ found
    return x, iterations


def _cones(A: Any, b: Float[np.ndarray, " r"], sizes: Sequence[int]) -> list[Cone]:
    """Return the cones of rows that hold upper triangles, column by column, what is beside the diagonal times 2^(1/2)."""
    import scipy.sparse as sp

    found, end = [], 0
    for n in sizes:
        start, end = end, end + n * (n + 1) // 2
        column, row = np.tril_indices(n)
        scale, place = np.where(row == column, 1.0, np.sqrt(0.5)), np.zeros((n, n), dtype=int)
        place[row, column] = place[column, row] = np.arange(end - start)
        part = sp.csc_array(A[start:end])
        occurs = np.flatnonzero(np.diff(part.indptr))
        rows = sp.csr_array(sp.diags_array(scale) @ part[:, occurs])[place.ravel()]
        stack = np.ascontiguousarray(rows.toarray().T).reshape(-1, n, n)
        found.append(Cone(occurs, rows, stack, (scale * b[start:end])[place]))
    return found


def minimised(cones: list[Cone], c: Vector, near: float = ACCURATE) -> tuple[Vector | None, int]:
    """Return x, or None where there is none or none is found, and how many steps were taken.

    Args:
        cones: where S is.
        c: what is minimised.
        near: the gap at which x is returned, relative to the value.

    >>> import scipy.sparse as sp  # the largest x with I - x [0 1; 1 0] >= 0 is 1
    >>> A = np.array([[0.0, 1.0], [1.0, 0.0]])
    >>> one = Cone(np.array([0]), sp.csr_array(A.reshape(4, 1)), A[None], np.eye(2))
    >>> round(float(minimised([one], np.array([-1.0]))[0][0]), 6)
    1.0
    """
    size = max(1.0, *(float(np.linalg.norm(one.B)) for one in cones))
    at = _Point(
        np.zeros(len(c)),
        [size * np.eye(len(one.B)) for one in cones],
        [max(1.0, float(np.abs(c).max())) * np.eye(len(one.B)) for one in cones],
    )
    most = LARGE * at.mu
    for taken in range(ITERATIONS):
        r_p = [one.B - one.A(at.x) - S for one, S in zip(cones, at.S, strict=True)]
        r_d = -c - _adjoint(cones, at.Z, len(c))
        primal, dual = float(c @ at.x), -sum(_dot(one.B, Z) for one, Z in zip(cones, at.Z, strict=True))
        feasible = max(float(np.linalg.norm(r)) for r in r_p) <= FEASIBLE * size
        feasible = feasible and float(np.linalg.norm(r_d)) <= FEASIBLE * (1 + float(np.linalg.norm(c)))
        if feasible and abs(primal - dual) <= max(ACCURATE, near * min(abs(primal), abs(dual))):
            return at.x, taken
        if not at.mu < most:
            break
        try:
            with np.errstate(all="ignore"):
                at = _stepped(cones, at, r_p, r_d)
        except np.linalg.LinAlgError:
            break
    return None, taken


@dataclass(frozen=True, eq=False)
class _Point:
    x: Vector
    S: Blocks
    Z: Blocks

    @property
    def mu(self) -> float:
        return sum(map(_dot, self.S, self.Z)) / sum(map(len, self.S))

    def moved(self, by: "_Point", primal: float, dual: float) -> "_Point":
        return _Point(
            self.x + primal * by.x,
            [S + primal * dS for S, dS in zip(self.S, by.S, strict=True)],
            [Z + dual * dZ for Z, dZ in zip(self.Z, by.Z, strict=True)],
        )


def _stepped(cones: list[Cone], at: _Point, r_p: Blocks, r_d: Vector) -> _Point:
    from scipy.linalg import cho_solve

    inverses = [_symmetric(np.linalg.inv(S)) for S in at.S]
    H = np.zeros((len(r_d),) * 2)
    for one, inverse, Z in zip(cones, inverses, at.Z, strict=True):
        H[np.ix_(one.occurs, one.occurs)] += one.curvature(inverse, Z)
    H = _symmetric(H)
    d = 1 / np.sqrt(np.maximum(np.diag(H), LEAST * np.diag(H).max()))
    H = H * np.outer(d, d)
    factor = _factor(H)

    def direction(mu: float, second: Blocks) -> _Point:
        fixed = [
            mu * inverse - Z - _symmetric(inverse @ r @ Z) - more
            for inverse, Z, r, more in zip(inverses, at.Z, r_p, second, strict=True)
        ]
        right = d * (r_d - _adjoint(cones, fixed, len(r_d)))
        x = cho_solve(factor, right, check_finite=False)
        x = d * (x + cho_solve(factor, right - H @ x, check_finite=False))
        along = [one.A(x) for one in cones]
        dZ = [
            f + _symmetric(inverse @ A @ Z)
            for f, inverse, A, Z in zip(fixed, inverses, along, at.Z, strict=True)
        ]
        return _Point(x, [r - A for r, A in zip(r_p, along, strict=True)], dZ)

    def lengths(by: _Point, back: float) -> tuple[float, float]:
        return min(1.0, back * _longest(at.S, by.S)), min(1.0, back * _longest(at.Z, by.Z))

    first = direction(0.0, [np.zeros_like(S) for S in at.S])
    after = at.moved(first, *lengths(first, 1.0)).mu
    second = [_symmetric(back @ dS @ dZ) for back, dS, dZ in zip(inverses, first.S, first.Z, strict=True)]
    step = direction(at.mu * float(np.clip(after / at.mu, 0.05, 1.0)) ** 3, second)
    return at.moved(step, *lengths(step, BACK))


def _factor(H: Float[np.ndarray, "x x"]) -> tuple[Float[np.ndarray, "x x"], bool]:
    for shift in SHIFTS:
        try:
            return np.linalg.cholesky(H + shift * np.eye(len(H))), True
        except np.linalg.LinAlgError:
            continue
    raise np.linalg.LinAlgError("the unknowns are not told apart")


def _adjoint(cones: list[Cone], forms: Blocks, size: int) -> Vector:
    """Return A_k . form, summed over the cones."""
    total = np.zeros(size)
    for one, form in zip(cones, forms, strict=True):
        total[one.occurs] += one.rows.T @ form.ravel()
    return total


def _longest(forms: Blocks, moves: Blocks) -> float:
    """Return the longest step with which forms stay positive semidefinite, or a long one."""
    least = -1e-9
    for form, move in zip(forms, moves, strict=True):
        inverse = np.linalg.inv(np.linalg.cholesky(form))
        least = min(least, float(np.linalg.eigvalsh(inverse @ move @ inverse.T)[0]))
    return -1 / least


def _dot(a: Float[np.ndarray, "n n"], b: Float[np.ndarray, "n n"]) -> float:
    return float((a * b).sum())


def _symmetric(form: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "n n"]:
    return np.asarray((form + form.T) / 2)
