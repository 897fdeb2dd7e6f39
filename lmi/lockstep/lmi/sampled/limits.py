"""The largest disagreement from which no input meets its limit is looked for here, in doubles, and put to the checker.

Without rounding it is the program of `convex` with P >= k_l' k_l / u_max,l^2 for every input and gamma (T T')^-1 (x) I >=
P_dd, gamma least: radius = gamma^-1/2.
"""

import numpy as np
from jaxtyping import Float

from lockstep.check.sampled.controller import HeldController, SampledNetwork
from lockstep.check.sampled.inequality import Witness, metric
from lockstep.check.sampled.lifting import Lifted
from lockstep.check.sampled.limits import proves_radius
from lockstep.check.sampled.loop import SampledLoop, sampled_loop
from lockstep.lmi.sampled.candidates import priced_anew
from lockstep.lmi.sampled.certify import in_doubles, period_in_doubles
from lockstep.lmi.sampled.convex import step_program
from lockstep.lmi.sampled.search import spectral_radius

RATES = (0.005, 0.02, 0.1)
"""How fast V is asked to decay, as parts of how fast the linear loop does."""

KEPT = (0.995, 0.97, 0.9)
"""Parts of the radius found that are claimed: rounding needs some room."""

CLAIMED = 0.5
"""The part of the decay that is claimed: the rest is room for rounding."""


def largest_radius(
    network: SampledNetwork, controllers: tuple[HeldController, ...], limits: Float[np.ndarray, " m"]
) -> tuple[float, Witness] | None:
    """Find and prove a large radius, in short decimals; None if none is proved.

    Args:
        network: agents, coordinates, alpha, period, delay, the matrices exact.
        controllers: one per agent, with the coefficients of the code.
        limits: (m,) of each agent's inputs.
    """
    loop, exact_loop = in_doubles(network, controllers), sampled_loop(network, controllers)
    one = period_in_doubles(loop)
    if one is None or not np.isfinite(limits).any():
        return None
    spread = 1 - spectral_radius(loop, one) ** 2
    found = [_least(loop, one, limits, 1 - rate * spread) for rate in RATES] if spread > 0 else []
    for gamma, witness in sorted((each for each in found if each is not None), key=lambda each: each[0]):
        for candidate in priced_anew(loop, one, witness, CLAIMED, exact_messages=True):
            for part in KEPT:
                radius = float(f"{part / gamma**0.5:.4g}")
                if proves_radius(exact_loop, controllers, candidate, limits, radius):
                    return radius, candidate
    return None


def _least(
    loop: SampledLoop, one: Lifted, limits: Float[np.ndarray, " m"], decay: float
) -> tuple[float, Witness] | None:
    """Return gamma and its witness without prices of the errors, or None."""
    import cvxpy as cp

    n_d = loop.n_d
    rows = np.array([row / limits[k % len(limits)] for k, row in enumerate(loop.computed[:, : loop.n_xi])])
    program = step_program(loop, one, decay, rows.T @ rows)
    if program is None:
        return None
    gamma, inverse = cp.Variable(), np.linalg.inv(program.basis)
    conditions = [gamma * np.asarray(metric(loop)) - program.P[:n_d, :n_d] >> 0]
    conditions += [program.V - np.outer(inner, inner) >> 0 for inner in rows @ inverse.T if inner.any()]
    return program.least(gamma, conditions)
