"""How many times sets of starts hold the start that a problem names, and what is said of the limits of inputs."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.linalg import expm

from lockstep.check.continuous.initial_set import axes_text
from lockstep.check.design_file.claims import SampledClaims
from lockstep.check.system.loop import Gains
from lockstep.lmi.analysis.decimals import round_down
from lockstep.model.checks.plausibility import initial_deviations
from lockstep.model.network import Network
from lockstep.model.problem import Problem

INSTANTS = 1000
"""Of the run in which inputs are held against their limits, beside its beginning, where they are largest as a rule."""

Away = Float[np.ndarray, "N n"] | None
"""x_i(0) - mean of each agent, where a problem names a start."""


def times_covered(radius: float | None, half_axes: Sequence[float] | None, away: Away) -> float:
    """Return how many times a start lies in a ball or in an ellipsoid, the larger; 0 without a start or a set.

    >>> times_covered(1.0, (4.0, 0.5), np.array([[2.0, 0.0], [-2.0, 0.0]])).__round__(3)
    1.414
    """
    if away is None or not away.any():
        return 0.0
    sizes = [np.full(away.shape[1], radius)] if radius else []
    sizes += [np.array(half_axes)] if half_axes else []
    return max((1 / math.hypot(*(away / a).ravel()) for a in sizes), default=0.0)


def limits_answer(claims: SampledClaims, problem: Problem) -> dict[str, Any]:
    """Return what is claimed of limits, |x_d(0)| of the start in the file, and how many times that start is covered."""
    sets = {
        "": (claims.radius, claims.half_axes),
        "clipped_": (claims.clipped_radius, claims.clipped_half_axes),
    }
    found: dict[str, Any] = {"gain": claims.limits_gain}
    away, agent = initial_deviations(problem), problem.file.agent
    for name, (radius, axes) in sets.items():
        found[f"{name}radius"] = radius
        if axes:
            found[f"{name}half_axes"] = dict(zip(agent.states, axes, strict=True))
            found[f"{name}text"] = axes_text(axes, agent.states, agent.units)
        found[f"{name}times_start"] = round_down(times_covered(radius, axes, away), 3) or None
    found = {key: one for key, one in found.items() if one is not None}
    if found and away is not None:
        found["start"] = math.hypot(*away.ravel())
    return found


def within_limits(problem: Problem, network: Network, gains: Gains) -> bool:
    """Whether no input meets its limit from the file's initial states: computed, of the linear part, in continuous time.

    (15) without phi and disturbances, x_cl(0) = ((T (x) I) x(0), 0), u_i = [C_Ci D_Ci] Y_i x_cl.
    """
    away = initial_deviations(problem)
    if away is None or not problem.has_limits:
        return False
    loop, K = network.loop(gains.order), gains.blocks
    to_u = np.stack([(block @ Y)[gains.order :] for block, Y in zip(K, loop.Y, strict=True)])
    x = np.pad((loop.d.T @ away).ravel(), (0, loop.n_x - loop.E.shape[1]))
    step = expm(loop.A_cl(K) * (problem.simulation.horizon / INSTANTS))
    for _ in range(INSTANTS):
        if (np.abs(to_u @ x) > problem.limits).any():
            return False
        x = step @ x
    return True
