"""Enclosures of elementary functions on arrays of intervals.

The value at a double is enclosed by python-flint's ball arithmetic (`arb`: Johansson 2017) at 100 bits and
rounded outwards to the next doubles; monotonicity then carries the endpoints to the interval. Outside its
domain a function is cut to its domain here; that the domain holds is checked apart (`regularity`), so a cut
never proves anything.
"""

import math
from collections.abc import Callable
from fractions import Fraction
from functools import lru_cache

import flint
import numpy as np

from lockstep.check.bound import intervals
from lockstep.check.bound.intervals import INF, Endpoints, Interval

BITS = 100

# Domain, range, and the values at the ends of the domain (limits where an end is infinite).
_INCREASING: dict[str, tuple[float, float, float, float]] = {
    "exp": (-INF, INF, 0.0, INF),
    "log": (0.0, INF, -INF, INF),
    "asin": (-1.0, 1.0, -math.nextafter(math.pi / 2, INF), math.nextafter(math.pi / 2, INF)),
    "atan": (-INF, INF, -math.nextafter(math.pi / 2, INF), math.nextafter(math.pi / 2, INF)),
    "sinh": (-INF, INF, -INF, INF),
    "tanh": (-INF, INF, -1.0, 1.0),
}
_AT: dict[str, Callable[[flint.arb], flint.arb]] = {
    **{name: getattr(flint.arb, name) for name in (*_INCREASING, "sin", "cos", "tan", "acos", "cosh")},
    "sech2": lambda x: x.sech() ** 2,
}
PI_BELOW, PI_ABOVE = math.pi, math.nextafter(math.pi, INF)  # the double nearest to pi is below it


@lru_cache(maxsize=1 << 17)
def at_point(name: str, x: float) -> tuple[float, float]:
    """Return doubles around the value of the named function at the finite double x.

    >>> at_point("exp", 0.0)
    (1.0, 1.0)
    """
    with flint.ctx.workprec(BITS):
        return _around(_AT[name](flint.arb(x)))


def _around(value: flint.arb) -> tuple[float, float]:
    middle = float(value.mid()) if value.is_finite() else math.nan
    if math.isnan(middle):
        return -INF, INF
    if value.is_exact() and value == flint.arb(middle):
        return middle, middle
    below, above = math.nextafter(middle, -INF), math.nextafter(middle, INF)
    return (below if flint.arb(below) <= value else -INF), (above if value <= flint.arb(above) else INF)


@lru_cache(maxsize=1 << 16)
def number_around(value: Fraction) -> tuple[float, float]:
    """Return doubles around a rational number, equal if it is one."""
    with flint.ctx.workprec(BITS):
        return _around(flint.arb(flint.fmpq(value.numerator, value.denominator)))


def _at_points(name: str, x: Endpoints) -> Interval:
    """Return the enclosures at every entry of x; an infinite entry gives everything."""
    unique, back = np.unique(x, return_inverse=True)
    pairs = np.array([at_point(name, v) if math.isfinite(v) else (-INF, INF) for v in unique.tolist()])
    pairs = pairs.reshape(-1, 2)[back]
    return pairs[:, 0], pairs[:, 1]


def increasing(name: str, x: Interval) -> Interval:
    """Return the enclosure of an increasing function, cut to its domain."""
    first, last, bottom, top = _INCREASING[name]
    outside = (x[1] < first) | (x[0] > last)
    inner = np.clip(x[0], first, last), np.clip(x[1], first, last)
    below, _ = _at_points(name, inner[0])
    _, above = _at_points(name, inner[1])
    lower = np.where(inner[0] == first, bottom, np.maximum(below, bottom))
    upper = np.where(inner[1] == last, top, np.minimum(above, top))
    return intervals.sound(np.where(outside, -INF, lower), np.where(outside, INF, upper))


def acos(x: Interval) -> Interval:
    """Return acos(x), which decreases from pi to 0."""
    inner = np.clip(x[0], -1.0, 1.0), np.clip(x[1], -1.0, 1.0)
    return np.maximum(_at_points("acos", inner[1])[0], 0.0), np.minimum(
        _at_points("acos", inner[0])[1], PI_ABOVE
    )


def cosh(x: Interval) -> Interval:
    """Return cosh(x), which increases in |x|."""
    near, far = intervals.mignitude(x), intervals.magnitude(x)
    upper = np.where(np.isinf(far), INF, _at_points("cosh", far)[1])
    return intervals.sound(np.maximum(_at_points("cosh", near)[0], 1.0), upper)


def sech2(x: Interval) -> Interval:
    """Return 1/cosh(x)^2 in (0, 1], which decreases in |x|."""
    near, far = intervals.mignitude(x), intervals.magnitude(x)
    lower = np.where(np.isinf(far), 0.0, np.maximum(_at_points("sech2", far)[0], 0.0))
    return lower, np.minimum(_at_points("sech2", near)[1], 1.0)


def _quarters(x: Interval) -> tuple[Endpoints, Endpoints]:
    """Return x/(pi/2) widened by more than its error: 3 roundings and that of pi, each below 2^-53."""
    low, high = x[0] / (math.pi / 2), x[1] / (math.pi / 2)
    return low - (np.abs(low) + 1.0) * 2.0**-50, high + (np.abs(high) + 1.0) * 2.0**-50


def _has_quarter(x: Interval, residue: int) -> np.ndarray:
    """Return where x may hold (4 k + residue) pi/2 for some whole k."""
    low, high = _quarters(x)
    found = np.ceil((low - residue) / 4.0) <= np.floor((high - residue) / 4.0)
    unclear = ~(np.abs(low) <= 2.0**40) | ~(np.abs(high) <= 2.0**40)
    return np.asarray(found | unclear)


def _wave(name: str, x: Interval, top: int, bottom: int) -> Interval:
    left, right = _at_points(name, x[0]), _at_points(name, x[1])
    lower = np.where(_has_quarter(x, bottom), -1.0, np.minimum(left[0], right[0]))
    upper = np.where(_has_quarter(x, top), 1.0, np.maximum(left[1], right[1]))
    # A thin interval has no turning point inside it, only its own value.
    thin = (x[0] == x[1]) & np.isfinite(x[0])
    lower, upper = np.where(thin, left[0], lower), np.where(thin, left[1], upper)
    return np.maximum(lower, -1.0), np.minimum(upper, 1.0)


def sin(x: Interval) -> Interval:
    """Return sin(x)."""
    return _wave("sin", x, 1, 3)


def cos(x: Interval) -> Interval:
    """Return cos(x)."""
    return _wave("cos", x, 0, 2)


def tan_has_pole(x: Interval) -> np.ndarray:
    """Return where x may hold an odd multiple of pi/2."""
    return np.asarray(_has_quarter(x, 1) | _has_quarter(x, 3))


def tan(x: Interval) -> Interval:
    """Return tan(x); everything where x may hold a pole."""
    pole = tan_has_pole(x)
    lower, upper = _at_points("tan", x[0])[0], _at_points("tan", x[1])[1]
    return intervals.sound(np.where(pole, -INF, lower), np.where(pole, INF, upper))


def hypot(x: Interval, y: Interval) -> Interval:
    """Return sqrt(x^2 + y^2)."""
    return intervals.root(intervals.add(intervals.power(x, 2), intervals.power(y, 2)))


def direction(x: Interval, y: Interval) -> Interval:
    """Return x / sqrt(x^2 + y^2), increasing in x; its range [-1, 1] covers every slope at the origin."""
    near, far = intervals.mignitude(y), intervals.magnitude(y)
    lower = _direction_at(x[0], np.where(x[0] < 0, near, far))[0]
    upper = _direction_at(x[1], np.where(x[1] < 0, far, near))[1]
    return lower, upper


def _direction_at(x: Endpoints, y: Endpoints) -> Interval:
    value = intervals.multiply((x, x), intervals.inverse(hypot((x, x), (y, y))))
    sign = np.sign(x)
    exact = (y == 0) & (x != 0)
    low, high = np.maximum(value[0], np.minimum(sign, 0.0)), np.minimum(value[1], np.maximum(sign, 0.0))
    unclear = ~np.isfinite(x) | ~np.isfinite(y)
    low, high = np.where(unclear, np.minimum(sign, 0.0), low), np.where(unclear, np.maximum(sign, 0.0), high)
    return np.where(exact, sign, low), np.where(exact, sign, high)


def real_power(x: Interval, exponent: Fraction) -> Interval:
    """Return x^exponent for x > 0 (x >= 0 where the exponent is positive)."""
    inner = np.maximum(x[0], 0.0), np.maximum(x[1], 0.0)
    first, last = (0, 1) if exponent > 0 else (1, 0)
    at = [_power_at(inner[0], exponent), _power_at(inner[1], exponent)]
    outside = x[1] < 0
    lower, upper = np.maximum(at[first][0], 0.0), at[last][1]
    return intervals.sound(np.where(outside, -INF, lower), np.where(outside, INF, upper))


def _power_at(x: Endpoints, exponent: Fraction) -> Interval:
    pairs = np.array([_power_at_point(v, exponent) for v in x.tolist()]).reshape(-1, 2)
    return pairs[:, 0], pairs[:, 1]


@lru_cache(maxsize=1 << 16)
def _power_at_point(x: float, exponent: Fraction) -> tuple[float, float]:
    if x in (0.0, INF):
        return (0.0, 0.0) if (x == 0.0) == (exponent > 0) else (INF, INF)
    with flint.ctx.workprec(BITS):
        ratio = flint.fmpq(exponent.numerator, exponent.denominator)
        return _around((flint.arb(ratio) * flint.arb(x).log()).exp())


def atan2(y: Interval, x: Interval) -> Interval:
    """Return the angle of (x, y) on a box apart from the cut x <= 0, y = 0; [-pi, pi] elsewhere."""
    half = np.full_like(x[0], PI_BELOW / 2), np.full_like(x[0], PI_ABOVE / 2)
    flat = increasing("atan", intervals.multiply(y, intervals.inverse(x)))
    steep = increasing("atan", intervals.multiply(x, intervals.inverse(y)))
    above, below = intervals.subtract(half, steep), intervals.subtract(intervals.negative(half), steep)
    cases = [x[0] > 0, y[0] > 0, y[1] < 0]
    lower = np.select(cases, [flat[0], above[0], below[0]], -PI_ABOVE)
    upper = np.select(cases, [flat[1], above[1], below[1]], PI_ABOVE)
    return lower, upper
