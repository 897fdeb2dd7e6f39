"""What a header says of formations and of agents behind a leader: whose differences agree, what a command to one costs."""

import math

import numpy as np

from lockstep.check.sampled.controller import PRECISIONS
from lockstep.lmi.analysis.decimals import above
from lockstep.lmi.document import Stored


def said_of_formation(stored: Stored) -> dict[str, str]:
    """Return what agrees where there are offsets: all that is proved of x is proved of x less them."""
    if stored.problem.offsets is None:
        return {}
    real = stored.problem.controller.real
    said = (
        "what agrees is each agent's x less its offset o: so are all distances above to be read, from the formation; outputs"
        f" are taken less C o, rounded to {real}, which errs by {PRECISIONS[real].u:.1e} of it: an error of a reading"
    )
    return {"formation": said}


def said_of_leader(stored: Stored) -> dict[str, str]:
    """Return what is proved of agents behind a leader that is given a command v of its own: it is its disturbance xi = B v.

    With the orthonormal T the disagreement of a disturbance of one agent is |xi_d|^2 = (1 - 1/N) |xi|^2; |B|, its rows in the
    scales of rho, is at most its Frobenius norm. Two digits, rounded up, cover the rounding of both.
    """
    problem, claims = stored.problem, stored.claims
    if problem.spectrum is not None or (problem.graph().in_degrees > 0).all():
        return {}
    leader, N = int(problem.graph().in_degrees.argmin()), problem.sizes.N
    said = f"a command v to {problem.agent().name}{leader + 1} alone, which leads, is its disturbance B v"
    rho = claims.sampled.rho if claims.sampled.certified else claims.rho
    B, scales = problem.agents_B()[leader], problem.performance.states
    counted = scales > 0 if len(scales) else np.ones(len(B), dtype=bool)
    if rho is not None and not B[~counted].any() and problem.design.coordinates == "orthonormal":
        scaled = B[counted] / scales[counted, None] if len(scales) else B
        gain = rho * math.sqrt(1 - 1 / N) * float(np.linalg.norm(scaled)) * (1 + 1e-9)
        said += f": from agreement |z| <= {two_digits(gain)} |v| in L2 is proved, with every message in time, z being what"
        said += " rho weighs"
    return {"leader": f"{said}; not proved: that followers come to agree with it while v lasts"}


def two_digits(value: float | None) -> str:
    """Round up to two digits, so that the last bits of a machine's arithmetic do not show.

    >>> two_digits(4177144.9)
    '4.2e+06'
    """
    return "an unclaimed number of" if value is None else above(value, 2)
