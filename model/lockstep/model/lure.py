"""The agent of (2) as a linear part and a nonlinearity with structure: h(t, x) = G phi(H x, t) + offset(t).

The right-hand side f(x, u, t) is split term by term,

    f(x, u, t) = A x + B u + G phi(H x, t) + offset(t),

where A x + B u is affine with constant coefficients, phi holds every term that depends on a state in any
other way, and offset(t) holds what depends on no state. All agents share the offset, so it cancels in their
disagreement; what the certificate needs is how phi grows from one state to another. (3) at the origin needs
h(t, 0) = G phi(0, t) + offset(t) = 0 besides: `Lure.at_origin`.

H has as few rows as the terms allow: sin(theta_l - theta_m) sees one number. G has as few columns: a spring
force that enters two equations is one component of phi.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import casadi as ca
import numpy as np
from flint import fmpq, fmpq_mat
from jaxtyping import Float

from lockstep.model.affine import Affine, NormalForms, Row, total
from lockstep.model.coefficients import is_double, is_exact, scaled, to_double


@dataclass(frozen=True, eq=False)
class Lure:
    """One agent, x' = A x + B u + G phi(H x, t) + offset(t), y = C x."""

    A: Float[np.ndarray, "n n"]
    B: Float[np.ndarray, "n m"]
    C: Float[np.ndarray, "q n"]
    G: Float[np.ndarray, "n r"]
    H: Float[np.ndarray, "v n"]
    phi: ca.Function
    """(v, t) -> (w): v numbers and the time in, r numbers out; all three may be empty (a linear agent)."""
    offset: ca.Function
    """(t) -> (c): n numbers that depend on no state, common to all agents."""
    at_origin: ca.Function
    """(t) -> (h): h(t, 0) = G phi(0, t) + offset(t), which (3) requires to be 0 and consensus does not."""
    rounded: tuple[str, ...] = ()
    """The entries that no double holds exactly once the terms are collected: each is rounded once."""

    def __post_init__(self) -> None:
        for letter in "ABCGH":
            matrix = np.array(getattr(self, letter), dtype=float)
            matrix.flags.writeable = False
            object.__setattr__(self, letter, matrix)

    @property
    def is_linear(self) -> bool:
        """Whether there is no nonlinearity: phi has no components."""
        return bool(self.G.shape[1] == 0)


def lure_form(
    forms: NormalForms,
    rows: Sequence[Affine],
    outputs: Sequence[Row],
    m: int,
) -> Lure:
    """Assemble A, B, G, H, phi and the offset from the normal forms of the n right-hand sides.

    Args:
        forms: the table the rows were split with; its variables are the n states, then the m inputs.
        rows: the normal form of each right-hand side; no atom of them depends on an input.
        outputs: the rows of C.
        m: the number of inputs.
    """
    n = len(rows)
    state_terms = [_part(forms, row, of_states=True) for row in rows]
    drives = [Affine(constant=row.constant, terms=_part(forms, row, of_states=False).terms) for row in rows]
    linear = [row.row for row in rows]
    columns = _columns(state_terms)
    components = [component for _, component in columns]
    arguments = _arguments(forms, components)
    v, t = arguments.v, forms.time
    AB, G = _matrix(linear, n + m), _matrix([column for column, _ in columns], n).T
    w = ca.vertcat(*[forms.rebuild(part, arguments, t) for part in components], ca.SX(0, 1))
    drive = ca.vertcat(*[forms.rebuild(part, lambda _: ca.SX(0), t) for part in drives])
    origin = drive + ca.mtimes(ca.SX(ca.DM(G)), ca.substitute(w, v, ca.SX.zeros(v.shape[0])))
    return Lure(
        A=AB[:, :n],
        B=AB[:, n:],
        C=_matrix(outputs, n),
        G=G,
        H=_matrix(arguments.rows, n),
        phi=ca.Function("phi", [v, t], [ca.densify(w)], ["v", "t"], ["w"]),
        offset=ca.Function("offset", [t], [ca.densify(drive)], ["t"], ["c"]),
        at_origin=ca.Function("at_origin", [t], [ca.densify(origin)], ["t"], ["h"]),
        rounded=(
            *(_entry("A", i, j) if j < n else _entry("B", i, j - n) for i, j in _inexact(linear)),
            *(_entry("C", i, j) for i, j in _inexact(outputs)),
            *(_entry("G", i, k) for k, i in _inexact([column for column, _ in columns])),
            *(_entry("H", i, j) for i, j in _inexact(arguments.rows)),
            *(f"phi{k}" for k, part in enumerate(components, start=1) if arguments.rounds(forms, part)),
        ),
    )


def _inexact(rows: Sequence[Row]) -> list[tuple[int, int]]:
    """Return where a matrix of these rows has an entry that no double holds."""
    return [(i, j) for i, row in enumerate(rows) for j, value in row if not is_double(value)]


def _entry(letter: str, i: int, j: int) -> str:
    return f"{letter}[{i + 1},{j + 1}]"


def _part(forms: NormalForms, row: Affine, *, of_states: bool) -> Affine:
    """Return the atoms of a row that depend on states, or those that depend on t only."""
    return Affine(terms=tuple((k, w) for k, w in row.terms if bool(forms.atoms[k].variables) is of_states))


def _matrix(rows: Sequence[Row], width: int) -> Float[np.ndarray, "rows width"]:
    matrix = np.zeros((len(rows), width))
    for i, row in enumerate(rows):
        for j, value in row:
            matrix[i, j] = to_double(value)
    return matrix


def _columns(rows: Sequence[Affine]) -> list[tuple[Row, Affine]]:
    """Choose the columns of G and the components of phi with G phi = rows, as few as the terms show.

    Rows that share terms form a group. A group with no more distinct terms than rows takes the terms as
    components (each sees fewer states than a row does), and its G holds their coefficients; a group with more
    terms than rows, or a row on its own, takes the rows as components, and its G selects them.
    """
    terms = _merged([dict(row.terms) for row in rows])
    columns: list[tuple[Row, Affine]] = []
    for group in _groups(terms):
        touched = sorted({i for column, _ in group for i, _ in column})
        if len(group) < len(touched) or len(group) == len(touched) > 1:
            columns += group
        else:
            columns += [(((i, Fraction(1)),), rows[i]) for i in touched]
    return sorted(columns, key=lambda column: column[0][0][0])


def _merged(rows: Sequence[dict[int, Fraction]]) -> list[tuple[Row, Affine]]:
    """Return (column of coefficients, term) pairs; atoms that always enter in one proportion are one term."""
    leads: dict[Row, tuple[Row, Affine]] = {}
    for k in sorted({k for row in rows for k in row}):
        column = tuple((i, row[k]) for i, row in enumerate(rows) if k in row)
        shape = tuple((i, value / column[0][1]) for i, value in column)
        first, sum_so_far = leads.get(shape, (column, Affine()))
        ratio = column[0][1] / first[0][1]
        if not is_double(ratio):
            # The proportion is no double, and a rounded one would not be this agent: keep the atom apart.
            shape, first, sum_so_far, ratio = ((-1 - k, ratio),), column, Affine(), Fraction(1)
        leads[shape] = (first, sum_so_far.plus(Affine(terms=((k, ratio),))))
    return list(leads.values())


def _groups(terms: list[tuple[Row, Affine]]) -> list[list[tuple[Row, Affine]]]:
    """Partition terms so that two of them that enter the same equation are in the same group."""
    groups: list[list[tuple[Row, Affine]]] = []
    for term in terms:
        touched = {i for i, _ in term[0]}
        linked = [g for g in groups if any(touched & {i for i, _ in column} for column, _ in g)]
        groups = [g for g in groups if g not in linked] + [[*(t for g in linked for t in g), term]]
    return groups


class _Arguments:
    """H and v: the linear forms that phi depends on, each written exactly as a combination of rows of H."""

    def __init__(self, rows: Sequence[Row], needed: Sequence[Row]) -> None:
        self.rows = list(rows)
        self.v = ca.SX.sym("v", len(self.rows))
        self.combinations = {row: solve(self.rows, row) for row in needed}

    def sound(self) -> bool:
        """Whether each form is a multiple of one row, or a sum of rows without rounding that could cancel."""
        return all(
            c is not None and (sum(map(bool, c)) == 1 or all(map(is_exact, c)))
            for c in self.combinations.values()
        )

    def rounds(self, forms: NormalForms, component: Affine) -> bool:
        """Whether a coefficient inside a component, or of a combination of rows, is rounded."""
        combinations = [self.combinations[row] or [] for row in forms.arguments(component)]
        return forms.rounds(component) or not all(is_exact(c) for row in combinations for c in row)

    def __call__(self, row: Row) -> ca.SX:
        combination = self.combinations[row]
        assert combination is not None
        return total(scaled(self.v[k], c) for k, c in enumerate(combination) if c)


def _arguments(forms: NormalForms, components: Sequence[Affine]) -> _Arguments:
    """Choose H: independent forms that phi depends on, or plain states where those are as few."""
    needed = sorted(frozenset[Row]().union(*(forms.arguments(part) for part in components)))
    directions = _directions(needed)
    independent: list[Row] = []
    for row in directions:
        if solve(independent, row) is None:
            independent.append(row)
    states: list[Row] = [((j, Fraction(1)),) for j in sorted({j for row in needed for j, _ in row})]
    chosen = _Arguments(sorted(independent), needed)
    dependent = len(directions) > len(independent)
    if (dependent and len(states) == len(independent)) or not chosen.sound():
        chosen = _Arguments(states, needed)
    return chosen


def _normalised(row: Row) -> Row:
    """Return the row over the size of its smallest coefficient, if that gives doubles: 2 x - 2 y is x - y."""
    least = min(abs(value) for _, value in row)
    quotients = tuple((j, value / least) for j, value in row)
    if len(row) == 1:
        return ((row[0][0], Fraction(1)),)
    return quotients if all(is_double(value) for _, value in quotients) else row


def _directions(rows: Sequence[Row]) -> list[Row]:
    """Return the different directions among the rows, the simplest first; x - y and 2 y - 2 x are one."""
    found: dict[Row, Row] = {}
    for row in map(_normalised, rows):
        opposite = tuple((j, -value) for j, value in row)
        found.setdefault(max(row, opposite), row)
    return sorted(found.values(), key=_simplicity)


def _simplicity(row: Row) -> tuple[int, Fraction, Row]:
    """Order rows with fewer states first, then those with smaller numbers."""
    return len(row), sum((abs(value) for _, value in row), Fraction(0)), row


def solve(rows: Sequence[Row], target: Row) -> list[Fraction] | None:
    """Return the exact c with sum c_k rows_k = target, or None if there are none; the rows are independent.

    >>> x, y = ((0, Fraction(1)),), ((0, Fraction(1)), (1, Fraction(-1)))
    >>> solve([x, y], ((1, Fraction(2)),))
    [Fraction(2, 1), Fraction(-2, 1)]
    >>> solve([y], x) is None
    True
    """
    if target in rows:
        return [Fraction(row == target) for row in rows]
    states = sorted({j for row in [*rows, target] for j, _ in row})
    columns = [[dict(row).get(j, Fraction(0)) for row in [*rows, target]] for j in states]
    system = fmpq_mat([[fmpq(x.numerator, x.denominator) for x in line] for line in columns])
    reduced, rank = system.rref()
    if rank > len(rows):
        return None
    return [Fraction(int(reduced[k, len(rows)].p), int(reduced[k, len(rows)].q)) for k in range(len(rows))]
