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
from collections.abc import Sequence
from typing import Any

import numpy as np
from flint import arb
from jaxtyping import Float

from lockstep.check.continuous.initial_set import axes_text
from lockstep.check.design_file.claims import SampledClaims
from lockstep.check.numbers import exactly
from lockstep.check.sampled import balls
from lockstep.check.sampled.inequality import Witness, metric
from lockstep.check.sampled.inputs.input_limits import level, reaches, seen_columns
from lockstep.check.sampled.inputs.saturation import ClippedWitness
from lockstep.check.sampled.loop import SampledLoop
from lockstep.lmi.analysis.certificate_sdp import solve_sdp
from lockstep.lmi.analysis.decimals import round_down
from lockstep.model.checks.plausibility import initial_deviations
from lockstep.model.problem import Problem

SHARE = 0.03
"""What each state counts besides its share of the start, of which all together are 1."""

WORTH, FAR = 1.5, 10.0
"""An ellipsoid is told beside a ball if it holds so many times what the ball does of the start, or so many of some state."""

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
    return max((1 / math.hypot(*(away / a).ravel()) for a in sizes), default=0.0)


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
    half_axes: Float[np.ndarray, " n"],
) -> float:
    """Return the largest multiple of half-axes that a witness proves, decided in balls; 0 where it proves none."""
    from scipy.linalg import eigvalsh

    with balls.working_precision():
        storage, c, K = _level_of(exact_loop, witness, limits)
        A = np.tile(half_axes, len(K) // len(half_axes))
        size = eigvalsh(A[:, None] * storage.P[: len(K), : len(K)] * A, K)[-1]
        most = round_down(ROOM * float((float(c.mid()) / size) ** 0.5))
        return most if reaches(exact_loop, storage, c, tuple((most * half_axes).tolist())) else 0.0


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
    S = inverse @ P @ inverse.T / c
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
    found = tuple(round_down(float(one), 3) for one in a)
    ball = multiple(radius, None, away)
    further = bool(ball) and multiple(None, found, away) >= WORTH * ball
    return found if further or max(found) >= FAR * radius else None


def limits_answer(claims: SampledClaims, problem: Problem) -> dict[str, Any]:
    """Return what is claimed of limits, |x_d(0)| of the start in the file, and how many times that start is covered."""
    sets = {
        "": (claims.radius, claims.half_axes),
        "clipped_": (claims.clipped_radius, claims.clipped_half_axes),
    }
    found: dict[str, Any] = {"gain": claims.limits_gain}
    away, agent = initial_deviations(problem), problem.file.agent
    for name, (radius, axes) in sets.items():
        found[f"{name}radius"] = radius
        if axes:
            found[f"{name}half_axes"] = dict(zip(agent.states, axes, strict=True))
            found[f"{name}text"] = axes_text(axes, agent.states, agent.units)
        found[f"{name}times_start"] = round_down(multiple(radius, axes, away), 3) or None
    found = {key: one for key, one in found.items() if one is not None}
    if found and away is not None:
        found["start"] = math.hypot(*away.ravel())
    return found
