"""Matrices of intervals over many boxes at once: pairs of arrays rows x columns x boxes, rounded outwards."""

import numpy as np

from lockstep.check.bound import intervals
from lockstep.check.bound.intervals import Interval


def stacked(values: list[Interval], rows: int) -> Interval:
    """Return enclosures, row by row, as one matrix per box."""
    low, high = (np.array([value[side] for value in values]) for side in (0, 1))
    return low.reshape(rows, -1, low.shape[-1]), high.reshape(rows, -1, high.shape[-1])


def product(first: Interval, second: Interval) -> Interval:
    """Return first @ second, box by box."""
    total: Interval | None = None
    for k in range(second[0].shape[0]):
        term = intervals.multiply(
            (first[0][:, k, None], first[1][:, k, None]), (second[0][None, k], second[1][None, k])
        )
        total = term if total is None else intervals.add(total, term)
    assert total is not None
    return total


def thin(matrix: np.ndarray) -> Interval:
    """Return doubles, boxes first, as matrices of points."""
    moved = np.moveaxis(np.asarray(matrix, dtype=float), 0, -1)
    return moved, moved


def transposed(matrix: Interval) -> Interval:
    """Return the transposes."""
    return matrix[0].swapaxes(0, 1), matrix[1].swapaxes(0, 1)


def row_sums(values: np.ndarray) -> np.ndarray:
    """Return an upper bound of the sum over the second axis of numbers that are not negative."""
    total = np.zeros((values.shape[0], values.shape[2]))
    for k in range(values.shape[1]):
        total = intervals.up(total + values[:, k])
    return total


def middle(matrix: Interval) -> np.ndarray:
    """Return the middles, boxes first; 0 where an entry has none."""
    with np.errstate(all="ignore"):
        value = 0.5 * matrix[0] + 0.5 * matrix[1]
    return np.moveaxis(np.where(np.isfinite(value), value, 0.0), -1, 0)


def positive_definite(matrix: Interval) -> np.ndarray:
    """Return on which boxes every symmetric matrix in the enclosure is positive definite: sufficient, never wrong.

    With Q the eigenvectors of the middle, in doubles, the congruence Q' M Q is shown to be strictly diagonally dominant with
    a positive diagonal. That says that Q is invertible, and that M is positive definite (Gershgorin; Horn and Johnson 2013,
    theorem 6.1.10).
    """
    centre = middle(matrix)
    _, vectors = np.linalg.eigh(0.5 * (centre + centre.swapaxes(1, 2)))
    Q = thin(vectors)
    with np.errstate(all="ignore"):
        turned = product(product(transposed(Q), matrix), Q)
        off = intervals.magnitude(turned)
        size = off.shape[0]
        off[range(size), range(size)] = 0.0
        diagonal = turned[0][range(size), range(size)]
        held = diagonal > row_sums(off)
    return np.asarray(held.all(axis=0))
