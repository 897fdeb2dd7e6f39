"""The arguments of phi over a domain of the states: v = H x for x in a box, as a box rounded outwards."""

from fractions import Fraction
from math import inf, nextafter

import numpy as np
from jaxtyping import Float

from lockstep.model.bound import Box


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


def _least(row: Float[np.ndarray, " n"], states: Float[np.ndarray, "n 2"]) -> float:
    """Return a lower bound of row x over the box, the exact minimum or the double below it."""
    total = Fraction(0)
    for h, (low, high) in zip(row, states, strict=True):
        end = low if h > 0 else high
        if h and np.isinf(end):
            return -inf
        total += Fraction(float(h)) * Fraction(float(end)) if h else 0
    return _rounded_down(total)


def _rounded_down(number: Fraction) -> float:
    try:
        nearest = float(number)
    except OverflowError:
        return -inf if number < 0 else nextafter(inf, 0.0)
    return nearest if Fraction(nearest) <= number else nextafter(nearest, -inf)
