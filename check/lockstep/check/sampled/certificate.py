"""The decision whether a stored witness proves the sampled, rounded controllers, and what follows from it.

    bound       |phi(a, t) - phi(b, t)| <= alpha |a - b|, proved before and elsewhere
    loop        the coefficients and the period as they are in the code, every rounding in it as a Delta
    witness     P, m, t, kappa in doubles, from wherever
    proof       no conjugate point in the period, P > 0 and Omega > 0 for these very numbers, in ball arithmetic

Nothing is searched for here: without a witness that holds, nothing is proved.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from lockstep.check.numbers import Matrix, exact, exactly
from lockstep.check.sampled import balls
from lockstep.check.sampled.conjugate_points import lifted_if_regular
from lockstep.check.sampled.controller import HeldController, SampledNetwork
from lockstep.check.sampled.inequality import Omega_matrix, Witness, metric, multiplier
from lockstep.check.sampled.lifting import Lifted, copies
from lockstep.check.sampled.loop import SampledLoop, sampled_loop

ROUNDED_UP = 1 + 1e-9
"""Some ten operations in doubles lose less than 1e-14."""

TOO_LONG = "no proof that the period has no conjugate point: it may be too long for phi"


@dataclass(frozen=True)
class SampledVerdict:
    """What is proved of the sampled loop, or why nothing is.

    decay: V shrinks by it from one sampling instant to the next, up to the noise;  residual_per_message_error: the
    ultimate distance from consensus at the sampling instants, |(T'(T T')^-1 T (x) I) x|, per unit of error of every message
    entry;  residual_rms_per_message_error: the same as a root mean square over time;  residual_from_underflow: the ultimate
    distance from underflow alone, absolute;  deltas: per agent, the bounds on the coefficient errors that stand for the
    rounding;  witness: what proves it, a `Witness` or one of `modes`;  figures: what a search knows besides, for people.
    """

    certified: bool
    reason: str
    period: float
    delay: int
    decay: float = float("nan")
    residual_per_message_error: float = float("nan")
    residual_rms_per_message_error: float = float("nan")
    residual_from_underflow: float = float("nan")
    deltas: tuple[Mapping[str, float], ...] = ()
    witness: Any = None
    figures: Mapping[str, Any] = field(default_factory=dict)


def decide_sampled(
    network: SampledNetwork, controllers: tuple[HeldController, ...], witnesses: Iterable[Witness]
) -> SampledVerdict:
    """Decide the sampled nonlinear loop, every rounding of its arithmetic included, by the first witness that proves it.

    Args:
        network: agents, coordinates, alpha, period, delay, the matrices exact.
        controllers: one per agent, with the coefficients of the code.
        witnesses: stored ones, or those of a search; those after the first that holds are not even looked for.

    Raises:
        ProblemError: controllers that do not fit the agents.
    """
    loop, at = sampled_loop(network, controllers), f"at {network.period:g} s"
    with balls.working_precision():
        one, tried = lifted_agent(loop), 0
        if one is None:
            return refused(network, controllers, f"{at} {TOO_LONG}")
        for witness in witnesses:
            tried += 1
            if proves(loop, one, witness):
                said = "no conjugate point in the period, P > 0 and Omega > 0, decided in ball arithmetic"
                return accepted(network, controllers, witness, said, witness)
    said = "no candidate survived the proof" if tried else "there is no witness"
    return refused(network, controllers, f"{at} {said}")


def lifted_agent(loop: SampledLoop) -> Lifted | None:
    """Return one period of one agent in balls, w = phi and z = alpha H x or those of a sector.

    None unless the period is shown to hold no conjugate point.
    """
    A, squares, period = loop.network.plant.A, loop.network.squares, loop.network.period
    return lifted_if_regular(A, loop.into, *squares, period)


def proves(exact_loop: SampledLoop, one: Lifted | None, witness: Witness) -> bool:
    """Decide in balls whether P > 0, m >= 0, t >= 0, 0 < decay < 1, M > 0, Omega > 0 and c P > diag((T T')^-1 (x) I, 0).

    one: the `lifted_agent` of the loop, without which nothing is proved.
    """
    M = admitted_multiplier(exact_loop, witness)
    if one is None or M is None or not (0 < witness.decay < 1 and _bounds_the_distance(exact_loop, witness)):
        return False
    return balls.is_positive_definite(Omega_matrix(exact_loop, copies(one, M), witness))


def admitted_multiplier(exact_loop: SampledLoop, witness: Witness) -> Matrix | None:
    """Return M in balls, or None unless the sizes fit, P = P' > 0, M > 0, and m, t, kappa and weight are not negative."""
    numbers = [witness.weight, witness.kappa, witness.kappa_mu]
    if not witness.fits(exact_loop) or not all(
        np.all(np.asarray(v) >= 0) for v in (witness.m, witness.t, numbers)
    ):
        return None
    if not np.array_equal(witness.P, witness.P.T) or not balls.is_positive_definite(exactly(witness.P)):
        return None
    M = multiplier(exact_loop.network.d, exactly(witness.m))
    return M if balls.is_positive_definite(M) else None


def _bounds_the_distance(exact_loop: SampledLoop, witness: Witness) -> bool:
    if not math.isfinite(witness.ratio):
        return False
    form = exact(witness.ratio) * exactly(witness.P)
    place = slice(0, exact_loop.n_d)
    form[place, place] = form[place, place] - metric(exact_loop)
    return balls.is_positive_definite(form)


def refused(network: SampledNetwork, controllers: tuple[HeldController, ...], reason: str) -> SampledVerdict:
    """Return the verdict that nothing is proved, and why."""
    deltas = tuple(dict(one.deltas) for one in controllers)
    return SampledVerdict(False, reason, network.period, network.delay, deltas=deltas)


def accepted(
    network: SampledNetwork,
    controllers: tuple[HeldController, ...],
    bounds: Witness,
    reason: str,
    witness: Any,
) -> SampledVerdict:
    """State what follows from the numbers of `bounds`, rounded up by far more than these few operations lose."""
    messages = ROUNDED_UP * math.hypot(*(one.message_noise(1.0) for one in controllers))
    lost = bounds.ultimate * math.hypot(*(one.message_noise(0.0) for one in controllers))
    lost += bounds.ultimate_mu * math.hypot(*(one.underflow for one in controllers))
    return replace(
        refused(network, controllers, reason),
        certified=True,
        decay=bounds.decay,
        residual_per_message_error=bounds.ultimate * messages,
        # What is never exceeded is no less in the mean square.
        residual_rms_per_message_error=min(bounds.rms, bounds.ultimate) * messages,
        residual_from_underflow=ROUNDED_UP * lost,
        witness=witness,
    )
