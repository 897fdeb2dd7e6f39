"""That a period holds no conjugate point: Gamma_11(t) is invertible for every t in [0, T_s], not at T_s alone.

Then, and only then, int |z|^2 - |w|^2 is negative for every w from rest, and the step of `lifting` is the true maximum.
Without it Gamma_11 may well be invertible at T_s: what the formulas then give is no bound of anything.

[0, T_s] is cut into pieces; on each, Gamma(t) is enclosed for all t at once, and no matrix in the enclosure of Gamma_11 is
singular if FLINT inverts the enclosure, whose answer is for every matrix in it. It is asked of near Gamma_11, with near
the inverse of the midpoint: almost an identity, whatever units the states are in, and singular where Gamma_11 is.
"""

import numpy as np
from flint import arb

from lockstep.check.numbers import Matrix, as_floats, exact, exactly
from lockstep.check.sampled.balls import exponential, inverse, midpoints, product, working_precision
from lockstep.check.sampled.lifting import Lifted, lift

MOST_PIECES = 1024
"""Pieces tried before giving up; one to sixteen are enough for periods a controller is sampled with."""

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
    with working_precision():
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


def lifted_if_regular(A: Matrix, B: Matrix, EE: Matrix, CC: Matrix, period: float) -> Lifted | None:
    """Return what `lift` does in balls; None unless it is shown that the period holds no conjugate point."""
    if not no_conjugate_point(A, EE, CC[: len(A), : len(A)], period):
        return None
    try:
        return lift(A, B, EE, CC, period)
    except (
        ZeroDivisionError
    ):  # inputs in units so small that Gamma_11, which holds B', is not inverted in these balls
        return None


def _is_regular(balls: Matrix) -> bool:
    """Tell whether no matrix in the balls is singular: FLINT inverts them all, times the inverse of the midpoint."""
    centre = midpoints(balls)
    if not np.isfinite(centre).all():
        return False
    try:
        inverse(product(inverse(exactly(centre)), balls))
    except ZeroDivisionError:
        return False
    return True
