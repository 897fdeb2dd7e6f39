"""Outward-rounded interval arithmetic on arrays of IEEE doubles.

An interval is a pair (lower, upper) of equal-shaped arrays; it encloses a set of real numbers, so an
endpoint may be infinite but lower < +inf and upper > -inf always, and no endpoint is NaN: what cannot be
said becomes (-inf, inf). IEEE 754 addition, multiplication, division and square root are correctly rounded,
hence one `nextafter` outwards encloses the exact result; an addition that is exact (Knuth's TwoSum has no
error term) is left as it is.
"""

from typing import Annotated, TypeAlias

import numpy as np

Endpoints: TypeAlias = Annotated[np.ndarray, " boxes"]
Mask: TypeAlias = Annotated[np.ndarray, " boxes"]
Interval: TypeAlias = tuple[Endpoints, Endpoints]

INF = float("inf")
LARGEST = float(np.finfo(np.float64).max)


def down(x: Endpoints) -> Endpoints:
    """Return the next double below."""
    return np.asarray(np.nextafter(x, -INF))


def up(x: Endpoints) -> Endpoints:
    """Return the next double above."""
    return np.asarray(np.nextafter(x, INF))


def sound(lower: Endpoints, upper: Endpoints) -> Interval:
    """Restore the invariants: NaN becomes everything, an endpoint infinite on the wrong side finite."""
    unknown = np.isnan(lower) | np.isnan(upper)
    lower = np.where(unknown, -INF, np.minimum(lower, LARGEST))
    upper = np.where(unknown, INF, np.maximum(upper, -LARGEST))
    return lower, upper


def everything(like: Endpoints) -> Interval:
    """Return (-inf, inf) in the shape of `like`."""
    return np.full_like(like, -INF), np.full_like(like, INF)


def _sum_and_error(a: Endpoints, b: Endpoints) -> tuple[Endpoints, Endpoints]:
    total = a + b
    virtual = total - a
    return total, (a - (total - virtual)) + (b - virtual)


def add(x: Interval, y: Interval) -> Interval:
    """Return x + y."""
    low, low_error = _sum_and_error(x[0], y[0])
    high, high_error = _sum_and_error(x[1], y[1])
    # A NaN error (an infinite endpoint) fails both comparisons and is rounded outwards.
    return sound(np.where(low_error >= 0, low, down(low)), np.where(high_error <= 0, high, up(high)))


def negative(x: Interval) -> Interval:
    """Return -x."""
    return -x[1], -x[0]


def subtract(x: Interval, y: Interval) -> Interval:
    """Return x - y."""
    return add(x, negative(y))


def _trivial(x: Interval) -> Mask:
    """Return where both endpoints are -1, 0 or 1: multiplying by them rounds nothing."""
    result: Mask = ((x[0] == 0) | (np.abs(x[0]) == 1)) & ((x[1] == 0) | (np.abs(x[1]) == 1))
    return result


def multiply(x: Interval, y: Interval) -> Interval:
    """Return x y, where 0 times an infinite endpoint is 0 (the endpoint stands for unbounded reals)."""
    corners = np.stack([x[0] * y[0], x[0] * y[1], x[1] * y[0], x[1] * y[1]])
    corners = np.where(np.isnan(corners), 0.0, corners)
    low, high = corners.min(axis=0), corners.max(axis=0)
    exact = _trivial(x) | _trivial(y)
    lower, upper = np.where(exact, low, down(low)), np.where(exact, high, up(high))
    same = ((x[0] >= 0) & (y[0] >= 0)) | ((x[1] <= 0) & (y[1] <= 0))
    opposite = ((x[0] >= 0) & (y[1] <= 0)) | ((x[1] <= 0) & (y[0] >= 0))
    return sound(
        np.where(same, np.maximum(lower, 0.0), lower), np.where(opposite, np.minimum(upper, 0.0), upper)
    )


def inverse(x: Interval) -> Interval:
    """Return 1/x; everything where x holds 0 inside, half a line where 0 is an endpoint."""
    low, high = 1.0 / x[1], 1.0 / x[0]
    exact_low, exact_high = np.abs(x[1]) == 1, np.abs(x[0]) == 1
    lower, upper = np.where(exact_low, low, down(low)), np.where(exact_high, high, up(high))
    above, below = x[0] >= 0, x[1] <= 0
    lower = np.where(above, np.maximum(lower, 0.0), np.where(x[1] == 0, -INF, lower))
    upper = np.where(below, np.minimum(upper, 0.0), np.where(x[0] == 0, INF, upper))
    unknown = ((x[0] < 0) & (x[1] > 0)) | ((x[0] == 0) & (x[1] == 0))
    return sound(np.where(unknown, -INF, lower), np.where(unknown, INF, upper))


def magnitude(x: Interval) -> Endpoints:
    """Return the largest |value|."""
    return np.maximum(np.abs(x[0]), np.abs(x[1]))


def mignitude(x: Interval) -> Endpoints:
    """Return the smallest |value|."""
    return np.maximum(np.maximum(x[0], -x[1]), 0.0) + 0.0


def absolute(x: Interval) -> Interval:
    """Return |x|."""
    return mignitude(x), magnitude(x)


def _rounded_power(x: Endpoints, exponent: int, *, upward: bool) -> Endpoints:
    """Return x^exponent of x >= 0, rounded one way, by repeated squaring."""
    result, base, remaining = np.ones_like(x), x, exponent
    while remaining:
        if remaining & 1:
            result = _rounded_product(result, base, upward)
        remaining >>= 1
        if remaining:
            base = _rounded_product(base, base, upward)
    return result


def _rounded_product(a: Endpoints, b: Endpoints, upward: bool) -> Endpoints:
    exact = (a == 0) | (a == 1) | (b == 0) | (b == 1)
    value = np.where((a == 0) | (b == 0), 0.0, a * b)
    return np.where(exact, value, up(value) if upward else np.maximum(np.minimum(down(value), LARGEST), 0.0))


def power(x: Interval, exponent: int) -> Interval:
    """Return x^exponent for a whole exponent."""
    if exponent < 0:
        return inverse(power(x, -exponent))
    if exponent == 1:
        return x
    if exponent % 2 == 0:
        near, far = mignitude(x), magnitude(x)
        low, high = _rounded_power(near, exponent, upward=False), _rounded_power(far, exponent, upward=True)
        return sound(low, high)
    return sound(_odd_power(x[0], exponent, upward=False), _odd_power(x[1], exponent, upward=True))


def _odd_power(x: Endpoints, exponent: int, *, upward: bool) -> Endpoints:
    size = np.abs(x)
    below = -_rounded_power(size, exponent, upward=not upward)
    return np.where(x >= 0, _rounded_power(size, exponent, upward=upward), below)


def root(x: Interval) -> Interval:
    """Return the square root of the part of x that is not negative; everything where there is none."""
    low, high = np.sqrt(np.maximum(x[0], 0.0)), np.sqrt(np.maximum(x[1], 0.0))
    lower = np.where((low == 0) | (low == 1), low, np.maximum(down(low), 0.0))
    upper = np.where((high == 0) | (high == 1), high, up(high))
    unknown = x[1] < 0
    return sound(np.where(unknown, -INF, lower), np.where(unknown, INF, upper))


def hull(x: Interval, y: Interval) -> Interval:
    """Return the smallest interval that holds both."""
    return np.minimum(x[0], y[0]), np.maximum(x[1], y[1])


def meet(x: Interval, y: Interval) -> Interval:
    """Return the intersection of two enclosures of the same set."""
    return np.maximum(x[0], y[0]), np.minimum(x[1], y[1])
