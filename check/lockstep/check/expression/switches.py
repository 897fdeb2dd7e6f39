"""Conditions and choices: the piecewise part of an expression."""

from __future__ import annotations

from fractions import Fraction

from lockstep.check.expression.node import Node, intern, linear, linear_terms, number, scale

TRUE, FALSE = intern("truth", (), True), intern("truth", (), False)


def positive(node: Node, *, weak: bool = False) -> Node:
    """Return the condition node > 0; `weak` lets it be decided almost everywhere (see `continuity`)."""
    value = number(node)
    if value is not None:
        return TRUE if value > 0 else FALSE
    offset, terms = linear_terms(node)
    if not weak and len(terms) == 1 and terms[0][1].op == "fabs":
        return _positive_with_modulus(offset, *terms[0])
    lead = abs(terms[0][0])
    return intern("positive", (scale(1 / lead, node),), weak)


def _positive_with_modulus(offset: Fraction, slope: Fraction, modulus: Node) -> Node:
    """Rewrite c0 + c |u| > 0 as two conditions that are linear in u where u is."""
    inner, radius = modulus.args[0], -offset / slope
    if slope > 0:  # |u| > radius
        return either(positive(linear(-radius, [(1, inner)])), positive(linear(-radius, [(-1, inner)])))
    return both(positive(linear(radius, [(-1, inner)])), positive(linear(radius, [(1, inner)])))


def negate(condition: Node) -> Node:
    """Return the condition's negation."""
    if condition.op == "truth":
        return FALSE if condition is TRUE else TRUE
    return condition.args[0] if condition.op == "not" else intern("not", (condition,))


def both(a: Node, b: Node) -> Node:
    """Return a and b."""
    if FALSE in (a, b) or a is negate(b):
        return FALSE
    if a is TRUE or a is b:
        return b
    return a if b is TRUE else intern("and", (a, b))


def either(a: Node, b: Node) -> Node:
    """Return a or b."""
    return negate(both(negate(a), negate(b)))


def choose(condition: Node, a: Node, b: Node, *, smooth: bool = False) -> Node:
    """Return a where the condition holds and b elsewhere.

    Where a box leaves the condition open, the enclosure is the hull of both; with `smooth` (the derivative
    of a slope, which a kink does not have) it is everything.
    """
    if condition is TRUE or (a is b and not smooth):
        return a
    if condition is FALSE:
        return b
    if condition.op == "not":
        return choose(condition.args[0], b, a, smooth=smooth)
    return intern("choose", (condition, a, b), smooth)
