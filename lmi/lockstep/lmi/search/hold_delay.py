"""Starts for a long period: gains for the loop with the delay that sampling and holding put into it.

The continuous loop with the least rho may be far too fast for its period. Held outputs come half a period late on the
mean, and a period more for each period of delay (Franklin, Powell and Workman, Digital Control of Dynamic Systems, 1998,
section 6.3). With B_i = F b_i, and this lag tau as a Pade approximant of order one, (2/tau - s) / (2/tau + s),

    x' = A x + F z - B_i u + G phi + xi,      z' = -(2/tau) z + (4/tau) b_i u,

whose smoothed norm is lowered in place of the loop's own: what it is small for, the period carries.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from lockstep.check.continuous.inequality import Claim
from lockstep.check.system.loop import Loop, Plant, build_loop
from lockstep.lmi.analysis.gain_limit import limited
from lockstep.lmi.search.random_start import INSIDE, STABLE, GainSearch, Score, StartResult, scored
from lockstep.lmi.search.smoothed_norm import SmoothedNorm, norm_descent, refined_to_maximum
from lockstep.lmi.search.stabilise import abscissa, stabilise
from lockstep.lmi.search.stopping import NEVER, Deadline

LATER = (1.0, 2.0, 4.0, 8.0)
"""How many times the lag is tried, until the sampled loop has a certificate: on the mean is not at the worst instant."""

ABSENT = 1e-12
"""A singular value of the inputs, relative to the largest, that is rounding."""


def with_input_delay(loop: Loop, claim: Claim, lag: float) -> tuple[Loop, Claim]:
    """Return the loop with its inputs late by `lag`, in its unit of time, and the claim; z has no weight and no xi.

    Args:
        loop: in units of the search, gains in those of the file.
        claim: of that loop.
        lag: tau.
    """
    plant, n_d = loop.plant, loop.E.shape[1]
    basis, sizes, _ = np.linalg.svd(np.hstack(plant.B))
    F = basis[:, : len(sizes)][:, sizes > ABSENT * max(float(sizes.max(initial=0.0)), 1e-300)]
    n, k = F.shape
    pole = 2 / lag
    whole = Plant(
        np.block([[plant.A, F], [np.zeros((k, n)), -pole * np.eye(k)]]),
        tuple(np.vstack([-B, 2 * pole * F.T @ B]) for B in plant.B),
        np.hstack([plant.C, np.zeros((len(plant.C), k))]),
        np.vstack([plant.G, np.zeros((k, plant.G.shape[1]))]),
        np.hstack([plant.H, np.zeros((len(plant.H), k))]),
    )
    found = build_loop(whole, loop.d, loop.order)
    E = np.zeros_like(found.E)
    late_n_d = E.shape[1]
    for U, Y, U_C, Y_C in zip(found.U, found.Y, loop.U, loop.Y, strict=True):
        U[late_n_d:], Y[:, late_n_d:] = U_C[n_d:], Y_C[:, n_d:]
    own = np.flatnonzero(np.arange(late_n_d) % (n + k) < n)
    E[np.ix_(own, own)] = loop.E[:n_d]
    R = np.zeros((n + k, n + k))
    R[:n, :n] = claim.R
    states = np.concatenate([claim.states if len(claim.states) else np.ones(n), np.zeros(k)])
    return replace(found, E=E), replace(claim, R=R, states=states)


def delayed_norm(search: GainSearch, more: float = 1.0) -> SmoothedNorm:
    """Return the smoothed norm of the loop with its inputs late, by `more` times the lag."""
    loop, claim = with_input_delay(search.loop, search.claim, more * search.lag / search.units.time)
    return SmoothedNorm(loop, claim, search.gain_limit, search.units.gains, rate=search.rate)


def for_delay(
    search: GainSearch, score: Score | None, start: StartResult, deadline: Deadline = NEVER
) -> tuple[StartResult, StartResult | None]:
    """Return a start with its gains made for the late loop, or as it is where that made what ships worse; and a second one.

    Where no lag leaves a sampled certificate, the second has the gains made for the first lag: a design for the period starts
    better from them than from gains that know of no period. None elsewhere.
    """
    K, limit, found, late = start.at.K, search.gain_limit, start, None
    own_rate: dict[str, Any] = {"rate": search.rate, "time": search.units.time}
    for more in LATER:
        if deadline.over or start.abscissa >= 0:
            break
        norm = delayed_norm(search, more)
        if abscissa(norm.loop, K, **own_rate)[0] >= 0:
            K = stabilise(norm.loop, K, STABLE * limit, units=search.units.gains, **own_rate)[0]
            K = limited(K, INSIDE * limit)
        if abscissa(norm.loop, K, **own_rate)[0] >= 0:
            break
        made = norm_descent(norm, K)
        if np.isfinite(made.rho):
            made = refined_to_maximum(norm, made)
        K, own, x = made.K, search.norm, search.norm.pack(made.K, made.w)
        square = own.level(x, None, own.frequencies(x)) if np.isfinite(made.rho) else np.inf
        held = scored(search, score, replace(start, at=replace(made, rho=float(np.sqrt(square)))))
        found = min(found, held, key=lambda one: one.rank)
        if np.isfinite(found.sampled):
            return found, None
        late = late or held
    return found, late if late is not None and np.isfinite(late.at.rho) else None
