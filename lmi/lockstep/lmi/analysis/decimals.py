"""Numbers in short decimals: upwards, downwards, to the nearest, and the entries of P to common places."""

import math
from decimal import ROUND_CEILING, ROUND_FLOOR, Context

import numpy as np
from jaxtyping import Float


def round_up(value: float, digits: int = 4) -> float:
    """Round up to so many significant digits of the decimal that names the double: what a file says is kept as it is.

    >>> round_up(13.2323, 4), round_up(3.449), round_up(1137429.5, 2)
    (13.24, 3.449, 1200000.0)
    """
    return _rounded(value, digits, ROUND_CEILING)


def round_down(value: float, digits: int = 4) -> float:
    """Round down, as `round_up` does.

    >>> round_down(1.95668), round_down(0.005506), round_down(12503.0), round_down(0.0312399)
    (1.956, 0.005506, 12500.0, 0.03123)
    """
    return _rounded(value, digits, ROUND_FLOOR)


def _rounded(value: float, digits: int, rounding: str) -> float:
    return float(Context(prec=digits, rounding=rounding).create_decimal(repr(float(value))))


def below(value: float, digits: int = 4) -> str:
    """Return a lower bound as text, rounded down: rounded up it would claim more than is proved."""
    return f"{round_down(value, digits):.{digits}g}"


def above(value: float, digits: int = 4) -> str:
    """Return an upper bound as text, rounded up.

    >>> above(1137429.5, 2), above(float("inf"))
    ('1.2e+06', 'inf')
    """
    return f"{round_up(value, digits):.{digits}g}"


def rounded_storage(P: Float[np.ndarray, "n n"], digits: int) -> Float[np.ndarray, "n n"]:
    """Round P to decimals: so many significant ones of its largest entry, as many places of all others."""
    places = digits - 1 - math.floor(math.log10(max(np.abs(P).max(initial=0.0), 1e-300)))
    return np.asarray(np.round(P, min(places, 300)))


def significant(values: Float[np.ndarray, "..."], digits: int) -> Float[np.ndarray, "..."]:
    """Round each number to so many significant decimals."""
    return np.array([float(f"{value:.{digits}g}") for value in values.ravel()]).reshape(values.shape)
