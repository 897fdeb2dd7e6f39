"""Relative degree on the domain, and the zero dynamics at an equilibrium (Isidori, Nonlinear Control Systems, 1995).

Output i has the relative degree r_i if L_g L_f^k y_i = 0 identically for k < r_i - 1 and the row L_g L_f^(r_i - 1) y_i is
not 0; with as many inputs as outputs the matrix D(x) of these rows has to be invertible (definition 5.1.1), on all
of the domain. The zero dynamics then have n - sum r_i states; linearised at an equilibrium their eigenvalues are the zeros of
det [s I - J, -B; C, 0] (section 4.3): with all Re s < 0 they are locally exponentially stable (minimum phase).
"""

from __future__ import annotations

from fractions import Fraction
from itertools import permutations

import numpy as np
from flint import acb, acb_poly, arb, arb_mat, arb_poly, fmpq

from lockstep.check.bound.enclosure import Program
from lockstep.check.bound.regularity import Conditions
from lockstep.check.expression.node import ZERO, Node, linear, multiply, number, power, variable
from lockstep.check.expression.traversal import expand
from lockstep.model.checks.proved.finding import CheckFinding, numbers
from lockstep.model.checks.proved.geometry.lie import Point, lie_derivative, lie_derivatives, too_long
from lockstep.model.checks.proved.interval_algebra.definite import Question
from lockstep.model.checks.proved.vector_field import Field, Nodes, exactly_at, smooth_on

BOXES = 5_000
SAMPLES = 50
MOST_SQUARE = 4


def relative_degree(field: Field, *, boxes: int = BOXES) -> CheckFinding:
    """Decide the relative degrees of the outputs on the domain."""
    name = "relative degree"
    if field.varies:
        return CheckFinding(name, "undecided", "f depends on t")
    degrees, rows = list[int](), list[Nodes]()
    for output, C in zip(field.agent.outputs, field.C, strict=True):
        node = linear(0, [(c, variable(j)) for j, c in enumerate(C)])
        for degree in range(1, field.n + 1):
            row = lie_derivatives(field, node)
            if any(x is not ZERO for x in row):
                if not _seen_nonzero(field, row):
                    return CheckFinding(
                        name, "undecided", f"whether an input enters derivative {degree} of {output}"
                    )
                degrees.append(degree)
                break
            node = lie_derivative(field, node)
            if too_long([node]):
                return CheckFinding(name, "undecided", f"the derivatives of {output} grow too long")
            if not smooth_on([node], field.lower, field.upper):
                return CheckFinding(name, "undecided", f"derivative {degree} of {output} has a kink")
        else:
            figure = f"{output} has none: no input enters its first {field.n} derivatives"
            return CheckFinding(name, "refuted", figure, None, {"output": output})
        rows.append(row)
    square = len(rows) == len(rows[0])
    if square and len(rows) <= MOST_SQUARE:
        return _invertible(field, name, degrees, _determinant(rows), boxes)
    value = {"degrees": degrees, "zero_dynamics": None}
    for output, row in zip(field.agent.outputs, rows, strict=True):
        size = linear(0, [(1, power(x, 2)) for x in row])
        if number(size) is None and not _positive(field, size, boxes)[0]:
            return CheckFinding(name, "undecided", f"the inputs' row of {output} may vanish", None, value)
    figure = f"{', '.join(map(str, degrees))}, output by output; {len(rows[0])} inputs, {len(rows)} outputs"
    return CheckFinding(name, "proved", figure, value)


def zero_dynamics(field: Field, point: Point, degree: CheckFinding) -> CheckFinding:
    """Decide the stability of the zero dynamics at an equilibrium, from the relative degrees that were found."""
    name = "zero dynamics"
    left = None if degree.value is None or degree.status != "proved" else degree.value["zero_dynamics"]
    if left is None:
        return CheckFinding(name, "undecided", "they need a relative degree, and as many inputs as outputs")
    if left == 0:
        return CheckFinding(
            name, "proved", "none: the relative degrees add up to n", {"states": 0, "zeros": []}
        )
    if not point.is_equilibrium:
        return CheckFinding(name, "undecided", "no equilibrium is known", {"states": left})
    if not smooth_on(field.f, point.lower, point.upper):
        return CheckFinding(name, "undecided", "f has a kink at the equilibrium", {"states": left})
    zeros = _zeros(field, point, left)
    if zeros is None:
        return CheckFinding(name, "undecided", "the zeros could not be enclosed", {"states": left})
    real = [float(z.real.mid()) for z in zeros]
    value = {
        "states": left,
        "zeros": [[float(z.real.mid()), float(z.imag.mid())] for z in zeros],
        "point": point.text,
    }
    where = f"{left} states, largest Re s = {max(real):.6g} at {numbers(point.text)}"
    if all(z.real < 0 for z in zeros):
        return CheckFinding(name, "proved", f"locally exponentially stable: {where}", value)
    if any(z.real > 0 for z in zeros):
        return CheckFinding(
            name, "refuted", f"unstable: {where}", value, {"zero": value["zeros"][real.index(max(real))]}
        )
    return CheckFinding(name, "undecided", f"a zero on the imaginary axis, to rounding: {where}", value)


def _invertible(field: Field, name: str, degrees: list[int], D: Node, boxes: int) -> CheckFinding:
    value = {"degrees": degrees, "zero_dynamics": field.n - sum(degrees)}
    shown = ", ".join(map(str, degrees))
    if D is ZERO:
        return CheckFinding(
            name, "refuted", f"{shown}, but the decoupling matrix is singular everywhere", None, {"D": 0.0}
        )
    if number(D) is not None:
        return CheckFinding(name, "proved", f"{shown}, everywhere", value)
    above, low = _positive(field, D, boxes)
    below, high = _positive(field, linear(0, [(-1, D)]), boxes) if not above else (False, None)
    if above or below:
        return CheckFinding(name, "proved", f"{shown} on the domain", value)
    origin = np.clip(0.0, field.lower, field.upper)
    if exactly_at([D], [Fraction(x) for x in origin.tolist()]) == [0]:
        figure = f"{shown} almost everywhere, but the decoupling matrix is singular at {numbers(origin[:-1])}"
        return CheckFinding(name, "refuted", figure, None, {"point": origin[:-1].tolist(), "D": 0.0})
    connected = bool(field.defined_on(field.lower[:, None], field.upper[:, None]).all())
    if low is not None and high is not None and connected:
        figure = f"{shown} almost everywhere, but the decoupling matrix changes sign on the domain"
        return CheckFinding(name, "refuted", figure, None, {"negative_at": low, "positive_at": high})
    return CheckFinding(
        name, "undecided", f"{shown}, unless the decoupling matrix vanishes somewhere", None, value
    )


def _seen_nonzero(field: Field, row: Nodes) -> bool:
    """Whether a row is surely not 0 at some point: one that is 0 everywhere may be written as if it were not."""
    points = field.samples(SAMPLES)
    defined = field.defined_on(points, points)
    return any(
        bool((defined & ((low > 0) | (high < 0))).any())
        for low, high in Program(row).on_boxes(points, points)
    )


def _positive(field: Field, node: Node, boxes: int) -> tuple[bool, object]:
    verdict = Question(((node,),), Conditions(field.conditions), field.lower, field.upper).decide(boxes)
    return verdict.proved, verdict.figures.get("point")


def _determinant(rows: list[Nodes]) -> Node:
    """Return det D, expanded."""
    terms = []
    for order in permutations(range(len(rows))):
        sign = (-1) ** sum(a > b for i, b in enumerate(order) for a in order[:i])
        terms.append((sign, multiply(*(row[j] for row, j in zip(rows, order, strict=True)))))
    return expand(linear(0, terms))


def _zeros(field: Field, point: Point, count: int) -> list[acb] | None:
    """Return balls around the zeros of det [s I - J, -B; C, 0], whose degree is known."""
    n, m = field.n, len(field.B[0])
    _, balls = point.values([x for row in field.jacobian for x in row])
    if not all(ball.is_finite() for ball in balls):
        return None
    B = [[arb(fmpq(x.numerator, x.denominator)) for x in row] for row in field.B]
    C = [[arb(fmpq(x.numerator, x.denominator)) for x in row] for row in field.C]
    values = []
    for s in range(count + 1):
        upper = [
            [(s if i == j else 0) - balls[i * n + j] for j in range(n)] + [-b for b in B[i]] for i in range(n)
        ]
        lower = [[*row, *[arb(0)] * m] for row in C]
        values.append(arb_mat([*upper, *lower]).det())
    polynomial = arb_poly.interpolate([arb(s) for s in range(count + 1)], values)
    try:
        zeros: list[acb] = acb_poly(polynomial).roots()
    except (ValueError, ArithmeticError, AttributeError):
        return None
    return zeros if len(zeros) == count else None
