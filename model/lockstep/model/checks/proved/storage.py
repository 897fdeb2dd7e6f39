"""Proposals of V = d'P d by a convex program over sampled slopes (cvxpy, Clarabel): never trusted, decided elsewhere.

Of x' = f(x, t) + B u, y = C x and d = a - b, V' <= s(dy, du) - 2 c V with s = dy'Q dy + 2 dy'S du + du'R du asks for

    [ J'P + P J + 2 c P - C'Q C   P B - C'S ]
    [           *                    -R     ]  <= 0   for every J = df/dx of the domain.

States are scaled by powers of two first (`scipy.linalg.matrix_balance`).
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from flint import fmpq, fmpq_mat
from jaxtyping import Float

from lockstep.check.numbers import exactly
from lockstep.check.psd import decide_positive_definite
from lockstep.model.checks.proved.vector_field import fraction

MOST_SAMPLES = 8
DIGITS = 6

Rational = list[list[Fraction]]


@dataclass(frozen=True)
class Supply:
    """s = dy'Q dy + 2 dy'S du + du'R du, in numbers that are taken exactly."""

    Q: Rational
    S: Rational
    R: Rational

    @classmethod
    def passive(cls, m: int) -> Supply:
        """Return 2 dy'du: incremental passivity."""
        return cls(_diagonal(m, 0), _diagonal(m, 1), _diagonal(m, 0))

    @classmethod
    def gain(cls, q: int, m: int, level: float) -> Supply:
        """Return level^2 |du|^2 - |dy|^2: an incremental L2 gain of at most `level`."""
        zeros = [[Fraction(0)] * m for _ in range(q)]
        return cls(_diagonal(q, -1), zeros, _diagonal(m, Fraction(level) ** 2))


def _diagonal(size: int, value: Fraction | int) -> Rational:
    return [[Fraction(value) * (i == j) for j in range(size)] for i in range(size)]


def scales(J: Float[np.ndarray, "k n n"]) -> Float[np.ndarray, " n"]:
    """Return powers of two that balance the slopes: x_i = s_i z_i."""
    from scipy.linalg import matrix_balance

    _, (scale, _) = matrix_balance(np.abs(J).max(axis=0), permute=False, separate=True)
    return np.asarray(scale)


def farthest_samples(J: Float[np.ndarray, "k n n"]) -> Float[np.ndarray, "l n n"]:
    """Return at most `MOST_SAMPLES` slopes, each the farthest from those before it."""
    flat = J.reshape(len(J), -1)
    flat = flat / np.maximum(np.abs(flat).max(axis=0), 1e-300)
    chosen = [int(np.abs(flat - flat.mean(axis=0)).sum(axis=1).argmax())]
    far = np.abs(flat - flat[chosen[0]]).sum(axis=1)
    while len(chosen) < MOST_SAMPLES and far.max() > 1e-9:
        chosen.append(int(far.argmax()))
        far = np.minimum(far, np.abs(flat - flat[chosen[-1]]).sum(axis=1))
    return J[chosen]


def propose_storage(
    J: Float[np.ndarray, "k n n"],
    B: Float[np.ndarray, "n m"],
    C: Float[np.ndarray, "q n"],
    supply: Supply | None,
    rate: float,
    *,
    gain: bool = False,
) -> tuple[Float[np.ndarray, "n n"], float] | None:
    """Return P for sampled slopes with the largest margin, or with `gain` the least R = r I and that r; None without one.

    Without a supply B and C play no part: V' <= -2 rate V.
    """
    import cvxpy as cp

    s = scales(J)
    J, B, C = J * s[None, None, :] / s[None, :, None], B / s[:, None], C * s[None, :]
    n = len(s)
    P, margin, r = cp.Variable((n, n), symmetric=True), cp.Variable(), cp.Variable(nonneg=True)
    limits = [P << np.eye(n)] if supply is None else []
    limits += [P >> margin * np.eye(n) if supply is None else P >> 1e-7 * np.eye(n)]
    through = None
    if supply is not None:
        Q, S, R = (np.array(M, dtype=float) for M in (supply.Q, supply.S, supply.R))
        through = P @ B - C.T @ S
        R = r * np.eye(B.shape[1]) if gain else R
        if not gain and not R.any():
            limits += [through == 0]
            through = None
    for slope in J:
        form = slope.T @ P + P @ slope + 2 * rate * P
        if supply is not None:
            form = form - C.T @ Q @ C
        slack = margin * np.eye(n)
        if through is not None:
            form = cp.bmat([[form, through], [through.T, -R]])
            slack = cp.bmat(
                [[slack, np.zeros((n, B.shape[1]))], [np.zeros((B.shape[1], n)), 0 * np.eye(B.shape[1])]]
            )
        limits += [0.5 * (form + form.T) << -slack]
    limits += [margin >= 1e-6] if gain else [margin <= 1.0]
    program = cp.Problem(cp.Minimize(r) if gain else cp.Maximize(margin), limits)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            program.solve(solver=cp.CLARABEL)
    except cp.SolverError:
        return None
    if P.value is None or not np.isfinite(P.value).all() or (not gain and margin.value <= 1e-8):
        return None
    return np.asarray(P.value) / np.outer(s, s), float(r.value if gain else margin.value)


def rounded(P: Float[np.ndarray, "n n"], B: Rational, target: Rational | None) -> Rational | None:
    """Return P in short decimals, with P B = target exactly where that is asked for; None if it is not positive definite."""
    n = len(P)
    places = [(i, j) for i in range(n) for j in range(i, n)]
    size = np.sqrt(np.abs(np.diag(P)))
    entries = {
        (i, j): Fraction(
            float(f"{P[i, j] / (size[i] * size[j]):.{DIGITS}f}") * float(f"{size[i] * size[j]:.3g}")
        )
        if i != j
        else Fraction(float(f"{P[i, i]:.{DIGITS}g}"))
        for i, j in places
    }
    if target is not None and not _solve(entries, places, B, target):
        return None
    exact = [[entries[min(i, j), max(i, j)] for j in range(n)] for i in range(n)]
    matrix = np.array([[fmpq(x.numerator, x.denominator) for x in row] for row in exact], dtype=object)
    return exact if decide_positive_definite(exactly(matrix)).positive else None


def _solve(
    entries: dict[tuple[int, int], Fraction], places: list[tuple[int, int]], B: Rational, target: Rational
) -> bool:
    """Change as few entries of P as P B = target determines, exactly; the largest diagonal ones stay free if they can."""
    n, m = len(B), len(B[0])
    ordered = sorted(places, key=lambda place: place[0] == place[1])
    rows = []
    for i in range(n):
        for k in range(m):
            row = [fmpq(0)] * (len(ordered) + 1)
            for j in range(n):
                at = ordered.index((min(i, j), max(i, j)))
                row[at] += fmpq(B[j][k].numerator, B[j][k].denominator)
            row[-1] = fmpq(target[i][k].numerator, target[i][k].denominator)
            rows.append(row)
    steps, rank = fmpq_mat(rows).rref()
    for row in steps.tolist()[:rank]:
        pivot = next(k for k, value in enumerate(row) if value != 0)
        if pivot == len(ordered):
            return False
        rest = [fraction(c) * entries[ordered[k]] for k, c in enumerate(row[:-1]) if k != pivot and c != 0]
        entries[ordered[pivot]] = fraction(row[-1]) - sum(rest, Fraction(0))
    return True
