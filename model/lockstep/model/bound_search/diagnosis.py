"""Why a box has no finite enclosure, in plain words."""

import numpy as np

from lockstep.check.bound.enclosure import Boxes, Program
from lockstep.check.bound.intervals import Interval
from lockstep.check.bound.unbounded.charts import Chart
from lockstep.check.expression.condition import Condition
from lockstep.check.expression.node import Node

AT_ITS_END = "is infinite at the end of its domain"
LARGE = 1e6
NEAR = 1e-6
_EDGES = {"not negative": (0.0,), "within one": (-1.0, 1.0), "above one": (1.0,)}
_CAUSES = {
    "monomial": "a power or quotient",
    "sqrt": "`sqrt`, whose slope at 0 is infinite",
    "tan": "`tan`",
    "linear": "a sum",
    "exp": "`exp`",
    "cosh": "`cosh`",
    "choose": "a slope that jumps",
}


def explain(chart: Chart, lower: Boxes, upper: Boxes, inputs: int, reached: float) -> str:
    """Return the reason for one box that is as small as boxes get."""
    where = _place(chart, lower[:, 0], upper[:, 0], inputs)
    verdicts = chart.conditions.on_boxes(lower, upper)
    broken = [c.text for c, held in zip(chart.conditions.conditions, verdicts, strict=True) if not held.all()]
    if broken:
        return f"{broken[0]} ({where})"
    if any(side and lower[k, 0] == 0 for k, side in enumerate(chart.pattern)):
        if reached > LARGE:
            return f"the slope grows without bound towards infinity ({where}), {reached:.3g} was reached"
        return f"no bound could be shown towards infinity ({where}); the largest slope seen is {reached:.6g}"
    edges = [
        c.name
        for c in chart.objective.conditions.conditions
        if not any(chart.pattern) and c.kind in _EDGES and _at_edge(c, lower, upper)
    ]
    if edges:
        return f"the slope of {edges[0]} {AT_ITS_END} ({where})"
    with np.errstate(all="ignore"):
        values = chart.point_program.trace(lower, upper)
    return f"the slope has no finite bound near a point: {_culprit(chart, values)} ({where})"


def _at_edge(condition: Condition, lower: Boxes, upper: Boxes) -> bool:
    low, high = Program(condition.args[:1]).on_boxes(lower, upper)[0]
    return any(bool(low[0] - NEAR <= edge <= high[0] + NEAR) for edge in _EDGES[condition.kind])


def _culprit(chart: Chart, values: dict[Node, Interval]) -> str:
    for node in chart.point_program.nodes:
        if _infinite(values[node]) and not any(_infinite(values[a]) for a in node.args):
            return f"{_CAUSES.get(node.op, f'`{node.op}`')} is unbounded there"
    return "an operation is unbounded there"


def _infinite(x: Interval) -> bool:
    return not bool(np.isfinite(x[0]).all() and np.isfinite(x[1]).all())


def _place(chart: Chart, lower: np.ndarray, upper: np.ndarray, inputs: int) -> str:
    parts = []
    for k in chart.searched:
        if k >= inputs:
            continue
        name = "t" if k == inputs - 1 else f"v{k + 1}"
        side = chart.pattern[k]
        if side and lower[k] == 0:
            parts.append(f"{name} -> {'+' if side > 0 else '-'}infinity")
        else:
            value = 0.5 * (lower[k] + upper[k])
            # The box is 2^-40 of its domain wide: more digits would say nothing.
            parts.append(f"{name} near {0.0 + round(side / value if side else value, 9):.6g}")
    return "where " + ", ".join(parts) if parts else "everywhere"
