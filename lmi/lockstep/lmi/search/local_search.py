"""Gains and certificate together, by strides of a nonlinear program, as long as a stride pays.

A stride may end in gains with a smaller rho that the sampled loop does not survive: two kinds of minima are often a
few per cent of rho apart. So the gains after every stride are held against the sampled loop, and the best of them are
kept, not the last.
"""

from dataclasses import dataclass, replace

from lockstep.check.continuous.inequality import Certificate
from lockstep.lmi.analysis.certificate_sdp import eliminates_P, least_rho
from lockstep.lmi.analysis.margins import largest_alpha
from lockstep.lmi.analysis.unit_scaling import claim_at
from lockstep.lmi.search.barrier import BarrierPoint, NewtonLimits
from lockstep.lmi.search.random_start import GainSearch, Score
from lockstep.lmi.search.stopping import NEVER, Deadline
from lockstep.lmi.shapes import GainBlocks

STRIDES = 12
"""At most so many; one that does not pay ends it before."""

SHORT, LONG = 100, 150
"""Newton steps, for each weight of the barrier, of the first stride and of those after it."""

RAISES = 14
"""Runs that raise alpha."""

WORTHWHILE = 0.01
"""A stride that lowers rho by less than this part of it is the last."""

WORSE = 1.05
"""A stride after which the sampled loop is this much worse than it was at best ends it."""


@dataclass(frozen=True)
class Polished:
    """Gains with an (unproved) certificate for the whole claim.

    index: of the start;  K: in the units of the file;  certificate: in those of the search;  rho: in those of the
    file;  sampled: the larger of rho and that of the sampled loop in doubles, which knows no gain errors;  history:
    the least rho after each stride;  alpha: the largest one reached, as a multiple of the claim's, where that was the
    aim.
    """

    index: int
    K: GainBlocks
    certificate: Certificate
    rho: float
    sampled: float
    history: tuple[float, ...]
    alpha: float = 0.0

    @property
    def rank(self) -> tuple[float, float, float, int]:
        """From best to worst: the largest alpha where that was the aim, then what ships, then rho."""
        return -self.alpha, self.sampled, self.rho, self.index


def as_outcome(search: GainSearch, index: int, point: BarrierPoint, score: Score | None) -> Polished:
    """Return gains with a certificate for the whole claim, in the units of the search, as an outcome."""
    return _outcome(search, index, point, score, ())


def polished(
    search: GainSearch,
    start: Polished,
    score: Score | None = None,
    *,
    rho: float | None = None,
    worthwhile: float = WORTHWHILE,
    deadline: Deadline = NEVER,
) -> Polished:
    """Lower rho from an outcome, and return the one on the way that ships best.

    Args:
        search: what is searched.
        start: where it begins.
        score: of the sampled loop; None to count rho alone.
        rho: None to lower rho; a number to raise alpha with rho at most that.
        worthwhile: the part of rho that a stride has to gain.
        deadline: when to end.
    """
    if eliminates_P(search.loop):
        # A step of the nonlinear program, which holds P, takes seconds there: see `smoothed_norm`.
        return start
    point, best, length = BarrierPoint(start.K, start.certificate), start, SHORT
    for _ in range(STRIDES):
        if deadline.over or (rho is not None and best.rho <= rho):
            break
        before = point.certificate.rho
        point = _stride(search, point, length, deadline)
        new = _outcome(search, start.index, point, score, best.history)
        best = replace(min(best, new, key=lambda one: one.rank), history=new.history)
        gained = 1 - point.certificate.rho / before
        if gained < worthwhile or new.sampled > WORSE * best.sampled:
            break
        length = LONG
    return best if rho is None else _with_alpha_raised(search, best, rho, deadline)


def _outcome(
    search: GainSearch, index: int, point: BarrierPoint, score: Score | None, history: tuple[float, ...]
) -> Polished:
    c = search.units.certificate(point.certificate)
    sampled = c.rho if score is None else max(c.rho, score(point.K, c.pair_weights))
    return Polished(index, point.K, point.certificate, c.rho, sampled, (*history, min([c.rho, *history])))


def _stride(search: GainSearch, point: BarrierPoint, length: int, deadline: Deadline) -> BarrierPoint:
    """Take one run of the nonlinear program; the point as it was where the run did not lower rho."""
    trial = search.program.improve(point, "rho", NewtonLimits(length, deadline=deadline))
    found = least_rho(search.loop, trial.K, search.claim, trial.certificate)
    better = found is not None and found.rho < point.certificate.rho
    return BarrierPoint(trial.K, found) if found is not None and better else point


def _with_alpha_raised(search: GainSearch, best: Polished, rho: float, deadline: Deadline) -> Polished:
    """Raise alpha with rho at most the one given; alpha stays 0 where rho itself was not reached."""
    if best.rho > rho:
        return best
    loop, claim, program = search.loop, search.claim, search.program
    most = rho * best.certificate.rho / best.rho  # rho in the units of the search
    K, alpha = best.K, largest_alpha(loop, best.K, claim, rho=most)
    for _ in range(RAISES):
        start = None if deadline.over else least_rho(loop, K, claim_at(claim, alpha=alpha))
        if start is None:
            break
        part = (alpha / claim.alpha) ** 2
        trial = program.improve(
            BarrierPoint(K, replace(start, rho=most), part), "alpha", NewtonLimits(LONG, deadline=deadline)
        ).K
        higher = largest_alpha(loop, trial, claim, rho=most, from_alpha=alpha)
        if higher <= alpha:
            break
        gained, K, alpha = higher / alpha - 1, trial, higher
        if gained < WORTHWHILE:
            break
    certificate = least_rho(loop, K, claim_at(claim, alpha=alpha))
    if certificate is None:
        return best
    return replace(best, K=K, certificate=certificate, alpha=alpha / claim.alpha)
