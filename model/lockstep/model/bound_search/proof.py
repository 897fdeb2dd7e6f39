"""The public questions: the smallest provable bound of a nonlinearity, and whether a given bound holds.

What is found here is a proposal. The final word is the checker's (`lockstep.check.bound.decide`): alpha is raised by
a little until it decides alpha with these scales, and a bound says how many boxes that takes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from fractions import Fraction

import casadi as ca
import numpy as np

from lockstep.check.bound.box import EVERY_TIME, Box
from lockstep.check.bound.cover import breakpoints
from lockstep.check.bound.decide import MOST_BOXES, Budget, decide_norm
from lockstep.check.bound.phi import ExactPhi
from lockstep.check.bound.slopes import Block, SlopeProblem
from lockstep.check.errors import demand
from lockstep.check.verdict import Verdict
from lockstep.model.bound_search.branch_and_bound import CoverSearch, SearchBudget, SearchState, SlopeRange
from lockstep.model.bound_search.casadi_graph import read
from lockstep.model.bound_search.incumbent import Incumbent
from lockstep.model.bound_search.point_slopes import PointSlopes
from lockstep.model.bound_search.result import Bound, SlopeWitness
from lockstep.model.bound_search.sampling import sample_points
from lockstep.model.bound_search.scaling import choose_scaling

BOXES = 250_000
"""The budget. A core examines about ten thousand a second, so that a domain in six variables that takes all of them is done
in half a minute."""

# A box in many variables costs what its curvature costs: ask for what can be had.
TOLERANCES = {0: 1e-9, 1: 1e-9, 2: 1e-6, 3: 1e-4}
LOOSEST = 5e-3

ROOMS = (0.0, 1e-15, 1e-14, 1e-12, 1e-9, 1e-6, 1e-4)
"""By which part a bound is raised, tried in this order, until the checker decides it."""

Report = Callable[[SearchState], None]


def search_bound(
    problem: SlopeProblem,
    *,
    tolerance: float | None = None,
    boxes: int = BOXES,
    progress: Report | None = None,
) -> Bound:
    """Return the smallest alpha found: |phi(a, t) - phi(b, t)| <= alpha |a - b| on the box; `confirmed_bound` has it decided.

    A vector phi is scaled: the bound is on |D_w^-1 J D_v| (see `Bound`), so that G D_w and D_v^-1 H take the
    places of G and H.

    Args:
        problem: of phi, the domain of v, convex and possibly unbounded, and the range of t; its slopes are not scaled.
        tolerance: the relative gap to close; by default 1e-9 in one variable and less in more.
        boxes: the budget, after which the best enclosure found is the answer: a count, so that the answer is the same
            on every machine.
        progress: called with the state of the search now and then.

    >>> v, t = ca.SX.sym("v"), ca.SX.sym("t")
    >>> phi = read(ca.Function("phi", [v, t], [-3.33 * ca.sin(v)]))
    >>> problem = SlopeProblem.of(phi, Box.everywhere(1))
    >>> confirmed_bound(problem, search_bound(problem)).alpha
    3.33
    """
    D_w, D_v = np.ones(len(problem.jacobian)), np.ones(problem.graph.inputs)
    parts = problem.blocks
    if not parts:
        return zero_bound(problem)
    limits = SearchBudget(_tolerance(tolerance, problem), max(1, boxes // len(parts)), progress)
    outcomes = []
    for rows, columns in parts:
        D_w[rows], D_v[columns] = _scaling(problem, (rows, columns))
        outcomes.append(search_block(problem.scaled(D_w, D_v), (rows, columns), limits))
    alpha = max(o.upper for o in outcomes)
    if len(problem.jacobian) > 1 and 0 < alpha < math.inf:
        for (rows, _), outcome in zip(parts, outcomes, strict=True):
            D_w[rows] = [_share(d, outcome.upper, alpha) for d in D_w[rows]]
    top = max(outcomes, key=lambda o: o.lower)
    converged = all(o.converged for o in outcomes)
    return Bound(
        alpha=alpha,
        lower=top.lower,
        witness=_witness(top.point, top.lower),
        converged=converged,
        reason=_reason(outcomes, alpha, top.lower, converged),
        tolerance=limits.tolerance,
        boxes=sum(o.boxes for o in outcomes),
        input_scale=tuple(D_v.tolist()),
        output_scale=tuple(D_w.tolist()),
    )


def confirmed_bound(problem: SlopeProblem, bound: Bound) -> Bound:
    """Return the bound with the least of a few alphas that the checker decides with its scales, not proved if none.

    The slopes of the problem are not scaled. The search may have come to a box by another way, and several independent
    components share alpha by their scales, with equality: their slopes, scaled, are enclosed a few units in the last
    place above it.
    """
    if not bound.proved:
        return bound
    scaled = problem.scaled(bound.output_scale, bound.input_scale)
    for room in ROOMS:
        alpha, budget = bound.alpha * (1 + room), Budget(min(MOST_BOXES, 4 * bound.boxes + 10_000))
        if decide_norm(scaled, alpha, budget).proved:
            return replace(bound, alpha=alpha, replay=budget.used)
    reason = "the checker does not come to an end with what was found"
    return replace(bound, alpha=math.inf, converged=False, reason=reason)


def prove_bound(
    phi: ca.Function | ExactPhi,
    box: Box,
    alpha: float,
    time: tuple[float, float] = EVERY_TIME,
    *,
    input_scale: Sequence[float] | None = None,
    output_scale: Sequence[float] | None = None,
    boxes: int = BOXES,
    progress: Report | None = None,
) -> Bound:
    """Decide whether alpha bounds |D_w^-1 J D_v|: proved, refuted with a witness, or neither in the budget.

    A witness is looked for among samples first, then the checker decides.

    Args:
        phi: w = phi(v, t), exact, or built from SX: a number in it is the IEEE double it is, exactly.
        box: the domain of v, convex and possibly unbounded.
        alpha: to be decided.
        time: the range of t.
        input_scale, output_scale: the diagonals of D_v and D_w; ones unless given.
        boxes, progress: as for `search_bound`.

    Raises:
        ProblemError: if phi is no such function, uses an unknown operation, or does not match the box.

    >>> v, t = ca.SX.sym("v"), ca.SX.sym("t")
    >>> answer = prove_bound(ca.Function("phi", [v, t], [-3.33 * ca.sin(v)]), Box.everywhere(1), 3.32)
    >>> answer.refuted, answer.witness.slope
    (True, 3.33)

    """
    demand(0 <= alpha < math.inf, f"alpha is {alpha}", "the bound to decide", "a finite number from 0 up")
    alpha = float(alpha)
    exact = read(phi) if isinstance(phi, ca.Function) else phi
    problem = SlopeProblem.of(exact, box, time).scaled(output_scale, input_scale)
    lower, point = _reached(problem)
    budget = _Watched(boxes, progress, lower)
    verdict = Verdict("refuted", "")
    if lower <= alpha:
        verdict = decide_norm(problem, alpha, budget)
        if verdict.status == "refuted":
            lower, point = verdict.figures["slope"], np.array([*verdict.figures["v"], verdict.figures["t"]])
    status, reason = verdict.status, verdict.reason
    if status == "refuted":
        reason = f"a slope of {lower!r} is reached, above {alpha!r}"
    return Bound(
        alpha=alpha if status == "proved" else math.inf,
        lower=lower,
        witness=_witness(point, lower),
        refuted=status == "refuted",
        converged=status != "undecided",
        reason="" if status == "proved" else reason,
        asked=alpha,
        boxes=budget.used,
        input_scale=_given(input_scale, problem.graph.inputs),
        output_scale=_given(output_scale, len(problem.jacobian)),
        replay=budget.used,
    )


def zero_bound(problem: SlopeProblem) -> Bound:
    """The bound of a linear agent, whose phi has no components, or of one that depends on t only."""
    return Bound(
        alpha=0.0,
        lower=0.0,
        reason="phi depends on no state: there is nothing to bound",
        input_scale=(1.0,) * problem.graph.inputs,
        output_scale=(1.0,) * len(problem.jacobian),
    )


class _Watched(Budget):
    """A budget that says how much of it is used."""

    def __init__(self, boxes: int, progress: Report | None, lower: float) -> None:
        super().__init__(min(boxes, MOST_BOXES))
        self.progress, self.lower = progress, lower

    def spend(self, count: int) -> None:
        super().spend(count)
        if self.progress is not None:
            self.progress(SearchState(self.used, self.lower, math.inf, self.used / self.boxes))


def search_block(problem: SlopeProblem, block: Block, limits: SearchBudget) -> SlopeRange:
    """Search the largest modulus of one block of the slopes, on both of its covers where there are two."""
    original = problem.lower, problem.upper
    direct, relaxed = problem.covers(problem.objective(block))
    if relaxed is None:
        return CoverSearch(direct, limits, original).run()
    half = replace(limits, boxes=max(1, limits.boxes // 2))
    size = relaxed.objective.variables
    own = replace(half, tolerance=max(limits.tolerance / 4, 1e-10))
    ceiling = CoverSearch(relaxed, own, (relaxed.lower[:size], relaxed.upper[:size])).run().upper
    return CoverSearch(direct, replace(half, ceiling=ceiling), original).run()


def _reached(problem: SlopeProblem) -> tuple[float, np.ndarray | None]:
    """Return the largest slope that samples reach, and where."""
    best, point = 0.0, None
    for block in problem.blocks:
        objective = problem.objective(block)
        reach = Incumbent(PointSlopes(objective), problem.lower, problem.upper)
        kinks = breakpoints(objective.value, objective.variables)
        for polish in (False, True):
            reach.sample(kinks, polish=polish)
        if reach.slope > best or point is None:
            best, point = max(best, reach.slope), reach.point
    return best, point


def _tolerance(tolerance: float | None, problem: SlopeProblem) -> float:
    if tolerance is None:
        used = frozenset[int]().union(*(x.variables for row in problem.jacobian for x in row))
        angles = max((min(len(r), len(c)) - 1 for r, c in problem.blocks), default=0)
        return TOLERANCES.get(len(used) + angles, LOOSEST)
    demand(0 < tolerance < 1, f"the tolerance is {tolerance}", "the bound", "a number between 0 and 1")
    return float(tolerance)


def _scaling(problem: SlopeProblem, block: Block) -> tuple[list[float], list[float]]:
    rows, columns = block
    if len(rows) == 1:
        return [1.0], [1.0] * len(columns)
    plain = problem.objective(block)
    return choose_scaling(
        plain, sample_points(PointSlopes(plain), problem.lower, problem.upper, [], polish=False)
    )


LITTLE = Fraction(1, 2**45)


def _share(scaled: float, own: float, alpha: float) -> float:
    """Return d own/alpha and a little more: a larger D_w makes the scaled slope smaller, the bound stays proved.

    The little more is for who proves it again with these scales: a scaled slope is enclosed a few units in the last
    place above itself, and must not be above alpha for it.
    """
    if own == alpha or own == 0.0:
        return scaled
    exact = Fraction(scaled) * Fraction(own) / Fraction(alpha) * (1 + LITTLE)
    nearest = float(exact)
    return nearest if Fraction(nearest) >= exact else math.nextafter(nearest, math.inf)


def _given(scales: Sequence[float] | None, size: int) -> tuple[float, ...]:
    return (1.0,) * size if scales is None else tuple(map(float, scales))


def _witness(point: np.ndarray | None, slope: float) -> SlopeWitness | None:
    if point is None:
        return None
    *v, t = (float(x) for x in point)
    return SlopeWitness(tuple(v), t, slope)


def _reason(outcomes: list[SlopeRange], alpha: float, lower: float, converged: bool) -> str:
    for outcome in outcomes:
        if outcome.upper == math.inf:
            return outcome.reason
    if not converged:
        return f"not converged within the budget: the truth is between {lower!r} and {alpha!r}"
    return ""
