"""The dual points that `witness` decides, as a semidefinite program in doubles.

For mu in [a, b], g >= 0 holds if and only if mu g(mu) is a sum of squares plus lambda (mu - a)(b - mu) with lambda >= 0:

    [c_1 + lambda, (c_0 - lambda (a + b)) / 2; *, c_2 + lambda a b] >= 0,        lambda (mu - a) where b is infinite,

so that nothing is lost by asking for it. The largest t is sought for which Z, Z_*, Z_c and this matrix, each scaled to
about one, are at least t I: room for rounding. The multiplier of the last is a moment matrix [E mu^2, E mu; E mu, 1] of
the mu that stand in the way, which says where to cut an interval that has no point.
"""

import math
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, NamedTuple

import numpy as np

from lockstep.check.floor.projected import Projected, Side, left_inverse
from lockstep.check.floor.witness import Piece
from lockstep.check.numbers import Matrix, as_floats
from lockstep.lmi.shapes import Vector

LEAST_PART = 1e-14
"""The part of the largest diagonal entry that every other is taken to have."""


@dataclass(frozen=True)
class FloorSolution:
    """What the solver returned: the margin t, the dual point, where mu stands in the way, and scales for another turn."""

    t: float
    piece: Piece
    mu: float
    scales: "Scales"


@dataclass(frozen=True)
class Scales:
    """Z = D Z^ D, likewise Z_*, and Z_c^ = D_c Z_c D_c, each diagonal as a vector."""

    Z: Vector
    Z_dual: Vector
    Z_c: Vector

    @classmethod
    def ones(cls, stated: Projected) -> "Scales":
        """Return no scaling."""
        primal, dual = stated.primal, stated.dual
        return cls(np.ones(primal.size), np.ones(dual.size), np.ones(primal.k + dual.k))

    def from_point(self, Z: Matrix, Z_dual: Matrix, Z_c: Matrix) -> "Scales":
        """Return those with which a dual point has the diagonals 1, so that the margin is one of each row."""
        return Scales(_root(np.diag(Z)), _root(np.diag(Z_dual)), 1 / _root(np.diag(Z_c)))


def _root(diagonal: Vector) -> Vector:
    """Return the root of a diagonal; entries that the solver left at about 0 count as a small part of the largest."""
    largest = float(diagonal.max(initial=0.0)) or 1.0
    return np.asarray(np.sqrt(np.maximum(diagonal, LEAST_PART * largest)))


class LinearTerms(NamedTuple):
    """What is linear in v, as matrices: the triangle of Z_c, rows flow Z e of both sides, and (c_0, c_1, c_2)."""

    Z_c: Matrix
    held: Matrix
    g: Matrix


@dataclass(frozen=True)
class FloorProgram:
    """The unknowns v = (Z, Z_*, k): triangles of the two as the solver stores them, and k row by row."""

    stated: Projected

    @property
    def sizes(self) -> tuple[int, int]:
        """How many entries the triangles of Z and Z_* have."""
        a, b = self.stated.primal.size, self.stated.dual.size
        return a * (a + 1) // 2, b * (b + 1) // 2

    @property
    def count(self) -> int:
        """Length of v."""
        return sum(self.sizes) + self.stated.primal.k * self.stated.dual.k

    def point(self, v: Vector) -> tuple[Matrix, Matrix, Matrix]:
        """Return (Z, Z_*, k)."""
        (a, b), primal, dual = self.sizes, self.stated.primal, self.stated.dual
        Z, Z_dual = matrix_of(v[:a], primal.size), matrix_of(v[a : a + b], dual.size)
        return Z, Z_dual, v[a + b :].reshape(primal.k, dual.k)

    def columns(self, scales: Scales) -> Vector:
        """Return by what each entry of v^ is multiplied in v."""
        k = self.stated.primal.k
        square, square_dual = (np.outer(D, D)[_places(len(D))] for D in (scales.Z, scales.Z_dual))
        return np.concatenate([square, square_dual, 1 / np.outer(scales.Z_c[:k], scales.Z_c[k:]).ravel()])

    def Z_c_of(self, v: Vector) -> Matrix:
        """Return Z_c."""
        return matrix_of(self.linear.Z_c @ v, self.stated.primal.k + self.stated.dual.k)

    @cached_property
    def linear(self) -> LinearTerms:
        """Return the linear terms, from their values at the unit vectors."""
        sides = _InDoubles.of(self.stated.primal), _InDoubles.of(self.stated.dual)
        coupling = as_floats(self.stated.coupling)
        values = [self._terms(unit, sides, coupling) for unit in np.eye(self.count)]
        return LinearTerms(*(np.array(one).T for one in zip(*values, strict=True)))

    def _terms(
        self, v: Vector, sides: "tuple[_InDoubles, _InDoubles]", coupling: Matrix
    ) -> tuple[Vector, Vector, Vector]:
        Z, Z_dual, k = self.point(v)
        corner, held, constant, slope = sides[0].terms(Z)
        corner_dual, held_dual, constant_dual, slope_dual = sides[1].terms(Z_dual)
        Z_c = np.block([[corner, k], [k.T, corner_dual]])
        c_0 = constant + constant_dual - 2 * float(np.sum(k * coupling))
        return triangle_of(Z_c), np.concatenate([held, held_dual]), np.array([c_0, slope, slope_dual])


class _InDoubles(NamedTuple):
    """kernel^+ flow, rows flow, constant and slope of a side, rounded."""

    k: int
    gain: Matrix
    held: Matrix
    constant: Matrix
    slope: Matrix

    @classmethod
    def of(cls, side: Side) -> "_InDoubles":
        if not side.size:
            none = np.zeros((0, 0))
            return cls(0, none, none, none, none)
        exact = (left_inverse(side.kernel) @ side.flow, side.rows @ side.flow, side.constant, side.slope)
        return cls(side.k, *(as_floats(one) for one in exact))

    def terms(self, Z: Matrix) -> tuple[Matrix, Vector, float, float]:
        """Return He(kernel^+ flow Z e), rows flow Z e as a vector, <Z, constant> and <Z, slope>."""
        columns = Z[:, : self.k]
        half = self.gain @ columns
        constant, slope = float(np.sum(Z * self.constant)), float(np.sum(Z * self.slope))
        return half + half.T, (self.held @ columns).ravel(), constant, slope


def largest_margin(program: FloorProgram, scales: Scales, lower: float, upper: float) -> FloorSolution | None:
    """Return the dual point for mu from `lower` to `upper` with the largest margin; None where the solver stops early."""
    import clarabel
    from scipy.sparse import csc_matrix

    rows, cones, unit = _constraints(program, scales, lower, upper)
    A = np.vstack(rows)
    b = np.zeros(len(A))
    b[0] = 1.0
    cost = np.zeros(A.shape[1])
    cost[-1] = -1.0
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    quadratic = csc_matrix((len(cost), len(cost)))
    solved = clarabel.DefaultSolver(quadratic, cost, csc_matrix(A), b, cones, settings).solve()
    x, z = np.array(solved.x), np.array(solved.z)
    if not np.all(np.isfinite(x)):
        return None
    v = x[: program.count] * program.columns(scales)
    Z, Z_dual, k = program.point(v)
    again = scales.from_point(Z, Z_dual, program.Z_c_of(v))
    return FloorSolution(
        float(x[-1]), Piece(upper, Z, Z_dual, k), math.nan if unit is None else _where(z[-3:], unit), again
    )


def _where(moments: Vector, unit: float) -> float:
    """Return the mean mu of [E mu^2, sqrt(2) E mu, E 1]."""
    return unit * float(moments[1]) / math.sqrt(2) / max(float(moments[2]), 1e-300)


def _constraints(
    program: FloorProgram, scales: Scales, lower: float, upper: float
) -> tuple[list[Matrix], list[Any], float | None]:
    """Return the rows of A with b - A (v^, lambda, t) in the cones, b being 1 in the first row and 0 in all others.

    Also the unit in which mu enters the matrix of g, which is the last cone; None where a number takes its place.
    """
    import clarabel

    linear, column, (a, b) = program.linear, program.columns(scales), program.sizes
    trace = np.concatenate([triangle_of(np.eye(len(D))) for D in (scales.Z, scales.Z_dual)])
    held = linear.held * column
    held /= np.maximum(np.linalg.norm(held, axis=1, keepdims=True), LEAST_PART)
    equations = np.vstack([np.pad(trace, (0, program.count - len(trace))), held])
    rows = [np.pad(equations, ((0, 0), (0, 2))), -np.eye(program.count + 2)[-2:-1]]
    cones: list[Any] = [clarabel.ZeroConeT(len(equations)), clarabel.NonnegativeConeT(1)]
    unknown = np.eye(program.count)
    Z_c = linear.Z_c * column * np.outer(scales.Z_c, scales.Z_c)[_places(len(scales.Z_c))][:, None]
    for entries, size in (
        (unknown[:a], len(scales.Z)),
        (unknown[a : a + b], len(scales.Z_dual)),
        (Z_c, len(scales.Z_c)),
    ):
        if size:
            identity = triangle_of(np.eye(size))[:, None]
            rows.append(np.hstack([-entries, np.zeros((len(entries), 1)), identity]))
            cones.append(clarabel.PSDTriangleConeT(size))
    g = linear.g * column
    if lower == upper or not g[1:].any():
        value = g[0] + (g[1] * lower + g[2] / lower if lower == upper else 0.0)
        last = np.append(-value / (np.abs(value).max() or 1.0), [0.0, 1.0])[None, :]
        return [*rows, last], [*cones, clarabel.NonnegativeConeT(1)], None
    unit = _unit(lower, upper)
    polynomial, void = _polynomial(g, lower, upper, unit)
    rows[1][0, -1] = float(void)
    return [*rows, -polynomial], [*cones, clarabel.PSDTriangleConeT(2)], unit


def _polynomial(g: Matrix, lower: float, upper: float, unit: float) -> tuple[Matrix, bool]:
    """Return the triangle of the matrix of g, less t I, as it acts on (v^, lambda, t), for mu in multiples of a unit.

    Where a side says nothing a corner may be 0 whatever v and lambda are: t is then asked of lambda, not of the corner,
    and the second value is True.
    """
    entries = np.stack([g[1] * unit, g[0] / math.sqrt(2), g[2] / unit])
    entries /= np.abs(entries).max() or 1.0
    slack = _slack(lower / unit, upper / unit)
    room = [0.0 if not entries[i].any() and slack[i] == 0 else -1.0 for i in (0, 2)]
    return np.column_stack([entries, slack, [room[0], 0.0, room[1]]]), 0.0 in room


def _unit(lower: float, upper: float) -> float:
    if math.isinf(upper):
        return lower or 1.0
    return math.sqrt(lower * upper) if lower else upper


def _slack(a: float, b: float) -> tuple[float, float, float]:
    """Return the entries by which lambda enters, of the triangle."""
    if math.isinf(b):
        return 0.0, -1 / math.sqrt(2), a
    return 1.0, -(a + b) / math.sqrt(2), a * b


def matrix_of(entries: Vector, size: int) -> Matrix:
    """Return the symmetric matrix of a triangle as the solver stores it: column by column, off-diagonals times sqrt(2)."""
    M = np.zeros((size, size))
    i, j = _places(size)
    M[i, j] = M[j, i] = np.where(i == j, entries, entries / math.sqrt(2))
    return M


def triangle_of(M: Matrix) -> Vector:
    """Return the triangle of a symmetric matrix as the solver stores it."""
    i, j = _places(len(M))
    return np.asarray(np.where(i == j, M[i, j], math.sqrt(2) * M[i, j]))


@cache
def _places(size: int) -> tuple[Any, Any]:
    """Return the rows and columns of the upper triangle, column by column."""
    j, i = np.tril_indices(size)
    return i, j
