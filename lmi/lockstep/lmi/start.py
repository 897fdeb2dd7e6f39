"""One design from one random start: stabilise, climb to the full claim, then lower rho."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lockstep.lmi.bmi import BilinearProgram, Limits, Point
from lockstep.lmi.inequality import Certificate, Claim
from lockstep.lmi.inner import inner_step
from lockstep.lmi.solve import least_rho
from lockstep.lmi.stabilise import stabilise
from lockstep.model.loop import Loop

FRACTIONS = (1.0, 0.3, 0.1, 0.03, 0.01, 1e-3)
"""Parts of alpha and delta tried, largest first, for a first certificate of gains that are merely stable."""

CLIMBS, DESCENTS, CREEPS = 6, 4, 3
"""At most so many runs towards the full claim, so many that lower rho, and so many inner steps after a
failed one."""

WORTHWHILE = 0.01
"""A run that lowers rho by less than this part of it is the last."""


@dataclass(frozen=True)
class Outcome:
    """What one start came to: gains with an (unproved) certificate for the full claim, or how far it got.

    fraction: the part of alpha and delta that was certified on the way, 1 for the full claim;  abscissa: of
    the stabilised
    loop;  history: rho after each run.
    """

    index: int
    K: Float[np.ndarray, "N k l"] | None
    certificate: Certificate | None
    fraction: float
    abscissa: float
    history: tuple[float, ...] = ()

    @property
    def rho(self) -> float:
        """The rho reached; infinite without a certificate for the full claim."""
        return np.inf if self.certificate is None else self.certificate.rho


def from_start(loop: Loop, claim: Claim, gain_limit: float, seed: int, index: int) -> Outcome:
    """Run one start; the same arguments give the same outcome."""
    generator = np.random.default_rng([seed, index])
    shape = (loop.d.N, loop.U[0].shape[1], loop.Y[0].shape[0])
    # The size of the start is drawn too: small gains suit loops that are nearly stable, larger ones those
    # that are not.
    K, abscissa = stabilise(loop, generator.choice([0.5, 1.0, 2.0]) * generator.standard_normal(shape))
    K = _within(K, 0.9 * gain_limit)
    point = _first_point(loop, K, claim)
    if point is None:
        return Outcome(index, None, None, 0.0, abscissa)
    program = BilinearProgram(loop, claim, gain_limit)
    fraction = point.alpha_fraction**0.5
    if fraction < 1:
        point, fraction = _climb(loop, claim, program, point)
        if fraction < 1:
            return Outcome(index, None, None, fraction, abscissa)
    return _descend(loop, claim, program, point, index, abscissa)


def _within(K: Float[np.ndarray, "N k l"], limit: float) -> Float[np.ndarray, "N k l"]:
    """Scale each agent's gains down to the limit."""
    return np.stack([block * min(1.0, limit / max(float(np.linalg.norm(block, 2)), 1e-300)) for block in K])


def _first_point(loop: Loop, K: Float[np.ndarray, "N k l"], claim: Claim) -> Point | None:
    for fraction in FRACTIONS:
        found = least_rho(loop, K, claim.at(alpha=fraction * claim.alpha, fraction_of_delta=fraction))
        if found is not None:
            return Point(K, found, fraction**2, fraction**2)
    return None


def _climb(loop: Loop, claim: Claim, program: BilinearProgram, point: Point) -> tuple[Point, float]:
    """Raise the fractions of alpha^2 and delta^2 to 1; return the point and the certified fraction."""
    reached = point.alpha_fraction**0.5
    rho_most = 10.0 * point.certificate.rho
    for _ in range(CLIMBS):
        trial = program.improve(point, "claim", Limits(150, rho_most))
        found = least_rho(loop, trial.K, claim)
        if found is not None:
            return Point(trial.K, found), 1.0
        point = trial
    return point, reached


def _descend(
    loop: Loop, claim: Claim, program: BilinearProgram, point: Point, index: int, abscissa: float
) -> Outcome:
    """Stride with the nonlinear program; where its gains do not certify, creep a few certified steps and
    stride again."""
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
        if point.certificate.rho > (1 - WORTHWHILE) * before:
            break
    return Outcome(index, point.K, point.certificate, 1.0, abscissa, tuple(history))


def creep(loop: Loop, claim: Claim, gain_limit: float, point: Point, steps: int) -> Point:
    """Take inner convex steps: each keeps a certificate, and rho never rises."""
    for _ in range(steps):
        step = inner_step(loop, point.K, claim, point.certificate, gain_limit)
        found = None if step is None else least_rho(loop, step[0], claim)
        if step is None or found is None or found.rho >= point.certificate.rho:
            return point
        point = Point(step[0], found)
    return point
