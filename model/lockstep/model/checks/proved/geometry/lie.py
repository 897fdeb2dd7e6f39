"""Lie derivatives and brackets of exact expressions, and their values at a point as exact numbers or balls."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from flint import arb, arb_mat, fmpq, fmpq_mat

from lockstep.check.bound.enclosure import Program
from lockstep.check.expression.node import Node, add, linear, multiply
from lockstep.check.expression.traversal import expand, order
from lockstep.model.checks.proved.equilibria import Equilibrium
from lockstep.model.checks.proved.vector_field import Field, Nodes, exactly_at, jacobian

MOST_POINTS = 4
MOST_NODES = 20_000
"""Of an expression that is differentiated further."""


@dataclass(frozen=True, eq=False)
class Point:
    """Where a property is decided: an equilibrium, or the middle of the domain; exact, or somewhere in a box."""

    lower: np.ndarray
    upper: np.ndarray
    exact: tuple[Fraction, ...] | None
    is_equilibrium: bool

    @classmethod
    def all(cls, field: Field, found: Sequence[Equilibrium]) -> list[Point]:
        """Return the equilibria, exact ones first, and then the middle of the domain."""
        points = []
        for one in sorted(found, key=lambda one: one.exact is None):
            exact = None if one.exact is None else (*one.exact, Fraction(0))
            points.append(cls(np.append(one.lower, 0.0), np.append(one.upper, 0.0), exact, True))
        middle = field.samples(1)[:, 0]
        middle[-1] = 0.0
        return [*points[:MOST_POINTS], cls(middle, middle, tuple(Fraction(x) for x in middle), False)]

    @property
    def text(self) -> list[float]:
        """The states, to rounding."""
        return (
            [float(x) for x in self.exact[:-1]]
            if self.exact
            else (0.5 * (self.lower + self.upper))[:-1].tolist()
        )

    def values(self, nodes: Sequence[Node]) -> tuple[list[Fraction] | None, list[arb]]:
        """Return nodes here as rationals, None where one is not, and as balls."""
        rational: list[Fraction] | None = None
        if self.exact is not None:
            found = exactly_at(nodes, self.exact)
            rational = [x for x in found if x is not None] if None not in found else None
        if rational is not None:
            return rational, [arb(fmpq(x.numerator, x.denominator)) for x in rational]
        ranges = Program(nodes).on_boxes(self.lower[:, None], self.upper[:, None])
        return None, [arb(float(low[0])).union(arb(float(high[0]))) for low, high in ranges]


def lie_derivative(field: Field, node: Node) -> Node:
    """Return L_f of a function of the states."""
    (row,) = jacobian([node], field.n)
    return expand(add(*(multiply(d, f) for d, f in zip(row, field.f, strict=True))))


def lie_derivatives(field: Field, node: Node) -> Nodes:
    """Return L_g of a function, for each column g of B."""
    (row,) = jacobian([node], field.n)
    return tuple(expand(linear(0, zip(g, row, strict=True))) for g in zip(*field.B, strict=True))


def bracket(field: Field, v: Nodes, w: Nodes) -> Nodes:
    """Return [v, w] = Dw v - Dv w."""
    Dv, Dw = jacobian(v, field.n), jacobian(w, field.n)
    return tuple(
        expand(
            add(
                *(multiply(a, x) for a, x in zip(dw, v, strict=True)),
                linear(0, [(-1, multiply(a, x)) for a, x in zip(dv, w, strict=True)]),
            )
        )
        for dv, dw in zip(Dv, Dw, strict=True)
    )


def too_long(nodes: Sequence[Node]) -> bool:
    """Whether expressions have grown beyond what is differentiated further."""
    return len(order(nodes)) > MOST_NODES


def rank_at(point: Point, rows: Sequence[Nodes], n: int) -> tuple[int, bool]:
    """Return the rank of rows of n nodes at a point, and whether it is exact: in balls a minor shows full rank only."""
    flat = [node for row in rows for node in row]
    rational, balls = point.values(flat)
    if rational is not None:
        table = [
            [fmpq(x.numerator, x.denominator) for x in rational[k * n : k * n + n]] for k in range(len(rows))
        ]
        return int(fmpq_mat(table).rank()), True
    if not all(ball.is_finite() for ball in balls):
        return 0, False
    middle = np.array([float(ball.mid()) for ball in balls]).reshape(-1, n)
    chosen = _independent(middle)
    if len(chosen) < n:
        return len(chosen), False
    minor = arb_mat([[balls[k * n + j] for j in range(n)] for k in chosen])
    return (n, True) if not minor.det().contains(0) else (n - 1, False)


def _independent(rows: np.ndarray) -> list[int]:
    """Return rows that are independent to rounding, the best ones."""
    from scipy.linalg import qr

    size = np.abs(rows).max(axis=1, keepdims=True)
    scaled = rows / np.where(size > 0, size, 1.0)
    _, R, order_ = qr(scaled.T, mode="economic", pivoting=True)
    diagonal = np.abs(np.diag(R))
    return [int(k) for k, d in zip(order_, diagonal, strict=False) if d > 1e-10 * max(diagonal[0], 1e-300)]
