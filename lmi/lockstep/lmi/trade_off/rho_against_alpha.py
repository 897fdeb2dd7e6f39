"""The trade-off of a design: the least rho of its gains for each alpha, up to the largest alpha they carry.

The bounds of single slopes, where the design uses them, are scaled as alpha is.

    from lockstep.lmi.trade_off.rho_against_alpha import as_csv, curve
    print(as_csv(curve(read(Path("design.json")))))

The figures come from a solver (`reach`): they show a curve, and the design's own rho and alpha are what is proved.
"""

import math
from collections.abc import Sequence

import numpy as np

from lockstep.check.errors import demand
from lockstep.lmi.analysis.margins import largest_alpha, trade_off
from lockstep.lmi.document import Stored
from lockstep.lmi.processes.threads import one_thread
from lockstep.lmi.stored_bound import reproved_bound
from lockstep.model.assembly import network_of

MARGIN = 1e-3
"""How far below the largest alpha the curve ends: there rho grows without bound."""


def curve(stored: Stored, points: int = 12) -> list[tuple[float, float]]:
    """Return (alpha, least rho) of a design file's gains, from alpha = 0 to the largest they carry; infinite: none found.

    Args:
        stored: the design file, as `document.read` gives it.
        points: how many, evenly spaced in alpha.

    Raises:
        ProblemError: fewer than two points, or a linear agent, which has no alpha to vary.
    """
    demand(points >= 2, f"`points` is {points}", "the trade-off", "2 or more")
    problem = stored.problem
    agent = problem.agent()
    demand(not agent.lure.is_linear, "the agent is linear", "the trade-off", "an agent with a nonlinearity")
    with one_thread():
        network, claim = network_of(problem, reproved_bound(stored)), stored.claim
        loop, K = network.loop(problem.order), stored.gains.blocks
        most = largest_alpha(loop, K, claim) * (1 - MARGIN)
        return trade_off(loop, K, claim, [float(f"{alpha:.6g}") for alpha in np.linspace(0.0, most, points)])


def as_csv(points: Sequence[tuple[float, float]]) -> str:
    """Return the curve as CSV, rho left empty where it is infinite.

    >>> print(as_csv([(0.0, 1.5), (2.0, math.inf)]), end="")
    alpha,rho
    0,1.5
    2,
    """
    rows = [f"{alpha:.6g},{rho:.6g}" if math.isfinite(rho) else f"{alpha:.6g}," for alpha, rho in points]
    return "\n".join(["alpha,rho", *rows, ""])
