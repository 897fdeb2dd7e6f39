"""Whether inputs stay within their limits in the run of a file: what static gains are chosen by, and no claim."""

import math

import numpy as np
from scipy.linalg import expm

from lockstep.check.system.loop import Gains
from lockstep.model.checks.plausibility import initial_deviations
from lockstep.model.network import Network
from lockstep.model.problem import Problem

PARTS, INSTANTS = 0.1, 20_000
"""Of the fastest mode's time constant between the instants at which inputs are held against their limits; the most of them:
a run of stiff agents is looked at in its beginning, where inputs are largest as a rule."""

MOST_STATES = 500
"""Of all agents together: of more of them it is not asked, the run would take minutes."""


def within_limits(problem: Problem, network: Network, gains: Gains) -> bool:
    """Whether no input meets its limit from the file's initial states: computed, of the linear part, in continuous time.

    (15) without phi and disturbances, x_cl(0) = ((T (x) I) x(0), 0), u_i = [C_Ci D_Ci] Y_i x_cl.
    """
    away = initial_deviations(problem)
    if away is None or away.size > MOST_STATES or not problem.has_limits:
        return False
    loop, K = network.loop(gains.order), gains.blocks
    to_u = np.stack([(block @ Y)[gains.order :] for block, Y in zip(K, loop.Y, strict=True)])
    x = np.pad((loop.d.T @ away).ravel(), (0, loop.n_x - loop.E.shape[1]))
    A_cl, horizon = loop.A_cl(K), problem.simulation.horizon
    h = PARTS / max(float(np.abs(np.linalg.eigvals(A_cl)).max(initial=0.0)), PARTS / horizon)
    step = expm(A_cl * h)
    for _ in range(min(math.ceil(horizon / h), INSTANTS)):
        if not (np.abs(to_u @ x) <= problem.limits).all():
            return False
        x = step @ x
    return True
