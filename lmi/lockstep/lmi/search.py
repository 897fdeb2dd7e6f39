"""The search for gains: several starts side by side over the cores, the best one kept."""

import os
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from lockstep.lmi.inequality import Claim
from lockstep.lmi.start import Outcome, from_start
from lockstep.lmi.threads import one_thread
from lockstep.lmi.workers import started_without_interrupts
from lockstep.model.loop import Loop


def search(
    loop: Loop,
    claim: Claim,
    gain_limit: float,
    *,
    starts: int,
    seed: int,
    rho: float | None = None,
    jobs: int | None = None,
    tell: Callable[[float], None] | None = None,
    deadline: float | None = None,
) -> Outcome:
    """Return the best outcome of `starts` random starts; the same seed gives the same outcome, whatever
    `jobs` is, unless a deadline cuts the search: then the outcome says so.

    Args:
        loop: in doubles.
        claim: what is to be certified.
        gain_limit: bound on the spectral norm of each agent's gain block.
        starts, seed: how many random starts, and from which seed they are drawn.
        rho: None to lower rho; a number to raise alpha with rho at most that.
        jobs: processes; by default as many as there are cores to run on.
        tell: told the part of the starts that are done.
        deadline: of `time.monotonic`, which all processes of a machine share.
    """
    from joblib import Parallel, delayed

    workers = min(jobs or len(os.sched_getaffinity(0)), starts)
    tell = tell or (lambda _part: None)
    tell(0.0)
    tasks = (
        delayed(_single_threaded)(loop, claim, gain_limit, seed, index, rho, deadline)
        for index in range(starts)
    )
    outcomes: list[Outcome] = []
    with started_without_interrupts():
        found = Parallel(n_jobs=workers, return_as="generator")(tasks)
    for outcome in found:
        outcomes.append(outcome)
        tell(len(outcomes) / starts)
    if not outcomes:
        raise ValueError("a search needs at least one start")
    best = min(outcomes, key=_rank)
    return replace(best, cut=any(outcome.cut for outcome in outcomes))


def _single_threaded(*arguments: Any) -> Outcome:
    with one_thread():
        return from_start(*arguments)


def _rank(outcome: Outcome) -> tuple[float, float, float, float, int]:
    """Order outcomes from best to worst: the largest alpha where that was the aim, then rho, then how far it got."""
    certified = outcome.certificate is not None
    last = outcome.history[-1] if outcome.history else float("inf")
    part = max(outcome.fraction, outcome.claimed)
    return (-outcome.alpha if certified else 0.0, outcome.rho, -part, last, outcome.index)
