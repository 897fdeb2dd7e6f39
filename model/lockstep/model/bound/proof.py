"""The public questions: the smallest provable bound of a nonlinearity, and whether a given bound holds."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import casadi as ca
import numpy as np
from jaxtyping import Float

from lockstep.check.bound.box import EVERY_TIME, Box, check_time
from lockstep.check.bound.conditions import Conditions
from lockstep.check.bound.continuity import settle
from lockstep.check.bound.graph import Graph
from lockstep.check.bound.objective import Objective, blocks
from lockstep.check.bound.period import reduce_to_period
from lockstep.check.bound.relaxation import relax
from lockstep.check.bound.result import Bound, Witness
from lockstep.check.errors import ProblemError
from lockstep.check.expression.derivative import derivative
from lockstep.check.expression.node import Node, scale
from lockstep.model.bound.graph import read
from lockstep.model.bound.sampling import sample_points
from lockstep.model.bound.scaling import choose_scaling
from lockstep.model.bound.search import Limits, Outcome, Progress, Search

BOXES = 250_000
"""The budget. A core examines about ten thousand a second, so that a domain in six variables that takes all of them is done
in half a minute."""

# A box in many variables costs what its curvature costs: ask for what can be had.
TOLERANCES = {0: 1e-9, 1: 1e-9, 2: 1e-6, 3: 1e-4}
LOOSEST = 5e-3

Report = Callable[[Progress], None]


@dataclass(frozen=True, eq=False)
class Task:
    """phi read and settled, its slopes, and the domain of (v, t)."""

    graph: Graph
    jacobian: list[list[Node]]
    lower: Float[np.ndarray, " variables"]
    upper: Float[np.ndarray, " variables"]

    @property
    def empty(self) -> bool:
        """Whether there is no slope to bound: phi has no components or no arguments."""
        return not self.jacobian or self.graph.inputs == 0


def smallest_bound(
    phi: ca.Function,
    box: Box,
    time: tuple[float, float] = EVERY_TIME,
    *,
    tolerance: float | None = None,
    boxes: int = BOXES,
    progress: Report | None = None,
) -> Bound:
    """Return the smallest provable alpha: |phi(a, t) - phi(b, t)| <= alpha |a - b| on the box, t in `time`.

    A vector phi is scaled: the bound is on |D_w^-1 J D_v| (see `Bound`), so that G D_w and D_v^-1 H take the
    places of G and H.

    Args:
        phi: w = phi(v, t), built from SX; a number in it is the IEEE double it is, exactly.
        box: the domain of v, convex and possibly unbounded.
        time: the range of t.
        tolerance: the relative gap to close; by default 1e-9 in one variable and less in more.
        boxes: the budget, after which the best enclosure found is the answer: a count, so that the answer is the same
            on every machine.
        progress: called with the state of the search now and then.

    Raises:
        ProblemError: if phi is no such function, uses an unknown operation, or does not match the box.

    >>> v, t = ca.SX.sym("v"), ca.SX.sym("t")
    >>> smallest_bound(ca.Function("phi", [v, t], [-3.33 * ca.sin(v)]), Box.everywhere(1)).alpha
    3.33

    """
    task = prepare(phi, box, time)
    if task.empty:
        return _nothing(task, box, None)
    parts = blocks(task.jacobian) or [([0], [0])]
    limits = Limits(_tolerance(tolerance, task), max(1, boxes // len(parts)), None, progress)
    outcomes, D_w, D_v = [], np.ones(len(task.jacobian)), np.ones(box.size)
    for rows, columns in parts:
        own_w, own_v = _scaling(task, rows, columns)
        D_w[rows], D_v[columns] = own_w, own_v
        outcomes.append(search_block(task, rows, columns, D_w, D_v, limits))
    alpha = max(o.upper for o in outcomes)
    if len(task.jacobian) > 1 and 0 < alpha < math.inf:
        for (rows, _), outcome in zip(parts, outcomes, strict=True):
            D_w[rows] = [_share(d, outcome.upper, alpha) for d in D_w[rows]]
    return _bound(outcomes, limits, D_w, D_v)


def prove_bound(
    phi: ca.Function,
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

    Arguments and errors are those of `smallest_bound`; the scales are ones unless given.

    >>> v, t = ca.SX.sym("v"), ca.SX.sym("t")
    >>> answer = prove_bound(ca.Function("phi", [v, t], [-3.33 * ca.sin(v)]), Box.everywhere(1), 3.32)
    >>> answer.refuted, answer.witness.slope
    (True, 3.33)

    """
    if not 0 <= alpha < math.inf:
        raise ProblemError(
            f"alpha is {alpha}", where="the bound to decide", expected="a finite number from 0 up"
        )
    task = prepare(phi, box, time)
    D_w = scale_given(output_scale, len(task.jacobian), "output_scale")
    D_v = scale_given(input_scale, box.size, "input_scale")
    if task.empty:
        return _nothing(task, box, float(alpha))
    parts = blocks(task.jacobian) or [([0], [0])]
    limits = Limits(0.0, max(1, boxes // len(parts)), float(alpha), progress)
    outcomes = [search_block(task, rows, columns, D_w, D_v, limits) for rows, columns in parts]
    return _bound(outcomes, limits, D_w, D_v)


def prepare(phi: ca.Function, box: Box, time: tuple[float, float]) -> Task:
    """Return phi read, settled and differentiated, with its domain."""
    graph = read(phi)
    if box.size != graph.inputs:
        raise ProblemError(
            f"the domain has {box.size} components, phi takes {graph.inputs}",
            where="the domain",
            expected="one range per component of v",
        )
    low, high = check_time(time)
    lower, upper = np.array([*box.lower, low]), np.array([*box.upper, high])
    graph = settle(graph, lower[:, None], upper[:, None])
    columns = [derivative(graph.outputs, k) for k in range(graph.inputs)]
    rows = [[column[i] for column in columns] for i in range(len(graph.outputs))]
    return Task(graph, rows, lower, upper)


def _nothing(task: Task, box: Box, asked: float | None) -> Bound:
    """The bound of a linear agent, whose phi has no components, or of one that depends on t only."""
    return Bound(
        alpha=0.0,
        lower=0.0,
        witness=None,
        proved=True,
        refuted=False,
        converged=True,
        reason="phi depends on no state: there is nothing to bound",
        asked=asked,
        tolerance=0.0,
        boxes=0,
        input_scale=(1.0,) * box.size,
        output_scale=(1.0,) * len(task.jacobian),
    )


def _tolerance(tolerance: float | None, task: Task) -> float:
    if tolerance is None:
        used = frozenset[int]().union(*(x.variables for row in task.jacobian for x in row))
        angles = max((min(len(r), len(c)) - 1 for r, c in blocks(task.jacobian)), default=0)
        return TOLERANCES.get(len(used) + angles, LOOSEST)
    if not 0 < tolerance < 1:
        raise ProblemError(
            f"the tolerance is {tolerance}", where="the bound", expected="a number between 0 and 1"
        )
    return float(tolerance)


def scale_given(scales: Sequence[float] | None, size: int, name: str) -> Float[np.ndarray, " scales"]:
    """Return given scales, or ones; refuse what is none."""
    given = np.ones(size) if scales is None else np.asarray(scales, dtype=np.float64)
    if given.shape != (size,) or not (np.isfinite(given).all() and (given > 0).all()):
        raise ProblemError(f"`{name}` is {scales}", where="the bound", expected=f"{size} positive numbers")
    return given


def _objective(
    task: Task, rows: list[int], columns: list[int], D_w: np.ndarray, D_v: np.ndarray
) -> Objective:
    """Return the block of D_w^-1 J D_v, scaled exactly."""
    slopes = tuple(
        tuple(scale(Fraction(float(D_v[j])) / Fraction(float(D_w[i])), task.jacobian[i][j]) for j in columns)
        for i in rows
    )
    return Objective(slopes, Conditions(task.graph.conditions), task.graph.inputs + 1)


def _scaling(task: Task, rows: list[int], columns: list[int]) -> tuple[list[float], list[float]]:
    ones_w, ones_v = np.ones(len(task.jacobian)), np.ones(task.graph.inputs)
    if len(rows) == 1:
        return [1.0], [1.0] * len(columns)
    plain = _objective(task, rows, columns, ones_w, ones_v)
    return choose_scaling(plain, sample_points(plain, task.lower, task.upper, [], polish=False))


def search_block(
    task: Task, rows: list[int], columns: list[int], D_w: np.ndarray, D_v: np.ndarray, limits: Limits
) -> Outcome:
    """Search the largest modulus of one block of D_w^-1 J D_v."""
    objective = _objective(task, rows, columns, D_w, D_v)
    lower, upper = reduce_to_period([objective.value, *_needs(objective)], task.lower, task.upper)
    relaxed = _relaxed(objective, lower, upper, limits)
    if relaxed is None:
        return Search(
            objective, *_with_angles(objective, lower, upper), limits, (task.lower, task.upper)
        ).run()
    direct = replace(limits, ceiling=relaxed.upper, boxes=_half(limits))
    return Search(objective, *_with_angles(objective, lower, upper), direct, (task.lower, task.upper)).run()


def _relaxed(objective: Objective, lower: np.ndarray, upper: np.ndarray, limits: Limits) -> Outcome | None:
    """Return a bound that takes the bounded functions of unbounded variables as independent."""
    found = relax(objective, lower, upper)
    if found is None:
        return None
    own = replace(limits, asked=None, tolerance=max(limits.tolerance / 4, 1e-10), boxes=_half(limits))
    ends = _with_angles(*found)
    return Search(found[0], *ends, own, (found[1], found[2])).run()


def _half(limits: Limits) -> int:
    return max(1, limits.boxes // 2)


def _with_angles(objective: Objective, lower: np.ndarray, upper: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    angles = objective.angles
    return np.concatenate([lower, [a for a, _ in angles]]), np.concatenate([upper, [b for _, b in angles]])


def _needs(objective: Objective) -> list[Node]:
    return [n for c in objective.conditions.conditions for n in (c.guard, *c.args)]


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


def _bound(outcomes: list[Outcome], limits: Limits, D_w: np.ndarray, D_v: np.ndarray) -> Bound:
    top = max(outcomes, key=lambda o: o.lower)
    alpha = max(o.upper for o in outcomes)
    asked = limits.asked
    proved = alpha < math.inf if asked is None else alpha <= asked
    refuted = asked is not None and top.lower > asked
    converged = all(o.converged for o in outcomes) or refuted
    return Bound(
        alpha=alpha,
        lower=top.lower,
        witness=_witness(top),
        proved=proved,
        refuted=refuted,
        converged=converged,
        reason=_reason(outcomes, alpha, top.lower, converged, asked),
        asked=asked,
        tolerance=limits.tolerance,
        boxes=sum(o.boxes for o in outcomes),
        input_scale=tuple(float(x) for x in D_v),
        output_scale=tuple(float(x) for x in D_w),
    )


def _witness(outcome: Outcome) -> Witness | None:
    if outcome.point is None:
        return None
    *v, t = (float(x) for x in outcome.point)
    return Witness(tuple(v), t, outcome.lower)


def _reason(outcomes: list[Outcome], alpha: float, lower: float, converged: bool, asked: float | None) -> str:
    for outcome in outcomes:
        if outcome.upper == math.inf:
            return outcome.reason
    if asked is not None and lower > asked:
        return f"a slope of {lower!r} is reached, above {asked!r}"
    if not converged:
        return f"not converged within the budget: the truth is between {lower!r} and {alpha!r}"
    return ""
