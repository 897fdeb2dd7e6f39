"""A bound of its own for each slope d phi_k / d v_l, where one number alpha for all arguments would say too little.

By the mean value theorem for a Lipschitz function (Lebourg 1975; Clarke 1990, theorem 2.3.7), for a and b in a convex box
and any t,

    phi_k(a, t) - phi_k(b, t) = sum_l j_l (a_l - b_l),      |j_l| <= the bound of entry (k, l).

A thrust T cos(theta) changes by T per angle and by 1 per newton; alpha grants the angle's slope to the thrust as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import casadi as ca

from lockstep.check.bound.box import EVERY_TIME, Box
from lockstep.check.bound.result import Entry
from lockstep.check.errors import ProblemError
from lockstep.check.expression.node import ZERO
from lockstep.model.bound.proof import (
    BOXES,
    LOOSEST,
    TOLERANCES,
    Task,
    prepare,
    scale_given,
    search_block,
)
from lockstep.model.bound.search import Limits

ROOMS = (0.0, 1e-12, 1e-9, 1e-6, 1e-4)
"""By which part a bound is raised, tried in this order, until it is decided as the checker decides it."""


def entry_bounds(
    phi: ca.Function,
    box: Box,
    time: tuple[float, float] = EVERY_TIME,
    *,
    input_scale: Sequence[float] | None = None,
    output_scale: Sequence[float] | None = None,
    boxes: int = BOXES,
) -> tuple[Entry, ...]:
    """Return a proved bound for each slope of D_w^-1 J D_v that is not identically 0.

    None are returned where no component has two arguments, so that alpha says as much, and where a bound was not
    proved within the budget.

    Args:
        phi, box, time: as for `smallest_bound`.
        input_scale, output_scale: the diagonals of D_v and D_w; ones unless given.
        boxes: the budget for all of them, a count.

    >>> v, t = ca.SX.sym("v", 2), ca.SX.sym("t")
    >>> phi = ca.Function("phi", [v, t], [v[0] * ca.sin(v[1])])
    >>> [entry.bound for entry in entry_bounds(phi, Box((-2.0, -10.0), (2.0, 10.0)))]
    [1.0, 2.0]
    """
    task = prepare(phi, box, time)
    places = _places(task)
    if len({k for k, _ in places}) == len(places):
        return ()
    scales = output_scale, input_scale
    found = []
    for k, l in places:
        limits = _limits(task, k, l, max(1, boxes // len(places)))
        upper = _searched(task, k, l, scales, limits)
        raised = (Entry(k, l, upper * (1 + room)) for room in ROOMS if upper < float("inf"))
        entry = next((one for one in raised if _holds(task, one, scales, limits)), None)
        if entry is None:
            return ()
        found.append(entry)
    return tuple(found)


def entries_hold(
    phi: ca.Function,
    box: Box,
    entries: Sequence[Entry],
    time: tuple[float, float] = EVERY_TIME,
    *,
    input_scale: Sequence[float] | None = None,
    output_scale: Sequence[float] | None = None,
    boxes: int = BOXES,
) -> bool:
    """Decide whether stated entries bound the slopes of D_w^-1 J D_v, and whether they are all that are not 0.

    A missing entry is no small matter: phi_k(a) - phi_k(b) would have a part that no bound speaks of.

    Raises:
        ProblemError: an entry for a component or argument that phi does not have, or two for one slope.
    """
    task = prepare(phi, box, time)
    stated = [(one.component, one.argument) for one in entries]
    if len(set(stated)) < len(stated) or any(k >= len(task.jacobian) or l >= box.size for k, l in stated):
        raise ProblemError(
            f"entries for the slopes {', '.join(f'({k + 1}, {l + 1})' for k, l in stated)}",
            where="entries",
            expected=f"each slope of {len(task.jacobian)} components by {box.size} arguments at most once",
        )
    scales = output_scale, input_scale
    return set(stated) >= set(_places(task)) and all(
        _holds(
            task,
            one,
            scales,
            _limits(task, one.component, one.argument, max(1, boxes // len(entries))),
        )
        for one in entries
    )


Scales = tuple[Sequence[float] | None, Sequence[float] | None]


def _places(task: Task) -> list[tuple[int, int]]:
    """Return (k, l) of each slope that is not identically 0."""
    return [(k, l) for k, row in enumerate(task.jacobian) for l, slope in enumerate(row) if slope is not ZERO]


def _limits(task: Task, k: int, l: int, boxes: int) -> Limits:
    tolerance = TOLERANCES.get(len(task.jacobian[k][l].variables), LOOSEST)
    return Limits(tolerance, boxes)


def _searched(task: Task, k: int, l: int, scales: Scales, limits: Limits) -> float:
    D_w = scale_given(scales[0], len(task.jacobian), "output_scale")
    D_v = scale_given(scales[1], task.graph.inputs, "input_scale")
    return search_block(task, [k], [l], D_w, D_v, limits).upper


def _holds(task: Task, entry: Entry, scales: Scales, limits: Limits) -> bool:
    asked = replace(limits, tolerance=0.0, asked=entry.bound)
    return _searched(task, entry.component, entry.argument, scales, asked) <= entry.bound
