"""A run whose states left every range in which they mean something: said with time, agent and state."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from lockstep.check.errors import ClaimError

BEYOND = 1e9
"""A state past this, in its own unit, counts as gone; infinite and NaN do so too."""


class Diverged(ClaimError):
    """The loop diverged; the figures have `time` in s, `agent` counted from 1, and `state` by name."""


def check_bounded(
    t: Float[np.ndarray, " K"], x: Float[np.ndarray, "K N n"], names: Sequence[str], agent: str
) -> None:
    """Refuse a record in which a state is not finite or beyond `BEYOND`.

    Raises:
        Diverged: at the first instant and of the first agent where one is.
    """
    with np.errstate(invalid="ignore"):
        gone = ~(np.abs(x) <= BEYOND)
    if not gone.any():
        return
    k, i, j = (int(index) for index in np.argwhere(gone)[0])
    raise Diverged(
        f"the loop diverges: {names[j]} of {agent}{i + 1} is beyond {BEYOND:g} at t = {t[k]:.6g} s",
        time=float(t[k]),
        agent=i + 1,
        state=names[j],
    )
