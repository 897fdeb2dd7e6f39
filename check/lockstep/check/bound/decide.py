"""The decision: |phi(a, t) - phi(b, t)| <= alpha |a - b| on a box, in given scales, with a given number of boxes.

Nothing is searched for here. alpha, the scales, the bounds of single slopes and the number of boxes are those of a
proposal; a branch and bound drops the boxes where the slope is at most alpha and cuts the others. What is cut, and where,
depends on the box and on alpha alone, so that the number of boxes that a proof takes is the same on every machine, and
a replay needs exactly that many.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import zip_longest

import numpy as np

from lockstep.check.bound.box import EVERY_TIME, Box
from lockstep.check.bound.cover import Cover, Examined, Part, Pool
from lockstep.check.bound.phi import ExactPhi
from lockstep.check.bound.slope_bounds import Entry
from lockstep.check.bound.slopes import Block, Given, SlopeProblem
from lockstep.check.bound.unbounded.tails import Pattern
from lockstep.check.errors import demand
from lockstep.check.verdict import Verdict

MOST_BOXES = 1_000_000
"""What a proposal may ask for. A core examines about ten thousand boxes a second."""

OFFSET_BOXES = 10_000
"""For what terms in t alone need: one variable, and no slope to be tight about."""

BATCH = 256


class Budget:
    """How many boxes there are, and how many have been used."""

    def __init__(self, boxes: int) -> None:
        self.boxes, self.used = boxes, 0

    def spend(self, count: int) -> None:
        """Use so many; raises `_Spent` if there are not as many left."""
        if self.used + count > self.boxes:
            raise _Spent
        self.used += count


class _Spent(Exception):
    """The boxes do not suffice."""


def decide_bound(
    phi: ExactPhi,
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
        alpha: a finite double, 0 or above.
        output_scale, input_scale: the diagonals of D_w and D_v; None for ones.
        entries: bounds of single slopes, |d phi_k / d v_l| D_v,l / D_w,k.
        boxes: how many boxes may be examined; `figures["boxes"]` says how many were.
        time: the range of t.

    Returns:
        "proved"; "refuted", with `v`, `t` and a `slope` provably reached there; or "undecided".

    Raises:
        ProblemError: what does not fit phi.
    """
    problem = SlopeProblem.of(phi, box, time).scaled(output_scale, input_scale)
    budget = Budget(boxes)
    verdict = decide_norm(problem, alpha, budget)
    if verdict.proved and entries:
        verdict = decide_entries(problem, entries, budget)
    return replace(verdict, figures={**verdict.figures, "boxes": budget.used})


def decide_offset(needs: ExactPhi) -> Verdict:
    """Decide whether terms in t alone have a value at every t >= 0, from phi(v, t) = v with what they need."""
    found = decide_bound(
        needs, Box((0.0,), (1.0,)), 1.0, None, None, boxes=OFFSET_BOXES, time=(0.0, math.inf)
    )
    said = "the terms in t alone have a value at every t >= 0"
    what = ", ".join(dict.fromkeys(one.text for one in needs.conditions))
    return Verdict("proved", said) if found.proved else Verdict("undecided", f"in a term in t alone {what}")


def decide_norm(problem: SlopeProblem, alpha: float, budget: Budget) -> Verdict:
    """Decide alpha alone."""
    verdict = Verdict("proved", "phi has no slope")
    for block in problem.blocks:
        verdict = decide_block(problem, block, alpha, budget)
        if not verdict.proved:
            break
    return verdict


def decide_entries(problem: SlopeProblem, entries: Sequence[Entry], budget: Budget) -> Verdict:
    """Decide bounds of single slopes, and whether those that are not named are 0."""
    stated = {(one.component, one.argument): one.bound for one in entries}
    rows, columns = len(problem.jacobian), problem.graph.inputs
    shown = ", ".join(f"({one.component + 1}, {one.argument + 1})" for one in entries)
    once = len(stated) == len(entries) and all(k < rows and l < columns for k, l in stated)
    expected = f"each slope of {rows} components by {columns} arguments at most once"
    demand(once, f"entries for the slopes {shown}", "entries", expected)
    for k, l in problem.places:
        verdict = decide_block(problem, ([k], [l]), stated.get((k, l), 0.0), budget)
        if not verdict.proved:
            missing = "" if (k, l) in stated else ", whose entry is missing"
            return replace(verdict, reason=f"slope ({k + 1}, {l + 1}){missing}: {verdict.reason}")
    return Verdict("proved", "each slope is within its bound")


def decide_block(problem: SlopeProblem, block: Block, level: float, budget: Budget) -> Verdict:
    """Take the two covers of a block in turn: a proof on either is one, a witness counts on its own domain only."""
    direct, relaxed = problem.covers(problem.objective(block))
    runs = [_branch(direct, level, problem, budget)]
    runs += [] if relaxed is None else [_branch(relaxed, level, None, budget)]
    undecided = Verdict("undecided", "")
    try:
        turn: tuple[Verdict | None, ...]
        for turn in zip_longest(*runs):
            for verdict in filter(None, turn):
                if verdict.status != "undecided":
                    return verdict
                undecided = verdict
    except _Spent:
        return Verdict("undecided", f"{budget.boxes} boxes do not suffice to decide {level!r}")
    return undecided


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
            left = examined.pool.take(examined.pool.bound > level)
            verdict = _witness(cover, part[0], examined, level, problem) or _stuck(cover, part[0], left)
            if verdict is not None:
                yield verdict
                return
            pools[part[0]] = pools[part[0]].join(left) if part[0] in pools else left
        yield None
        parts = _next_parts(cover, pools)
    yield Verdict("proved", f"no slope is above {level!r}")


def _next_parts(cover: Cover, pools: dict[Pattern, Pool]) -> list[Part]:
    """Cut the last boxes of the chart met last that has any: depth first, which keeps few."""
    for pattern in reversed(pools):
        pool = pools[pattern]
        if pool.bound.size:
            last = np.arange(pool.bound.size) >= pool.bound.size - BATCH
            pools[pattern] = pool.take(~last)
            return cover.cutter.split(pattern, pool.take(last))
    return []


def _witness(
    cover: Cover, pattern: Pattern, examined: Examined, level: float, problem: SlopeProblem | None
) -> Verdict | None:
    """Return a refutation if the slope is provably above the level at the middle of a box, a point of the domain.

    Above the level where the functions of a relaxed cover are independent, it says only that no proof will come from there.
    """
    for found in examined.enclosures:
        point = cover.middle_above(pattern, found, level)
        slope = -1.0 if point is None else cover.slope_at(point)
        if point is None or slope <= level:
            continue
        if problem is None:
            return Verdict("undecided", f"a slope of {slope!r} is reached with independent functions")
        point = point[: len(problem.lower)]
        # Across a side without width there is no difference of phi.
        wide = problem.lower[:-1] < problem.upper[:-1]
        if wide.all() and ((point >= problem.lower) & (point <= problem.upper)).all():
            figures = {"v": point[:-1].tolist(), "t": float(point[-1]), "slope": slope}
            return Verdict("refuted", f"a slope of {slope!r} is reached, above {level!r}", figures)
    return None


def _stuck(cover: Cover, pattern: Pattern, left: Pool) -> Verdict | None:
    """Return that nothing is decided if a box that is left cannot be cut."""
    stuck = cover.stuck(left)
    if not stuck.any():
        return None
    box, chart = left.take(stuck), cover.chart(pattern)
    held = chart.conditions.on_boxes(box.lower, box.upper)
    broken = [c.text for c, holds in zip(chart.conditions.conditions, held, strict=True) if not holds.all()]
    what = broken[0] if broken else "the slope could not be enclosed"
    return Verdict("undecided", f"{what} on a box that is too small to be cut")
