"""The question about phi as the branch and bound takes it: its scaled slopes, block by block, over the domain of (v, t)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Annotated

import numpy as np

from lockstep.check.bound.box import EVERY_TIME, Box, check_time
from lockstep.check.bound.continuity import settle
from lockstep.check.bound.cover import Cover
from lockstep.check.bound.objective import Objective, blocks
from lockstep.check.bound.phi import ExactPhi
from lockstep.check.bound.regularity import Conditions
from lockstep.check.bound.unbounded.periodicity import reduce_to_period
from lockstep.check.bound.unbounded.relaxation import relax
from lockstep.check.errors import demand
from lockstep.check.expression.derivative import derivative
from lockstep.check.expression.node import ZERO, Node, scale

Given = Sequence[float] | np.ndarray | None
"""Scales of a proposal; None stands for ones."""
Block = tuple[list[int], list[int]]


@dataclass(frozen=True, eq=False)
class SlopeProblem:
    """phi with its continuous switches settled, its slopes d phi_k / d v_l, and the domain of (v, t)."""

    graph: ExactPhi
    jacobian: list[list[Node]]
    lower: Annotated[np.ndarray, " variables"]
    upper: Annotated[np.ndarray, " variables"]

    @classmethod
    def of(cls, phi: ExactPhi, box: Box, time: tuple[float, float] = EVERY_TIME) -> SlopeProblem:
        """Settle and differentiate phi; raises `ProblemError` if the box does not match it."""
        found = f"the domain has {box.size} components, phi takes {phi.inputs}"
        demand(box.size == phi.inputs, found, "the domain", "one range per component of v")
        low, high = check_time(time)
        lower, upper = np.array([*box.lower, low]), np.array([*box.upper, high])
        phi = settle(phi, lower[:, None], upper[:, None])
        columns = [derivative(phi.outputs, l) for l in range(phi.inputs)]
        return cls(phi, [[column[k] for column in columns] for k in range(len(phi.outputs))], lower, upper)

    @property
    def blocks(self) -> list[Block]:
        """The (rows, columns) whose norms are bounded one by one; none where there is no slope to bound."""
        if not self.jacobian or self.graph.inputs == 0:
            return []
        return blocks(self.jacobian) or [([0], [0])]  # without a slope there are still the conditions of phi

    @property
    def places(self) -> list[tuple[int, int]]:
        """(k, l) of each slope that is not identically 0."""
        return [
            (k, l) for k, row in enumerate(self.jacobian) for l, slope in enumerate(row) if slope is not ZERO
        ]

    def scaled(self, output_scale: Given, input_scale: Given) -> SlopeProblem:
        """Return it with D_w^-1 J D_v in place of J, exactly; raises `ProblemError` for scales that are none."""
        D_w = _scales(output_scale, len(self.jacobian), "output_scale")
        D_v = _scales(input_scale, self.graph.inputs, "input_scale")
        rows = zip(D_w, self.jacobian, strict=True)
        return replace(
            self, jacobian=[[scale(v / w, x) for v, x in zip(D_v, row, strict=True)] for w, row in rows]
        )

    def objective(self, block: Block) -> Objective:
        """Return one block of the slopes, with what phi needs to have a value."""
        slopes = tuple(tuple(self.jacobian[k][l] for l in block[1]) for k in block[0])
        return Objective(slopes, Conditions(self.graph.conditions), self.graph.inputs + 1)

    def covers(self, objective: Objective) -> tuple[Cover, Cover | None]:
        """Return its domain, one period of it where it is periodic, and where there is one a bounded domain that says more.

        The second takes bounded functions of unbounded variables as independent: a bound of it is one of the first.
        """
        outputs = [objective.value, *objective.conditions.nodes]
        lower, upper = reduce_to_period(outputs, self.lower, self.upper)
        relaxed = relax(objective, lower, upper)
        return Cover(objective, lower, upper), None if relaxed is None else Cover(*relaxed)


def _scales(given: Given, size: int, name: str) -> list[Fraction]:
    scales = np.ones(size) if given is None else np.asarray(given, dtype=np.float64)
    positive = scales.shape == (size,) and np.isfinite(scales).all() and (scales > 0).all()
    demand(positive, f"`{name}` is {given}", "the bound", f"{size} positive numbers")
    return [Fraction(x) for x in scales.tolist()]
