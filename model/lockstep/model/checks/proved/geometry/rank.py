"""Controllability and observability at a point, by Lie brackets and Lie derivatives.

Strong accessibility: the brackets of f, g_1, ..., g_m that hold at least one g span R^n at x (Sussmann and Jurdjevic 1972;
Nijmeijer and van der Schaft 1990, theorem 3.21); at an equilibrium, where ad_f^k g alone span it, x is locally controllable.
Observability: the differentials of L_f^k y_i span R^n at x (Hermann and Krener 1977, theorem 3.1). A rank in rational numbers
is exact, and a minor in balls that is not 0 shows a full rank; nothing is decided at a kink. That a rank is never full is
shown by a subspace of the states: one that holds B and that f keeps (moving along it moves f along it), or one that y and f
do not see.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from fractions import Fraction

from flint import fmpq, fmpq_mat

from lockstep.check.expression.node import ZERO, Node, constant, linear, linear_terms, variable
from lockstep.model.checks.proved.finding import CheckFinding, numbers
from lockstep.model.checks.proved.geometry.lie import Point, bracket, lie_derivative, rank_at, too_long
from lockstep.model.checks.proved.vector_field import Field, Nodes, as_written, jacobian, smooth_on

MOST_BRACKETS = 40
MOST_TERMS = 1_000
"""Of all brackets, beyond ad_f^k g."""

Steps = Iterator[tuple[Sequence[Nodes], str]]
Vectors = list[list[Fraction]]


def controllability_rank(field: Field, point: Point) -> CheckFinding:
    """Decide strong accessibility at a point."""
    kept = "f keeps a subspace that holds B"
    found = _decided(
        field, point, "controllability", reachable(field), (kept, "never_moved", "brackets"), _brackets
    )
    if found.status == "proved" and found.figure.endswith("ad_f^k g") and point.is_equilibrium:
        return replace(found, figure=f"{found.figure} (locally controllable)")
    return found


def observability_rank(field: Field, point: Point) -> CheckFinding:
    """Decide local observability at a point, u = 0."""
    words = ("neither f nor y sees a direction of the states", "never_seen", "derivatives")
    return _decided(field, point, "observability", observed(field), words, _derivatives)


def _decided(
    field: Field,
    point: Point,
    what: str,
    most: tuple[int, list[float]],
    words: tuple[str, str, str],
    steps: Callable[[Field], Steps],
) -> CheckFinding:
    """Decide whether the rank is full: never, where a subspace shows it, or here, where one of the steps has it."""
    name, n, (why, key, counted) = f"{what} rank", field.n, words
    dimension, direction = most
    if dimension < n:
        figure = f"at most {dimension} of {n}, at every point: {why}"
        return CheckFinding(name, "refuted", figure, {"rank": dimension}, {key: direction})
    if field.varies:
        return CheckFinding(name, "undecided", "f depends on t")
    at, rank, count = f"{n} at {numbers(point.text)}", 0, 0
    if not smooth_on(field.f, point.lower, point.upper):
        return CheckFinding(name, "undecided", f"f has a kink at {numbers(point.text)}")
    for rows, how in steps(field):
        (rank, sure), count = rank_at(point, rows, n), len(rows)
        if sure and rank == n:
            value = {"rank": n, "point": point.text, counted: count}
            return CheckFinding(name, "proved", f"{n} of {at}, by {how}", value)
    figure = f"{rank} of {at} by {count} {counted}; more, or other inputs, may add to it"
    return CheckFinding(name, "undecided", figure, None, {"rank": rank, "point": point.text})


def _brackets(field: Field) -> Steps:
    columns: list[Nodes] = [tuple(constant(x) for x in g) for g in zip(*field.B, strict=True)]
    generation, found = list(columns), list(columns)
    yield found, "ad_f^k g"
    for _ in range(field.n - 1):
        if any(too_long(v) for v in generation):
            break
        generation = [bracket(field, field.f, v) for v in generation]
        found += generation
        yield found, "ad_f^k g"
    for v in found:  # which grows
        terms = sum(len(linear_terms(x)[1]) for b in found for x in b)
        if len(found) >= MOST_BRACKETS or terms > MOST_TERMS or too_long(v):
            break
        brackets = [bracket(field, g, v) for g in columns]
        found += [b for b in brackets if any(x is not ZERO for x in b)]
    yield found, "brackets"


def _derivatives(field: Field) -> Steps:
    generation: list[Node] = [linear(0, [(c, variable(j)) for j, c in enumerate(row)]) for row in field.C]
    found = list(generation)
    for _ in range(2 * field.n):
        yield jacobian(found, field.n), f"{len(found)} Lie derivatives"
        if too_long(generation):
            break
        generation = [lie_derivative(field, node) for node in generation]
        found += generation


def reachable(field: Field) -> tuple[int, list[float]]:
    """Return the dimension of the least subspace that holds B and that f keeps, and a vector normal to it."""
    A, terms = _terms(field)
    return _closure([list(g) for g in zip(*field.B, strict=True)], A, terms)


def observed(field: Field) -> tuple[int, list[float]]:
    """Return the dimension of the least space of linear forms that holds C and that f keeps, and a direction none sees."""
    A, terms = _terms(field)
    return _closure(field.C, [list(column) for column in zip(*A, strict=True)], [(b, a) for a, b in terms])


def _terms(field: Field) -> tuple[Vectors, list[tuple[Vectors, Vectors]]]:
    """Return A by rows and, of each component k of phi, the rows of H that it depends on and its column of G."""
    exact = as_written(field.agent)
    G, H = _rows(exact.G.T), _rows(exact.H)
    uses = [sorted(w.variables - {exact.phi.inputs}) for w in exact.phi.outputs]
    return _rows(exact.A), [([H[j] for j in used], [G[k]]) for k, used in enumerate(uses)]


def _closure(start: Vectors, A: Vectors, terms: Sequence[tuple[Vectors, Vectors]]) -> tuple[int, list[float]]:
    """Return the least space that holds the start and with v also A v, and of a term what v meets the other side of."""
    basis, changed = _Span(len(A), start), True
    while changed:
        changed = False
        for v in list(basis.vectors):
            changed |= basis.add([_dot(row, v) for row in A])
            for met, added in terms:
                if any(_dot(w, v) for w in met):
                    changed |= any(basis.add(w) for w in added)
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
