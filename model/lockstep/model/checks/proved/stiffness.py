"""Stiffness at a point, and a period for a sampled controller from the fastest motion on the domain.

Stiffness ratio: max |Re s| / min |Re s| over the eigenvalues s of J = df/dx that decay (Lambert, Computational Methods in
Ordinary Differential Equations, 1973, section 8.1), in balls. Every eigenvalue of J(x, t) on the domain is at most
w = sup |D^-1 J D|_2, with powers of two D; proved by branch and bound. The period suggested is 0.2 / w, the short end of
the rule w h = 0.2 to 0.6 (Astrom and Wittenmark, Computer-Controlled Systems, 3rd ed., 1997): a suggestion, no proof.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from lockstep.check.expression.node import add, multiply, scale
from lockstep.model.checks.proved.finding import CheckFinding, numbers
from lockstep.model.checks.proved.geometry.lie import Point
from lockstep.model.checks.proved.interval_algebra.eigenvalues import eigenvalues
from lockstep.model.checks.proved.one_sided_lipschitz import SAMPLES, bounded
from lockstep.model.checks.proved.storage import scales
from lockstep.model.checks.proved.vector_field import Field, at_points

BOXES = 5_000
PART = 0.2


def stiffness(field: Field, point: Point, *, boxes: int = BOXES) -> CheckFinding:
    """Enclose the eigenvalues at a point and bound those on the domain."""
    name = "stiffness"
    w = fastest(field, boxes)
    period = None if not w else PART / w
    more = {"fastest": w, "period": period}
    said = (
        f"; none on the domain exceeds {w:.4g} 1/s, a motion that {period:.2g} s would follow"
        if period
        else ""
    )
    values = eigenvalues(field, point.lower, point.upper, point.exact)
    if values is None:
        return CheckFinding(name, "undecided", f"the eigenvalues could not be told apart{said}", more)
    decaying = [-float(s.real.mid()) for s in values if s.real < 0]
    spectrum = [[float(s.real.mid()), float(s.imag.mid())] for s in values]
    ratio = max(decaying) / min(decaying) if decaying else None
    shown = "no mode decays" if ratio is None else f"ratio {ratio:.4g} at {numbers(point.text)}"
    value = {"ratio": ratio, "eigenvalues": spectrum, "point": point.text, **more}
    return CheckFinding(name, "proved" if w else "undecided", f"{shown}{said}", value)


def fastest(field: Field, boxes: int) -> float | None:
    """Return a proved bound of |s| over the eigenvalues s of the Jacobian on the domain, None if there is none."""
    J = at_points(field.jacobian, field.samples(SAMPLES))
    J = J[np.isfinite(J).all(axis=(1, 2))]
    if not len(J):
        return None
    D = [Fraction(x) for x in scales(J).tolist()]
    scaled = [[scale(D[j] / D[i], x) for j, x in enumerate(row)] for i, row in enumerate(field.jacobian)]
    columns = list(zip(*scaled, strict=True))
    gram = tuple(
        tuple(add(*(multiply(x, y) for x, y in zip(a, b, strict=True))) for b in columns) for a in columns
    )
    level = bounded(field, gram, boxes).proved
    return None if level is None else float(np.nextafter(np.sqrt(level), np.inf))
