"""Incremental dissipativity with V = d'P d, P > 0 constant, and contraction, of x' = f(x, t) + B u, y = C x on the domain.

For any two solutions in the domain, with d, du, dy their differences (Willems 1972; incremental form: van der Schaft 2013;
passivity: Pavlov and Marconi, Incremental passivity and output regulation, 2008):

    d/dt V <= dy'Q dy + 2 dy'S du + du'R du.

Contraction at rate c in the metric P (Lohmiller and Slotine 1998): V' <= -2 c V with u = 0. Both are linear in J = df/dx at
each point, so that a matrix inequality at every point of the box, which is convex, proves them. P comes from a convex program
(`storage`) and is decided by branch and bound (`definite`), strictly.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from flint import fmpq, fmpq_mat

from lockstep.check.bound.regularity import Conditions
from lockstep.check.expression.node import Node, linear
from lockstep.check.psd import decide_positive_definite
from lockstep.check.verdict import Verdict
from lockstep.model.checks.proved.finding import CheckFinding, numbers
from lockstep.model.checks.proved.interval_algebra.definite import BOXES, Question
from lockstep.model.checks.proved.interval_algebra.eigenvalues import eigenvalues
from lockstep.model.checks.proved.storage import Rational, Supply, farthest_samples, propose_storage, rounded
from lockstep.model.checks.proved.vector_field import Field, as_written, at_points

SAMPLES = 300
PARTS = (0.98, 0.7, 0.3, 0.02)
"""Of the rate that the slowest mode allows: which ones are tried."""
ROUNDS = 4
"""Programs, each with the points that refuted the last."""


def contraction(field: Field, *, metric: Rational | None = None, boxes: int = BOXES) -> CheckFinding:
    """Find a rate c > 0 at which the domain contracts, in a given constant metric or in one that is searched for.

    Returns:
        "proved" with `rate` and `P`; "refuted" where the Jacobian at a point, or everywhere, has an eigenvalue with
        Re s >= 0, so that no constant metric has a rate above 0; "undecided".
    """
    name = "contraction"
    refuted = not_decaying(field)
    if refuted is not None:
        return CheckFinding(name, "refuted", f"in no constant metric: {refuted[0]}", None, refuted[1])
    J = _slopes(field)
    fastest = -float(np.linalg.eigvals(J).real.max())
    if not fastest > 0:
        return CheckFinding(name, "undecided", "the slowest mode has Re s = 0 to rounding")
    zeros, J = np.zeros((field.n, 1)), farthest_samples(J)
    share = boxes // len(PARTS)
    for part in PARTS:
        rate, P = fastest * part, metric
        for _ in range(1 if metric else ROUNDS):
            if metric is None:
                found = propose_storage(J, zeros, zeros.T, None, rate)
                P = None if found is None else rounded(found[0], [], None)
            if P is None:
                break
            verdict = decide_storage(field, P, None, shown := Fraction(float(f"{rate:.4g}")), share // 2)
            if verdict.proved:
                value = {"rate": float(shown), "P": _floats(P)}
                return CheckFinding(
                    name, "proved", f"rate {float(shown):.6g} 1/s in a constant metric", value
                )
            if verdict.status == "undecided":
                break
            J = np.vstack([J, _slopes_at(field, verdict)])
    return CheckFinding(name, "undecided", "no constant metric was proved", None, {"slowest": fastest})


def passivity(field: Field, *, boxes: int = BOXES) -> CheckFinding:
    """Decide incremental passivity, supply 2 dy'du, by a quadratic storage function with P > 0: P B = C' exactly."""
    m, q = len(field.B[0]), len(field.C)
    name = "incremental passivity"
    if m != q:
        return CheckFinding(name, "undecided", f"{m} inputs and {q} outputs: it asks for as many of each")
    CB = _product(field.C, field.B)
    witness = _not_positive(CB)
    if witness is not None and fmpq_mat(_exact(field.B).tolist()).rank() == m:
        figure = "P B = C' makes C B = B'P B symmetric and positive definite, which it is not"
        return CheckFinding(name, "refuted", figure, None, {"CB": _floats(CB), "direction": witness})
    return dissipativity(field, Supply.passive(m), name=name, boxes=boxes)


def dissipativity(
    field: Field, supply: Supply, *, name: str = "incremental dissipativity", boxes: int = BOXES
) -> CheckFinding:
    """Decide incremental dissipativity with a supply rate by a quadratic storage function with P > 0.

    Returns:
        "proved" with `P`; "refuted" where Q <= 0 and no P > 0 has V' <= 0 for du = 0; "undecided".
    """
    if _negative_semidefinite(supply.Q):
        refuted = not_decaying(field, marginal=False)
        if refuted is not None:
            return CheckFinding(name, "refuted", f"by no P > 0: {refuted[0]}", None, refuted[1])
    P = _storage(field, supply, farthest_samples(_slopes(field)), boxes)
    if P is None:
        return CheckFinding(name, "undecided", "no strict storage function was proved on the domain")
    return CheckFinding(name, "proved", "by V = d'P d", {"P": _floats(P)})


def _storage(field: Field, supply: Supply, J: np.ndarray, boxes: int) -> Rational | None:
    """Return a P that is proved; where a point refutes one, its slopes join those of the program."""
    for _ in range(ROUNDS):
        found = propose_storage(J, _array(field.B), _array(field.C), supply, 0.0)
        free = any(x for row in supply.R for x in row)
        target = None if free else _product(_transpose(field.C), supply.S)
        P = None if found is None else rounded(found[0], field.B, target)
        if P is None:
            return None
        verdict = decide_storage(field, P, supply, Fraction(0), boxes // 2)
        if verdict.proved:
            return P
        if "point" not in verdict.figures:
            return None
        J = np.vstack([J, _slopes_at(field, verdict)])
    return None


def incremental_gain(field: Field, *, boxes: int = BOXES) -> CheckFinding:
    """Find an incremental L2 gain from u to y, supply g^2 |du|^2 - |dy|^2, by a quadratic storage function with P > 0."""
    name, m, q = "incremental L2 gain", len(field.B[0]), len(field.C)
    refuted = not_decaying(field, marginal=False)
    if refuted is not None:
        return CheckFinding(name, "refuted", f"no finite one by any P > 0: {refuted[0]}", None, refuted[1])
    J = farthest_samples(_slopes(field))
    B, C = _array(field.B), _array(field.C)
    best = propose_storage(J, B, C, Supply.gain(q, m, 1.0), 0.0, gain=True)
    for more in (1.02, 1.3, 3.0) if best is not None else ():
        level = float(f"{np.sqrt(max(best[1], 0.0)) * more:.4g}") if best is not None else 0.0
        supply = Supply.gain(q, m, level)
        P = _storage(field, supply, J, boxes // 4) if level > 0 else None
        if P is not None:
            return CheckFinding(name, "proved", f"at most {level:.6g}", {"gain": level, "P": _floats(P)})
    return CheckFinding(name, "undecided", "no strict storage function was proved on the domain")


def decide_storage(field: Field, P: Rational, supply: Supply | None, rate: Fraction, boxes: int) -> Verdict:
    """Decide the matrix inequality of `storage` strictly, for every J of the domain, with P > 0.

    With R = 0 the off-diagonal block P B - C'S has to vanish, exactly.
    """
    n = field.n
    if _not_positive(P) is not None:
        return Verdict("undecided", "P is not positive definite")
    rows: list[list[Node]] = []
    J, C = field.jacobian, field.C
    CQC = _product(_product(_transpose(C), supply.Q), C) if supply else [[Fraction(0)] * n] * n
    for i in range(n):
        rows.append([])
        for j in range(n):
            terms = [(-P[k][i], J[k][j]) for k in range(n)] + [(-P[k][j], J[k][i]) for k in range(n)]
            rows[i].append(linear(CQC[i][j] - 2 * rate * P[i][j], terms))
    if supply is not None:
        CS = _product(_transpose(C), supply.S)
        PB = _product(P, field.B)
        across = [[c - p for c, p in zip(a, b, strict=True)] for a, b in zip(CS, PB, strict=True)]
        if any(x for row in supply.R for x in row):
            rows = [[*row, *(linear(x, []) for x in more)] for row, more in zip(rows, across, strict=True)]
            for k, own in enumerate(supply.R):
                rows.append([*(linear(across[i][k], []) for i in range(n)), *(linear(x, []) for x in own)])
        elif any(x for row in across for x in row):
            return Verdict("undecided", "P B is not C'S")
    size = [Fraction(2) ** round(np.log2(float(P[i][i]))) if i < n else Fraction(1) for i in range(len(rows))]
    root = [Fraction(2) ** (round(np.log2(float(s))) // 2) for s in size]
    scaled = tuple(
        tuple(linear(0, [(1 / (root[i] * root[j]), x)]) for j, x in enumerate(row))
        for i, row in enumerate(rows)
    )
    question = Question(scaled, Conditions(field.conditions), field.lower, field.upper)
    return question.decide(boxes)


def not_decaying(field: Field, *, marginal: bool = True) -> tuple[str, dict[str, object]] | None:
    """Return why no P > 0 has J'P + P J < 0 (<= 0 without `marginal`) on the domain, with a witness; None if not shown."""
    if marginal:
        exact = as_written(field.agent)
        stacked = fmpq_mat([*exact.A.tolist(), *exact.H.tolist()])
        if stacked.rank() < field.n:
            return "f is the same along a direction of the states", {"direction": kernel_vector(stacked)}
    points = field.samples(SAMPLES)
    J = at_points(field.jacobian, points)
    good = np.isfinite(J).all(axis=(1, 2)) & field.defined_on(points, points)
    if not good.any():
        return None
    abscissae = np.where(
        good, np.linalg.eigvals(np.where(good[:, None, None], J, 0.0)).real.max(axis=1), -np.inf
    )
    point = points[:, int(abscissae.argmax())]
    values = eigenvalues(field, point, point) if abscissae.max() > 0 else None
    worst = max(values, key=lambda s: float(s.real.mid())) if values else None
    if worst is None or not worst.real > 0:
        return None
    said = f"the Jacobian at {numbers(point[: field.n])} has an eigenvalue with Re s = {float(worst.real.mid()):.6g}"
    return said, {"point": point[:-1].tolist(), "t": float(point[-1]), "real_part": float(worst.real.mid())}


def _slopes(field: Field) -> np.ndarray:
    J = at_points(field.jacobian, field.samples(SAMPLES))
    return np.asarray(J[np.isfinite(J).all(axis=(1, 2))])


def _slopes_at(field: Field, verdict: Verdict) -> np.ndarray:
    point = np.array([*verdict.figures["point"], verdict.figures["t"]])[:, None]
    return at_points(field.jacobian, point)


def kernel_vector(matrix: fmpq_mat) -> list[float]:
    """Return a vector that a matrix of deficient rank maps to 0."""
    steps, rank = matrix.rref()
    rows = steps.tolist()[:rank]
    pivots = [next(k for k, x in enumerate(row) if x != 0) for row in rows]
    free = next(k for k in range(matrix.ncols()) if k not in pivots)
    vector = [0.0] * matrix.ncols()
    vector[free] = 1.0
    for row, pivot in zip(rows, pivots, strict=True):
        vector[pivot] = -int(row[free].p) / int(row[free].q)
    return vector


def _not_positive(M: Rational) -> list[float] | None:
    """Return a direction z with z'M z <= 0, or that shows that M is not symmetric; None if M is positive definite."""
    for i, row in enumerate(M):
        for j, x in enumerate(row):
            if x != M[j][i]:
                return [float(k in (i, j)) for k in range(len(M))]
    answer = decide_positive_definite(_exact(M))
    return None if answer.positive else [] if answer.vector is None else answer.vector.tolist()


def _negative_semidefinite(M: Rational) -> bool:
    """Whether M <= 0: it is 0, or -M is positive definite."""
    return not any(x for row in M for x in row) or decide_positive_definite(-_exact(M)).positive


def _exact(M: Rational) -> np.ndarray:
    return np.array([[fmpq(x.numerator, x.denominator) for x in row] for row in M], dtype=object)


def _product(first: Rational, second: Rational) -> Rational:
    return [
        [sum((a * b for a, b in zip(r, c, strict=True)), Fraction(0)) for c in zip(*second, strict=True)]
        for r in first
    ]


def _transpose(M: Rational) -> Rational:
    return [list(column) for column in zip(*M, strict=True)]


def _array(M: Rational) -> np.ndarray:
    return np.array(M, dtype=float)


def _floats(M: Rational) -> list[list[float]]:
    return [[float(x) for x in row] for row in M]
