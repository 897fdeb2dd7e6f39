"""How many times sets of starts hold the start that a problem names, and what is said of the limits of inputs."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from lockstep.check.continuous.initial_set import axes_text
from lockstep.check.design_file.claims import SampledClaims
from lockstep.lmi.analysis.decimals import round_down
from lockstep.model.checks.plausibility import initial_deviations
from lockstep.model.problem import Problem

Away = Float[np.ndarray, "N n"] | None
"""x_i(0) - mean of each agent, where a problem names a start."""


def times_covered(
    radius: float | None, half_axes: Sequence[float] | None, away: Away, most: float = math.inf
) -> float:
    """Return how many times a start lies in a ball or an ellipsoid, the larger, at most `most`; 0 without a start or a set.

    >>> times_covered(1.0, (4.0, 0.5), np.array([[2.0, 0.0], [-2.0, 0.0]])).__round__(3)
    1.414
    """
    if away is None or not away.any():
        return 0.0
    sizes = [np.full(away.shape[1], radius)] if radius else []
    sizes += [np.array(half_axes)] if half_axes else []
    return min(most, max((1 / math.hypot(*(away / a).ravel()) for a in sizes), default=0.0))


ROUNDED = 1e-12
"""Of a state: what agents are further apart than is no rounding of their mean."""


def times_in_domain(problem: Problem, away: Away) -> float:
    """Return how many times as far from agreement a start may be before an agent is out of the domain; 0 if one is."""
    if away is None:
        return math.inf
    box, starts = problem.agent().box, problem.initial_states()
    if ((starts < box[:, 0]) | (starts > box[:, 1])).any():
        return 0.0
    apart = abs(away) > ROUNDED * abs(starts).max(axis=0)
    room = np.where(away > 0, box[:, 1], box[:, 0]) - starts
    return float(1 + np.min(room[apart] / away[apart], initial=math.inf))


def limits_answer(claims: SampledClaims, problem: Problem, *, local: bool = False) -> dict[str, Any]:
    """Return what is claimed of limits, |x_d(0)| of the start in the file, and how many times that start is covered.

    Of a design on a domain (local) no start that is out of it is covered.
    """
    sets = {
        "": (claims.radius, claims.half_axes),
        "clipped_": (claims.clipped_radius, claims.clipped_half_axes),
    }
    found: dict[str, Any] = {"gain": claims.limits_gain}
    away, agent = initial_deviations(problem), problem.file.agent
    most = times_in_domain(problem, away) if local else math.inf
    for name, (radius, axes) in sets.items():
        found[f"{name}radius"] = radius
        if axes:
            found[f"{name}half_axes"] = dict(zip(agent.states, axes, strict=True))
            found[f"{name}text"] = axes_text(axes, agent.states, agent.units)
        times = times_covered(radius, axes, away, most)
        found[f"{name}times_start"] = round_down(times, 3) or None
        found[f"{name}beyond"] = "an agent is out of its domain" if times == most > 0 else None
    found = {key: one for key, one in found.items() if one is not None}
    if found and away is not None:
        found["start"] = math.hypot(*away.ravel())
    return found
