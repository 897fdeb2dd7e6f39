"""Many starts, the promising ones pursued side by side over the cores, ranked by what ships."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from lockstep.lmi.analysis.certificate_sdp import eliminates_P
from lockstep.lmi.processes.threads import one_thread
from lockstep.lmi.processes.workers import started_without_interrupts
from lockstep.lmi.search.hold_delay import for_delay
from lockstep.lmi.search.local_search import WORTHWHILE, Polished, as_outcome, polished
from lockstep.lmi.search.random_start import (
    GainSearch,
    Homotopy,
    Score,
    StartResult,
    homotopy,
    resume,
    run_start,
)
from lockstep.lmi.search.stopping import NEVER, Deadline

DRAWN, DRAWN_OF_LARGE = 4, 2
"""Starts drawn for each one that is polished; half of them are taken further: most of a search is spent on
few of them (successive halving; Jamieson and Talwalkar 2016). Of large loops fewer are drawn: each takes a minute. Where P is
eliminated each takes minutes: no more are drawn than are asked for, and those taken further, then all as
they were drawn, are pursued one after the other, until one has a certificate."""

SETTLED = 0.002
"""The part of rho that a stride has to gain when the best outcome is polished to its end, or a rho that is asked for is to be
reached."""

SPOILT = 1.05
"""Times the least rho of all starts, above which the sampled rho of the best one is: that start is pursued as well."""

LOST = 1.3
"""A period with which the best start has a rho that is above the least one by more than this makes it worth while to
begin from gains made for the late loop."""

Tell = Callable[[float], None]
T = TypeVar("T")


@dataclass(frozen=True)
class SearchResult:
    """What a search found: outcomes from best to worst, or how near the nearest gains came.

    outcomes: with a certificate for the whole claim, in doubles;  abscissa: the least of any start, in 1/s;  nearest: the
    gains that carry most of the claim, if any carry some of it;  least_rho: the smallest one reached for the whole
    claim;  cut: whether a deadline cut the search;  late: starts whose gains are made for the lag of the period, where
    that left none of them a sampled certificate.
    """

    outcomes: tuple[Polished, ...]
    abscissa: float
    nearest: Homotopy | None
    least_rho: float
    cut: bool
    late: tuple[StartResult, ...] = ()


def search_gains(
    search: GainSearch,
    *,
    starts: int,
    seed: int,
    score: Score | None = None,
    rho: float | None = None,
    jobs: int | None = None,
    tell: Tell | None = None,
    deadline: Deadline = NEVER,
    last: bool = True,
) -> SearchResult:
    """Return what the most promising of many starts came to; the same seed gives the same, whatever `jobs` is.

    Args:
        search: loop, claim and gain limit.
        starts, seed: how many starts are pursued to the end, and from which seed they are drawn.
        score: of the sampled loop; None to rank by rho alone.
        rho: None to lower rho; a number to raise alpha with rho at most that.
        jobs: processes; by default as many as there are cores to run on.
        tell: told the part that is done.
        deadline: when to end; what it cuts depends on the machine.
        last: whether nothing else is tried where this comes to nothing: else it ends where half of the starts are not stable.
    """
    if starts < 1:
        raise ValueError("a search needs at least one start")
    cores = _Cores(jobs or len(os.sched_getaffinity(0)), tell or (lambda _part: None))
    eliminates = eliminates_P(search.loop)
    count = (1 if eliminates else DRAWN_OF_LARGE if search.is_large else DRAWN) * starts
    drawn = list[StartResult]()
    for k, half in enumerate((range(count // 2), range(count // 2, count))):
        if last or not drawn or min(one.abscissa for one in drawn) < 0:
            arguments = [(search, score, seed, index, deadline) for index in half]
            drawn += cores.run((k / 5, (k + 1) / 5), run_start, arguments, deadline)
    drawn.sort(key=lambda one: one.rank)
    finite = [one for one in drawn if np.isfinite(one.at.rho)]
    promising = finite[: -(-count // 2)]
    further = cores.run((0.4, 0.6), resume, [(search, score, one, deadline) for one in promising], deadline)
    further += promising[len(further) :]
    further.sort(key=lambda one: one.rank)
    unheld = list[StartResult]()
    if search.lag and further:
        # A design for the period may begin with gains that the period spoils, and end below those that it does not.
        lowest = min([*further, *finite], key=lambda one: one.at.rho)
        unheld = [lowest] if further[0].sampled > SPOILT * search.units.rho * lowest.at.rho else []
    late: list[StartResult] = []
    if unheld and further[0].sampled > LOST * search.units.rho * min(one.at.rho for one in further):
        held = cores.run((0.6, 0.6), for_delay, [(search, score, one, deadline) for one in further], deadline)
        late = sorted((one for _, one in held if one is not None), key=lambda one: one.rank)[:starts]
        further = [one for one, _ in held] + further[len(held) :]
        further.sort(key=lambda one: one.rank)
    stable = [one for one in drawn if one.abscissa < 0]
    pursued = (further or (stable[:1] if eliminates else stable))[:starts]
    pursued += [one for one in unheld if all(one is not other for other in pursued)]
    if eliminates and further:
        # As they were before they were taken next to the maximum, where certificates are hard to find.
        pursued += [one for one in finite if one.rank not in {other.rank for other in further}]
    ends: list[tuple[Homotopy | None, Polished | None]] = []
    for some in [[one] for one in pursued] if eliminates else [pursued]:
        ends += cores.run((0.6, 0.9), _pursue, [(search, score, one, rho, deadline) for one in some])
        if any(outcome is not None for _, outcome in ends):
            break
    outcomes = sorted((outcome for _, outcome in ends if outcome is not None), key=lambda one: one.rank)
    least = min((one.rho for one in outcomes), default=np.inf)
    if rho is not None:
        outcomes = [one for one in outcomes if one.alpha]
    elif outcomes:
        outcomes[0] = _settled(search, outcomes[0], score, deadline)
    cores.tell(1.0)
    return SearchResult(
        tuple(outcomes),
        min((one.abscissa / search.units.time for one in drawn), default=np.inf),
        max((one for one, _ in ends if one), key=lambda one: (one.certified, one.claimed), default=None),
        float(least),
        deadline.over,
        tuple(late),
    )


def _pursue(
    search: GainSearch, score: Score | None, start: StartResult, rho: float | None, deadline: Deadline
) -> tuple[Homotopy | None, Polished | None]:
    """Take gains to the whole claim, and polish them there."""
    climbed = homotopy(search, start.at, deadline)
    if climbed is None or climbed.certified < 1:
        return climbed, None
    outcome = as_outcome(search, start.index, climbed.point, score)
    worthwhile = WORTHWHILE if rho is None else SETTLED
    return climbed, polished(search, outcome, score, rho=rho, worthwhile=worthwhile, deadline=deadline)


def _settled(search: GainSearch, best: Polished, score: Score | None, deadline: Deadline) -> Polished:
    """Polish the best outcome until hardly anything is gained."""
    with one_thread():
        found = polished(search, best, score, worthwhile=SETTLED, deadline=deadline)
    return min(found, best, key=lambda one: one.rank)


@dataclass(frozen=True)
class _Cores:
    """Runs a function on many arguments, over the cores, and tells which part of the whole is done."""

    count: int
    tell: Tell

    def run(
        self,
        part: tuple[float, float],
        function: Callable[..., T],
        arguments: Sequence[tuple[Any, ...]],
        deadline: Deadline = NEVER,
    ) -> list[T]:
        """Return the results in the order of the arguments: those that were begun before the deadline."""
        from joblib import Parallel, delayed

        self.tell(part[0])
        if not arguments:
            return []
        found: list[T] = []
        with started_without_interrupts():
            results = Parallel(n_jobs=min(self.count, len(arguments)), return_as="generator")(
                delayed(_single_threaded)(function, *one) for one in arguments if not deadline.over
            )
        for result in results:
            found.append(result)
            self.tell(part[0] + (part[1] - part[0]) * len(found) / len(arguments))
        return found


def _single_threaded(function: Callable[..., T], *arguments: Any) -> T:
    with one_thread():
        return function(*arguments)
