"""A run whose states left every range in which they mean something: said with time, agent and state."""

import numpy as np
from jaxtyping import Float

from lockstep.check.bound.box import Box
from lockstep.check.errors import ClaimError
from lockstep.model.agents.agent import Agent
from lockstep.model.agents.state_sizes import state_sizes

BEYOND = 1e9
"""A state past this counts as gone, where all states are of one size; infinite ones and NaN do so too."""


class Diverged(ClaimError):
    """The loop diverged; the figures have `time` in s, `agent` counted from 1, and `state` by name."""


def beyond(agent: Agent) -> float:
    """Return what no state is past that is still there: `BEYOND` for the smallest, in a pressure's Pa as much more as Pa are
    less than m."""
    sizes = state_sizes(agent)
    return float(BEYOND * sizes.max() / sizes.min())


def check_bounded(
    t: Float[np.ndarray, " K"], x: Float[np.ndarray, "K N n"], agent: Agent, last: int | None = None
) -> None:
    """Refuse a record in which a state is not finite or `beyond` all that it means.

    Args:
        t, x: the record;  agent: whose states they are.
        last: how many instants at its end are new; by default all.

    Raises:
        Diverged: at the first instant and of the first agent where one is.
    """
    with np.errstate(invalid="ignore"):
        gone = ~(np.abs(x if last is None else x[-last:]) <= beyond(agent))
    if not gone.any():
        return
    k, i, j = (int(index) for index in np.argwhere(gone)[0])
    k += len(t) - len(gone)
    left = left_domain(t[: k + 1], x[: k + 1], agent)
    raise Diverged(
        f"the loop diverges: {agent.states[j]} of {agent.name}{i + 1} is beyond {beyond(agent):.1g} at t = {t[k]:.6g} s"
        + (f"; {left}" if left else ""),
        time=float(t[k]),
        agent=i + 1,
        state=agent.states[j],
        left=left,
    )


def left_domain(
    t: Float[np.ndarray, " K"], x: Float[np.ndarray, "K N n"], agent: Agent, box: Box | None = None
) -> str:
    """Return which agent first left the domain of its bound, or another `box` of v, with what and when; empty if none did."""
    H, box = agent.lure.H, box or agent.argument_box
    with np.errstate(invalid="ignore"):
        v = x @ H.T
        outside = np.argwhere((v < np.asarray(box.lower)) | (v > np.asarray(box.upper)))
    if not len(outside):
        return ""
    k, i, l = (int(index) for index in outside[0])
    j = int(np.argmax(np.abs(H[l])))
    return f"{agent.name}{i + 1} left the domain: {agent.states[j]} = {x[k, i, j]:.4g} at {t[k]:.4g} s"
