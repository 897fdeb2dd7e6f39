"""How large the states of an agent are beside each other: m beside Pa, of which no sum and no single bound says anything."""

from functools import lru_cache

import casadi as ca
import numpy as np
from jaxtyping import Float

from lockstep.model.agents.agent import Agent

WELL_WITHIN = 0.5
"""Of how far the sides of a domain are from its middle, or 0: random states have room to move."""

NEAR_SIDE = 0.05
"""Of the width of a domain, or of the spread: with 0 nearer to a side its middle has more room."""


@lru_cache(maxsize=64)  # a run asks at each of its steps
def state_sizes(agent: Agent) -> Float[np.ndarray, " n"]:
    """Return sizes of the states at which the slopes of an agent are alike, those that balance df/dx.

    Of a state that acts on no other it is what the fastest of the slopes makes of the states that act on it; of one that
    others do not act on, either, it is 1, as where slopes are not finite.

    >>> x, u = ca.SX.sym("x", 3), ca.SX.sym("u")
    >>> rhs = ca.vertcat(-x[0], -x[2] + u, 1e8 * x[1])
    >>> state_sizes(Agent(name="a", x=x, u=u, rhs=rhs, y=x[1])).tolist()
    [1.0, 1.0, 8192.0]
    """
    from scipy.linalg import matrix_balance

    J = ca.Function("J", [agent.x, agent.u, agent.t], [ca.jacobian(agent.rhs, agent.x)])
    slopes = np.asarray(J(middle(agent), np.zeros(agent.m), 0.0))
    sizes = np.ones(agent.n)
    if np.isfinite(slopes).all():
        sizes = matrix_balance(slopes)[1].sum(axis=1)  # diagonal, its columns permuted
        rates = np.abs(slopes * sizes / sizes[:, None])
        acting = rates - np.diag(np.diag(rates))
        for k in np.flatnonzero(~acting.any(axis=0) & acting.any(axis=1)):
            sizes[k] *= acting[k].max() / rates.max()
    sizes.flags.writeable = False
    return sizes


def random_range(agent: Agent, spread: float) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Return about which state random ones are drawn, and how far from it: `spread`, or half-way to the sides of the domain.

    About 0, but for a state whose domain has 0 outside or near a side: about its middle, or `spread` from its finite side.
    """
    low, high = agent.box.T
    with np.errstate(invalid="ignore"):
        inside = (low + high) / 2
    about_0 = np.minimum(-low, high) >= NEAR_SIDE * np.minimum(high - low, spread)
    beside = np.where(np.isfinite(low), low + spread, high - spread)
    about = np.where(about_0, 0.0, np.where(np.isfinite(inside), inside, beside))
    return about, np.minimum(spread, WELL_WITHIN * np.minimum(about - low, high - about))


def middle(agent: Agent) -> Float[np.ndarray, " n"]:
    """Return 0, or for a state whose domain does not hold it, the middle of its domain or its finite side."""
    low, high = agent.box[:, 0], agent.box[:, 1]
    with np.errstate(invalid="ignore"):
        side = np.where(np.isfinite(low), low, high)
        inside = np.where(np.isfinite(low) & np.isfinite(high), (low + high) / 2, side)
    return np.where((low <= 0) & (high >= 0), 0.0, inside)
