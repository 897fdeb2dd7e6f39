"""Integrals of recorded signals: of those held between the instants exactly, of smooth ones by trapezoids."""

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
