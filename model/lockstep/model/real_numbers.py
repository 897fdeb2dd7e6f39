"""Arrays of real numbers, from whatever a caller gives."""

from typing import Any

import numpy as np
from jaxtyping import Float

from lockstep.check.errors import ProblemError
from lockstep.check.wording import shorten


def reals(value: Any, name: str, where: str, *, single: bool = False) -> Float[np.ndarray, "*shape"]:
    """Return finite numbers as a new array of doubles, or a `single` one.

    Raises:
        ProblemError: what is no number, not finite, or complex: NumPy would drop the imaginary part.

    >>> reals([1, 1j], "B", "network")
    Traceback (most recent call last):
    lockstep.check.errors.ProblemError: network: `B` is [1, 1j]; expected finite numbers, none of them complex
    """
    try:
        found = np.array(value)
        if not np.iscomplexobj(found) and not (single and found.ndim):
            numbers = found.astype(float)
            if np.isfinite(numbers).all():
                return numbers
    except (TypeError, ValueError):
        pass
    raise ProblemError(
        f"`{name}` is {shorten(repr(value))}", where=where, expected="finite numbers, none of them complex"
    )
