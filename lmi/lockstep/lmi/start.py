"""One design from one random start: stabilise, climb to the full claim, then lower rho."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from lockstep.lmi.bmi import BilinearProgram, Limits, Point, within
from lockstep.lmi.inequality import Certificate, Claim
from lockstep.lmi.inner import inner_step
from lockstep.lmi.reach import largest_alpha
from lockstep.lmi.solve import least_rho
from lockstep.lmi.stabilise import abscissa as abscissa_of
from lockstep.lmi.stabilise import stabilise
from lockstep.model.loop import Loop

FRACTIONS = (1.0, 0.3, 0.1, 0.03, 0.01, 1e-3)
"""Parts of alpha and delta tried, largest first, for a first certificate of gains that are merely stable."""

CLIMBS, DESCENTS, CREEPS = 6, 4, 3
"""At most so many runs towards the full claim, so many that lower rho, and so many inner steps after a
failed one."""

STUCK = 1.2
"""A climb whose fractions do not grow by this factor in one run is given up."""

UNPROVED = 1 - 1e-9
"""The fraction of alpha^2 of gains that the nonlinear program says carry all of it, but no certificate does."""

WORTHWHILE = 0.01
"""A run that lowers rho by less than this part of it is the last."""


@dataclass(frozen=True)
class Outcome:
    """What one start came to: gains with an (unproved) certificate for the full claim, or how far it got.

    fraction: the part of alpha and delta that has a certificate, 1 for the full claim;  abscissa: of the stabilised
    loop;  history: rho after each run;  alpha: the largest one reached, where that was the aim;  nearest: where the
    full claim was not reached, the gains that came nearest, and `claimed` the part they carry by the nonlinear
    program's own word: only the best start's is worth a certificate.
    """

    index: int
    K: Float[np.ndarray, "N k l"] | None
    certificate: Certificate | None
    fraction: float
    abscissa: float
    history: tuple[float, ...] = ()
    alpha: float = 0.0
    nearest: Float[np.ndarray, "N k l"] | None = None
    claimed: float = 0.0

    @property
    def rho(self) -> float:
        """The rho reached; infinite without a certificate for the full claim."""
        return np.inf if self.certificate is None else self.certificate.rho


def from_start(
    loop: Loop, claim: Claim, gain_limit: float, seed: int, index: int, rho: float | None = None
) -> Outcome:
    """Run one start; the same arguments give the same outcome.

    Args:
        loop, claim, gain_limit: what is asked.
        seed, index: of the random start.
        rho: None to lower rho; a number to raise alpha with rho at most that.
    """
    generator = np.random.default_rng([seed, index])
    shape = (loop.d.N, loop.U[0].shape[1], loop.Y[0].shape[0])
    # The size of the start is drawn too: small gains suit loops that are nearly stable, larger ones those
    # that are not.
    # Inside the limit of the descent, not on it: from a kink the slope of one side leads nowhere.
    first = within(generator.choice([0.5, 1.0, 2.0]) * generator.standard_normal(shape), 0.5 * gain_limit)
    K, _ = stabilise(loop, first, 0.8 * gain_limit)
    K = within(K, 0.9 * gain_limit)
    abscissa = abscissa_of(loop, K)[0]
    point = _first_point(loop, K, claim)
    if point is None:
        return Outcome(index, None, None, 0.0, abscissa)
    program = BilinearProgram(loop, claim, gain_limit)
    fraction = point.alpha_fraction**0.5
    if fraction < 1:
        climbed = _climb(loop, claim, program, point)
        if climbed.alpha_fraction < 1:
            parts = [climbed.alpha_fraction, *([climbed.delta_fraction] if program.ways else [])]
            claimed = min(parts) ** 0.5
            return Outcome(index, None, None, fraction, abscissa, nearest=climbed.K, claimed=claimed)
        point = climbed
    reached = _descend(loop, claim, program, point, index, abscissa, stop_at=rho)
    return reached if rho is None else _raise_alpha(loop, claim, program, reached, rho)


def _first_point(loop: Loop, K: Float[np.ndarray, "N k l"], claim: Claim) -> Point | None:
    for fraction in FRACTIONS:
        found = least_rho(loop, K, claim.at(alpha=fraction * claim.alpha, fraction_of_delta=fraction))
        if found is not None:
            return Point(K, found, fraction**2, fraction**2)
    return None


def _climb(loop: Loop, claim: Claim, program: BilinearProgram, point: Point) -> Point:
    """Raise the fractions of alpha^2 and delta^2 to 1; return where it ends: with fractions of 1 only if certified."""
    rho_most = 10.0 * point.certificate.rho
    for _ in range(CLIMBS):
        trial = program.improve(point, "claim", Limits(150, rho_most))
        found = least_rho(loop, trial.K, claim)
        if found is not None:
            return Point(trial.K, found)
        trial = replace(trial, alpha_fraction=min(trial.alpha_fraction, UNPROVED))
        before, after = (p.alpha_fraction * p.delta_fraction for p in (point, trial))
        if after > before:
            point = trial
        if after < STUCK * before:
            break
    return point


def _descend(
    loop: Loop,
    claim: Claim,
    program: BilinearProgram,
    point: Point,
    index: int,
    abscissa: float,
    *,
    stop_at: float | None,
) -> Outcome:
    """Lower rho by strides of the nonlinear program; where one does not certify, creep a few certified steps first."""
    history = [point.certificate.rho]
    for _ in range(DESCENTS):
        before = point.certificate.rho
        trial = program.improve(point, "rho", Limits(400))
        found = least_rho(loop, trial.K, claim)
        if found is not None and found.rho < before:
            point = Point(trial.K, found)
        else:
            point = creep(loop, claim, program.gain_limit, point, CREEPS)
        history.append(point.certificate.rho)
        if point.certificate.rho > (1 - WORTHWHILE) * before or point.certificate.rho <= (stop_at or 0.0):
            break
    return Outcome(index, point.K, point.certificate, 1.0, abscissa, tuple(history), claimed=1.0)


def _raise_alpha(loop: Loop, claim: Claim, program: BilinearProgram, reached: Outcome, rho: float) -> Outcome:
    """Raise alpha with rho at most the one given; the outcome has no certificate where rho itself was not reached."""
    if reached.K is None or reached.certificate is None or reached.certificate.rho > rho:
        return replace(reached, certificate=None)
    K, alpha = reached.K, largest_alpha(loop, reached.K, claim, rho=rho)
    for _ in range(DESCENTS):
        part = alpha / claim.alpha
        start = least_rho(loop, K, claim.at(alpha=alpha))
        if start is None:
            break
        trial = program.improve(Point(K, replace(start, rho=rho), part**2), "alpha", Limits(400)).K
        higher = largest_alpha(loop, trial, claim, rho=rho, from_alpha=alpha)
        if higher <= alpha:
            break
        gained, K, alpha = higher / alpha - 1, trial, higher
        if gained < WORTHWHILE:
            break
    return replace(reached, K=K, certificate=least_rho(loop, K, claim.at(alpha=alpha)), alpha=alpha)


def creep(loop: Loop, claim: Claim, gain_limit: float, point: Point, steps: int) -> Point:
    """Take inner convex steps: each keeps a certificate, and rho never rises."""
    for _ in range(steps):
        step = inner_step(loop, point.K, claim, point.certificate, gain_limit)
        found = None if step is None else least_rho(loop, step[0], claim)
        if step is None or found is None or found.rho >= point.certificate.rho:
            return point
        point = Point(step[0], found)
    return point
