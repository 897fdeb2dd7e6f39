"""Witnesses for controllers in integers are looked for here, in doubles, and put to the checker.

Rounding in counts, mu, takes the place that the messages' noise has in the searches for floating point: the loop is given
to them with the columns of the two exchanged, and the witness is read with their prices exchanged.
"""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from lockstep.check.continuous.inequality import Performance
from lockstep.check.sampled.certificate import decide_sampled
from lockstep.check.sampled.controller import HeldController, SampledNetwork
from lockstep.check.sampled.fixed_point import FixedController, proves_range, ranges_of
from lockstep.check.sampled.inequality import Witness
from lockstep.check.sampled.l2_gain import proves_rho
from lockstep.check.sampled.loop import SampledLoop, sampled_loop
from lockstep.lmi.sampled.candidates import ROUNDINGS, candidates, priced_for_rounding
from lockstep.lmi.sampled.input_limits import RATES, least_level
from lockstep.lmi.sampled.l2_gain import SampledRho, period_of
from lockstep.lmi.sampled.loop_gain import best_multiplier, spectral_radius
from lockstep.lmi.sampled.witnesses import first_guess, in_doubles, period_in_doubles
from lockstep.lmi.shapes import PairWeights

SLACKS = (2e-4, 1e-3, 5e-3, 1e-2, 2e-2)
"""How far above the rho of floating point that of integers is looked for."""

PRICES = tuple(10.0**k for k in range(-6, 9))
"""Of mu in the search for rho, relative to the lifted cost: the first that holds says least of rounding."""

SHARE, CLAIMED = 0.05, 0.9
"""The part of V's level that rounding may take, and the part of the decay that is claimed."""

KEPT = (0.99, 0.97, 0.9)
"""Parts of the radius found, less what rounding takes of it, that are claimed."""


def with_mu_for_noise(loop: SampledLoop) -> SampledLoop:
    """Return the loop with mu in the place of the messages' noise, and the reverse."""
    return replace(loop, messages=loop.underflows, underflows=loop.messages)


def _read(witness: Witness) -> Witness:
    return replace(witness, kappa=witness.kappa_mu, kappa_mu=witness.kappa)


def agreement_witness(
    network: SampledNetwork, held: tuple[HeldController, ...], guess: PairWeights | None
) -> Witness | None:
    """Find a witness of agreement that leaves little of the disagreement to rounding; None if none is proved."""
    loop = with_mu_for_noise(in_doubles(network, held))
    one = period_in_doubles(loop)
    if one is None or not spectral_radius(loop, one) < 1:
        return None
    first = first_guess(network.d, guess)
    for m in (first, best_multiplier(loop, one, first)[0]):
        for found in candidates(loop, one, m):
            if decide_sampled(network, held, [_read(found)]).certified:
                return _read(found)
    return None


def rho_witness(
    network: SampledNetwork, held: tuple[HeldController, ...], weights: Performance, known: SampledRho
) -> SampledRho | None:
    """Find and prove a rho near that of floating point, with the least price of mu that holds; None if none does."""
    loop = with_mu_for_noise(in_doubles(network, held, weights.outputs))
    exact = sampled_loop(network, held, weights.outputs)
    for slack in SLACKS:
        at = float(f"{known.rho * (1 + slack):.4g}")
        period = period_of(loop, weights, known.witness.m, at)
        if period is None:
            continue
        for price in PRICES:
            witness = replace(period, price=price).witness(ROUNDINGS[0])
            if witness is not None and proves_rho(exact, weights, at, _read(witness)):
                return SampledRho(at, _read(witness))
    return None


def radius_witness(
    network: SampledNetwork, held: tuple[HeldController, ...], integers: tuple[FixedController, ...]
) -> tuple[float, Witness] | None:
    """Find and prove a large radius from which no integer meets its limit; None if none is proved."""
    exact = sampled_loop(network, held)
    mu = math.hypot(*(one.underflow for one in held))
    rows = np.array([row / side for row, side in ranges_of(in_doubles(network, held), integers)], dtype=float)
    for gamma, candidate in _levels(network, held, rows, mu):
        room = max(1 - candidate.kappa_mu * mu * mu / (1 - candidate.decay), 1e-6)
        for part in KEPT:
            found = float(f"{part * (room / gamma) ** 0.5:.4g}")
            if proves_range(exact, integers, candidate, found):
                return found, candidate
    return None


def state_bounds(
    network: SampledNetwork, held: tuple[HeldController, ...], sides: Float[np.ndarray, " k"]
) -> Float[np.ndarray, "N n_C"] | None:
    """Return how large the states of each controller become before r or u, whose limits are given, is met.

    Args:
        network: agents, coordinates, alpha, period, delay.
        held: controllers in floating point.
        sides: (q + m,) of every agent's r and u.
    """
    n, m, loop = held[0].order, held[0].inputs, in_doubles(network, held)
    rows = [
        np.vstack([loop.seen[i][n:], loop.computed[i * m : (i + 1) * m]])[:, : loop.n_x] / sides[:, None]
        for i in range(len(held))
    ]
    for _, witness in _levels(network, held, np.vstack(rows), 0.0):
        inverse = np.linalg.inv(witness.P)
        seen = [one[:n, : loop.n_x] for one in loop.seen]
        return np.array([np.sqrt(np.diag(rows @ inverse @ rows.T)) for rows in seen])
    return None


def _levels(
    network: SampledNetwork, held: tuple[HeldController, ...], rows: Float[np.ndarray, "k n_x"], mu: float
) -> Iterator[tuple[float, Witness]]:
    """Yield gamma and witnesses of |k_l x_cl| <= 1 wherever V <= 1, gamma (T T')^-1 >= P_d, gamma the least for a decay."""
    loop = with_mu_for_noise(in_doubles(network, held))
    one = period_in_doubles(loop)
    if one is None:
        return
    spread = 1 - spectral_radius(loop, one) ** 2
    for rate in RATES if spread > 0 else ():
        noise = SHARE * rate * spread / (mu * mu) if mu else math.inf
        found = least_level(loop, one, rows, 1 - rate * spread, noise)
        if found is not None:
            for candidate in priced_for_rounding(loop, one, found[1], CLAIMED):
                yield found[0], _read(candidate)
