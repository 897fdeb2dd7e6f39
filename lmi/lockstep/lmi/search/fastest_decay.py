"""Gains whose loop decays faster: objective "decay".

    sigma(K)   the largest sigma for which the loop of e^(sigma t) x_cl, with gains K, has a certificate

Holding a sigma just below sigma(K), a run of the nonlinear program lowers rho of that loop: what its gains then have to
spare is a larger sigma. The P of the decay is one of its own, and rho of the loop itself is looked at after each run. Nothing
here is trusted.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from lockstep.lmi.analysis.certificate_sdp import least_rho
from lockstep.lmi.search.barrier import BarrierPoint, NewtonLimits
from lockstep.lmi.search.random_start import GainSearch, Score
from lockstep.lmi.search.stopping import NEVER, Deadline
from lockstep.lmi.shapes import GainBlocks

RUNS = 8
"""At most so many runs of the nonlinear program."""

NEWTON_STEPS = 100
"""For each weight of the barrier, in one run."""

HELD = 0.97
"""The part of sigma(K) that a run holds: at sigma(K) itself there is no room to begin in."""

PARTS = (1.0, 0.5, 0.25)
"""Of the way to the gains of a run, the first with more decay and with rho within its limit."""

WORTHWHILE = 0.01
"""A run that raises sigma by less than this part of it is the last."""

HALVINGS = 8
"""Of the range of sigma."""

Decaying = Callable[[float], GainSearch]
"""The search for the loop of e^(sigma t) x_cl."""


def raised_decay(
    at: Decaying, K: GainBlocks, *, rho: float, score: Score | None, deadline: Deadline = NEVER
) -> GainBlocks:
    """Return gains with a larger sigma, or K.

    Args:
        at: the loop by decay.
        K: gains with a certificate, in the units of the file.
        rho: the largest one allowed, in these units.
        score: of the sampled loop: gains without a finite one are passed over.
        deadline: after which the best so far is returned.
    """
    sigma = largest_decay(at, K, deadline=deadline)
    for _ in range(RUNS):
        search = at(HELD * sigma)
        start = None if deadline.over else least_rho(search.loop, K, search.claim)
        if start is None:
            break
        steps = NewtonLimits(NEWTON_STEPS, deadline=deadline)
        trial = search.program.improve(BarrierPoint(K, start), "rho", steps).K
        before = sigma
        for part in PARTS:
            new = K + part * (trial - K)
            if deadline.over or not _ships(at(0.0), new, rho, score):
                continue
            if (faster := largest_decay(at, new, least=sigma, deadline=deadline)) > sigma:
                K, sigma = new, faster
                break
        if sigma < (1 + WORTHWHILE) * before:
            break
    return K


def largest_decay(at: Decaying, K: GainBlocks, *, least: float = 0.0, deadline: Deadline = NEVER) -> float:
    """Return sigma(K), by bisection between `least` and what the linear loop has; `least` where not even that holds."""
    search = at(0.0)
    low, high = least, -float(np.linalg.eigvals(search.loop.A_cl(K)).real.max()) / search.units.time
    for _ in range(HALVINGS if high > low else 0):
        if deadline.over:
            break
        middle = (low + high) / 2
        one = at(middle)
        low, high = (middle, high) if least_rho(one.loop, K, one.claim) is not None else (low, middle)
    return low


def _ships(search: GainSearch, K: GainBlocks, rho: float, score: Score | None) -> bool:
    """Tell whether gains keep to the largest rho, and to a sampled loop that has one."""
    found = least_rho(search.loop, K, search.claim)
    if found is None or search.units.rho * found.rho > rho:
        return False
    if score is None:
        return True
    weights = search.units.certificate(replace(found, P=np.zeros((search.loop.n_x,) * 2))).pair_weights
    return bool(np.isfinite(score(K, weights)))
