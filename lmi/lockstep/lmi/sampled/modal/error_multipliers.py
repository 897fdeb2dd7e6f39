"""From storage functions to witnesses: prices of every error, and the decay and the weight that they leave room for."""

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from lockstep.check.continuous.inequality import LETTERS
from lockstep.check.continuous.modes import Segment
from lockstep.check.sampled.inequality import Omega_matrix, step_matrix
from lockstep.check.sampled.lifting import Lifted, copies
from lockstep.check.sampled.modes import SampledModalWitness
from lockstep.lmi.sampled.modal.mode import LiftedMode, ModalSetting, Storage
from lockstep.lmi.sampled.storage import distance_ratio, holds_in_doubles

CERTAIN = 1e-12
"""The delta of a coefficient without error, in place of 0."""

DOUBLINGS_OF_PRICE = 60
MU = 1e6
"""What underflow counts relative to the messages' noise: it is some thirty decades smaller."""


def priced_modal_witness(
    setting: ModalSetting, found: Any, dear: float, claimed: tuple[float, float] | None = None
) -> Iterator[SampledModalWitness]:
    """Yield a witness with prices of every error, as cheap a noise as holds, and the decay and weight that it has room for.

    claimed: a decay and a kappa from which the price of the noise is raised.
    """
    storages, mu, P_mean = found
    pairs = list(zip(pairwise(setting.ends), storages, strict=True))
    modes = [(P, setting.mode(value)) for (low, high), P in pairs for value in (low, high)]
    modes.append((P_mean, setting.mode(0.0)))
    t = np.full(len(LETTERS), 1e-300)
    noise = 1e-300
    ready: list[tuple[Storage, LiftedMode, Lifted]] = []
    for P, mode in modes:
        if mode is None:
            return
        lifted = mode.lifted if mode.with_rho else copies(mode.lifted, mu * np.eye(1))
        ready.append((P, mode, lifted))
        N = step_matrix(mode.loop, lifted)
        for way in mode.loop.ways:
            k, E, Y = LETTERS.index(way.letter), N[:, way.place], way.Y[:, : mode.loop.n_x]
            enters = float(np.linalg.norm(E.T @ P @ E, 2)) if len(P) else 0.0
            out = float(np.linalg.norm(Y @ np.linalg.solve(P, Y.T), 2)) if Y.size else 0.0
            t[k] = max(
                t[k],
                dear * math.sqrt(enters / max(out, 1e-300)) / max(way.delta, CERTAIN)
                if out
                else 1e6 * enters,
            )
        into = N[:, mode.loop.messages.start : mode.loop.underflows.stop]
        noise = max(noise, float(np.linalg.norm(into.T @ P @ into, 2)), float(np.abs(mode.running).max()))
    segments = tuple(Segment(high, P) for (_, high), P in pairs)
    first = [(P, mode) for P, mode in modes[:-1] if mode is not None]
    ratio = max(distance_ratio(mode.loop, P) for P, mode in first)
    trial = SampledModalWitness(segments, P_mean, t, setting.ends[0], mu, 1.0, math.inf, 0.0, ratio, math.inf)

    def holds(witness: SampledModalWitness) -> bool:
        return all(
            holds_in_doubles(Omega_matrix(mode.loop, lifted, witness.of(P, mode.loop), mode.running))
            for P, mode, lifted in ready
        )

    def at(price: float, decay: float = 1.0, weight: float = 0.0) -> SampledModalWitness:
        return replace(trial, kappa=price, kappa_mu=MU * price, decay=decay, weight=weight)

    if setting.rho is not None:
        witness = at(1e8 * noise)
        if holds(witness):
            yield witness
        return
    if claimed is not None:
        decay, least_price = claimed
        prices_tried = (1.1 * 1.3**k * least_price for k in range(12))
        price = next((p for p in prices_tried if holds(at(p, decay=decay))), None)
        if price is not None:
            price, most = 1.5 * price, (1 - decay) / ratio
            halves = (most / 2**k for k in range(8))
            weight = next((w for w in halves if holds(at(price, decay=decay, weight=w))), 0.0)
            yield at(price, decay=decay, weight=0.98 * weight)
        return
    price = next((p for k in range(DOUBLINGS_OF_PRICE) if holds(at(p := 1.5 * 4.0**k * noise))), None)
    if price is None:
        return
    low, high = 0.0, 1.0
    for _ in range(16):
        middle = (low + high) / 2 if low else high / 8
        low, high = (low, middle) if holds(at(4 * price, decay=middle)) else (middle, high)
    decay = 1 - (1 - high) / 2
    weight, most = 0.0, (1 - decay) / ratio
    for k in range(12):
        if holds(at(4 * price, decay=decay, weight=most / 2**k)):
            weight = most / 2 ** (k + 1)
            break
    yield at(4 * price, decay=decay, weight=weight)
