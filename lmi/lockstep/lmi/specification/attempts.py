"""One specification after the other, as `defaults` yields them, until gains are near their floor: the best of them.

Specifications have weights of their own, so that they are compared by rho over its floor, of the loop that ships.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from lockstep.check.errors import ClaimError, Infeasible, NotCertified, OutOfTime
from lockstep.lmi.analysis.certificate_sdp import eliminates_P
from lockstep.lmi.proposal import Proposal, claim_of
from lockstep.lmi.search.stopping import NothingYet, Stop
from lockstep.lmi.specification.defaults import (
    CALM,
    FAR,
    MUCH,
    STATES,
    VERY_FAR,
    Specification,
    defaults_of,
    keeping,
    specifications,
)
from lockstep.lmi.specification.within_limits import within_limits
from lockstep.model.assembly import network_of
from lockstep.model.bound_search import Bound
from lockstep.model.problem import Problem

Progress = Callable[[str, float], None]
"""Called with what is being done and the part of it that is done, from 0 to 1."""


class Attempt(NamedTuple):
    """What `design` is given beside the problem, and whether to look for what is in the way where no gains are found."""

    jobs: int | None
    tell: Progress
    time_limit: float | None
    stop: Stop
    explain: bool


DESIGNED_FOR_PERIOD = 3.0
"""Times its continuous rho at most: what gains are taken to ship with whose sampled loop is worse, or has no rho. A design
for the period brings most of them back."""


@dataclass
class _Tried:
    """How far specifications of a problem came, in words; the best gains, and how many it took to find them."""

    problem: Problem
    said: list[str] = field(default_factory=list)
    best: Proposal | None = None
    taken: int = 0

    def add(self, spec: Specification, found: Proposal) -> None:
        """Take what a specification came to, if it is much better, or enough where what was taken is not."""
        best = self.best
        suffices = (
            spec.enough and best and best.floor and _over_floor(found, best) <= VERY_FAR < _over_floor(best)
        )
        as_large = len(self.said) == 1 and best and best.problem.order < spec.problem.order
        part = 1.0 if suffices else STATES if as_large else MUCH
        if best is None or _shipped(found, best) < part * _shipped(best):
            before = "; ".join(filter(None, (*self.said, spec.not_asked)))
            self.best = found if spec.problem is self.problem else _with_remark(found, spec, before)
            self.taken = len(self.said) + 1
        times = " times its lower bound" * bool(found.floor)
        self.said.append(spec.with_limit(f"rho was {_over_floor(found):.3g}{times}"))

    def is_near(self, spec: Specification) -> bool:
        """Return whether larger gains than those of a specification are not looked for.

        Of many agents with gains of their own another search takes many minutes. Of many graphs there is no floor.
        """
        best, again = self.best, self.taken < len(self.said)
        if best is None:
            return False
        if spec.static:
            if not best.floor or _shipped(best) > max(spec.static, CALM if spec.sized else 0.0):
                return False
            calm = best.problem.design.decay or within_limits(best.problem, best.network, best.gains)
            return bool(_shipped(best) <= spec.static or calm)
        near = VERY_FAR if spec.enough or again else FAR
        far = _over_floor(best) > near if best.floor else best.network.spectrum is None and not again
        return not far or eliminates_P(best.network.loop(best.problem.order))

    def result(self) -> Proposal:
        """Return the best, which says what was tried after it."""
        assert self.best is not None
        if not self.said[self.taken :]:
            return self.best
        asked = self.best.figures["defaults"] | {"not_taken": "; ".join(self.said[self.taken :])}
        return replace(self.best, figures=self.best.figures | {"defaults": asked})


def first_near_its_floor(
    problem: Problem, bound: Bound, attempt: Attempt, propose: Callable[[Problem, Bound, Attempt], Proposal]
) -> Proposal:
    """Return what the first specification of a problem comes to that comes near its floor, or the best of all.

    Args:
        problem: as it was read.
        bound: of its nonlinearity.
        attempt: processes, progress, time for all specifications and what ends the search.
        propose: designs and proves what one specification asks for.

    Raises:
        Infeasible, NotCertified, OutOfTime: see `design`; of the last specification, if none led to gains.
    """
    specs = list(specifications(problem, network_of(problem, bound), claim_of(problem, bound)))
    deadline = None if attempt.time_limit is None else time.monotonic() + attempt.time_limit
    stop, tried, first = attempt.stop, _Tried(problem), ""
    for number, spec in enumerate(specs, start=1):
        last = number == len(specs)
        stop.found = tried.best is not None and problem.design.method == "certified"
        left = attempt.time_limit
        if deadline is not None and number > 1:
            left = max(deadline - time.monotonic(), 1e-3)
        so_far = f" ({tried.said[-1]})" if tried.said else ""
        nth = f"attempt {number} of at most {len(specs)}{so_far}: " * (len(specs) > 1)

        def counted(what: str, part: float, nth: str = nth) -> None:
            attempt.tell(nth + what, part)

        one = Attempt(attempt.jobs, counted, left, stop, explain=last)
        try:
            tried.add(spec, propose(spec.problem, bound, one))
        except KeyboardInterrupt as error:  # a second one keeps nothing, nor does one that nobody is to take
            asked = isinstance(error, NothingYet) or (stop.flag and not stop.asked)
            if tried.best is None or not asked:
                raise
            stop.asked = True
        except (Infeasible, NotCertified, OutOfTime) as error:
            # What no controller can is said in the same words each time.
            first = first or ("" if spec.static else str(error))
            if tried.best is None and (last or stop.asked or _over(deadline)):
                raise _after(error, first, tried.said, spec) from None
            tried.said.append(spec.with_limit(_came_to(error, problem.design.decay)))
        if tried.best is not None and (stop.asked or _over(deadline) or tried.is_near(spec)):
            break
    found = tried.result()
    return replace(found, figures=found.figures | {"interrupted": True}) if stop.asked else found


def _over(deadline: float | None) -> bool:
    return deadline is not None and time.monotonic() >= deadline


def _after(error: ClaimError, first: str, said: Sequence[str], spec: Specification) -> ClaimError:
    """Return the error of the last specification, with how far those before it came."""
    if not said or isinstance(error, OutOfTime) or str(error) == first:
        return error
    before = "; ".join(filter(None, (*said, spec.not_asked)))
    return type(error)(f"{error}; before that, by default, {before}", **error.figures)


def _came_to(error: ClaimError, decay: float | None) -> str:
    """Return how far an attempt without gains came, in a few words."""
    figures = error.figures
    if "fraction" in figures:
        return f"{int(100 * figures['fraction']) / 100 or 'nothing'} of what is asked was carried"
    if isinstance(error, NotCertified):
        return f"gains were found, but not proved ({error})"
    if figures.get("abscissa", -1.0) < 0:
        return "none had a certificate" + ", even for a thousandth of alpha" * ("abscissa" in figures)
    if not decay:
        return "no loop was as stable as is searched for"
    came = figures.get("decay", 0.0)
    return f"no loop decayed at {decay:g} 1/s{f' ({came:.2g} 1/s at most)' if came > 0 else ''}"


def _over_floor(found: Proposal, other: Proposal | None = None) -> float:
    """Return rho over its floor, or over that of another one."""
    floor = found.floor or (other and other.floor)
    rho = np.inf if found.certificate is None else found.certificate.rho
    return rho / floor.rho if floor else rho


def _shipped(found: Proposal, other: Proposal | None = None) -> float:
    """Return the same of the sampled loop: of gains that the period spoils, what a design for it may come to."""
    over_floor = _over_floor(found, other)
    if found.certificate is None or found.sampled is None:
        return over_floor
    return over_floor * min(found.sampled / found.certificate.rho, DESIGNED_FOR_PERIOD)


def _with_remark(found: Proposal, spec: Specification, before: str) -> Proposal:
    """Return a proposal that says what was asked for by default, and the decay that a design for the period keeps to."""
    problem = spec.problem
    if spec.enough and found.guarantees.decay is not None:
        problem = keeping(problem, found.guarantees.decay[0])
    asked = ({"order": 0} if spec.static else {}) | defaults_of(problem)
    figures = found.figures | {"defaults": asked | ({"given_up": before} if before else {})}
    return replace(found, problem=problem, figures=figures)
