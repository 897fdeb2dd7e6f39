"""The decision: |phi(a, t) - phi(b, t)| <= alpha |a - b| on a box, in given scales, with a given number of boxes.

Nothing is searched for here. alpha, the scales, the bounds of single slopes and the number of boxes are those of a
proposal; a branch and bound drops the boxes where the slope is at most alpha and cuts the others. What is cut, and where,
depends on the box and on alpha alone, so that the number of boxes that a proof takes is the same on every machine, and
a replay needs exactly that many.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from lockstep.check.bound.box import EVERY_TIME, Box
from lockstep.check.bound.cover import Cover, Pool
from lockstep.check.bound.graph import Graph
from lockstep.check.bound.result import Entry
from lockstep.check.bound.slopes import Block, Given, Scales, SlopeProblem
from lockstep.check.bound.tails import Pattern
from lockstep.check.errors import ProblemError
from lockstep.check.verdict import Verdict

MOST_BOXES = 1_000_000
"""What a proposal may ask for. A core examines about ten thousand boxes a second."""

BATCH = 256


class Budget:
    """How many boxes there are, and how many have been used."""

    def __init__(self, boxes: int) -> None:
        if not 0 <= boxes <= MOST_BOXES:
            raise ProblemError(
                f"{boxes} boxes", where="the proof of the bound", expected=f"a number from 0 to {MOST_BOXES}"
            )
        self.boxes, self.used = boxes, 0

    def spend(self, count: int) -> None:
        """Use so many; raises `_Spent` if there are not as many left."""
        if self.used + count > self.boxes:
            raise _Spent
        self.used += count


class _Spent(Exception):
    """The boxes do not suffice."""


def decide_bound(
    phi: Graph,
    box: Box,
    alpha: float,
    output_scale: Given,
    input_scale: Given,
    entries: Sequence[Entry] = (),
    *,
    boxes: int,
    time: tuple[float, float] = EVERY_TIME,
) -> Verdict:
    """Decide whether |D_w^-1 J D_v| <= alpha at every v of the box and every t, and whether the entries bound its slopes.

    With entries, each slope that is not identically 0 has to have one: where one is missing, its bound is taken to be 0.
    A locally Lipschitz phi on a convex box has the constant sup |J| over the points where it is differentiable; that phi
    is continuous and defined on the box is part of what is decided.

    Args:
        phi: phi(v, t), exact.
        box: the domain of v.
        alpha: a double, 0 or above.
        output_scale, input_scale: the diagonals of D_w and D_v; None for ones.
        entries: bounds of single slopes, |d phi_k / d v_l| D_v,l / D_w,k.
        boxes: how many boxes may be examined; `figures["boxes"]` says how many were.
        time: the range of t.

    Returns:
        "proved"; "refuted", with `v`, `t` and a `slope` provably reached there; or "undecided".

    Raises:
        ProblemError: what does not fit phi, or a number of boxes above `MOST_BOXES`.
    """
    problem = SlopeProblem.of(phi, box, time)
    budget = Budget(boxes)
    verdict = decide_norm(problem, alpha, output_scale, input_scale, budget)
    if verdict.proved and entries:
        verdict = decide_entries(problem, entries, output_scale, input_scale, budget)
    return Verdict(verdict.status, verdict.reason, {**verdict.figures, "boxes": budget.used})


def decide_norm(
    problem: SlopeProblem,
    alpha: float,
    output_scale: Given,
    input_scale: Given,
    budget: Budget,
) -> Verdict:
    """Decide alpha alone."""
    alpha = check_level(alpha)
    D_w, D_v = problem.scales(output_scale, input_scale)
    for block in problem.blocks:
        verdict = decide_block(problem, block, D_w, D_v, alpha, budget)
        if not verdict.proved:
            return verdict
    return Verdict("proved", f"no slope is above {alpha!r}")


def check_level(alpha: float) -> float:
    """Return a bound to decide as a float; raises `ProblemError` if it is none."""
    if not 0 <= alpha < math.inf:
        raise ProblemError(
            f"alpha is {alpha}", where="the bound to decide", expected="a finite number from 0 up"
        )
    return float(alpha)


def decide_entries(
    problem: SlopeProblem,
    entries: Sequence[Entry],
    output_scale: Given,
    input_scale: Given,
    budget: Budget,
) -> Verdict:
    """Decide bounds of single slopes, and whether those that are not named are 0."""
    stated = {(one.component, one.argument): one.bound for one in entries}
    size = len(problem.jacobian), problem.graph.inputs
    if len(stated) < len(entries) or any(k >= size[0] or l >= size[1] for k, l in stated):
        shown = ", ".join(f"({one.component + 1}, {one.argument + 1})" for one in entries)
        raise ProblemError(
            f"entries for the slopes {shown}",
            where="entries",
            expected=f"each slope of {size[0]} components by {size[1]} arguments at most once",
        )
    D_w, D_v = problem.scales(output_scale, input_scale)
    for k, l in problem.places:
        verdict = decide_block(problem, ([k], [l]), D_w, D_v, stated.get((k, l), 0.0), budget)
        if not verdict.proved:
            missing = "" if (k, l) in stated else ", which has no entry"
            reason = f"slope ({k + 1}, {l + 1}){missing}: {verdict.reason}"
            return Verdict(verdict.status, reason, verdict.figures)
    return Verdict("proved", "each slope is within its bound")


def decide_block(
    problem: SlopeProblem,
    block: Block,
    D_w: Scales,
    D_v: Scales,
    level: float,
    budget: Budget,
) -> Verdict:
    """Take the two covers of a block in turn: a proof on either is one, a witness counts on its own domain only."""
    direct, relaxed = problem.covers(problem.objective(block, D_w, D_v))
    runs = [_branch(direct, level, problem, budget)]
    runs += [] if relaxed is None else [_branch(relaxed, level, None, budget)]
    answers: dict[int, Verdict] = {}
    try:
        while len(answers) < len(runs):
            for k, run in enumerate(runs):
                verdict = None if k in answers else next(run)
                if verdict is not None:
                    answers[k] = verdict
                    if verdict.proved or (k == 0 and verdict.status == "refuted"):
                        return verdict
    except _Spent:
        reason = f"the {budget.boxes} boxes do not suffice to decide whether a slope is above {level!r}"
        return Verdict("undecided", reason)
    return answers[0]


def _branch(
    cover: Cover, level: float, problem: SlopeProblem | None, budget: Budget
) -> Iterator[Verdict | None]:
    """Yield None after each batch of boxes, and at last the answer; witnesses are points of the problem's domain."""
    pools: dict[Pattern, Pool] = {}
    parts = [cover.root]
    while parts:
        for part in parts:
            budget.spend(part[1].shape[1])
            examined = cover.examine(part, level)
            for found in examined.enclosures:
                point = cover.middle_above(part[0], found, level)
                if point is not None:
                    yield from _witness(cover, point, level, problem)
            left = examined.pool.take(examined.pool.bound > level)
            if cover.stuck(left).any():
                yield _stuck(cover, part[0], left.take(np.flatnonzero(cover.stuck(left))[:1]), level)
            pools[part[0]] = pools[part[0]].join(left) if part[0] in pools else left
        yield None
        parts = _next_parts(cover, pools)
    yield Verdict("proved", f"no slope is above {level!r}")


def _next_parts(
    cover: Cover, pools: dict[Pattern, Pool]
) -> list[tuple[Pattern, np.ndarray, np.ndarray, np.ndarray]]:
    """Cut the last boxes of the chart met last that has any: depth first, which keeps few."""
    for pattern in reversed(pools):
        pool = pools[pattern]
        if pool.bound.size:
            last = np.arange(pool.bound.size) >= pool.bound.size - BATCH
            pools[pattern] = pool.take(~last)
            return cover.cutter.split(pattern, pool.take(last))
    return []


def _witness(
    cover: Cover, point: np.ndarray, level: float, problem: SlopeProblem | None
) -> Iterator[Verdict]:
    """Yield a refutation if the slope is provably above the level at a point of the domain."""
    slope = cover.slope_at(point)
    if slope <= level:
        return
    if problem is None:
        yield Verdict("undecided", f"with independent functions a slope of {slope!r} is reached")
        return
    point = point[: len(problem.lower)]
    if ((point >= problem.lower) & (point <= problem.upper)).all():
        *v, t = (float(x) for x in point)
        figures = {"v": v, "t": t, "slope": slope}
        yield Verdict("refuted", f"a slope of {slope!r} is reached, above {level!r}", figures)


def _stuck(cover: Cover, pattern: Pattern, box: Pool, level: float) -> Verdict:
    chart = cover.chart(pattern)
    held = chart.conditions.on_boxes(box.lower, box.upper)
    broken = [c.text for c, holds in zip(chart.conditions.conditions, held, strict=True) if not holds.all()]
    what = broken[0] if broken else f"the slope could not be shown to be at most {level!r}"
    return Verdict("undecided", f"{what} on a box that is too small to be cut")
