"""A bound of its own for each slope d phi_k / d v_l, where one number alpha for all arguments would say too little.

By the mean value theorem for a Lipschitz function (Lebourg 1975; Clarke 1990, theorem 2.3.7), for a and b in a convex box
and any t,

    phi_k(a, t) - phi_k(b, t) = sum_l j_l (a_l - b_l),      |j_l| <= the bound of entry (k, l).

A thrust T cos(theta) changes by T per angle and by 1 per newton; alpha grants the angle's slope to the thrust as well. And
of friction beside an orifice, each of one argument, alpha bounds the root of the sum of squares, of m/s and Pa: which of the
two that is about depends on the units, where a bound for each has a multiplier for each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from lockstep.check.bound.decide import MOST_BOXES, Budget, decide_block
from lockstep.check.bound.slope_bounds import Entry
from lockstep.check.bound.slopes import Block, SlopeProblem
from lockstep.model.bound_search.branch_and_bound import SearchBudget
from lockstep.model.bound_search.proof import LOOSEST, ROOMS, TOLERANCES, search_block
from lockstep.model.bound_search.result import Bound


def with_entries(problem: SlopeProblem, bound: Bound, boxes: int) -> Bound:
    """Return the bound with a proved one for each slope of D_w^-1 J D_v that is not 0, and the boxes that they take counted.

    None are there where phi has one slope only, so that alpha says as much, and where a bound was not proved within the
    budget.

    Args:
        problem: its slopes are not scaled.
        bound: the scales D_w and D_v are those of it.
        boxes: the budget for all of them, a count.
    """
    entries, used = _search(problem.scaled(bound.output_scale, bound.input_scale), boxes)
    return replace(bound, entries=entries, replay=bound.replay + used)


def slopes_of(
    entries: Sequence[Entry], scales: tuple[Sequence[float], Sequence[float]] | None
) -> tuple[float, ...]:
    """Return bounds of d phi_k / d v_l themselves, without the scales D_w and D_v (None: ones), rounded up by a little."""
    ratios = (scales[0][one.component] / scales[1][one.argument] if scales else 1.0 for one in entries)
    return tuple(one.bound * ratio * (1 + 2**-50) for one, ratio in zip(entries, ratios, strict=True))


def _search(problem: SlopeProblem, boxes: int) -> tuple[tuple[Entry, ...], int]:
    """Return the entries, and how many boxes the checker takes to decide them."""
    places = problem.places
    if len(places) <= 1:
        return (), 0
    found, used = [], 0
    for k, l in places:
        tolerance = TOLERANCES.get(len(problem.jacobian[k][l].variables), LOOSEST)
        outcome = search_block(problem, ([k], [l]), SearchBudget(tolerance, max(1, boxes // len(places))))
        decided = _decided(problem, ([k], [l]), outcome.upper, 4 * outcome.boxes + 10_000)
        if decided is None:
            return (), 0
        found.append(decided[0])
        used += decided[1]
    return tuple(found), used


def _decided(problem: SlopeProblem, block: Block, upper: float, boxes: int) -> tuple[Entry, int] | None:
    """Return the least of a few entries from `upper` on that the checker decides, and the boxes it takes."""
    for room in ROOMS if upper < float("inf") else ():
        entry = Entry(block[0][0], block[1][0], upper * (1 + room))
        budget = Budget(min(MOST_BOXES, boxes))
        if decide_block(problem, block, entry.bound, budget).proved:
            return entry, budget.used
    return None
