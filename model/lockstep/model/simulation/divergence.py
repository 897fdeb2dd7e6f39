"""A run whose states left every range in which they mean something: said with time, agent and state."""

import numpy as np
from jaxtyping import Float

from lockstep.check.errors import ClaimError
from lockstep.model.agents.agent import Agent

BEYOND = 1e20
"""A state past this counts as gone, and so do infinite ones and NaN: a pressure in Pa is past 1e9 with nothing wrong."""


class Diverged(ClaimError):
    """The loop diverged; the figures have `time` in s, `agent` counted from 1, and `state` by name."""


def check_bounded(
    t: Float[np.ndarray, " K"], x: Float[np.ndarray, "K N n"], agent: Agent, last: int | None = None
) -> None:
    """Refuse a record in which a state is not finite or beyond `BEYOND`.

    Args:
        t, x: the record;  agent: whose states they are.
        last: how many instants at its end are new; by default all.

    Raises:
        Diverged: at the first instant and of the first agent where one is.
    """
    with np.errstate(invalid="ignore"):
        gone = ~(np.abs(x if last is None else x[-last:]) <= BEYOND)
    if not gone.any():
        return
    k, i, j = (int(index) for index in np.argwhere(gone)[0])
    k += len(t) - len(gone)
    left = left_domain(t[:k], x[:k], agent)
    raise Diverged(
        f"the loop diverges: {agent.states[j]} of {agent.name}{i + 1} is beyond {BEYOND:g} at t = {t[k]:.6g} s"
        + (f"; {left}" if left else ""),
        time=float(t[k]),
        agent=i + 1,
        state=agent.states[j],
    )


def left_domain(t: Float[np.ndarray, " K"], x: Float[np.ndarray, "K N n"], agent: Agent) -> str:
    """Return which agent first left the domain that its bound is proved on, with what and when; empty if none did."""
    H, box = agent.lure.H, agent.argument_box
    with np.errstate(invalid="ignore"):
        v = x @ H.T
        outside = np.argwhere(~((v >= np.asarray(box.lower)) & (v <= np.asarray(box.upper))))
    if not len(outside):
        return ""
    k, i, l = (int(index) for index in outside[0])
    j = int(np.argmax(np.abs(H[l])))
    return f"{agent.name}{i + 1} left the domain: {agent.states[j]} = {x[k, i, j]:.4g} at {t[k]:.4g} s"
