"""f(x) = 0 with its linear part solved exactly: A x + G phi + c = 0 as x_p = affine(x_q) and fewer nonlinear equations.

Rows of [G A c] are reduced over the rationals with the columns of G first: rows without a nonlinear term are linear
equations. An equation that is a product is taken apart: sin(x) cos(x) = 0 is sin(x) = 0 or cos(x) = 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from itertools import product as every
from math import prod

from flint import fmpq, fmpq_mat

from lockstep.check.expression.node import (
    ONE,
    Node,
    factors,
    linear,
    linear_terms,
    multiply,
    number,
    power,
    variable,
)
from lockstep.check.expression.traversal import expand, substitute
from lockstep.model.checks.proved.vector_field import Field, fraction

MOST_BRANCHES = 32


@dataclass(frozen=True)
class ReducedEquilibria:
    """The equilibria: x_p = solved[p] for the states solved for, and one of `branches` holds (each of equations = 0).

    free: the states in which a branch is written;  hidden: those among them that no equation depends on.
    """

    solved: dict[int, Node]
    free: tuple[int, ...]
    hidden: tuple[int, ...]
    branches: tuple[tuple[Node, ...], ...]


def reduced_equilibria(field: Field) -> ReducedEquilibria:
    """Solve the linear part of f(x) = 0."""
    n = field.n
    atoms, rows = _atoms(field)
    width = len(atoms)
    table = [[row.get(k, 0) for k in range(width + n + 1)] for row in rows]
    steps, rank = fmpq_mat([[fmpq(v.numerator, v.denominator) for v in row] for row in table]).rref()
    solved: dict[int, Node] = {}
    equations: list[Node] = []
    for row in [[fraction(v) for v in one] for one in steps.tolist()[:rank]]:
        terms = [(c, variable(j)) for j, c in enumerate(row[width : width + n]) if c]
        if any(row[:width]):
            equations.append(linear(row[-1], [*zip(row[:width], atoms, strict=True), *terms]))
        elif not terms:
            return ReducedEquilibria({}, (), (), ())
        else:
            pivot, lead = terms[0][1].data, terms[0][0]
            solved[pivot] = linear(-row[-1] / lead, [(-c / lead, x) for c, x in terms[1:]])
    equations = [expand(node) for node in substitute(equations, {variable(j): x for j, x in solved.items()})]
    free = tuple(j for j in range(n) if j not in solved)
    seen = frozenset[int]().union(*(node.variables for node in equations))
    branches = _branches([node for node in equations if number(node) != 0])
    return ReducedEquilibria(solved, free, tuple(j for j in free if j not in seen), branches)


def _atoms(field: Field) -> tuple[list[Node], list[dict[int, Fraction | int]]]:
    """Return the nonlinear terms of f, and each row's coefficients of (terms, states, 1)."""
    split = [linear_terms(node) for node in field.f]
    atoms = list(dict.fromkeys(x for _, terms in split for _, x in terms if x.op != "variable"))
    place = {x: k for k, x in enumerate(atoms)}
    last = len(atoms) + field.n
    rows = []
    for offset, terms in split:
        row: dict[int, Fraction | int] = {last: offset}
        for c, x in terms:
            row[place[x] if x in place else len(atoms) + x.data] = c
        rows.append(row)
    return atoms, rows


def _branches(equations: list[Node]) -> tuple[tuple[Node, ...], ...]:
    """Return the systems of which one has to hold; none where an equation is a constant other than 0."""
    if any(number(node) is not None for node in equations):
        return ()
    choices = [_alternatives(node) for node in equations]
    if prod(map(len, choices)) > MOST_BRANCHES:
        choices = [[node] for node in equations]
    found = [tuple(dict.fromkeys(branch)) for branch in every(*choices)]
    return tuple(dict.fromkeys(found))


def _alternatives(node: Node) -> list[Node]:
    """Return the factors of which one is 0 where the equation holds; divisors and exp, which are never 0, are left out.

    What all terms of a sum have in common is taken out first; a divisor is not 0 wherever f has a value.
    """
    offset, terms = linear_terms(node)
    parts = [factors(x)[1] for _, x in terms] + [{} for _ in range(offset != 0)]
    shared = {x: min(part.get(x, 0) for part in parts) for x in dict.fromkeys(y for p in parts for y in p)}
    over = [power(x, -p) for x, p in shared.items() if p]
    rest = linear(0, [(c, multiply(x, *over)) for c, x in [*terms, (offset, ONE)] if c])
    outer = [x for x, p in shared.items() if p > 0 and x.op != "exp"]
    inner = [] if number(rest) is not None else [rest]
    return [_normal(x) for x in dict.fromkeys([*outer, *inner])] or [ONE]


def _normal(node: Node) -> Node:
    """Return a sum with its first coefficient 1, so that equal equations are one node."""
    _, terms = linear_terms(node)
    return linear(0, [(1 / terms[0][0], node)]) if terms else node
