"""From which disagreements no input ever meets its limit: the samples decide, since u is held between them.

With a witness of `inequality`, V(xi(0)) <= V_0 and exact messages, mu and nu are what underflow adds, and at every
sampling instant

    V <= V_0 + e,         e = (kappa |nu|^2 + kappa_mu |mu|^2) / (1 - decay),
    |u_l| <= g_l sqrt(V) + e_l,     g_l = sqrt(k_l P^-1 k_l') + sum_j delta_j sqrt(tr Y_j P^-1 Y_j'),
                                    e_l = |mu_i| + (|n_l| + delta_D) |nu_i|,

k_l and n_l being the rows of u_l in xi and in nu, i its agent, and the sum running over the coefficient errors (rounding)
of C and D of that agent. With controllers at rest V_0 = x_d' P_dd x_d, and so

    (c / r^2) (T T')^-1 (x) I - P_dd > 0,     c = min_l ((u_max,l - e_l) / g_l)^2 - e,

proves that |(T'(T T')^-1 T (x) I) x(0)| <= r keeps every u_l within u_max,l for ever.
"""

import math
from typing import Annotated

import numpy as np
from flint import arb

from lockstep.check.numbers import exactly
from lockstep.check.sampled import balls
from lockstep.check.sampled.certify import ROUNDED_UP, lifted_agent, proves
from lockstep.check.sampled.conjugate import no_conjugate_point
from lockstep.check.sampled.controller import HeldController
from lockstep.check.sampled.inequality import Witness, metric
from lockstep.check.sampled.loop import SampledLoop


def proves_radius(
    exact_loop: SampledLoop,
    controllers: tuple[HeldController, ...],
    witness: Witness,
    limits: Annotated[np.ndarray, " m"],
    radius: float,
) -> bool:
    """Decide in balls whether a witness proves that no |u_l| exceeds limits[l] from disagreements up to a radius.

    Args:
        exact_loop: assembled from the controllers.
        controllers: as in the code.
        witness: of the sampled loop.
        limits: (m,) of each agent's inputs; infinite where there is none.
        radius: in the metric of the disagreement, above 0.
    """
    network = exact_loop.network
    with balls.working_precision():
        if not no_conjugate_point(network.plant.A, *network.squares, network.period):
            return False
        if not (0 < radius < math.inf and proves(exact_loop, lifted_agent(exact_loop), witness)):
            return False
        level = _level(exact_loop, controllers, witness, limits)
        place = slice(0, exact_loop.n_d)
        P = exactly(witness.P)[place, place]
        return bool(level > 0) and balls.is_positive_definite(
            level / arb(radius) ** 2 * metric(exact_loop) - P
        )


def _level(
    loop: SampledLoop,
    controllers: tuple[HeldController, ...],
    witness: Witness,
    limits: Annotated[np.ndarray, " m"],
) -> arb:
    """Return c."""
    inverse, m = balls.inverse(exactly(witness.P)), len(limits)
    lost = [(arb(ROUNDED_UP * one.message_noise(0.0)), arb(one.underflow)) for one in controllers]
    added = sum((arb(witness.kappa) * nu * nu + arb(witness.kappa_mu) * mu * mu for nu, mu in lost), arb(0))
    least = arb("inf")
    for i, (nu, mu) in enumerate(lost):
        errors, delta_D = arb(0), arb(controllers[i].deltas["D"])
        for way in loop.ways:
            if way.agent == i and way.letter in "CD":
                Y = way.Y[:, : loop.n_xi]
                errors += arb(way.delta) * np.trace(balls.product(Y, inverse, Y.T)).sqrt()
        for l in np.flatnonzero(np.isfinite(limits)):
            row = loop.computed[i * m + l : i * m + l + 1, : loop.n_xi]
            reach = balls.product(row, inverse, row.T)[0, 0].sqrt() + errors
            seen = loop.computed[i * m + l : i * m + l + 1, loop.messages]
            direct = balls.product(seen, seen.T)[0, 0].sqrt() + delta_D
            room = arb(float(limits[l])) - mu - direct * nu
            if not (room > 0 and reach > 0):
                return arb(-1)
            least = least.min((room / reach) ** 2)
    return least - added / (1 - arb(witness.decay))
