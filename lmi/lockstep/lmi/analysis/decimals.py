"""Numbers in short decimals: upwards, downwards, to the nearest, and the entries of P to common places."""

import math
from decimal import ROUND_CEILING, ROUND_FLOOR, Context

import numpy as np
from jaxtyping import Float


def round_up(value: float, digits: int = 4) -> float:
    """Round up to so many significant decimals.

    >>> round_up(13.2323, 4)
    13.24
    """
    if value <= 0 or not math.isfinite(value):
        return value
    unit = 10.0 ** (math.floor(math.log10(value)) - digits + 1)
    rounded = float(f"{math.ceil(value / unit - 1e-9) * unit:.{digits}g}")
    return rounded if rounded >= value else float(f"{rounded + unit:.{digits}g}")


def round_down(value: float, digits: int = 4) -> float:
    """Round a number above 0 down to so many significant decimals.

    >>> round_down(1.95668), round_down(1.9566), round_down(12503.0), round_down(0.0312399)
    (1.956, 1.956, 12500.0, 0.03123)
    """
    unit = 10.0 ** (math.floor(math.log10(value)) - digits + 1)
    short = float(f"{math.floor(value / unit) * unit:.{digits}g}")
    return short if short <= value else float(f"{short - unit:.{digits}g}")


def below(value: float, digits: int = 4) -> str:
    """Return a lower bound, as decimals name it, in so many digits, rounded down: rounded up it would claim more.

    >>> below(0.87749999), below(0.005506), below(float("inf"))
    ('0.8774', '0.005506', 'inf')
    """
    return (
        f"{float(Context(prec=digits, rounding=ROUND_FLOOR).create_decimal(repr(float(value)))):.{digits}g}"
    )


def above(value: float, digits: int = 4) -> str:
    """Return an upper bound in so many digits, rounded up.

    >>> above(1137429.5, 2), above(3.449), above(3.44901)
    ('1.2e+06', '3.449', '3.45')
    """
    return (
        f"{float(Context(prec=digits, rounding=ROUND_CEILING).create_decimal(repr(float(value)))):.{digits}g}"
    )


def rounded_storage(P: Float[np.ndarray, "n n"], digits: int) -> Float[np.ndarray, "n n"]:
    """Round P to decimals: so many significant ones of its largest entry, as many places of all others."""
    places = digits - 1 - math.floor(math.log10(max(np.abs(P).max(initial=0.0), 1e-300)))
    return np.asarray(np.round(P, min(places, 300)))


def significant(values: Float[np.ndarray, "..."], digits: int) -> Float[np.ndarray, "..."]:
    """Round each number to so many significant decimals."""
    return np.array([float(f"{value:.{digits}g}") for value in values.ravel()]).reshape(values.shape)
