"""All equilibria f(x) = 0, u = 0, on the domain: existence, uniqueness and number, by interval Newton's method.

f is linear where it can be: its linear part is solved exactly (`elimination`), the rest by `interval_newton`.
A zero with rational coordinates is found exactly, so that one on the boundary of the domain is told from one beyond it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import isfinite

import numpy as np

from lockstep.check.bound import intervals
from lockstep.check.bound.enclosure import Boxes, Program
from lockstep.check.expression.node import Node, factors, linear, linear_terms, variable
from lockstep.model.checks.proved.elimination import ReducedEquilibria, reduced_equilibria
from lockstep.model.checks.proved.finding import CheckFinding, numbers
from lockstep.model.checks.proved.interval_algebra.eigenvalues import stability
from lockstep.model.checks.proved.interval_newton import End, System
from lockstep.model.checks.proved.vector_field import Field, exactly_at

NAME = "equilibria"
BOXES = 20_000
ROUNDS = 8
DENOMINATORS = (1, 12, 1000)
SHOWN = 12


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """One equilibrium: a box with exactly one, its rational coordinates where they are known, and its stability."""

    lower: End
    upper: End
    exact: tuple[Fraction, ...] | None
    stable: bool | None
    """Whether every eigenvalue of the Jacobian has Re < 0, or one has Re > 0; None where neither is shown."""

    @property
    def middle(self) -> list[float]:
        """The coordinates, to rounding."""
        return [float(x) for x in self.exact or 0.5 * (self.lower + self.upper)]

    def document(self) -> dict[str, object]:
        """Return it as plain JSON types."""
        return {
            "x": self.middle,
            "exact": self.exact is not None,
            "width": float((self.upper - self.lower).max(initial=0.0)),
            "stable": self.stable,
        }


def equilibria(field: Field, *, boxes: int = BOXES) -> tuple[CheckFinding, tuple[Equilibrium, ...]]:
    """Find all equilibria on the domain of the agent.

    Args:
        field: the agent's; where it depends on t nothing is decided.
        boxes: a budget.

    Returns:
        "proved" with their number, "refuted" where they are not isolated, "undecided" with the boxes left open; and those
        that are known.
    """
    if field.varies:
        return CheckFinding(NAME, "undecided", "f depends on t: an equilibrium at one instant is none"), ()
    form = reduced_equilibria(field)
    search = _Search(field, form, boxes)
    for branch in form.branches:
        search.take(branch)
    return search.finding(), tuple(search.found)


class _Search:
    """The branches of one field, and what they have given."""

    def __init__(self, field: Field, form: ReducedEquilibria, boxes: int) -> None:
        self.field, self.form, self.budget, self.used = field, form, boxes, 0
        self.found: list[Equilibrium] = []
        self.open: list[tuple[list[float], list[float]]] = []
        self.rest = np.clip(0.0, field.lower, field.upper)
        self.unknowns = tuple(j for j in form.free if j not in form.hidden)
        self.solved = [form.solved.get(j, variable(j)) for j in range(field.n)]
        self.tied = [j for j, x in form.solved.items() if not x.variables.isdisjoint(form.hidden)]
        self.states = Program(self.solved)
        self.rows = Program(field.f)

    def take(self, branch: Sequence[Node]) -> None:
        """Search the domain for the equilibria of one branch."""
        lower, upper = self._finite(branch)
        if (lower > upper).any():
            return
        if not self.unknowns:
            self._keep(np.zeros(0), np.zeros(0), branch)
            return
        if len(branch) < len(self.unknowns) or not (np.isfinite(lower).all() and np.isfinite(upper).all()):
            box = np.vstack([lower, upper])[:, :, None]
            if not self._outside(box[0], box[1]).all():
                self.open.append((lower.tolist(), upper.tolist()))
            return
        system = System(branch, self.unknowns, self._outside, self._defined)
        zeros = system.zeros(lower, upper, max(self.budget - self.used, 0))
        self.used += zeros.boxes
        for low, high in zeros.found:
            self._keep(low, high, branch)
        self.open += [(low.tolist(), high.tolist()) for low, high in zeros.open]

    def finding(self) -> CheckFinding:
        """Say what was found."""
        points = [one.document() for one in self.found]
        names = self.field.agent.states
        along = [names[j] for j in self.form.hidden]
        if self.open:
            low, high = self.open[0]
            where = [names[j] for j in self.unknowns]
            shown = [{"states": where, "lower": _plain(a), "upper": _plain(b)} for a, b in self.open[:SHOWN]]
            first = f"the first {where} from {numbers(low)} to {numbers(high)}"
            if not where:
                first = f"as states that move with {', '.join(along)} may leave the domain"
            figure = f"{len(self.found)} found, {len(self.open)} boxes open, {first}; give ranges or raise the budget"
            return CheckFinding(NAME, "undecided", figure, {"found": points}, {"open": shown})
        if along and self.found:
            figure = f"not isolated: {len(points)} of them, each for every {', '.join(along)}"
            return CheckFinding(NAME, "refuted", figure, {"families": len(points), "along": along}, points)
        said = {True: "stable", False: "unstable", None: ""}
        listed = ", ".join(f"{numbers(one.middle)} {said[one.stable]}".strip() for one in self.found[:SHOWN])
        figure = f"exactly {len(points)}: {listed}" if points else "none"
        return CheckFinding(NAME, "proved", figure, {"count": len(points), "points": points})

    def _finite(self, branch: Sequence[Node]) -> tuple[End, End]:
        """Return the domain of the unknowns, cut by each equation solved for a variable that it is linear in."""
        n = self.field.n
        lower, upper = self.field.lower[:n].copy(), self.field.upper[:n].copy()
        equations = [*branch, *(linear(0, [(1, x), (-1, variable(j))]) for j, x in self.form.solved.items())]
        for node in branch:
            if len(node.variables) == 1 and (far := _roots_within(node)) is not None:
                (j,) = node.variables
                lower[j], upper[j] = max(lower[j], -far), min(upper[j], far)
        for _ in range(ROUNDS):
            for node in equations:
                _contract(node, lower, upper)
        places = list(self.unknowns)
        return lower[places], upper[places]

    def _full(self, lower: Boxes, upper: Boxes) -> tuple[Boxes, Boxes]:
        """Return all states over boxes of the unknowns; the hidden ones over their whole range."""
        n = self.field.n
        low, high = (
            np.repeat(end[:, None], lower.shape[1], axis=1) for end in (self.field.lower, self.field.upper)
        )
        low[list(self.unknowns)], high[list(self.unknowns)] = lower, upper
        for j, value in enumerate(self.states.on_boxes(low, high)):
            if j in self.form.solved:
                low[j], high[j] = value
        low[n] = high[n] = 0.0
        return low, high

    def _outside(self, lower: Boxes, upper: Boxes) -> np.ndarray:
        """Return which boxes hold no equilibrium of the domain: a state is outside, or a row of f is not 0."""
        low, high = self._full(lower, upper)
        n = self.field.n
        out = ((high[:n] < self.field.lower[:n, None]) | (low[:n] > self.field.upper[:n, None])).any(axis=0)
        for value in self.rows.on_boxes(low, high):
            out |= (value[0] > 0) | (value[1] < 0)
        return np.asarray(out)

    def _defined(self, lower: Boxes, upper: Boxes) -> np.ndarray:
        return self.field.defined_on(*self._full(lower, upper))

    def _keep(self, lower: End, upper: End, branch: Sequence[Node]) -> None:
        """Record a zero of a branch if it is an equilibrium in the domain, or leave it open."""
        low, high = (end[:, 0] for end in self._full(lower[:, None], upper[:, None]))
        exact = self._rational(low, high)
        sides = list(zip(self.field.lower[: self.field.n], self.field.upper[: self.field.n], strict=True))
        places = [j for j in range(self.field.n) if j not in (*self.form.hidden, *self.tied)]
        if self._outside(lower[:, None], upper[:, None]).all():
            return
        if exact is not None and not all(sides[j][0] <= exact[j] <= sides[j][1] for j in places):
            return
        # A tied state moves with a free one: it has to stay in the domain over the whole range of that one.
        surely = self.tied if exact is not None else [*places, *self.tied]
        if (exact is None and len(branch) > len(self.unknowns)) or not all(
            sides[j][0] <= low[j] and high[j] <= sides[j][1] for j in surely
        ):
            self.open.append((lower.tolist(), upper.tolist()))
            return
        if not self._defined(lower[:, None], upper[:, None]).all():
            self.open.append((lower.tolist(), upper.tolist()))
            return
        if exact is not None and any(one.exact == exact for one in self.found):
            return
        if any(
            (low[:-1] <= o.upper).all() and (o.lower <= high[:-1]).all() and not (exact and o.exact)
            for o in self.found
        ):
            self.open.append((lower.tolist(), upper.tolist()))  # of two branches: one or two
            return
        hidden = list(self.form.hidden)
        low[hidden] = high[hidden] = self.rest[hidden]
        for j, value in enumerate(self.states.on_boxes(low[:, None], high[:, None])):
            if j in self.tied:
                low[j], high[j] = value[0][0], value[1][0]
        point = None if exact is None or hidden else (*exact, Fraction(0))
        self.found.append(Equilibrium(low[:-1], high[:-1], exact, stability(self.field, low, high, point)))

    def _rational(self, low: End, high: End) -> tuple[Fraction, ...] | None:
        """Return a zero of f with short rational coordinates in the box; a free state is as near to 0 as its range is."""
        for limit in DENOMINATORS:
            point = [Fraction(x) for x in self.rest.tolist()]
            for j in self.unknowns:
                point[j] = Fraction(0.5 * (low[j] + high[j])).limit_denominator(limit)
                if not low[j] <= point[j] <= high[j]:
                    break
            else:
                full = self._zero_from(point)
                if full is not None:
                    return full
        return None

    def _zero_from(self, point: Sequence[Fraction]) -> tuple[Fraction, ...] | None:
        """Return the states that go with the unknowns if f is exactly 0 there."""
        full = [value for value in exactly_at(self.solved, point) if value is not None]
        if len(full) < self.field.n:
            return None
        return (
            None
            if any(value != 0 for value in exactly_at(self.field.f, [*full, Fraction(0)]))
            else tuple(full)
        )


def _contract(node: Node, lower: End, upper: End) -> None:
    """Cut the range of each variable that the sum is linear in: x_j = -(rest) / c_j."""
    offset, terms = linear_terms(node)
    for c, x in terms:
        if x.op == "variable":
            rest = linear(-offset / c, [(-d / c, y) for d, y in terms if y is not x])
            size = max([0, *rest.variables]) + 1
            low, high = Program([rest]).on_boxes(lower[:size, None], upper[:size, None])[0]
            lower[x.data], upper[x.data] = max(lower[x.data], low[0]), min(upper[x.data], high[0])


def _roots_within(node: Node) -> float | None:
    """Return Cauchy's bound 1 + max |a_i / a_n| of the real roots of a polynomial in one variable, None for other nodes."""
    offset, terms = linear_terms(node)
    degrees = {}
    for c, x in terms:
        powers = list(factors(x)[1].items())
        if len(powers) != 1 or powers[0][0].op != "variable" or powers[0][1] < 1:
            return None
        degrees[powers[0][1]] = c
    lead = degrees.pop(max(degrees))
    return float(
        intervals.up(np.array(1.0 + float(max([abs(c / lead) for c in (offset, *degrees.values())]))))
    ) * (1 + 1e-12)


def _plain(ends: Sequence[float]) -> list[float | None]:
    return [x if isfinite(x) else None for x in ends]
