"""The sector of each component of phi: a v^2 <= v phi(v, t) <= b v^2 on the domain (Khalil 2002, definition 6.2).

phi is the agent's as it is written, before any slope is moved into A. Where v is not 0 the quotient phi / v is enclosed; at
and around 0, where phi(0, t) = 0, it lies in the range of the slopes between 0 and v (mean value theorem).
"""

from __future__ import annotations

from fractions import Fraction
from math import inf

import numpy as np

from lockstep.check.bound import intervals
from lockstep.check.bound.continuity import settle
from lockstep.check.bound.enclosure import Program
from lockstep.check.bound.intervals import Interval
from lockstep.check.bound.phi import ExactPhi
from lockstep.check.bound.regularity import Conditions
from lockstep.check.expression.derivative import derivative
from lockstep.check.expression.node import ZERO, Node, Undefined, linear, linear_terms, variable
from lockstep.check.expression.traversal import expand, substitute
from lockstep.model.agents.agent import Agent
from lockstep.model.agents.arguments import arguments_text
from lockstep.model.checks.proved.finding import CheckFinding
from lockstep.model.checks.proved.interval_algebra.definite import (
    BOXES,
    TOLERANCES,
    Question,
    largest_eigenvalue,
    least_level,
)
from lockstep.model.checks.proved.vector_field import FAR, Ends, as_written


def sectors(agent: Agent, *, boxes: int = BOXES) -> list[CheckFinding]:
    """Find the sector of each component of phi on the domain of the agent.

    Returns:
        One finding per component: "proved" with `a` and `b`, each within 1e-4 of the sharpest where that could be shown, None
        where there is none; "refuted" where phi(0, t) is not 0; "undecided" for several arguments.
    """
    exact, box = as_written(agent), agent.argument_box
    count = exact.phi.inputs
    lower, upper = np.array([*box.lower, -inf]), np.array([*box.upper, inf])
    phi = settle(exact.phi, lower[:, None], upper[:, None])
    return [_sector(agent, phi, k, lower, upper, boxes) for k in range(len(phi.outputs))] if count else []


def _sector(agent: Agent, phi: ExactPhi, k: int, lower: Ends, upper: Ends, boxes: int) -> CheckFinding:
    name, w = f"sector of phi{k + 1}", phi.outputs[k]
    arguments = sorted(w.variables - {phi.inputs})
    if len(arguments) != 1:
        shown = ", ".join(f"v{j + 1}" for j in arguments)
        return CheckFinding(name, "undecided", f"it has the arguments {shown}: a sector is of one")
    (j,) = arguments
    try:
        at_zero = substitute([w], {variable(j): ZERO})[0]
    except Undefined:  # beyond the domain, or its conditions are open
        at_zero = w
    if lower[j] <= 0 <= upper[j] and at_zero is not ZERO:
        return _offset(name, j, at_zero, phi.inputs)
    points = _points(lower, upper, j)
    low = _end(w, phi, j, lower, upper, points, -1, at_zero is ZERO, boxes)
    high = _end(w, phi, j, lower, upper, points, 1, at_zero is ZERO, boxes)
    ends = [None if low[0] is None else -low[0], high[0]]
    shown = f"[{'-inf' if ends[0] is None else f'{ends[0]:.6g}'}, {'inf' if ends[1] is None else f'{ends[1]:.6g}'}]"
    value = {"a": ends[0], "b": ends[1], "argument": j + 1}
    seen = {"lowest": {"ratio": -low[1], "v": low[2]}, "highest": {"ratio": high[1], "v": high[2]}}
    where = arguments_text(agent)
    if ends == [None, None]:
        return CheckFinding(name, "undecided", f"no end was proved ({where})", value, seen)
    reached = f"{-low[1]:.6g} and {high[1]:.6g} are reached ({where})"
    return CheckFinding(name, "proved", f"{shown} of v{j + 1}; {reached}", value, seen)


def _offset(name: str, j: int, at_zero: Node, time: int) -> CheckFinding:
    """phi(0, t) is not identically 0: a time at which it is not refutes every sector."""
    program = Program([at_zero])
    for t in (0.0, 1.0, 0.5):
        point = np.zeros((time + 1, 1))
        point[time] = t
        if program.nodes[-1].variables - {time}:
            break
        low, high = program.on_boxes(point, point)[0]
        if low[0] > 0 or high[0] < 0:
            value = 0.5 * float(low[0]) + 0.5 * float(high[0])
            figure = f"none: phi, less constants beside it, is {value:.6g} where v{j + 1} = 0"
            return CheckFinding(name, "refuted", figure, None, {"v": 0.0, "t": t, "phi": value})
    return CheckFinding(name, "undecided", "whether phi(0, t) = 0 could not be decided")


def _end(
    w: Node,
    phi: ExactPhi,
    j: int,
    lower: Ends,
    upper: Ends,
    points: np.ndarray,
    sign: int,
    through: bool,
    boxes: int,
) -> tuple[float | None, float, float]:
    """Return the least b with sign phi / v <= b that is proved, the largest value seen, and its v."""
    quotient = _quotient(w, j, sign)
    slope = Program(derivative([w], j)) if through else None
    reached, at, size = largest_eigenvalue(((quotient,),), points)
    if not np.isfinite(upper[j] - lower[j]):
        size = max(1.0, abs(reached))

    def ask(level: float) -> Question:
        def tighter(part: Interval, values: list[Interval]) -> list[Interval]:
            if slope is None:
                return values
            low, high = part[0].copy(), part[1].copy()
            low[j], high[j] = np.minimum(low[j], 0.0), np.maximum(high[j], 0.0)
            d = slope.on_boxes(low, high)[0]
            d = d if sign > 0 else intervals.negative(d)
            between = intervals.subtract((np.full_like(low[j], level),) * 2, d)
            return [intervals.meet(values[0], between)]

        question = linear(Fraction(level), [(-1, quotient)])
        return Question(((question,),), Conditions(phi.conditions), lower, upper, tighter)

    found = least_level(ask, reached, at, size, boxes, (1e-4, *TOLERANCES))
    return found.proved, found.reached, float(found.point[j])


def _quotient(w: Node, j: int, sign: int) -> Node:
    """Return sign phi / v with powers cancelled term by term."""
    offset, terms = linear_terms(expand(w))
    parts = [(sign * c, x / variable(j)) for c, x in terms]
    return linear(0, [*parts, *([(sign * offset, 1 / variable(j))] if offset else [])])


def _points(lower: Ends, upper: Ends, j: int) -> np.ndarray:
    """Return points of (v, t) with v_j spread over its range, dense near 0 but not 0, and t over some of its."""
    low, high = max(lower[j], -FAR), min(upper[j], FAR)
    spread = [
        *np.linspace(low, high, 400),
        *(np.geomspace(1e-6, 1.0, 50) * high),
        *(np.geomspace(1e-6, 1.0, 50) * low),
    ]
    points = np.zeros((len(lower), len(spread)))
    points[j] = np.clip(spread, lower[j], upper[j])
    points[-1] = np.linspace(0.0, FAR, len(spread))[np.random.default_rng(0).permutation(len(spread))]
    kept = points[:, points[j] != 0]
    return kept if kept.size else points
