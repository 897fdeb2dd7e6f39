"""What must hold on a box before a slope there means anything: operations defined, no value that jumps.

A condition carries a guard, the `if_else` branches that lead to its operation: where the guard is false on
the whole box the operation is not used there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Annotated

import numpy as np

from lockstep.check.bound import functions
from lockstep.check.bound.enclosure import Boxes, Program
from lockstep.check.expression.condition import HOLDS, Condition, changed
from lockstep.check.expression.node import Node

Holds = Annotated[np.ndarray, " boxes"]


_TESTS: dict[str, Callable[..., Holds]] = {
    **HOLDS,
    "no pole": lambda x: ~functions.tan_has_pole(x),
    "off the cut": lambda y, x: (x[0] > 0) | (y[0] > 0) | (y[1] < 0),
    "decided": lambda x: x[0] == x[1],
}


class Conditions:
    """All conditions of a function, tested together on boxes."""

    def __init__(self, conditions: Sequence[Condition]) -> None:
        self.conditions = tuple(conditions)
        self.nodes = [n for c in self.conditions for n in c.nodes]
        self._program = Program(self.nodes)

    def on_boxes(self, lower: Boxes, upper: Boxes) -> list[Holds]:
        """Return, per condition, on which boxes it surely holds."""
        found = iter(self._program.on_boxes(lower, upper))
        verdicts = []
        with np.errstate(all="ignore"):
            for condition in self.conditions:
                _, possible = next(found)
                held = _TESTS[condition.kind](*(next(found) for _ in condition.args))
                verdicts.append(held | (possible == 0))
        return verdicts

    def changed(self, change: Callable[[Sequence[Node]], Sequence[Node]]) -> Conditions:
        """Return the conditions with their guards and arguments changed, all at once."""
        return Conditions(changed(self.conditions, change))

    def open_on(self, lower: Boxes, upper: Boxes) -> Conditions:
        """Return those that do not surely hold on every one of the boxes."""
        verdicts = self.on_boxes(lower, upper)
        return Conditions([c for c, held in zip(self.conditions, verdicts, strict=True) if not held.all()])
