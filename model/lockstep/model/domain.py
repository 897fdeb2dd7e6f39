"""The arguments of phi over a domain of the states, v = H x for x in a box, and smaller boxes inside of it."""

from fractions import Fraction
from math import inf, isfinite

import numpy as np
from jaxtyping import Float

from lockstep.check.errors import ProblemError
from lockstep.check.numbers import rounded_down
from lockstep.model.bound_search import Box


def argument_box(H: Float[np.ndarray, "v n"], states: Float[np.ndarray, "n 2"]) -> Box:
    """Return a box that contains H x for every x in the box of the states.

    Each side is the exact sum of the ends that count, rounded outwards; H x fills the box where each row of H
    has a state of its own.

    Args:
        H: (v, n).
        states: lower and upper bound of each state, infinite where there is none.

    >>> argument_box(np.array([[1.0, -2.0], [0.0, 0.0]]), np.array([[-1.0, 3.0], [0.0, np.inf]]))
    Box(lower=(-inf, 0.0), upper=(3.0, 0.0))
    """
    lower = [_least(row, states) for row in H]
    upper = [0.0 - _least(-row, states) for row in H]
    return Box(tuple(lower), tuple(upper))


def inner_box(box: Box, fraction: float) -> Box:
    """Return the box with `fraction` of its size around its middle: what is left to a leader (`lockstep.check.local`).

    A side without an opposite one moves towards 0 as if its opposite were -side, and by 1 - fraction if it is 0.

    Raises:
        ProblemError: a fraction outside of [0, 1), which would leave no room between the boxes.

    >>> inner_box(Box((-4.0, -2.0), (8.0, np.inf)), 0.5)
    Box(lower=(-1.0, -1.0), upper=(5.0, inf))
    """
    if not 0 <= fraction < 1:
        raise ProblemError(
            f"{fraction}",
            where="the part of the domain left to the leader",
            expected="from 0 up to, but not, 1",
        )
    sides = [_inner_side(low, high, fraction) for low, high in zip(box.lower, box.upper, strict=True)]
    return Box(tuple(low for low, _ in sides), tuple(high for _, high in sides))


def _inner_side(low: float, high: float, fraction: float) -> tuple[float, float]:
    if isfinite(low) and isfinite(high):
        middle, half = low / 2 + high / 2, high / 2 - low / 2
        return middle - fraction * half, middle + fraction * half
    return (
        low + (1 - fraction) * (abs(low) or 1.0) if isfinite(low) else low,
        high - (1 - fraction) * (abs(high) or 1.0) if isfinite(high) else high,
    )


def _least(row: Float[np.ndarray, " n"], states: Float[np.ndarray, "n 2"]) -> float:
    """Return a lower bound of row x over the box, the exact minimum or the double below it."""
    total = Fraction(0)
    for h, (low, high) in zip(row, states, strict=True):
        end = low if h > 0 else high
        if h and np.isinf(end):
            return -inf
        total += Fraction(float(h)) * Fraction(float(end)) if h else 0
    return rounded_down(total)
