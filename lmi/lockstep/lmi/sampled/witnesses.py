"""Witnesses for the sampled, rounded controllers are looked for here, in doubles, and put to the checker's decision.

Nothing here is believed: `lockstep.check.sampled.certificate` decides, and needs none of this.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain, islice
from typing import Any

import numpy as np
from jaxtyping import Float

from lockstep.check.numbers import as_floats
from lockstep.check.sampled.certificate import TOO_LONG, SampledVerdict, decide_sampled, refused
from lockstep.check.sampled.controller import HeldController, SampledNetwork
from lockstep.check.sampled.inequality import Witness
from lockstep.check.sampled.lifting import Lifted, lift
from lockstep.check.sampled.loop import NO_NOISE, SampledLoop, sampled_loop
from lockstep.check.system.disagreement import Disagreement
from lockstep.check.system.loop import Plant
from lockstep.lmi.sampled.candidates import candidates, fastest_candidates
from lockstep.lmi.sampled.loop_gain import best_multiplier, gain, spectral_radius
from lockstep.lmi.sampled.storage import in_exact_arithmetic
from lockstep.lmi.shapes import PairWeights

TRIES = 3
"""Candidates put to the proof: the first nearly always holds."""

LEAST = 1e-6
"""Of the largest pair weight: without a pair M may be singular."""

ROUNDED = (
    "without rounding there is one (computed): lower the gains, which may be large and cancel (`gain_limit`), scale the"
    ' states of given controllers so that B and C are of one size, or take [controller] real = "float64"'
)
"""Units of outputs and inputs do not matter: the errors are counted in those of the rows and columns of the gains."""


def certify_sampled(
    network: SampledNetwork,
    controllers: tuple[HeldController, ...],
    guess: PairWeights | None = None,
    *,
    witness: Witness | None = None,
    thorough: bool = True,
) -> SampledVerdict:
    """Prove the sampled nonlinear loop with every rounding of its arithmetic, or say why it could not be.

    Args:
        network: agents, coordinates, alpha, period, delay, the matrices exact.
        controllers: one per agent, with the coefficients of the code.
        guess: pair weights to start from, such as those of the continuous certificate.
        witness: a candidate that is put to the proof before any is searched for.
        thorough: look for the witness that says most about noise, not for the first that proves stability.

    Raises:
        ProblemError: controllers that do not fit the agents.
    """
    if witness is not None:
        replayed = decide_sampled(network, controllers, [witness])
        if replayed.certified:
            return replayed
    loop = in_doubles(network, controllers)
    one, at = period_in_doubles(loop), f"at {network.period:g} s"
    if one is None:
        said = f"{at} a period of the agents with slopes up to {network.alpha:g} overflows in doubles"
        return refused(network, controllers, said)
    linear = in_doubles(replace(network, alpha=0.0, sector=None), controllers)
    plain = period_in_doubles(linear)
    figures: dict[str, Any] = {"spectral_radius": np.inf if plain is None else spectral_radius(linear, plain)}
    if not figures["spectral_radius"] < 1:
        said = f"{at} the sampled linear loop has the spectral radius {figures['spectral_radius']:.6g}, not below 1"
        return replace(refused(network, controllers, said), figures=figures)
    first = first_guess(network.d, guess)
    m, figures["gain"] = best_multiplier(loop, one, first)
    if figures["gain"] >= 1:
        found = (
            f"is {figures['gain']:.6g}, not"
            if np.isfinite(figures["gain"])
            else "has no bound, let alone one"
        )
        said = f"{at} the gain around the nonlinearity {found} below 1"
        return replace(refused(network, controllers, said), figures=figures)
    said = f"{at} no certificate was found"
    # The weights of the least gain may be so unequal that no doubles hold a witness: the guess is tried as well.
    for weights in (m, first) if gain(loop, one, first) < 1 else (m,):
        trials = islice(candidates(loop, one, weights, thorough=thorough), TRIES)
        best = next(trials, None)
        if best is None:
            continue
        verdict = decide_sampled(network, controllers, chain([best], trials))
        if verdict.certified:
            return replace(verdict, figures=figures)
        said = verdict.reason
    rounded = thorough and TOO_LONG not in said  # of the agents alone, which no gain moves
    if rounded and next(candidates(in_exact_arithmetic(loop), one, m, thorough=False), None) is not None:
        said += f": {ROUNDED}"
    return replace(refused(network, controllers, said), figures=figures)


def certify_decay(
    network: SampledNetwork,
    controllers: tuple[HeldController, ...],
    weights: Sequence[PairWeights],
    slow: float,
    asked: float = 1.0,
    known: Sequence[Witness] = (),
) -> SampledVerdict | None:
    """Prove a decay of V that is less than `slow`, by a V of its own: one that bounds residuals well decays slowly.

    Args:
        network, controllers: of a loop that is certified.
        weights: pair weights to try.
        slow: the factor of V in a period that is known;  asked: the one that is asked for.
        known: put to the proof before any is searched for.
    """
    loop = in_doubles(network, controllers)
    one = period_in_doubles(loop)
    positive = [np.maximum(m, LEAST * m.max()) for m in (first_guess(network.d, of) for of in weights)]
    found = iter(()) if one is None else fastest_candidates(loop, one, positive, asked)
    for trial in chain(known, found):
        if trial.decay < slow and (verdict := decide_sampled(network, controllers, [trial])).certified:
            return verdict
    return None


def first_guess(d: Disagreement, guess: PairWeights | None) -> PairWeights:
    """Return pair weights to start from: those given, or all alike."""
    pairs = len(d.pairs())
    usable = guess is not None and len(guess) == pairs and np.all(guess >= 0) and guess.sum() > 0
    return np.array(guess, dtype=float) if usable else np.ones(pairs)


def in_doubles(
    network: SampledNetwork,
    controllers: tuple[HeldController, ...],
    noise: Float[np.ndarray, " q"] = NO_NOISE,
) -> SampledLoop:
    """Return the loop in doubles, for the search."""
    plant, d = plant_in_doubles(network)
    return sampled_loop(replace(network, plant=plant, d=d), controllers, noise)


def plant_in_doubles(network: SampledNetwork) -> tuple[Plant, Disagreement]:
    """Return the agents and the coordinates in doubles."""
    p, d = network.plant, network.d
    plant = Plant(
        as_floats(p.A), tuple(as_floats(B) for B in p.B), as_floats(p.C), as_floats(p.G), as_floats(p.H)
    )
    return plant, Disagreement(*(as_floats(M) for M in (d.T, d.right, d.S, d.L, d.L_r)))


def period_in_doubles(loop: SampledLoop) -> Lifted | None:
    """Return `check.sampled.certify.lifted_agent` of a loop in doubles, or None where it overflows."""
    from scipy.linalg import expm

    network = loop.network
    with np.errstate(all="ignore"):
        try:
            one = lift(network.plant.A, loop.into, *network.squares, network.period, expm)
        except (np.linalg.LinAlgError, ValueError, OverflowError):
            return None
    return one if all(np.isfinite(part).all() for part in (one.A_d, one.BB_d, one.CC_d)) else None
