"""The domain of a bound: the arguments v = H x of states in a box, and what "global" means.

A bound is claimed with a scope. "global": it holds for every v, so that the domain of the problem file plays no part in
it; "local": on the box of v = H x, and the certificate speaks of trajectories that stay there. What is to be decided
for either is the same bound on another box (`claimed_box`).
"""

from collections.abc import Iterable, Sequence
from fractions import Fraction
from math import inf, isinf
from typing import Any, Literal

from lockstep.check.bound.box import Box
from lockstep.check.numbers import as_fraction, rounded_down

Scope = Literal["global", "local"]


def claimed_box(scope: Scope, box: Box) -> Box:
    """Return the box on which a bound of that scope has to be decided.

    >>> claimed_box("global", Box((0.0,), (1.0,)))
    Box(lower=(-inf,), upper=(inf,))
    """
    return Box.everywhere(box.size) if scope == "global" else box


def argument_box(H: Iterable[Sequence[Any]], states: Iterable[Sequence[float]]) -> Box:
    """Return a box that contains H x for every x in the box of the states.

    Each side is the exact sum of the ends that count, rounded outwards; H x fills the box where each row of H
    has a state of its own.

    Args:
        H: v rows of n numbers: doubles, or rationals with a numerator and a denominator.
        states: lower and upper bound of each state, infinite where there is none.

    >>> argument_box([[1.0, -2.0], [0.0, 0.0]], [[-1.0, 3.0], [0.0, inf]])
    Box(lower=(-inf, 0.0), upper=(3.0, 0.0))
    """
    states, rows = list(states), [[as_fraction(h) for h in row] for row in H]
    lower = [_least(row, states) for row in rows]
    upper = [0.0 - _least([-h for h in row], states) for row in rows]
    return Box(tuple(lower), tuple(upper))


def _least(row: Sequence[Fraction], states: Sequence[Sequence[float]]) -> float:
    """Return a lower bound of row x over the box, the exact minimum or the double below it."""
    total = Fraction(0)
    for h, (low, high) in zip(row, states, strict=True):
        end = float(low if h > 0 else high)
        if h and isinf(end):
            return -inf
        total += h * Fraction(end) if h else 0
    return rounded_down(total)
