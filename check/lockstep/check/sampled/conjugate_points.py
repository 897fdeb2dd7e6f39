"""That a period holds no conjugate point: Gamma_11(t) is invertible for every t in [0, T_s], not at T_s alone.

Then, and only then, int |z|^2 - |w|^2 is negative for every w from rest, and the step of `lifting` is the true maximum.
Without it Gamma_11 may well be invertible at T_s: what the formulas then give is no bound of anything.

A part h of the period is so short that |exp(t H) - I| <= exp(h |H|) - 1 < 1 for t in [0, h], where Gamma(t) = exp(t H). E E'
and C_z'C_z are squares. Of two equal parts, held inputs being 0, the first reaches x from rest at the cost x' S^+ x, of
which the second gives back x' Q x at most: with S^1/2 Q S^1/2 < I the whole is negative, too, and so on by doubling. S and
Q may be singular: with diag(e) > 0 small, Q + diag(e) - (Q + diag(e)) S (Q + diag(e)) > 0 says more.
"""

from contextlib import suppress

import numpy as np
from flint import arb

from lockstep.check.numbers import Matrix, exactly
from lockstep.check.sampled.balls import BITS, is_positive_definite, product, working_precision
from lockstep.check.sampled.lifting import Lifted, halvings_to, lift

SHORT = 0.5
"""h |H|, the norm the largest sum of a row: ln 2 would do."""

MOST_HALVINGS, LOST = 200, 16
"""A period with states in m beside Pa is halved some thirty times. And bits taken for each: with fewer, states in units 2^80
apart are refused."""

SLIGHT = 2.0**-60
"""e_k S_kk: by so little a period just below a conjugate point may be refused."""


def lifted_if_regular(A: Matrix, B: Matrix, EE: Matrix, CC: Matrix, period: float) -> Lifted | None:
    """Return what `lift` does in balls; None unless it is shown that the period holds no conjugate point.

    >>> one, zero, none = exactly(np.eye(1)), exactly(np.zeros((1, 1))), exactly(np.zeros((1, 0)))
    >>> [lifted_if_regular(zero, none, one, one, T) is None for T in (1.5, 1.6)]  # cos t = 0 at pi / 2
    [False, True]
    """
    n = len(A)
    whole = np.block([[-A.T, -CC[:n, :n]], [EE, A]])
    sizes = np.array([float(arb(entry).abs_upper()) for entry in whole.ravel()]).reshape(whole.shape)
    # With inputs in units so small that Gamma_11, which holds B', is not inverted in these balls there is no period.
    with suppress(ZeroDivisionError, np.linalg.LinAlgError):
        halvings = halvings_to(SHORT, sizes, period)
        if halvings > MOST_HALVINGS or period / 2**halvings * 2**halvings != period:
            return None
        with working_precision(BITS + LOST * halvings):
            one = lift(A, B, EE, CC, period / 2**halvings)
            for _ in range(halvings):
                reached = np.array([float(arb(S_kk).abs_upper()) for S_kk in one.BB_d.diagonal()])
                Q = one.CC_d[:n, :n] + exactly(np.diag(SLIGHT / np.where(reached > 0, reached, 1.0)))
                if not is_positive_definite(Q - product(Q, one.BB_d, Q)):
                    return None
                one = one.twice()
            return one
    return None
