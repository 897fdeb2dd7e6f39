"""Integrals of recorded signals: of those held between the instants exactly, of smooth ones by trapezoids, or, where the
rates at both ends of each interval are known, of the cubic through them."""

from collections.abc import Callable
from typing import Literal

import numpy as np
from jaxtyping import Float

Hold = Literal["held", "smooth"]
"""Whether row k of a record is the value on [t_k, t_k+1), or the value of a smooth signal at t_k."""


def running_integral(
    values: Float[np.ndarray, "K *rest"], t: Float[np.ndarray, " K"], hold: Hold
) -> Float[np.ndarray, "K *rest"]:
    """Return the integral of a record from its start to each of its instants t.

    >>> running_integral(np.array([1.0, 3.0, 5.0]), np.array([0.0, 1.0, 2.0]), "smooth").tolist()
    [0.0, 2.0, 6.0]
    """
    means = values[:-1] if hold == "held" else (values[:-1] + values[1:]) / 2
    widths = np.diff(t).reshape(-1, *[1] * (values.ndim - 1))
    return np.concatenate([np.zeros_like(values[:1]), np.cumsum(means * widths, axis=0)])


def running_integral_of_cubics(
    function: Callable[[Float[np.ndarray, "K-1 *rest"]], Float[np.ndarray, " K-1"]],
    values: Float[np.ndarray, "K *rest"],
    rates: Float[np.ndarray, "2 K-1 *rest"],
    t: Float[np.ndarray, " K"],
) -> Float[np.ndarray, " K"]:
    """Return the integral of a function of a smooth signal from the start of its record to each of its instants.

    Between the instants the signal is the cubic that has its values and rates at both ends, which a signal of omega rad/s on
    instants h apart leaves by (omega h)^4 / 384 at most. The function is integrated at four points of Gauss and Legendre:
    exactly, if it is a square.

    Args:
        function: of the signal at one instant of each interval.
        values: at the instants.
        rates: just after the first instant of each interval, and just before its last one.
        t: the instants.
    """
    width = np.diff(t)
    h = width.reshape(-1, *[1] * (values.ndim - 1))
    step = values[1:] - values[:-1]
    mean = np.zeros(len(width))
    for point, weight in zip(*np.polynomial.legendre.leggauss(4), strict=True):
        s = (1 + point) / 2
        bent = (1 - s) * (h * rates[0] - step) - s * (h * rates[1] - step)
        mean += weight / 2 * function(values[:-1] + s * step + s * (1 - s) * bent)
    return np.concatenate([[0.0], np.cumsum(mean * width)])
