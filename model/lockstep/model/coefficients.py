"""Coefficients of expressions: exact rationals, the doubles they become, and whether that loses anything."""

from fractions import Fraction
from math import isfinite

import casadi as ca

from lockstep.check.errors import ProblemError


def scaled(value: ca.SX, coefficient: Fraction) -> ca.SX:
    """Return coefficient * value, rounded once; a plain fraction no double holds, such as 1/3, divides."""
    if not is_double(coefficient) and _is_plain(coefficient):
        return (float(coefficient.numerator) * value) / float(coefficient.denominator)
    return to_double(coefficient) * value


def is_exact(coefficient: Fraction) -> bool:
    """Whether `scaled` uses the coefficient as it is."""
    return is_double(coefficient) or _is_plain(coefficient)


def _is_plain(coefficient: Fraction) -> bool:
    return max(abs(coefficient.numerator), coefficient.denominator) < 10_000


def is_double(number: Fraction) -> bool:
    """Whether a double holds the number exactly."""
    try:
        return Fraction(float(number)) == number
    except OverflowError:
        return False


def fraction(number: float) -> Fraction:
    """Return the rational that a double is; one that is not finite is bad input."""
    if not isfinite(number):
        raise ProblemError(f"a coefficient of an expression is {number}", expected="a finite number")
    return Fraction(number)


def to_double(number: Fraction) -> float:
    """Round a rational to the nearest double; one too large is bad input."""
    try:
        return float(number)
    except OverflowError:
        raise ProblemError(
            "a coefficient of an expression is larger than 1.79e308",
            expected="numbers that fit in double precision",
            remedy="change the units",
        ) from None
