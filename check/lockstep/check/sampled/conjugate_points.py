"""That a period holds no conjugate point: Gamma_11(t) is invertible for every t in [0, T_s], not at T_s alone.

Then, and only then, int |z|^2 - |w|^2 is negative for every w from rest, and the step of `lifting` is the true maximum.
Without it Gamma_11 may well be invertible at T_s: what the formulas then give is no bound of anything.

[0, T_s] is cut into pieces; on each, Gamma(t) is enclosed for all t at once, and |I - near Gamma_11| < 1 for some matrix
near its inverse shows that no matrix in the enclosure is singular. That is done for D_b Gamma D_b^-1 with a diagonal D_b,
whose part is as regular as Gamma_11: norms are to be of the loop, not of the units that its states are in.
"""

import math

import numpy as np
from flint import arb

from lockstep.check.numbers import Matrix, as_floats, exact, exactly, eye
from lockstep.check.sampled.balls import exponential, inverse, midpoints, product

MOST_PIECES = 1024
"""Pieces tried before giving up; one to sixteen are enough for periods a controller is sampled with."""

SWEEPS, LARGEST_POWER = 8, 100
"""Over all rows, and of two in one step: two or three settle it, others would prove the same with other pieces."""

NARROWEST = 1e-5
"""A piece this short, relative to the period, that is still not settled holds a conjugate point or next to one."""


def no_conjugate_point(A: Matrix, EE: Matrix, CC: Matrix, period: float) -> bool:
    """Prove that Gamma_11 is invertible on [0, T_s]; False if it is not, or not shown to be.

    Held inputs do not enter: they leave Gamma_11 block triangular with an identity.

    >>> from lockstep.check.numbers import exactly
    >>> one, zero = exactly(np.eye(1)), exactly(np.zeros((1, 1)))
    >>> no_conjugate_point(zero, one, one, 1.5), no_conjugate_point(zero, one, one, 1.6)  # cos t = 0 at pi / 2
    (True, False)
    """
    n = len(A)
    whole = np.block([[-A.T, -CC], [EE, A]])
    if not np.isfinite(as_floats(whole)).all():
        return False
    whole = _balanced(whole)
    end = exact(period)
    pieces = [(end * 0, end)]
    for _ in range(MOST_PIECES):
        if not pieces:
            return True
        low, high = pieces.pop()
        middle, radius = (low + high) / 2, (high - low) / 2
        # Gamma(t) = Gamma(t - middle) Gamma(middle): the wide factor is near the identity.
        wide = exponential(arb(0, arb(radius).upper()) * whole)
        here = product(wide, exponential(middle * whole)[:, :n])[:n]
        if _is_regular(here):
            continue
        if arb(radius) < arb(NARROWEST) * arb(end):
            return False
        pieces += [(low, middle), (middle, high)]
    return False


def _balanced(matrix: Matrix) -> Matrix:
    """Return it between D_b and D_b^-1, powers of two such that a row sums up to about what its column does (Osborne 1960).

    >>> midpoints(_balanced(np.array([[0.0, 1.0], [-65536.0, -1.0]])))
    array([[   0.,  256.],
           [-256.,   -1.]])
    """
    sizes, d = np.abs(midpoints(exactly(matrix))), np.ones(len(matrix))
    np.fill_diagonal(sizes, 0.0)
    for k in [*range(len(matrix))] * SWEEPS:
        row, column = sizes[k].sum(), sizes[:, k].sum()
        if 0 < row < math.inf and 0 < column < math.inf:
            power = round((math.log2(column) - math.log2(row)) / 2)
            factor = 2.0 ** min(max(power, -LARGEST_POWER), LARGEST_POWER)
            d[k], sizes[k], sizes[:, k] = d[k] * factor, sizes[k] * factor, sizes[:, k] / factor
    return np.asarray(exactly(d)[:, None] * exactly(matrix) / exactly(d))


def _is_regular(balls: Matrix) -> bool:
    """Tell whether no matrix in the balls is singular: |I - near matrix|_inf < 1 with near the inverse of the midpoint."""
    centre = midpoints(balls)
    if not np.isfinite(centre).all():
        return False
    try:
        near = midpoints(inverse(exactly(centre)))
    except ZeroDivisionError:
        return False
    if not np.isfinite(near).all():
        return False
    rest = eye(len(near), balls) - product(exactly(near), balls)
    return all(sum((abs(arb(value)) for value in row), start=arb(0)) < 1 for row in rest)
