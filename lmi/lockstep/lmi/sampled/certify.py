"""The proof that the sampled, rounded controllers do what is claimed, and what it says.

    bound       |phi(a, t) - phi(b, t)| <= alpha |a - b|, proved before and elsewhere
    loop        the coefficients and the period as they are in the code, every rounding in it as a Delta
    witness     P, m, t, kappa in doubles, from wherever
    proof       no conjugate point in the period, P > 0 and W > 0 for these very numbers, in ball arithmetic

What a reader has to trust is this file, `inequality`, `loop`, `lifting`, `conjugate` and `balls`, the model layer under
them, and FLINT; not `search`, `storage` and `candidates`.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from itertools import chain, islice
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from lockstep.check.disagreement import Disagreement
from lockstep.check.loop import Plant
from lockstep.check.numbers import as_floats, exactly
from lockstep.check.sampled import balls
from lockstep.check.sampled.conjugate import no_conjugate_point
from lockstep.check.sampled.controller import HeldController, Network
from lockstep.check.sampled.inequality import W_matrix, Witness, metric, multiplier
from lockstep.check.sampled.lifting import Lifted, copies, lift
from lockstep.check.sampled.loop import SampledLoop, sampled_loop
from lockstep.lmi.sampled.candidates import candidates
from lockstep.lmi.sampled.search import best_multiplier, gain, spectral_radius

ROUNDED_UP = 1 + 1e-9
"""Some ten operations in doubles lose less than 1e-14."""

TRIES = 3
"""Candidates put to the proof: the first nearly always holds."""


@dataclass(frozen=True)
class SampledVerdict:
    """What is proved of the sampled loop, or why nothing is.

    decay: V shrinks by it from one sampling instant to the next, up to the noise;  residual: the ultimate distance from
    consensus at the sampling instants, |(T'(T T')^-1 T (x) I) x|, per unit of error of every message entry;
    residual_rms: the same as a root mean square over time;  underflow: the ultimate distance from underflow alone,
    absolute;  deltas: per agent, the bounds on the coefficient errors that stand for the rounding;  gain: from w
    to z, in doubles, for information;  witness: what proves it.
    """

    certified: bool
    reason: str
    period: float
    delay: int
    proof: Literal["ball", "none"] = "none"
    decay: float = float("nan")
    residual: float = float("nan")
    residual_rms: float = float("nan")
    underflow: float = float("nan")
    deltas: tuple[Mapping[str, float], ...] = ()
    witness: Witness | None = None
    figures: Mapping[str, Any] = field(default_factory=dict)

    def document(self) -> dict[str, Any]:
        """Return the verdict as plain JSON types."""
        return {
            "certified": self.certified,
            "proof": self.proof,
            "reason": self.reason,
            "period": self.period,
            "delay": self.delay,
            "decay": self.decay,
            "residual_per_message_error": self.residual,
            "residual_rms_per_message_error": self.residual_rms,
            "residual_from_underflow": self.underflow,
            "rounding": [dict(one) for one in self.deltas],
            **dict(self.figures),
        }


def certify_sampled(
    network: Network,
    controllers: tuple[HeldController, ...],
    guess: Float[np.ndarray, " pairs"] | None = None,
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
    exact_loop = sampled_loop(network, controllers)
    with balls.working_precision():
        if witness is not None and _holds(exact_loop, [witness]):
            return _accepted(network, controllers, witness, {})
    loop = in_doubles(network, controllers)
    one, at = period_in_doubles(loop), f"at {network.period:g} s"
    if one is None:
        said = f"{at} a period of the agents with slopes up to {network.alpha:g} overflows in doubles"
        return _refused(network, controllers, said, {})
    figures: dict[str, Any] = {"spectral_radius": spectral_radius(loop, one)}
    if not figures["spectral_radius"] < 1:
        said = f"{at} the sampled linear loop has the spectral radius {figures['spectral_radius']:.6g}, not below 1"
        return _refused(network, controllers, said, figures)
    first = first_guess(network.d, guess)
    m, figures["gain"] = best_multiplier(loop, one, first)
    if figures["gain"] >= 1:
        said = f"{at} the gain around the nonlinearity is {figures['gain']:.6g}, not below 1"
        return _refused(network, controllers, said, figures)
    said = f"{at} no certificate was found"
    # The weights of the least gain may be so unequal that no doubles hold a witness: the guess is tried as well.
    for weights in (m, first) if gain(loop, one, first) < 1 else (m,):
        trials = islice(candidates(loop, one, weights, thorough=thorough), TRIES)
        best = next(trials, None)
        if best is None:
            continue
        with balls.working_precision():
            found = _holds(exact_loop, chain([best], trials))
        if found is not None:
            return _accepted(network, controllers, found, figures)
        said = f"{at} no candidate survived the proof"
    return _refused(network, controllers, said, figures)


def first_guess(d: Disagreement, guess: Float[np.ndarray, " pairs"] | None) -> Float[np.ndarray, " pairs"]:
    """Return pair weights to start from: those given, or all alike."""
    pairs = len(d.pairs())
    usable = guess is not None and len(guess) == pairs and np.all(guess >= 0) and guess.sum() > 0
    return np.array(guess, dtype=float) if usable else np.ones(pairs)


def in_doubles(network: Network, controllers: tuple[HeldController, ...]) -> SampledLoop:
    """Return the loop in doubles, for the search."""
    plant, d = plant_in_doubles(network)
    return sampled_loop(replace(network, plant=plant, d=d), controllers)


def plant_in_doubles(network: Network) -> tuple[Plant, Disagreement]:
    """Return the agents and the coordinates in doubles."""
    p, d = network.plant, network.d
    plant = Plant(
        as_floats(p.A), tuple(as_floats(B) for B in p.B), as_floats(p.C), as_floats(p.G), as_floats(p.H)
    )
    return plant, Disagreement(*(as_floats(M) for M in (d.T, d.right, d.S, d.L, d.L_r)))


def lifted_agent(loop: SampledLoop) -> Lifted:
    """Return one period of one agent, w = phi and z = alpha H x or those of a sector, in the kind of number of the loop."""
    return lift(loop.network.plant.A, loop.into, *loop.network.squares, loop.network.period)


def period_in_doubles(loop: SampledLoop) -> Lifted | None:
    """Return `lifted_agent` of a loop in doubles, or None where it overflows."""
    with np.errstate(all="ignore"):
        try:
            one = lifted_agent(loop)
        except (np.linalg.LinAlgError, ValueError, OverflowError):
            return None
    return one if all(np.isfinite(part).all() for part in (one.A_d, one.S, one.Q)) else None


def _holds(exact_loop: SampledLoop, trials: Iterable[Witness]) -> Witness | None:
    """Return the first witness that is proved, with the period, or None; those after it are not even looked for."""
    network = exact_loop.network
    if not no_conjugate_point(network.plant.A, *network.squares, network.period):
        return None
    one = lifted_agent(exact_loop)
    return next((trial for trial in trials if proves(exact_loop, one, trial)), None)


def proves(exact_loop: SampledLoop, one: Lifted, witness: Witness) -> bool:
    """Decide in balls whether P > 0, m >= 0, t >= 0, 0 < decay < 1, M > 0, W > 0 and c P > diag((T T')^-1 (x) I, 0).

    That the period holds no conjugate point is to be shown apart.
    """
    if not witness.fits(exact_loop) or np.any(witness.m < 0) or np.any(witness.t < 0):
        return False
    if not (0 < witness.decay < 1 and witness.weight >= 0 and min(witness.kappa, witness.kappa_mu) >= 0):
        return False
    if not np.array_equal(witness.P, witness.P.T) or not balls.is_positive_definite(exactly(witness.P)):
        return False
    M = multiplier(exact_loop.network.d, exactly(witness.m))
    if not balls.is_positive_definite(M) or not _bounds_the_distance(exact_loop, witness):
        return False
    return balls.is_positive_definite(W_matrix(exact_loop, copies(one, M), witness))


def _bounds_the_distance(exact_loop: SampledLoop, witness: Witness) -> bool:
    if not math.isfinite(witness.ratio):
        return False
    form = exactly(np.array([[witness.ratio]]))[0, 0] * exactly(witness.P)
    place = slice(0, exact_loop.n_d)
    form[place, place] = form[place, place] - metric(exact_loop)
    return balls.is_positive_definite(form)


def _refused(
    network: Network, controllers: tuple[HeldController, ...], reason: str, figures: Mapping[str, Any]
) -> SampledVerdict:
    deltas = tuple(dict(one.deltas) for one in controllers)
    return SampledVerdict(False, reason, network.period, network.delay, deltas=deltas, figures=figures)


def _accepted(
    network: Network, controllers: tuple[HeldController, ...], witness: Witness, figures: Mapping[str, Any]
) -> SampledVerdict:
    """State what follows, rounded up by far more than these few operations lose."""
    messages = ROUNDED_UP * math.hypot(*(one.message_noise(1.0) for one in controllers))
    lost = witness.ultimate * math.hypot(*(one.message_noise(0.0) for one in controllers))
    lost += witness.ultimate_mu * math.hypot(*(one.underflow for one in controllers))
    return SampledVerdict(
        True,
        "no conjugate point in the period, P > 0 and W > 0, decided in ball arithmetic",
        network.period,
        network.delay,
        "ball",
        witness.decay,
        witness.ultimate * messages,
        witness.rms * messages,
        ROUNDED_UP * lost,
        tuple(dict(one.deltas) for one in controllers),
        witness,
        figures,
    )
