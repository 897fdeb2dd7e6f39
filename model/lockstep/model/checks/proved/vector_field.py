"""The vector field x' = f(x, t) + B u of an agent, exactly, with its Jacobian, as the checks take it.

Variables 0..n-1 are the states and n is the time; u = 0 wherever an input plays no part, and B is constant. Where f has
kinks its derivatives are selections whose enclosures hold Clarke's generalised Jacobian (Clarke 1990, chapter 2), so that
the mean value theorem holds for them on every box.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from typing import Annotated

import numpy as np

from lockstep.check.bound.continuity import settle
from lockstep.check.bound.enclosure import Boxes, Program
from lockstep.check.bound.phi import ExactPhi
from lockstep.check.bound.regularity import Conditions
from lockstep.check.expression.condition import Condition
from lockstep.check.expression.derivative import derivative
from lockstep.check.expression.node import ZERO, Node, Undefined, constant, linear, number, variable
from lockstep.check.expression.traversal import order, substitute
from lockstep.check.system.agent import ExactAgent
from lockstep.model.agents.agent import Agent
from lockstep.model.agents.variants import nonlinearity

Nodes = tuple[Node, ...]
Matrix = tuple[Nodes, ...]
Ends = Annotated[np.ndarray, " variables"]
FAR = 10.0
"""Where points are looked at in a range without an end: proposals only."""


@dataclass(frozen=True, eq=False)
class Field:
    """f and h (its part that is not linear in x) with their Jacobians, on the domain of (x, t)."""

    agent: Agent
    f: Nodes
    h: Nodes
    conditions: tuple[Condition, ...]
    lower: Ends
    upper: Ends

    @classmethod
    def of(cls, agent: Agent) -> Field:
        """Return the field of an agent on its domain, u = 0, with continuous switches settled."""
        exact, n = as_written(agent), agent.n
        lower = np.array([*agent.box[:, 0], -np.inf])
        upper = np.array([*agent.box[:, 1], np.inf])
        moved = {variable(exact.phi.inputs): variable(n)}
        for j, row in enumerate(exact.H):
            moved[variable(j)] = linear(0, [(fraction(c), variable(i)) for i, c in enumerate(row)])
        flat = [node for c in exact.phi.conditions for node in c.nodes]
        changed = iter(substitute(flat, moved))
        needs = []
        for c in exact.phi.conditions:
            guard = next(changed)
            needs.append(Condition(c.kind, tuple(next(changed) for _ in c.args), c.name, guard))
        h = nonlinearity(exact)
        graph = settle(ExactPhi(tuple(h), tuple(needs), n), lower[:, None], upper[:, None])
        f = tuple(
            linear(0, [(1, w), *((fraction(a), variable(j)) for j, a in enumerate(row))])
            for row, w in zip(exact.A, graph.outputs, strict=True)
        )
        return cls(agent, f, graph.outputs, graph.conditions, lower, upper)

    @property
    def n(self) -> int:
        """The number of states."""
        return self.agent.n

    @property
    def varies(self) -> bool:
        """Whether f depends on the time."""
        return any(self.n in node.variables for node in self.f)

    @property
    def B(self) -> list[list[Fraction]]:
        """The input matrix over the rationals."""
        return [[fraction(x) for x in row] for row in self.agent.exact.B]

    @property
    def C(self) -> list[list[Fraction]]:
        """The output matrix over the rationals."""
        return [[fraction(x) for x in row] for row in self.agent.exact.C]

    @cached_property
    def jacobian(self) -> Matrix:
        """d f_i / d x_j."""
        return jacobian(self.f, self.n)

    @cached_property
    def slopes(self) -> Matrix:
        """d h_i / d x_j."""
        return jacobian(self.h, self.n)

    @cached_property
    def defined(self) -> Conditions:
        """What f needs to have a value and not to jump, on boxes."""
        return Conditions(self.conditions)

    def defined_on(self, lower: Boxes, upper: Boxes) -> np.ndarray:
        """Return on which boxes f is surely defined and continuous."""
        held = np.ones(lower.shape[1], dtype=bool)
        for one in self.defined.on_boxes(lower, upper):
            held &= one
        return held

    def inside(self, point: Sequence[float] | np.ndarray) -> bool:
        """Whether a point of (x, t) is in the domain."""
        return bool(((self.lower <= point) & (np.asarray(point) <= self.upper)).all())

    def samples(self, count: int) -> np.ndarray:
        """Return points of (x, t) as columns, corners among them: the same on every machine."""
        lower = np.where(np.isfinite(self.lower), self.lower, np.minimum(-FAR, self.upper - 2 * FAR))
        upper = np.where(np.isfinite(self.upper), self.upper, np.maximum(FAR, self.lower + 2 * FAR))
        parts = np.random.default_rng(0).uniform(size=(len(lower), count))
        parts[:, 0] = 0.5
        ends = parts[:, 1 : count // 2]
        parts[:, 1 : count // 2] = np.round(ends)
        points = lower[:, None] + (upper - lower)[:, None] * parts
        return np.clip(points, lower[:, None], upper[:, None])


def smooth_on(nodes: Sequence[Node], lower: Ends, upper: Ends) -> bool:
    """Whether nodes surely have no kink in a box of (x, t), so that their derivatives there say what they say."""
    kinks = [
        n.args[0] - n.args[1] if n.op in ("fmin", "fmax") else n if n.op == "hypot" else n.args[0]
        for n in order(nodes)
        if n.op in ("fabs", "fmin", "fmax", "hypot", "positive")
    ]
    ranges = Program(kinks).on_boxes(lower[:, None], upper[:, None]) if kinks else []
    return all(low[0] > 0 or high[0] < 0 for low, high in ranges)


def as_written(agent: Agent) -> ExactAgent:
    """Return the agent over the rationals with no slope moved from phi into A."""
    back = [replace(move, amount=-move.amount) for move in agent.moves]
    return agent.exact.moved(back)


def fraction(value: object) -> Fraction:
    """Return a rational of FLINT as Python's."""
    return Fraction(int(value.p), int(value.q))  # type: ignore[attr-defined]


def jacobian(nodes: Sequence[Node], n: int, *, of_slopes: bool = False) -> Matrix:
    """Return the derivatives of nodes with respect to variables 0..n-1, a row per node."""
    columns = [derivative(nodes, j, of_slopes=of_slopes) for j in range(n)]
    return tuple(tuple(column[i] for column in columns) for i in range(len(nodes)))


def at_points(rows: Matrix, points: Boxes) -> np.ndarray:
    """Return a matrix of nodes at points (columns), points x rows x columns: in doubles, for proposals."""
    values = Program([node for row in rows for node in row]).on_boxes(points, points)
    with np.errstate(all="ignore"):
        middle = np.array([0.5 * (low + high) for low, high in values])
    return middle.reshape(len(rows), len(rows[0]), -1).transpose(2, 0, 1)


def exactly_at(nodes: Sequence[Node], point: Sequence[Fraction]) -> list[Fraction | None]:
    """Return nodes at a rational point where exact arithmetic gives a rational, None where it does not."""
    values = {variable(k): constant(value) for k, value in enumerate(point)}
    try:
        return [Fraction(0) if node is ZERO else number(node) for node in substitute(nodes, values)]
    except Undefined:
        return [None] * len(nodes)
