"""Sets of starts whose size has the unit of each state: half-axes a of an ellipsoid, for a witness that is given.

A ball |x_d(0)| <= r adds metres and metres per second, and is no larger than the least of them allows. With V <= c proved by
a witness and L L' = (T T')^-1,

    sum_i sum_k ((x_ik - mean_k) / a_k)^2 <= 1   lies in   V <= c   where   lambda_max(A S A) <= c,   A = I (x) diag(a),
    S = (L^-1 (x) I) P_d (L^-1 (x) I)'.

That is linear in b_k = a_k^-2, and sum_k w_k b_k is the least where, with w_k = sum_i (x_ik(0) - mean_k)^2, the start in the
file is covered most times. A state that counts for nothing there would be left no room: each has a small w_k besides, in the
unit of what V <= c allows it alone. Without a start all count alike.
"""

import math

import numpy as np
from flint import arb
from jaxtyping import Float

from lockstep.check.numbers import exactly
from lockstep.check.sampled import balls
from lockstep.check.sampled.inequality import Witness, metric
from lockstep.check.sampled.inputs.input_limits import level, reaches, seen_columns
from lockstep.check.sampled.inputs.saturation import ClippedWitness
from lockstep.check.sampled.loop import SampledLoop
from lockstep.lmi.analysis.certificate_sdp import solve_sdp
from lockstep.lmi.analysis.covered_start import Away, times_covered
from lockstep.lmi.analysis.decimals import round_down

SHARE = 0.03
"""What each state counts besides its share of the start, of which all together are 1."""

WORTH, FAR = 1.5, 10.0
"""An ellipsoid is told beside a ball if it holds so many times what the ball does of the start, or so many of some state."""

ROOM = 0.995
"""Of the half-axes found: for rounding."""

Sizes = Float[np.ndarray, " n"]
ONE = np.ones(1)
"""All states are of size 1."""


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
    with balls.working_precision():
        storage, c, K = _level_of(exact_loop, witness, limits)
        away = np.zeros((1, len(exact_loop.network.plant.A))) if away is None else away
        a = largest_half_axes(K, storage.P[: len(K), : len(K)], float(c.mid()), away, radius)
        return a if a and reaches(exact_loop, storage, c, a) else None


def largest_multiple(
    exact_loop: SampledLoop,
    witness: Witness | ClippedWitness,
    limits: Float[np.ndarray, " m"],
    sizes: Sizes = ONE,
) -> tuple[float, tuple[float, ...]]:
    """Return the largest multiple of the sizes that V <= c of a witness holds, and these half-axes: 0 where it holds none.

    Decided in balls, but for the witness, which is taken as proved.
    """
    from scipy.linalg import eigvalsh

    with balls.working_precision():
        storage, c, K = _level_of(exact_loop, witness, limits)
        S = np.diag(np.resize(sizes, len(K)))
        largest = eigvalsh(S @ storage.P[: len(K), : len(K)] @ S, K)[-1]
        most = round_down(ROOM * math.sqrt(max(float(c.mid()), 0.0) / largest))
        a = tuple(np.resize(most * sizes, len(exact_loop.network.plant.A)).tolist())
        return (most, a) if reaches(exact_loop, storage, c, a) else (0.0, a)


def _level_of(
    loop: SampledLoop, witness: Witness | ClippedWitness, limits: Float[np.ndarray, " m"]
) -> tuple[Witness, arb, Float[np.ndarray, "n_d n_d"]]:
    """Return the storage of a witness, the level c up to which it holds, and (T T')^-1 (x) I."""
    K = balls.midpoints(metric(loop))
    if isinstance(witness, ClippedWitness):
        rows = loop.computed[:, : loop.n_x] - exactly(witness.h)
        return witness.storage, level(loop, witness.storage, limits, rows), K
    return witness, level(loop, witness, limits, loop.computed[:, seen_columns(loop)]), K


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
    import cvxpy as cp

    n, inverse = away.shape[1], np.linalg.inv(np.linalg.cholesky(K))
    with np.errstate(over="ignore", invalid="ignore"):
        S = inverse @ P @ inverse.T / c
    if not np.isfinite(S).all():
        return None
    alone = np.array([np.linalg.eigvalsh(S[k::n, k::n])[-1] ** -0.5 for k in range(n)])

    def all_of(a: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n_d n_d"]:
        A = np.tile(a, len(S) // n)
        return np.asarray(A[:, None] * S * A)

    share = (np.linalg.norm(away / (np.abs(away).max() or 1.0), axis=0) / alone) ** 2
    b, least = cp.Variable(n), SHARE + share / (share.sum() or 1.0)
    inside = cp.diag(cp.hstack([b] * (len(S) // n))) - all_of(alone) >> 0
    solved = solve_sdp(cp.Problem(cp.Minimize(least @ b), [inside]))
    a = alone / np.sqrt(b.value) if solved and (b.value > 0).all() else alone
    a = ROOM * a * np.linalg.eigvalsh(all_of(a))[-1] ** -0.5
    if not (np.isfinite(a).all() and (a > 0).all()):
        return None
    found = tuple(round_down(float(one), 3) for one in a)
    ball = times_covered(radius, None, away)
    further = bool(ball) and times_covered(None, found, away) >= WORTH * ball
    return found if further or max(found) >= FAR * radius else None
