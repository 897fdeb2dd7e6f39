"""The eigenvalues of the Jacobian at a point or over a box, enclosed in balls.

Simple ones by `acb_mat.eig`. Multiple ones at a rational point from the characteristic polynomial over the rationals; in
balls by Gershgorin: with R the eigenvectors in doubles, the discs of R^-1 J R hold the eigenvalues, each connected part as
many as it has discs (Horn and Johnson, Matrix Analysis, 2nd ed., 2013, theorem 6.1.1). Each gets the hull of its part.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from math import isfinite
from typing import Annotated, Any

import numpy as np
from flint import acb, acb_mat, arb, fmpq, fmpq_mat

from lockstep.check.bound.enclosure import Program
from lockstep.model.checks.proved.vector_field import Field, exactly_at, smooth_on

End = Annotated[np.ndarray, " variables"]
Point = Sequence[Fraction] | None


def stability(field: Field, lower: End, upper: End, exact: Point = None) -> bool | None:
    """Tell whether all eigenvalues of the Jacobian over a box have Re < 0, or one has Re > 0 at every point of it.

    At a kink the slopes on its sides tell nothing: None.
    """
    values = eigenvalues(field, lower, upper, exact) if smooth_on(field.f, lower, upper) else None
    if values is None:
        return None
    if all(value.real < 0 for value in values):
        return True
    return False if any(value.real > 0 for value in values) else None


def eigenvalues(field: Field, lower: End, upper: End, exact: Point = None) -> list[acb] | None:
    """Return balls around the eigenvalues of the Jacobian over a box, None where they cannot be told apart.

    Args:
        field: the agent's.
        lower, upper: of (x, t).
        exact: (x, t), where the box is about one rational point.
    """
    entries = [x for row in field.jacobian for x in row]
    ranges = Program(entries).on_boxes(lower[:, None], upper[:, None])
    if not all(isfinite(low[0]) and isfinite(high[0]) for low, high in ranges):
        return None
    balls = [arb(float(low[0])).union(arb(float(high[0]))) for low, high in ranges]
    J = acb_mat(field.n, field.n, balls)
    try:
        found: list[acb] = J.eig(algorithm="rump", multiple=True)
    except (ValueError, ZeroDivisionError):
        found = []
    if found and all(value.is_finite() for value in found):
        return found
    values = None if exact is None or not smooth_on(field.f, lower, upper) else _rationals(field, exact)
    return gershgorin(J) if values is None else values


def _rationals(field: Field, point: Sequence[Fraction]) -> list[acb] | None:
    rows = [exactly_at(row, point) for row in field.jacobian]
    if any(x is None for row in rows for x in row):
        return None
    J = fmpq_mat([[fmpq(x.numerator, x.denominator) for x in row if x is not None] for row in rows])
    roots: Any = J.charpoly().complex_roots()  # each with how often; FLINT's stub has no counts
    return [acb(root) for root, count in roots for _ in range(count)]


def gershgorin(J: acb_mat) -> list[acb] | None:
    """Return a ball for each eigenvalue of a matrix of balls, the same for those that are not told apart.

    >>> [round(float(x.real.mid()), 9) for x in gershgorin(acb_mat([[2, 0, 1], [0, 2, 0], [0, 0, 5]]))]
    [2.0, 2.0, 5.0]
    """
    n = J.nrows()
    middle = np.array([[complex(J[i, j].mid()) for j in range(n)] for i in range(n)])
    R = acb_mat(np.linalg.eig(middle)[1].tolist())
    try:
        T = R.solve(J * R)
    except ZeroDivisionError:
        return None
    discs = []
    for i in range(n):
        radius = sum((T[i, j].abs_upper() for j in range(n) if j != i), start=arb(0)).abs_upper()
        if not (radius.is_finite() and T[i, i].is_finite()):
            return None
        discs.append(T[i, i] + acb(arb(0, radius), arb(0, radius)))
    for _ in range(n):  # a hull may meet more of them
        for i in range(n):
            for j in range(n):
                if discs[i].overlaps(discs[j]):
                    discs[i] = discs[i].union(discs[j])
    return discs
