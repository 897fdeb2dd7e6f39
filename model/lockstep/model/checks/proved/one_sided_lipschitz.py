"""One-sided Lipschitz and quadratic inner-boundedness constants of h(x, t), the part of f that is not linear in x.

One-sided Lipschitz: (a - b)' (h(a) - h(b)) <= rho |a - b|^2. Quadratically inner-bounded:
|h(a) - h(b)|^2 <= beta |a - b|^2 + gamma (a - b)' (h(a) - h(b)), both for all a, b in the domain (Abbaszadeh and Marquez,
Nonlinear observer design for one-sided Lipschitz systems, ACC 2010, (2) and (3)). On a box, which is convex, with J = dh/dx:
h(a) - h(b) is a mean of J(x) (a - b) along the segment, and |.|^2 is convex, so that the least constants are

    rho = sup lambda_max((J + J') / 2),    beta(gamma) = sup lambda_max(J'J - gamma (J + J') / 2).
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

import numpy as np

from lockstep.check.bound.regularity import Conditions
from lockstep.check.expression.node import ONE, ZERO, add, linear, multiply
from lockstep.model.checks.proved.finding import CheckFinding, numbers
from lockstep.model.checks.proved.interval_algebra.definite import (
    BOXES,
    Question,
    Supremum,
    largest_eigenvalue,
    least_level,
)
from lockstep.model.checks.proved.vector_field import Field, Matrix, at_points

SAMPLES = 400


def one_sided_lipschitz(field: Field, *, boxes: int = BOXES) -> CheckFinding:
    """Find rho on the domain: proved from above, and the point where nearly as much is reached."""
    name = "one-sided Lipschitz"
    level = bounded(field, symmetric(field.slopes), boxes)
    return _finding(name, "rho", field, level, {})


def quadratic_inner_boundedness(field: Field, *, boxes: int = BOXES) -> CheckFinding:
    """Find beta for the gamma that makes it smallest among points, rounded; both may be negative."""
    J = at_points(field.slopes, field.samples(SAMPLES))
    J = J[np.isfinite(J).all(axis=(1, 2))]
    gamma = _best_gamma(J)
    S = symmetric(field.slopes)
    gram = tuple(
        tuple(
            add(*(multiply(row[i], row[j]) for row in field.slopes), linear(0, [(-Fraction(gamma), S[i][j])]))
            for j in range(field.n)
        )
        for i in range(field.n)
    )
    level = bounded(field, gram, boxes, float((J**2).sum(axis=(1, 2)).max(initial=0.0)))
    return _finding("quadratic inner-boundedness", "beta", field, level, {"gamma": gamma})


def symmetric(J: Matrix) -> Matrix:
    """Return (J + J') / 2."""
    half = Fraction(1, 2)
    n = len(J)
    return tuple(tuple(linear(0, [(half, J[i][j]), (half, J[j][i])]) for j in range(n)) for i in range(n))


def bounded(field: Field, M: Matrix, boxes: int, least: float = 0.0) -> Supremum:
    """Return the least level c that is proved with lambda_max(M(x, t)) <= c on the domain.

    Tolerances are relative to the values of M, or to `least` where these are smaller.
    """
    if all(x is ZERO for row in M for x in row):
        origin = np.clip(0.0, field.lower, field.upper).tolist()
        # Where h may jump, slopes that are all 0 say nothing.
        return Supremum(0.0, origin, 0.0 if below(field, ((ZERO,),))(1.0).decide(boxes).proved else None)
    kept = [i for i, row in enumerate(M) if any(x is not ZERO for x in row)]
    M = tuple(tuple(M[i][j] for j in kept) for i in kept)  # the rows that are 0 have the eigenvalue 0
    reached, at, size = largest_eigenvalue(M, field.samples(SAMPLES))
    size = max(size, least)
    level = least_level(below(field, M), reached, at, size, boxes)
    if len(kept) == field.n or level.reached > 0:
        return level
    return Supremum(0.0, level.point, None if level.proved is None else max(level.proved, 0.0))


def below(field: Field, M: Matrix) -> Callable[[float], Question]:
    """Return the question whether c I - M > 0 on the domain, by c."""

    def ask(level: float) -> Question:
        rows = tuple(
            tuple(linear(0, [(Fraction(level) * (i == j), ONE), (-1, x)]) for j, x in enumerate(row))
            for i, row in enumerate(M)
        )
        return Question(rows, Conditions(field.conditions), field.lower, field.upper)

    return ask


def _best_gamma(J: np.ndarray) -> float:
    """Return the gamma with the smallest beta over sampled slopes, convex in gamma, to two digits."""
    from scipy.optimize import minimize_scalar

    gram, S = J.swapaxes(1, 2) @ J, 0.5 * (J + J.swapaxes(1, 2))

    def beta(gamma: float) -> float:
        return float(np.linalg.eigvalsh(gram - gamma * S)[:, -1].max())

    far = 2.0 * float(np.abs(J).sum(axis=(1, 2)).max(initial=0.0)) + 1e-9
    best = minimize_scalar(beta, bounds=(-far, far), method="bounded").x if len(J) else 0.0
    rounded = float(f"{best:.2g}")
    return rounded if len(J) and beta(rounded) < (1 - 1e-3) * beta(0.0) else 0.0


def _finding(name: str, letter: str, field: Field, level: Supremum, more: dict[str, float]) -> CheckFinding:
    aside = "".join(f", {key} = {value:.6g}" for key, value in more.items())
    seen = {"point": level.point[:-1], "t": level.point[-1], "reached": level.reached}
    reached = f"{level.reached:.6g} is reached at {numbers(level.point[: field.n])}"
    if level.proved is None:
        return CheckFinding(
            name, "undecided", f"no {letter} was proved; {reached}{aside}", more or None, seen
        )
    figure = f"{letter} = {level.proved:.6g}{aside}; {reached}"
    return CheckFinding(name, "proved", figure, {letter: level.proved, **more}, seen)
