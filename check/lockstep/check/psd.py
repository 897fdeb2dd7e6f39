"""Whether a symmetric matrix of rationals is positive definite, decided exactly.

Two stages, both of which only ever conclude from exact arithmetic. First the fast one: a Cholesky factor of
the matrix less a small multiple of the identity is computed in doubles, and the exact residual M - L L' is
shown to be diagonally dominant, so that M = L L' + (positive definite); or a double eigenvector is found
whose exact quadratic form is not positive, which refutes. Where neither settles it (a matrix on the edge), an
exact L D L' over the rationals does.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from flint import fmpq, fmpq_mat

from lockstep.check.numbers import as_float, as_floats, exact, exactly

EDGE = 1e-10
"""What the first stage takes off a matrix scaled to a unit diagonal: far above the 1e-14 of a double Cholesky
factor of some hundred rows, far below any margin worth having. It decides which stage answers, never what the
answer is."""

FILTERED = 1e100
"""Entries from here up, with a diagonal of about 1, are left to the exact stage: doubles would overflow in the filter."""


MOST_BITS = 2_000
"""Of a numerator or denominator, after scaling: the cost of exact arithmetic grows with it. A double has 53 bits at one of
2 000 binary places, and an entry is a sum of products of a few; those of the worked example have 260 bits at most."""

MOST_ROWS = 700
"""Of a matrix: its entries are Python's objects, 1 GB of them at 1 000 rows, which took 15 s."""

MOST_WORK = 5_000_000_000
"""Rows^4 x bits of the exact stage, in which numbers grow with each row: 120 rows of 54 bits, twice that, took 9 s."""


@dataclass(frozen=True)
class Definiteness:
    """The answer, and what shows it.

    positive: whether the matrix is positive definite;  method: which exact argument decided;  vector: z with
    z' M z <= 0 where it is not, z' z = 1 to rounding;  value: z' M z;  margin: the smallest eigenvalue of the matrix scaled
    to a unit diagonal, in doubles, for information;  decided: false where the numbers are too long for an exact answer, and
    then `positive` is false as well and `method` says why.
    """

    positive: bool
    method: str
    margin: float
    vector: Annotated[np.ndarray, " n"] | None = None
    value: float = 0.0
    decided: bool = True


def too_many(rows: int) -> Definiteness | None:
    """Return that a matrix of so many rows is not decided, or None."""
    if rows <= MOST_ROWS:
        return None
    said = f"not decided, {rows} rows of rationals, at most {MOST_ROWS}"
    return Definiteness(False, said, np.nan, decided=False)


def decide_positive_definite(matrix: Annotated[np.ndarray, "n n"]) -> Definiteness:
    """Decide M > 0 for a symmetric object array of rationals; a matrix without rows is.

    >>> decide_positive_definite(exactly(np.array([[2.0, 1.0], [1.0, 1.0]]))).positive
    True
    >>> decide_positive_definite(exactly(np.array([[1.0, 1.0], [1.0, 1.0]]))).positive
    False
    """
    if not len(matrix):
        return Definiteness(True, "no rows", np.inf)
    if beyond := too_many(len(matrix)):
        return beyond
    for i in range(len(matrix)):
        if matrix[i, i] <= 0:
            unit = np.eye(len(matrix))[i]
            return Definiteness(False, "diagonal", -np.inf, unit, as_float(matrix[i, i]))
    scale = np.array([fmpq(2) ** -k for k in _halvings(matrix)], dtype=object)
    scaled = matrix * np.outer(scale, scale)
    bits = max(max(int(entry.p).bit_length(), int(entry.q).bit_length()) for entry in scaled.flat)
    if bits > MOST_BITS:
        said = f"entries too wildly scaled for exact arithmetic (one has {bits} bits, over {MOST_BITS})"
        return Definiteness(False, f"not decided, {said}", np.nan, decided=False)
    doubles = as_floats(scaled)
    margin = np.nan
    if np.abs(doubles).max() < FILTERED:
        values, vectors = np.linalg.eigh((doubles + doubles.T) / 2)
        margin = float(values[0])
        if margin > 0 and _residual_dominates(scaled, doubles):
            return Definiteness(True, "factor and exact residual", margin)
        vector = exactly(vectors[:, 0])
        if margin < 0 and vector @ (scaled @ vector) <= 0:
            return _refuted("exact quadratic form", margin, vector * scale, matrix)
    if len(matrix) ** 4 * bits > MOST_WORK:
        said = f"too near the edge for {len(matrix)} rows of rationals of {bits} bits: the exact factor takes too long"
        return Definiteness(False, f"not decided, {said}", margin, decided=False)
    k = failing_pivot(scaled)
    if k is None:
        return Definiteness(True, "exact LDL'", margin)
    return _refuted("exact LDL'", margin, _pivot_vector(scaled, k) * scale, matrix)


def _refuted(
    method: str, margin: float, vector: Annotated[np.ndarray, " n"], matrix: Annotated[np.ndarray, "n n"]
) -> Definiteness:
    """Report a vector of rationals with z' M z <= 0: z as doubles of length 1, and z' M z / z' z, exact until rounded."""
    value = (vector @ (matrix @ vector)) / (vector @ vector)
    z = as_floats(vector / max(abs(entry) for entry in vector))
    return Definiteness(False, method, margin, z / np.linalg.norm(z), as_float(value))


def _halvings(matrix: Annotated[np.ndarray, "n n"]) -> list[int]:
    """Return k_i with 4^-k_i M_ii between 1/2 and 4: an exact scaling of the diagonal to about 1."""
    return [(int(value.p).bit_length() - int(value.q).bit_length()) // 2 for value in np.diag(matrix)]


def _residual_dominates(scaled: Annotated[np.ndarray, "n n"], doubles: Annotated[np.ndarray, "n n"]) -> bool:
    """Tell whether M - L L' is strictly diagonally dominant with a positive diagonal, exactly."""
    n = len(doubles)
    try:
        L = np.linalg.cholesky(doubles - EDGE * np.eye(n))
    except np.linalg.LinAlgError:
        return False
    factor = fmpq_mat(exactly(L).tolist())
    residual = fmpq_mat(scaled.tolist()) - factor * factor.transpose()
    beside = [sum((abs(residual[i, j]) for j in range(n) if j != i), start=fmpq(0)) for i in range(n)]
    return all(residual[i, i] > beside[i] for i in range(n))


def failing_pivot(matrix: Iterable[Sequence[Any]]) -> int | None:
    """Run L D L' on the lower triangle of a matrix of rationals or balls; return the first pivot not above 0, or None.

    A pivot of balls is above 0 where all of the ball is, which encloses the pivot of every matrix in the balls.
    """
    work = [[*row[: i + 1]] for i, row in enumerate(matrix)]
    for k in range(len(work)):
        pivot = work[k][k]
        if not pivot > 0:
            return k
        for i, row in enumerate(work[k + 1 :], start=k + 1):
            ratio = row[k] / pivot
            if ratio == 0:  # of balls, too, zeros themselves alone are left out
                continue
            for j in range(k + 1, i + 1):
                row[j] -= ratio * work[j][k]
    return None


def _pivot_vector(matrix: Annotated[np.ndarray, "n n"], k: int) -> Annotated[np.ndarray, " n"]:
    """Return z = (-M_11^-1 M_1k, 1, 0): z' M z is the Schur complement at pivot k."""
    z = [exact(0.0)] * len(matrix)
    z[k] = exact(1.0)
    if k:
        head = fmpq_mat(matrix[:k, :k].tolist())
        column = fmpq_mat([[-value] for value in matrix[:k, k]])
        for i, row in enumerate(head.solve(column).tolist()):
            z[i] = row[0]
    return np.array(z, dtype=object)
