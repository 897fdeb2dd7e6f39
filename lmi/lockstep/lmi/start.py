"""One design from one random start: stabilise, climb to the full claim, then lower rho."""

import time
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from lockstep.lmi.bmi import BilinearProgram, Limits, Point, within
from lockstep.lmi.inequality import Certificate, Claim
from lockstep.lmi.inner import inner_step
from lockstep.lmi.interior import InteriorProgram
from lockstep.lmi.reach import largest_alpha
from lockstep.lmi.solve import least_rho
from lockstep.lmi.stabilise import abscissa as abscissa_of
from lockstep.lmi.stabilise import stabilise
from lockstep.model.loop import Loop

FRACTIONS, FEW_FRACTIONS = (1.0, 0.3, 0.1, 0.03, 0.01, 1e-3), (0.1, 1e-3)
"""Parts of alpha and delta tried, largest first, for a first certificate of gains that are merely stable; the few where
each try takes seconds and the climb from there does not."""

LARGE = 20
"""Rows of F_r from which on a loop is `interior`'s: with 16 of them, the three arms, it takes as long as `bmi`, with 23 a
third of the time."""

CLIMBS, DESCENTS, CREEPS = 6, 4, 3
"""At most so many runs towards the full claim, so many that lower rho, and so many inner steps after a
failed one; for a large loop none, whose semidefinite programs take a minute."""

STUCK = 1.2
"""A climb whose fractions do not grow by this factor in one run is given up."""

UNPROVED = 1 - 1e-9
"""The fraction of alpha^2 of gains that the nonlinear program says carry all of it, but no certificate does."""

WORTHWHILE = 0.01
"""A run that lowers rho by less than this part of it is the last."""

Program = BilinearProgram | InteriorProgram


@dataclass(frozen=True)
class Outcome:
    """What one start came to: gains with an (unproved) certificate for the full claim, or how far it got.

    fraction: the part of alpha and delta that has a certificate, 1 for the full claim;  abscissa: of the stabilised
    loop;  history: rho after each run;  alpha: the largest one reached, where that was the aim;  nearest: where the
    full claim was not reached, the gains that came nearest, and `claimed` the part they carry by the nonlinear
    program's own word: only the best start's is worth a certificate;  cut: whether the time limit ended it.
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
    cut: bool = False

    @property
    def rho(self) -> float:
        """The rho reached; infinite without a certificate for the full claim."""
        return np.inf if self.certificate is None else self.certificate.rho


def from_start(
    loop: Loop,
    claim: Claim,
    gain_limit: float,
    seed: int,
    index: int,
    rho: float | None = None,
    deadline: float | None = None,
) -> Outcome:
    """Run one start; the same arguments give the same outcome, unless the deadline cuts it.

    Args:
        loop, claim, gain_limit: what is asked.
        seed, index: of the random start.
        rho: None to lower rho; a number to raise alpha with rho at most that.
        deadline: of `time.monotonic`; a start that is over it returns the best it has, and says that it was cut.
    """
    if over(deadline):
        return Outcome(index, None, None, 0.0, np.inf, cut=True)
    K, abscissa = stable_gains(loop, gain_limit, seed, index)
    point = first_point(loop, K, claim)
    if point is None:
        return Outcome(index, None, None, 0.0, abscissa)
    program = program_for(loop, claim, gain_limit)
    fraction = point.alpha_fraction**0.5
    if fraction < 1:
        climbed = climb(loop, claim, program, point, deadline)
        if climbed.alpha_fraction < 1:
            parts = [climbed.alpha_fraction, *([climbed.delta_fraction] if program.ways else [])]
            claimed = min(parts) ** 0.5
            cut = over(deadline)
            return Outcome(index, None, None, fraction, abscissa, nearest=climbed.K, claimed=claimed, cut=cut)
        point = climbed
    reached = _descend(loop, claim, program, point, index, abscissa, stop_at=rho, deadline=deadline)
    return reached if rho is None else _raise_alpha(loop, claim, program, reached, rho, deadline)


def over(deadline: float | None) -> bool:
    """Tell whether a deadline of `time.monotonic` has passed; None never does."""
    return deadline is not None and time.monotonic() >= deadline


def program_for(loop: Loop, claim: Claim, gain_limit: float) -> Program:
    """Return the nonlinear program that suits the size of the loop."""
    if _is_large(loop):
        return InteriorProgram(loop, claim, gain_limit)
    return BilinearProgram(loop, claim, gain_limit)


def _is_large(loop: Loop) -> bool:
    return loop.n_x + int(loop.E_G.shape[1]) >= LARGE


def stable_gains(
    loop: Loop, gain_limit: float, seed: int, index: int
) -> tuple[Float[np.ndarray, "N k l"], float]:
    """Return gains within the limit whose loop is stable, if a descent from a random start finds such, and its abscissa."""
    generator = np.random.default_rng([seed, index])
    shape = (loop.d.N, loop.U[0].shape[1], loop.Y[0].shape[0])
    # The size of the start is drawn too: small gains suit loops that are nearly stable, larger ones those
    # that are not.
    # Inside the limit of the descent, not on it: from a kink the slope of one side leads nowhere.
    first = within(generator.choice([0.5, 1.0, 2.0]) * generator.standard_normal(shape), 0.5 * gain_limit)
    K, _ = stabilise(loop, first, 0.8 * gain_limit)
    K = within(K, 0.9 * gain_limit)
    return K, abscissa_of(loop, K)[0]


def first_point(loop: Loop, K: Float[np.ndarray, "N k l"], claim: Claim) -> Point | None:
    """Return gains with a certificate for some part of the claim, or None where not even the least part has one."""
    for fraction in FEW_FRACTIONS if _is_large(loop) else FRACTIONS:
        found = least_rho(loop, K, claim.at(alpha=fraction * claim.alpha, fraction_of_delta=fraction))
        if found is not None:
            return Point(K, found, fraction**2, fraction**2)
    return None


def climb(loop: Loop, claim: Claim, program: Program, point: Point, deadline: float | None = None) -> Point:
    """Raise the fractions of alpha^2 and delta^2 to 1; return where it ends: with fractions of 1 only if certified."""
    rho_most = 10.0 * point.certificate.rho
    for _ in range(CLIMBS):
        if over(deadline):
            break
        trial = program.improve(point, "claim", Limits(150, rho_most, deadline))
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
    program: Program,
    point: Point,
    index: int,
    abscissa: float,
    *,
    stop_at: float | None,
    deadline: float | None,
) -> Outcome:
    """Lower rho by strides of the nonlinear program; where one does not certify, creep a few certified steps first."""
    history = [point.certificate.rho]
    for _ in range(DESCENTS):
        if over(deadline):
            break
        before = point.certificate.rho
        trial = program.improve(point, "rho", Limits(program.descent, deadline=deadline))
        found = least_rho(loop, trial.K, claim)
        if found is not None and found.rho < before:
            point = Point(trial.K, found)
        elif not _is_large(loop) and not over(deadline):
            point = creep(loop, claim, program.gain_limit, point, CREEPS)
        history.append(point.certificate.rho)
        if point.certificate.rho > (1 - WORTHWHILE) * before or point.certificate.rho <= (stop_at or 0.0):
            break
    return Outcome(
        index, point.K, point.certificate, 1.0, abscissa, tuple(history), claimed=1.0, cut=over(deadline)
    )


def _raise_alpha(
    loop: Loop,
    claim: Claim,
    program: Program,
    reached: Outcome,
    rho: float,
    deadline: float | None,
) -> Outcome:
    """Raise alpha with rho at most the one given; the outcome has no certificate where rho itself was not reached."""
    if reached.K is None or reached.certificate is None or reached.certificate.rho > rho:
        return replace(reached, certificate=None)
    K, alpha = reached.K, largest_alpha(loop, reached.K, claim, rho=rho)
    for _ in range(DESCENTS):
        if over(deadline):
            break
        part = alpha / claim.alpha
        start = least_rho(loop, K, claim.at(alpha=alpha))
        if start is None:
            break
        trial = program.improve(
            Point(K, replace(start, rho=rho), part**2), "alpha", Limits(program.descent, deadline=deadline)
        ).K
        higher = largest_alpha(loop, trial, claim, rho=rho, from_alpha=alpha)
        if higher <= alpha:
            break
        gained, K, alpha = higher / alpha - 1, trial, higher
        if gained < WORTHWHILE:
            break
    certificate = least_rho(loop, K, claim.at(alpha=alpha))
    return replace(reached, K=K, certificate=certificate, alpha=alpha, cut=over(deadline))


def creep(loop: Loop, claim: Claim, gain_limit: float, point: Point, steps: int) -> Point:
    """Take inner convex steps: each keeps a certificate, and rho never rises."""
    for _ in range(steps):
        step = inner_step(loop, point.K, claim, point.certificate, gain_limit)
        found = None if step is None else least_rho(loop, step[0], claim)
        if step is None or found is None or found.rho >= point.certificate.rho:
            return point
        point = Point(step[0], found)
    return point
