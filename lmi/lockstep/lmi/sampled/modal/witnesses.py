"""Witnesses mode by mode are looked for here, in doubles: `check.sampled.modes` decides.

With rho the lifted period depends on mu and rho, which are searched one at a time. The prices of errors follow from P.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import chain

import numpy as np

from lockstep.check.continuous.inequality import Performance
from lockstep.check.sampled.certificate import SampledVerdict, refused
from lockstep.check.sampled.inequality import root
from lockstep.check.sampled.modes import (
    ModalLoop,
    SampledModalWitness,
    decide_modal_sampled,
    proves_modal_rho,
)
from lockstep.lmi.sampled.modal.error_multipliers import priced_modal_witness
from lockstep.lmi.sampled.modal.mode import ModalSetting
from lockstep.lmi.sampled.modal.storage import CLAIMED, linear_loss, quiet_storages, storages_of
from lockstep.lmi.sampled.period import longest_from

PRICES_OF_ROUNDING = (1.0, 10.0, 0.1, 100.0)
"""t in multiples of what makes an error e = delta Y x_cl cost as much entering, by E'P E, as leaving, by Y P^-1 Y'."""

SLACKS = (1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.3)
"""How far above the least rho found the proof is tried."""

SCALES = (0.0, -0.15, 0.15, -0.3, 0.3, 0.6, -0.6)
"""Powers of ten that the mu of the continuous certificate is tried with."""

MOST_RHO, FINENESS = 100.0, 2e-3
"""The sampled rho is looked for up to so many times the continuous one, and as finely as that."""

NEARLY_ALL = 0.98
"""The part of its decay that a V claims which is to decay fast: the rest is room for errors."""

RATES, FASTEST = (0.3, 0.1, 0.03, 0.01), (0.97, 0.9, 0.8, 0.65, 0.5)
"""How fast V is asked to decay, as parts of how fast the linear loop does: to pass little noise on, and as fast as it may."""

TRIES = 3
"""How many quiet witnesses are put to the proof."""

MOST_SEGMENTS = 8
"""Segments with a P each: a continuous certificate may have more."""


def certify_modal(
    loop: ModalLoop, ends: Sequence[float], weights: Performance, witness: SampledModalWitness | None = None
) -> SampledVerdict:
    """Prove the sampled loop mode by mode, or say why it could not be.

    Args:
        loop: identical controllers.
        ends: where segments end, each with a P of its own.
        weights: for scaling alone.
        witness: a candidate that is put to the proof before any is searched for.
    """
    if witness is not None:
        replayed = decide_modal_sampled(loop, witness)
        if replayed.certified:
            return replayed
    said, at = "no certificate was found mode by mode", f"at {loop.network.period:g} s"
    setting = ModalSetting(loop, _outside(loop, ends), weights)
    trials = [one for rate in RATES if (one := _decaying(setting, rate)) is not None]
    quietest = sorted(trials, key=_ultimate)[:TRIES]
    for one in chain(quietest, _of_any_noise(setting)):
        verdict = decide_modal_sampled(loop, one)
        if verdict.certified:
            return verdict
        said = verdict.reason
    return refused(loop.network, loop.controllers, f"{at} {said}")


def certify_modal_decay(
    loop: ModalLoop,
    ends: Sequence[float],
    weights: Performance,
    slow: float,
    known: SampledModalWitness | None,
    asked: float = 1.0,
) -> SampledVerdict | None:
    """Prove a decay of V that is less than `slow`, by a V of its own, a known witness being tried first; or None.

    asked: a factor of V in a period, below 1 if one is asked for: tried as well.
    """
    setting = ModalSetting(loop, _outside(loop, ends), weights)
    own = (1 - asked) / (NEARLY_ALL * (linear_loss(setting) or np.inf))
    rates = sorted((rate for rate in {own, *FASTEST} if 0 < rate <= 1), reverse=True)
    for one in chain([known], (_decaying(setting, rate, NEARLY_ALL) for rate in rates)):
        if one is not None and one.decay < slow and (found := decide_modal_sampled(loop, one)).certified:
            return found
    return None


def _decaying(setting: ModalSetting, rate: float, claimed: float = CLAIMED) -> SampledModalWitness | None:
    """Return a witness that passes little noise on, of a V that shrinks by a part of what the linear loop does."""
    quiet = quiet_storages(setting, rate, claimed)
    if quiet is None:
        return None
    each = (priced_modal_witness(setting, quiet[2:], t, quiet[:2]) for t in PRICES_OF_ROUNDING)
    return next(chain.from_iterable(each), None)


def _ultimate(witness: SampledModalWitness) -> float:
    """Return sqrt(c kappa / (1 - decay)), by which witnesses are compared."""
    below_1 = witness.decay < 1
    return root(witness.ratio * witness.kappa / (1 - witness.decay)) if below_1 else math.inf


def _of_any_noise(setting: ModalSetting) -> Iterator[SampledModalWitness]:
    """Yield witnesses whose storage was not chosen for the noise that they pass on."""
    found = storages_of(setting)
    for dear in PRICES_OF_ROUNDING if found is not None else ():
        yield from priced_modal_witness(setting, found, dear)


def modal_rho(
    loop: ModalLoop, ends: Sequence[float], weights: Performance, mu: float, rho: float
) -> tuple[float, SampledModalWitness] | None:
    """Find and prove a small rho mode by mode, from mu and rho of the continuous certificate; None if none is proved."""
    ends = _outside(loop, ends)
    best: tuple[float, float] | None = None
    first = ModalSetting(loop, ends, weights)
    for scale in SCALES if len(ends) == 2 else SCALES[:1]:
        least_one = _least_rho(first, mu * 10**scale, rho, best)
        if least_one is not None and (best is None or least_one < best[0]):
            best = least_one, mu * 10**scale
    if best is None:
        return None
    for slack in SLACKS:
        setting = first.at(best[1], float(f"{best[0] * (1 + slack):.4g}"))
        found = storages_of(setting)
        if found is None or setting.rho is None:
            continue
        for dear in PRICES_OF_ROUNDING:
            for witness in priced_modal_witness(setting, found, dear):
                if proves_modal_rho(loop, weights, setting.rho, witness):
                    return setting.rho, witness
    return None


def _least_rho(
    setting: ModalSetting, mu: float, rho: float, best: tuple[float, float] | None
) -> float | None:
    """Bisect the least rho for a mu; None where it is no better than the best so far."""

    def holds(value: float) -> bool:
        return storages_of(setting.at(mu, value)) is not None

    high = MOST_RHO * rho if best is None else best[0] * (1 - FINENESS)
    low = 0.9 * rho
    if best is None:
        high = next((f * rho for f in (1.02, 1.1, 1.5, 3.0, 10.0, MOST_RHO) if holds(f * rho)), 0.0)
        if not high:
            return None
    elif not holds(high):
        return None
    while high > low * (1 + FINENESS):
        middle = math.sqrt(low * high)
        low, high = (low, middle) if holds(middle) else (middle, high)
    return high


def longest_modal(
    loop_at: Callable[[float], ModalLoop], start: float, ends: Sequence[float], weights: Performance
) -> SampledVerdict | None:
    """Return the proved verdict at the largest period found; None if there is none."""

    def seems(period: float) -> bool:
        loop = loop_at(period)
        with np.errstate(all="ignore"):
            return storages_of(ModalSetting(loop, _outside(loop, ends), weights)) is not None

    return longest_from(start, seems, lambda period: certify_modal(loop_at(period), ends, weights))


def _outside(loop: ModalLoop, ends: Sequence[float]) -> tuple[float, ...]:
    """Return the ends of segments, the first and the last far enough outside for the weights in the code."""
    inner = [one for one in ends[1:-1] if loop.lower < one < loop.upper]
    step = -(-(len(inner) + 1) // MOST_SEGMENTS)
    return (loop.lower, *inner[step - 1 :: step], loop.upper)
