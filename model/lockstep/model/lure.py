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

from lockstep.model.affine import Affine, NormalForms, Row, is_double, is_exact, scaled, to_double, total
from lockstep.model.errors import ProblemError


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
    outputs: Float[np.ndarray, "q n"],
    m: int,
    *,
    jacobian: bool = False,
) -> Lure:
    """Assemble A, B, G, H, phi and the offset from the normal forms of the n right-hand sides.

    Args:
        forms: the table the rows were split with; its variables are the n states, then the m inputs.
        rows: the normal form of each right-hand side; no atom of them depends on an input.
        outputs: C.
        m: the number of inputs.
        jacobian: move the slope of phi at the origin into A (`split = "jacobian"`).
    """
    n = len(rows)
    state_terms = [_part(forms, row, of_states=True) for row in rows]
    drives = [Affine(constant=row.constant, terms=_part(forms, row, of_states=False).terms) for row in rows]
    linear = _matrix([row.row for row in rows], n + m)
    G, components = _columns(state_terms)
    H, substitute, v = _arguments(forms, components, n)
    w = ca.vertcat(*[forms.rebuild(part, substitute, forms.time) for part in components], ca.SX(0, 1))
    A = linear[:, :n]
    if jacobian:
        slope = _slope_at_origin(w, v, forms.time)
        A, w = A + G @ slope @ H, w - ca.mtimes(ca.DM(slope), v)
    drive = ca.vertcat(*[forms.rebuild(part, lambda _: ca.SX(0), forms.time) for part in drives])
    return _lure(A, linear[:, n:], outputs, G, H, v, forms.time, w, drive)


def _lure(
    A: Float[np.ndarray, "n n"],
    B: Float[np.ndarray, "n m"],
    C: Float[np.ndarray, "q n"],
    G: Float[np.ndarray, "n r"],
    H: Float[np.ndarray, "v n"],
    v: ca.SX,
    t: ca.SX,
    w: ca.SX,
    drive: ca.SX,
) -> Lure:
    origin = drive + ca.mtimes(ca.SX(ca.DM(G)), ca.substitute(w, v, ca.SX.zeros(v.shape[0])))
    return Lure(
        A,
        B,
        C,
        G,
        H,
        ca.Function("phi", [v, t], [ca.densify(w)], ["v", "t"], ["w"]),
        ca.Function("offset", [t], [ca.densify(drive)], ["t"], ["c"]),
        ca.Function("at_origin", [t], [ca.densify(origin)], ["t"], ["h"]),
    )


def _part(forms: NormalForms, row: Affine, *, of_states: bool) -> Affine:
    """Return the atoms of a row that depend on states, or those that depend on t only."""
    return Affine(terms=tuple((k, w) for k, w in row.terms if bool(forms.atoms[k].variables) is of_states))


def _matrix(rows: Sequence[Row], width: int) -> Float[np.ndarray, "rows width"]:
    matrix = np.zeros((len(rows), width))
    for i, row in enumerate(rows):
        for j, value in row:
            matrix[i, j] = to_double(value)
    return matrix


def _columns(rows: Sequence[Affine]) -> tuple[Float[np.ndarray, "n r"], list[Affine]]:
    """Choose G and the components of phi with G phi = rows, as few as the terms show.

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
    columns.sort(key=lambda column: column[0][0][0])
    G = _matrix([column for column, _ in columns], len(rows)).T
    return G, [component for _, component in columns]


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

    def __call__(self, row: Row) -> ca.SX:
        combination = self.combinations[row]
        assert combination is not None
        return total(scaled(self.v[k], c) for k, c in enumerate(combination) if c)


def _arguments(
    forms: NormalForms, components: Sequence[Affine], n: int
) -> tuple[Float[np.ndarray, "v n"], _Arguments, ca.SX]:
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
    return _matrix(chosen.rows, n), chosen, chosen.v


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


def _slope_at_origin(w: ca.SX, v: ca.SX, t: ca.SX) -> Float[np.ndarray, "r v"]:
    """Return d phi / d v at v = 0, for `split = "jacobian"`.

    A kink shows as a slope that jumps within `step` of the origin. The split is exact whatever the slope is,
    so this test only keeps a meaningless linearisation out.
    """
    slope = ca.substitute(ca.jacobian(w, v), v, ca.SX.zeros(v.shape[0]))
    if ca.depends_on(slope, t):
        raise ProblemError(
            "the slope of the nonlinearity at the origin depends on t",
            where="[agent] split",
            expected="a time-invariant linear part",
            remedy='use split = "terms"',
        )
    step, jump = 1e-9, 1e-6
    at = ca.Function("slope", [v, t], [ca.densify(ca.jacobian(w, v))])
    value = np.asarray(at(np.zeros(v.shape[0]), 0.0)).reshape(w.shape[0], v.shape[0])
    near = [
        np.asarray(at(sign * step * np.eye(v.shape[0])[k], 0.0))
        for k in range(v.shape[0])
        for sign in (-1, 1)
    ]
    if not np.isfinite(value).all() or any(
        not np.allclose(value, other, rtol=jump, atol=jump) for other in near
    ):
        raise ProblemError(
            "the nonlinearity has no slope at the origin",
            where="[agent] split",
            expected="a right-hand side that is differentiable at x = 0",
            remedy='use split = "terms"',
        )
    return value
