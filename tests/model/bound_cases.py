"""The questions that these tests ask of a nonlinearity: its smallest bound, and a bound of each slope."""

from collections.abc import Sequence
from typing import Any

import casadi as ca

from lockstep.check.bound.box import EVERY_TIME, Box
from lockstep.check.bound.slopes import SlopeProblem
from lockstep.model.bound_search import BOXES, Bound, Entry, confirmed_bound, read, search_bound, with_entries


def smallest_bound(
    phi: ca.Function, box: Box, time: tuple[float, float] = EVERY_TIME, **limits: Any
) -> Bound:
    """Return the smallest alpha that is found and decided: |phi(a, t) - phi(b, t)| <= alpha |a - b| on the box."""
    problem = SlopeProblem.of(read(phi), box, time)
    return confirmed_bound(problem, search_bound(problem, **limits))


def entry_bounds(
    phi: ca.Function,
    box: Box,
    time: tuple[float, float] = EVERY_TIME,
    *,
    input_scale: Sequence[float] | None = None,
    output_scale: Sequence[float] | None = None,
    boxes: int = BOXES,
) -> tuple[Entry, ...]:
    """Return a proved bound for each slope of D_w^-1 J D_v that is not identically 0; the scales are ones unless given."""
    problem = SlopeProblem.of(read(phi), box, time)
    D_v = (1.0,) * problem.graph.inputs if input_scale is None else tuple(input_scale)
    D_w = (1.0,) * len(problem.jacobian) if output_scale is None else tuple(output_scale)
    return with_entries(problem, Bound(0.0, 0.0, D_v, D_w), boxes).entries
