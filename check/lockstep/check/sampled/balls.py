"""Matrices of real balls: each entry an interval that is sure to hold the real number it stands for.

A ball matrix is an object array of `flint.arb` (and of `fmpq`, where an entry is exact), so that the same assembly code
runs on doubles for the search and on balls for the proof.
"""

from contextlib import AbstractContextManager
from typing import Any

import flint
import numpy as np
from flint import arb, arb_mat

from lockstep.check.numbers import Matrix, is_exact
from lockstep.check.psd import failing_pivot

BITS = 256
"""Working precision: a 14 x 14 loop at 5 ms loses some 40 bits in the exponential, the inverse and the pivots."""


def working_precision(bits: int = BITS) -> AbstractContextManager[None]:
    """Compute with so many bits, and with what was set before afterwards."""
    return flint.ctx.workprec(bits)


def product(first: Matrix, *others: Matrix) -> Matrix:
    """Return the product of matrices, from left to right; balls are multiplied by FLINT.

    >>> product(np.eye(2), 3 * np.eye(2)).tolist()
    [[3.0, 0.0], [0.0, 3.0]]
    """
    total = first
    for other in others:
        if not (is_exact(total) or is_exact(other)):
            total = total @ other
        elif 0 in (*total.shape, *other.shape):
            total = np.full((len(total), other.shape[1]), arb(0), dtype=object)
        else:
            total = _array(_balls(total) * _balls(other))
    return total


def exponential(matrix: Matrix) -> Matrix:
    """Return an enclosure of the exponential of a matrix of balls."""
    return _array(_balls(matrix).exp())


def inverse(matrix: Matrix) -> Matrix:
    """Return the inverse, or an enclosure of it.

    Raises:
        ZeroDivisionError: the balls hold a singular matrix, or might.
        numpy.linalg.LinAlgError: the doubles are singular.
    """
    if not is_exact(matrix):
        return np.linalg.inv(matrix)
    return matrix if not len(matrix) else _array(_balls(matrix).inv())


def midpoints(matrix: Matrix) -> Matrix:
    """Return the nearest doubles of a ball matrix's midpoints."""
    return np.array([float(arb(value).mid()) for value in matrix.ravel()], dtype=float).reshape(matrix.shape)


def is_positive_definite(matrix: Matrix) -> bool:
    """Tell whether every symmetric matrix in the balls is shown to be positive definite, by L D L'.

    Only the lower triangle is read. True is a proof: each pivot, an enclosure of the true one, lies above 0. False says
    that some pivot does not, so that the matrix is either not positive definite or too near the edge for this
    precision.

    >>> is_positive_definite(np.array([[arb(2), arb(1)], [arb(1), arb(1)]], dtype=object))
    True
    >>> is_positive_definite(np.array([[arb(1), arb(1)], [arb(1), arb(1)]], dtype=object))
    False
    """
    return failing_pivot(_balls(matrix).tolist()) is None


def _balls(matrix: Matrix) -> Any:
    return arb_mat([[arb(value) for value in row] for row in matrix.tolist()])


def _array(balls: Any) -> Matrix:
    return np.array(balls.tolist(), dtype=object).reshape(balls.nrows(), balls.ncols())
