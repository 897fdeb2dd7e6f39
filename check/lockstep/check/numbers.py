"""The two kinds of number the matrices are made of: IEEE doubles, and exact rationals.

Every number Lockstep reads is an IEEE double, taken exactly. The same assembly code then runs on float arrays
(for solvers) and on object arrays of `flint.fmpq` (for proofs), so that a proof is never about another matrix
than the one that was designed for.
"""

from collections.abc import Callable
from fractions import Fraction
from math import inf, nextafter
from typing import Annotated, Any

import numpy as np
from flint import fmpq, fmpq_mat

Matrix = Annotated[np.ndarray, "_ _"]
Vector = Annotated[np.ndarray, "_"]
Stack = Annotated[np.ndarray, "_ _ _"]


def exact(value: float) -> fmpq:
    """Return the rational number that a double is.

    >>> exact(0.5), exact(0.1) == fmpq(1, 10)
    (1/2, False)
    """
    return fmpq(*float(value).as_integer_ratio())


def exactly(array: Annotated[np.ndarray, "..."]) -> Annotated[np.ndarray, "..."]:
    """Return an object array of the rationals that the doubles of `array` are; one of rationals as it is."""
    out = np.empty(array.shape, dtype=object)
    for index, value in np.ndenumerate(array):
        out[index] = value if isinstance(value, fmpq) else exact(value)
    return out


def as_floats(array: Annotated[np.ndarray, "..."]) -> Annotated[np.ndarray, "..."]:
    """Return the nearest doubles of an array of either kind."""
    if not is_exact(array):
        return np.asarray(array, dtype=float)
    return np.array([as_float(value) for value in array.ravel()], dtype=float).reshape(array.shape)


def as_float(value: Any) -> float:
    """Return the double nearest to a `Fraction`, an `fmpq` or the middle of a ball, infinite beyond all doubles."""
    try:
        return int(value.p) / int(value.q) if isinstance(value, fmpq) else float(value)
    except OverflowError:
        return inf if value > 0 else -inf


def as_fraction(value: Any) -> Fraction:
    """Return a double, a `Fraction` or an `fmpq` as the rational that it is."""
    return Fraction(int(value.p), int(value.q)) if isinstance(value, fmpq) else Fraction(value)


def rounded_down(number: Fraction) -> float:
    """Return the largest double that is not above a rational.

    >>> rounded_down(Fraction(1, 3)) < Fraction(1, 3), rounded_down(Fraction(-1, 2))
    (True, -0.5)
    """
    try:
        nearest = float(number)
    except OverflowError:
        return -inf if number < 0 else nextafter(inf, 0.0)
    return nearest if Fraction(nearest) <= number else nextafter(nearest, -inf)


def is_double(number: Fraction) -> bool:
    """Whether a double holds the number exactly."""
    try:
        return Fraction(float(number)) == number
    except OverflowError:
        return False


def is_plain_or_double(number: Fraction) -> bool:
    """Whether a double holds the number, or a division of two short whole numbers gives it: 1/3."""
    return is_double(number) or max(abs(number.numerator), number.denominator) < 10_000


def is_exact(array: Annotated[np.ndarray, "..."]) -> bool:
    """Tell whether an array holds rationals."""
    return array.dtype == object


def inverse(matrix: Matrix) -> Matrix:
    """Return the inverse, exact for an array of rationals."""
    if not is_exact(matrix):
        return np.linalg.inv(matrix)
    return np.array(fmpq_mat(matrix.tolist()).inv().tolist(), dtype=object).reshape(matrix.shape)


def converter(
    exact_arithmetic: bool,
) -> Callable[[Annotated[np.ndarray, "..."]], Annotated[np.ndarray, "..."]]:
    """Return the map from arrays of either kind to the kind of number asked for."""
    return exactly if exact_arithmetic else as_floats


def eye(size: int, like: Matrix) -> Matrix:
    """Return the identity in the kind of number of `like`."""
    return exactly(np.eye(size)) if is_exact(like) else np.eye(size)


def product(first: Matrix, second: Matrix) -> Matrix:
    """Return first @ second; rationals are multiplied by FLINT.

    >>> product(exactly(np.eye(2)), exactly(np.array([[0.5], [2.0]]))).tolist()
    [[1/2], [2]]
    """
    if not (is_exact(first) and is_exact(second)) or 0 in (*first.shape, *second.shape):
        return first @ second if first.shape[1] else zeros(len(first), second.shape[1], first)
    return np.array((fmpq_mat(first.tolist()) * fmpq_mat(second.tolist())).tolist(), dtype=object)


def zeros(rows: int, columns: int, like: Matrix) -> Matrix:
    """Return zeros in the kind of number of `like`."""
    return np.full((rows, columns), fmpq(0), dtype=object) if is_exact(like) else np.zeros((rows, columns))


def block_diagonal(*blocks: Matrix) -> Matrix:
    """Return diag(M_1, M_2, ...) in the kind of number of the first.

    >>> block_diagonal(np.eye(1), np.full((1, 2), 3.0)).tolist()
    [[1.0, 0.0, 0.0], [0.0, 3.0, 3.0]]
    """
    whole = zeros(sum(map(len, blocks)), sum(block.shape[1] for block in blocks), blocks[0])
    row = column = 0
    for block in blocks:
        whole[row : row + len(block), column : column + block.shape[1]] = block
        row, column = row + len(block), column + block.shape[1]
    return whole
