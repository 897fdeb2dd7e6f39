"""Unbounded variables that enter through bounded functions only: each function becomes a variable.

The slope 3 cos(v1) u1 - sech^2(v2 - v1) u2 on all of R^2 is at most its maximum over cos in [-1, 1] and
sech^2 in [0, 1] taken independently: a finite box and a polynomial. That is an upper bound always, and the
supremum itself wherever the functions can take their extremes together (several incommensurable
oscillations, for instance).
"""

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from lockstep.check.bound.enclosure import Program
from lockstep.check.bound.objective import Objective
from lockstep.check.bound.regularity import Conditions
from lockstep.check.expression.node import Node, variable
from lockstep.check.expression.traversal import order, substitute

MOST_ATOMS = 8


def relax(
    objective: Objective,
    lower: Annotated[np.ndarray, " variables"],
    upper: Annotated[np.ndarray, " variables"],
) -> tuple[Objective, np.ndarray, np.ndarray] | None:
    """Return (objective, lower, upper) on a bounded box with no smaller supremum; None if there is none."""
    size = objective.variables
    lower, upper = lower[:size], upper[:size]
    unbounded = {k for k in objective.used if not np.isfinite(upper[k] - lower[k])}
    if not unbounded or objective.conditions.open_on(lower[:, None], upper[:, None]).conditions:
        return None
    outputs = [x for row in objective.slopes for x in row]
    ranges = _ranges(outputs, lower, upper)
    atoms = _atoms(outputs, unbounded, ranges)
    if len(atoms) > MOST_ATOMS:
        return None
    moved = substitute(outputs, {a: variable(size + i) for i, a in enumerate(atoms)})
    if any(k in x.variables for x in moved for k in unbounded):
        return None
    columns = len(objective.slopes[0])
    slopes = tuple(tuple(moved[i * columns : (i + 1) * columns]) for i in range(len(objective.slopes)))
    inside = np.clip(0.0, lower, upper)
    own_lower, own_upper = (np.where(np.isfinite(upper - lower), end, inside) for end in (lower, upper))
    return (
        Objective(slopes, Conditions([]), size + len(atoms)),
        np.concatenate([own_lower, [ranges[a][0] for a in atoms]]),
        np.concatenate([own_upper, [ranges[a][1] for a in atoms]]),
    )


def _ranges(outputs: Sequence[Node], lower: np.ndarray, upper: np.ndarray) -> dict[Node, tuple[float, float]]:
    with np.errstate(all="ignore"):
        values = Program(outputs).trace(lower[:, None], upper[:, None])
    return {node: (float(x[0][0]), float(x[1][0])) for node, x in values.items()}


def _atoms(
    outputs: Sequence[Node], unbounded: set[int], ranges: dict[Node, tuple[float, float]]
) -> list[Node]:
    """Return the first bounded nodes on the way up from an unbounded variable."""
    found: list[Node] = []
    opened = set[Node]()
    for node in order(outputs):
        reaches = any(a in opened for a in node.args) or (node.op == "variable" and node.data in unbounded)
        if reaches and all(np.isfinite(ranges[node])) and node.op not in ("positive", "not", "and"):
            found.append(node)
        elif reaches:
            opened.add(node)
    return found
