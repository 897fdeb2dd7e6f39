"""Controllability and observability at a point, by Lie brackets and Lie derivatives.

Strong accessibility: the brackets of f, g_1, ..., g_m that hold at least one g span R^n at x (Sussmann and Jurdjevic 1972;
Nijmeijer and van der Schaft 1990, theorem 3.21); at an equilibrium, where ad_f^k g alone span it, x is locally controllable.
Observability: the differentials of L_f^k y_i span R^n at x (Hermann and Krener 1977, theorem 3.1). A rank in rational numbers
is exact, and a minor in balls that is not 0 shows a full rank. That a rank is never full is shown by a subspace of the
states: one that holds B and that f keeps (moving along it moves f along it), or one that y and f do not see.
"""

from __future__ import annotations

from fractions import Fraction

from flint import fmpq, fmpq_mat

from lockstep.check.expression.node import ZERO, Node, constant, linear, variable
from lockstep.model.checks.proved.field import Field, Nodes, as_written, jacobian
from lockstep.model.checks.proved.finding import CheckFinding, numbers
from lockstep.model.checks.proved.lie import Point, along, bracket, rank_at, too_long

MOST_BRACKETS = 40


def controllability_rank(field: Field, point: Point) -> CheckFinding:
    """Decide strong accessibility at a point."""
    name, n = "controllability rank", field.n
    dimension, direction = reachable(field)
    if dimension < n:
        figure = f"at most {dimension} of {n}, at every point: f keeps a subspace that holds B"
        return CheckFinding(name, "refuted", figure, {"rank": dimension}, {"never_moved": direction})
    if field.varies:
        return CheckFinding(name, "undecided", "f depends on t")
    columns: list[Nodes] = [tuple(constant(x) for x in g) for g in zip(*field.B, strict=True)]
    generation, found, rank = list(columns), list(columns), 0
    for k in range(1, n + 1):
        rank, sure = rank_at(point, found, n)
        if sure and rank == n:
            local = " (locally controllable)" if point.is_equilibrium else ""
            figure = f"{n} of {n} at {numbers(point.text)}, by ad_f^k g{local}"
            return CheckFinding(
                name, "proved", figure, {"rank": n, "point": point.text, "brackets": len(found)}
            )
        if k == n or any(too_long(v) for v in generation):
            break
        generation = [bracket(field, field.f, v) for v in generation]
        found += generation
    for v in found:  # which grows
        if len(found) >= MOST_BRACKETS or too_long(v):
            break
        brackets = [bracket(field, g, v) for g in columns]
        found += [b for b in brackets if any(x is not ZERO for x in b)]
    rank, sure = rank_at(point, found, n)
    if sure and rank == n:
        figure = f"{n} of {n} at {numbers(point.text)}, by brackets"
        return CheckFinding(name, "proved", figure, {"rank": n, "point": point.text, "brackets": len(found)})
    figure = f"{rank} of {n} at {numbers(point.text)} by {len(found)} brackets; more may add to it"
    return CheckFinding(name, "undecided", figure, None, {"rank": rank, "point": point.text})


def observability_rank(field: Field, point: Point) -> CheckFinding:
    """Decide local observability at a point, u = 0."""
    name, n = "observability rank", field.n
    dimension, direction = seen(field)
    if dimension < n:
        figure = f"at most {dimension} of {n}, at every point: neither f nor y sees a direction of the states"
        return CheckFinding(name, "refuted", figure, {"rank": dimension}, {"never_seen": direction})
    if field.varies:
        return CheckFinding(name, "undecided", "f depends on t")
    outputs: list[Node] = [linear(0, [(c, variable(j)) for j, c in enumerate(row)]) for row in field.C]
    generation, found, rank = outputs, list(outputs), 0
    for _ in range(2 * n):
        rank, sure = rank_at(point, jacobian(found, n), n)
        if sure and rank == n:
            figure = f"{n} of {n} at {numbers(point.text)}, by {len(found)} Lie derivatives"
            return CheckFinding(
                name, "proved", figure, {"rank": n, "point": point.text, "derivatives": len(found)}
            )
        if too_long(generation):
            break
        generation = [along(field, node) for node in generation]
        found += generation
    figure = f"{rank} of {n} at {numbers(point.text)} by {len(found)} Lie derivatives; more, or an input, may add to it"
    return CheckFinding(name, "undecided", figure, None, {"rank": rank, "point": point.text})


def reachable(field: Field) -> tuple[int, list[float]]:
    """Return the dimension of the least subspace that holds B and that f keeps, and a vector normal to it."""
    exact = as_written(field.agent)
    uses = [sorted(w.variables - {exact.phi.inputs}) for w in exact.phi.outputs]
    basis = _Span(field.n, [list(g) for g in zip(*field.B, strict=True)])
    A, G, H = _rows(exact.A), _rows(exact.G.T), _rows(exact.H)
    changed = True
    while changed:
        changed = False
        for v in list(basis.vectors):
            changed |= basis.add([_dot(row, v) for row in A])
            for k, arguments in enumerate(uses):
                if any(_dot(H[j], v) for j in arguments):
                    changed |= basis.add(G[k])
    return len(basis.vectors), basis.normal()


def seen(field: Field) -> tuple[int, list[float]]:
    """Return the dimension of the least space of linear forms that holds C and that f keeps, and a direction none sees."""
    exact = as_written(field.agent)
    uses = [sorted(w.variables - {exact.phi.inputs}) for w in exact.phi.outputs]
    basis = _Span(field.n, field.C)
    columns, G, H = _rows(exact.A.T), _rows(exact.G.T), _rows(exact.H)
    changed = True
    while changed:
        changed = False
        for w in list(basis.vectors):
            changed |= basis.add([_dot(column, w) for column in columns])
            for k, arguments in enumerate(uses):
                if _dot(G[k], w):
                    for j in arguments:
                        changed |= basis.add(H[j])
    return len(basis.vectors), basis.normal()


class _Span:
    """A subspace over the rationals that grows."""

    def __init__(self, n: int, vectors: list[list[Fraction]]) -> None:
        self.n, self.vectors = n, list[list[Fraction]]()
        for vector in vectors:
            self.add(vector)

    def add(self, vector: list[Fraction]) -> bool:
        """Take a vector in; tell whether the subspace has grown."""
        grown = fmpq_mat(_exact([*self.vectors, vector])).rank() > len(self.vectors)
        if grown:
            self.vectors.append(vector)
        return bool(grown)

    def normal(self) -> list[float]:
        """Return a vector that is normal to the subspace, empty if it is everything."""
        if len(self.vectors) == self.n:
            return []
        from lockstep.model.checks.proved.dissipation import kernel_vector

        return kernel_vector(fmpq_mat(_exact(self.vectors or [[Fraction(0)] * self.n])))


def _rows(matrix: object) -> list[list[Fraction]]:
    return [[Fraction(int(x.p), int(x.q)) for x in row] for row in matrix]  # type: ignore[attr-defined]


def _exact(rows: list[list[Fraction]]) -> list[list[fmpq]]:
    return [[fmpq(x.numerator, x.denominator) for x in row] for row in rows]


def _dot(a: list[Fraction], b: list[Fraction]) -> Fraction:
    return sum((x * y for x, y in zip(a, b, strict=True)), Fraction(0))
