"""From which disagreements no input ever meets its limit: the samples decide, since u is held between them.

With a witness of `inequality`, V(x_cl(0)) <= V_0 and exact messages, mu and zeta are what underflow adds, and at every
sampling instant

    V <= V_0 + e,         e = (kappa |zeta|^2 + kappa_mu |mu|^2) / (1 - decay),
    |u_l| <= g_l sqrt(V) + e_l,     g_l = sqrt(k_l P^-1 k_l') + sum_j delta_j sqrt(tr Y_j P^-1 Y_j'),
                                    e_l = |mu_i| + (|z_l| + delta_D) |zeta_i|,

k_l and z_l being the rows of u_l in x_cl and in zeta, i its agent, and the sum running over the coefficient errors (rounding)
of C and D of that agent. With controllers at rest V_0 = x_d' P_d x_d, and so

    (c / r^2) (T T')^-1 (x) I - P_d > 0,     c = min_l ((u_max,l - e_l) / g_l)^2 - e,

proves that |(T'(T T')^-1 T (x) I) x(0)| <= r keeps every u_l within u_max,l for ever. States have units of their own: with
half-axes a in the place of r, and diag(a)^-2 in that of I / r^2, it is the ellipsoid

    sum_i sum_k ((x_ik(0) - mean_k) / a_k)^2 <= 1.

With a disturbance, and noise nu on the outputs where rho is a gain from it too, the inequality of `l2_gain` with rho = 1,
nothing weighed and decay < 1 gives from agreement, where V_0 = 0, for the energy

    e^2 = int xi_d' (S (x) I) xi_d dt + T_s sum_k nu_d(t_k)' (S (x) I) nu_d(t_k)

up to and with the sample at which u is computed

    V + T_s nu_d' (S (x) I) nu_d <= e^2 + (kappa |zeta|^2 + kappa_mu |mu|^2) / (1 - decay),

and e^2 < c, formed with the columns of nu_d besides those of x_cl, and P (+) T_s S (x) I in place of P, proves that none
meets its limit.
"""

import math
from collections.abc import Callable, Sequence
from typing import Annotated

import numpy as np
from flint import arb

from lockstep.check.continuous.inequality import Performance
from lockstep.check.numbers import Matrix, block_diagonal, exact, exactly, eye
from lockstep.check.sampled import balls
from lockstep.check.sampled.certificate import ROUNDED_UP, lifted_agent, proves
from lockstep.check.sampled.inequality import Witness, metric
from lockstep.check.sampled.l2_gain import dissipates
from lockstep.check.sampled.loop import SampledLoop

Radius = float | Sequence[float]
"""Of a set of disagreements: r, in the metric of the disagreement, or the half-axes a, in the unit of each state."""


def proves_radius(
    exact_loop: SampledLoop, witness: Witness, limits: Annotated[np.ndarray, " m"], *radii: Radius
) -> bool:
    """Decide in balls whether a witness proves that no |u_l| exceeds limits[l] from disagreements in each of some sets.

    Args:
        exact_loop: assembled from the controllers as in the code.
        witness: of the sampled loop.
        limits: (m,) of each agent's inputs; infinite where there is none.
        radii: of each set.
    """
    rows = exact_loop.computed[:, seen_columns(exact_loop)]
    return proves_reach(exact_loop, witness, lambda: level(exact_loop, witness, limits, rows), *radii)


def proves_reach(loop: SampledLoop, witness: Witness, level: Callable[[], arb], *radii: Radius) -> bool:
    """Decide in balls a witness of the sampled loop, and that all disagreements in each set have V <= level()."""
    with balls.working_precision():
        return proves(loop, lifted_agent(loop), witness) and reaches(loop, witness, level(), *radii)


def proves_gain(
    exact_loop: SampledLoop,
    witness: Witness,
    limits: Annotated[np.ndarray, " m"],
    weights: Performance,
    gain: float,
) -> bool:
    """Decide in balls whether no |u_l| exceeds limits[l] under a disturbance of energy gain^2, from agreement.

    Args:
        exact_loop: assembled from the controllers as in the code, with the noise of `weights`.
        witness: of the sampled loop with the disturbance, rho being 1.
        limits: (m,) of each agent's inputs; infinite where there is none.
        weights: whose scales of disturbance and noise are meant; what they weigh does not count.
        gain: the root of the energy, above 0.
    """
    quiet = weights._replace(R=0 * weights.R, Q=0 * weights.Q, W=weights.W[:0, :0])
    if not (0 < gain < math.inf and 0 < witness.decay < 1):
        return False
    with balls.working_precision():
        if not dissipates(exact_loop, quiet, witness, 1.0):
            return False
        rows = exact_loop.computed[:, seen_columns(exact_loop)]
        return bool(level(exact_loop, witness, limits, rows) > arb(gain) ** 2)


def seen_columns(loop: SampledLoop) -> list[int]:
    """Return the columns of x_cl and of nu_d."""
    return [*range(loop.n_x), *range(loop.outputs.start, loop.outputs.stop)]


def reaches(loop: SampledLoop, witness: Witness, c: arb, *radii: Radius) -> bool:
    """Decide whether all disagreements in each set, controllers at rest, have V <= c; False too of what is no set."""
    place, n = slice(0, loop.n_d), len(loop.network.plant.A)
    P, sets = exactly(witness.P)[place, place], [np.array(one, dtype=float) for one in radii]
    if not (c > 0 and all(a.shape in ((), (n,)) and (a > 0).all() and np.isfinite(a).all() for a in sets)):
        return False
    alike = [np.array([arb(x) for x in np.resize(a, loop.n_d)]) for a in sets]
    return all(balls.is_positive_definite(c * metric(loop) / np.outer(a, a) - P) for a in alike)


def level(loop: SampledLoop, witness: Witness, limits: Annotated[np.ndarray, " m"], rows: Matrix) -> arb:
    """Return c: from V <= c on, no |k_l x_cl + e_l| exceeds limits[l], e_l being the errors of u_l; (N m, n_x) rows k_l.

    Where the loop has noise nu_d, k_l acts on it too, and V counts T_s nu_d' (S (x) I) nu_d besides.
    """
    columns, m = seen_columns(loop), len(limits)
    unit, d = eye((len(columns) - loop.n_x) // (loop.network.d.N - 1), loop.held), loop.network.d
    form = block_diagonal(exactly(witness.P), exact(loop.network.period) * np.kron(d.S, unit))
    inverse = balls.inverse(form)
    lost = [(arb(ROUNDED_UP * one.message_noise(0.0)), arb(one.underflow)) for one in loop.controllers]
    kappa, kappa_mu = arb(witness.kappa), arb(witness.kappa_mu)
    added = sum((kappa * zeta * zeta + kappa_mu * mu * mu for zeta, mu in lost), arb(0))
    least = arb("inf")
    for i, (zeta, mu) in enumerate(lost):
        errors, delta_D = arb(0), arb(loop.controllers[i].deltas["D"])
        for way in loop.ways:
            if way.agent == i and way.letter in "CD":
                Y = way.Y[:, columns]
                errors += arb(way.delta) * np.trace(balls.product(Y, inverse, Y.T)).sqrt()
        for l in np.flatnonzero(np.isfinite(limits)):
            row = rows[i * m + l : i * m + l + 1]
            reach = balls.product(row, inverse, row.T)[0, 0].sqrt() + errors
            seen = loop.computed[i * m + l : i * m + l + 1, loop.messages]
            direct = balls.product(seen, seen.T)[0, 0].sqrt() + delta_D
            room = arb(float(limits[l])) - mu - direct * zeta
            # A leader has no incoming edges, and its u is 0.
            if not (room > 0 and (reach > 0 or reach.is_zero())):
                return arb(-1)
            least = least.min((room / reach) ** 2) if reach > 0 else least
    return least - added / (1 - arb(witness.decay))
