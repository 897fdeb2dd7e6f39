"""Sets of starts whose size has the unit of each state: half-axes a of an ellipsoid, for a witness that is given.

A ball |x_d(0)| <= r adds metres and metres per second, and is no larger than the least of them allows. With V <= c proved by
a witness and L L' = (T T')^-1,

    sum_i sum_k ((x_ik - mean_k) / a_k)^2 <= 1   lies in   V <= c   where   lambda_max(A S A) <= c,   A = I (x) diag(a),
    S = (L^-1 (x) I) P_d (L^-1 (x) I)'.

Where the problem names a start, a is first in proportion to how far apart it has the states; a state in which it has all
agents alike gets what the last tenth leaves. Without one, a is in proportion to what V <= c allows each state alone.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from lockstep.check.numbers import exactly
from lockstep.check.sampled import balls
from lockstep.check.sampled.inequality import Witness, metric
from lockstep.check.sampled.inputs.input_limits import level, reaches, seen_columns
from lockstep.check.sampled.inputs.saturation import ClippedWitness
from lockstep.check.sampled.loop import SampledLoop
from lockstep.lmi.analysis.decimals import round_down

PART = 0.9
"""Of the start's multiple, where some states are alike at the start: what the others give up for these."""

WORTH = 1.5
"""An ellipsoid is told beside a ball if it holds so many times what the ball does: of the start, or of some state."""

ROOM = 0.995
"""Of the half-axes found: for rounding."""

Away = Float[np.ndarray, "N n"] | None
"""x_i(0) - mean of each agent, where a problem names a start."""


def multiple(radius: float | None, half_axes: Sequence[float] | None, away: Away) -> float:
    """Return how many times a start lies in a ball or in an ellipsoid, the larger; 0 without a start or a set.

    >>> multiple(1.0, (4.0, 0.5), np.array([[2.0, 0.0], [-2.0, 0.0]])).__round__(3)
    1.414
    """
    if away is None or not away.any():
        return 0.0
    sizes = [np.full(away.shape[1], radius)] if radius else []
    sizes += [np.array(half_axes)] if half_axes else []
    return max((float(1 / np.linalg.norm(away / a)) for a in sizes), default=0.0)


def half_axes(
    exact_loop: SampledLoop,
    witness: Witness | ClippedWitness,
    limits: Float[np.ndarray, " m"],
    radius: float,
    away: Away,
) -> tuple[float, ...] | None:
    """Return half-axes that a witness of a ball proves as well, decided in balls; None where they add little.

    Args:
        exact_loop: assembled from the controllers as in the code.
        witness: of the loop while no input meets its limit, or of the clipped one.
        limits: (m,) of each agent's inputs.
        radius: of the ball that it proves.
        away: of the start, if there is one.
    """
    storage, rows = witness, exact_loop.computed[:, seen_columns(exact_loop)]
    if isinstance(witness, ClippedWitness):
        storage, rows = witness.storage, exact_loop.computed[:, : exact_loop.n_x] - exactly(witness.h)
    assert isinstance(storage, Witness)
    with balls.working_precision():
        c, K = level(exact_loop, storage, limits, rows), balls.midpoints(metric(exact_loop))
        away = np.zeros((1, len(exact_loop.network.plant.A))) if away is None else away
        a = largest_half_axes(K, storage.P[: len(K), : len(K)], float(c.mid()), away, radius)
        return a if a and reaches(exact_loop, storage, c, a) else None


def largest_half_axes(
    K: Float[np.ndarray, "n_d n_d"],
    P: Float[np.ndarray, "n_d n_d"],
    c: float,
    away: Float[np.ndarray, "N n"],
    radius: float,
) -> tuple[float, ...] | None:
    """Return a with lambda_max(A S A) = c > 0, a little less for rounding; None where it adds little to a ball.

    away: x_i - mean at a start, 0 where there is none.
    """
    from scipy.optimize import brentq

    inverse = np.linalg.inv(np.linalg.cholesky(K))
    S, n = inverse @ P @ inverse.T, away.shape[1]
    spread = np.linalg.norm(away, axis=0)

    def size(a: Float[np.ndarray, " n"]) -> float:
        A = np.tile(a, len(S) // n)
        return float(np.linalg.eigvalsh(A[:, None] * S * A)[-1]) / c

    alone = np.array([(np.linalg.eigvalsh(S[k::n, k::n])[-1] / c) ** -0.5 for k in range(n)])
    if not spread.any() or spread.all():
        a = spread if spread.any() else alone
        a = a * size(a) ** -0.5
    else:
        first, rest = PART * spread * size(spread) ** -0.5, np.where(spread > 0, 0.0, alone)
        a = first + rest * brentq(lambda part: size(first + part * rest) - 1, 0.0, 1.0)
    found = tuple(round_down(ROOM * float(one), 3) for one in a)
    ball = multiple(radius, None, away)
    more = multiple(None, found, away) / ball if ball else max(found) / radius
    return found if more >= WORTH else None
