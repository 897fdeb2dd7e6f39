"""From which disagreements the loop with clipped inputs converges and never leaves a set: the generalised sector.

What is applied is u - q(u), u being what the controllers compute and q the part that is clipped off. Wherever

    |u_l - h_l x_cl| <= u_max,l,        it holds that        q_l (q_l - h_l x_cl) <= 0,

since u_l > u_max,l gives 0 < q_l = u_l - u_max,l <= h_l x_cl, and below likewise (Tarbouriech, Garcia, Gomes da Silva and
Queinnec 2011, lemma 1.6). One more column for each q_l and tau_l >= 0 make of the inequality of `inequality`

    V(x_cl+) <= decay V(x_cl) + kappa |zeta|^2 + kappa_mu |mu|^2 + 2 sum_l tau_l q_l (q_l - h_l x_cl),

the loop having u - q in the place of u. With exact messages the sectors hold where

    V <= c + (kappa |zeta|^2 + kappa_mu |mu|^2) / (1 - decay),

c being `input_limits.level` of the rows k_l - h_l, and there the sum is not positive. From V(x_cl(0)) <= c on they hold for
ever, by induction from sample to sample, and V decays to what underflow adds. With h = 0 nothing is ever clipped.
"""

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from lockstep.check.numbers import Matrix, converter, exactly, is_exact, zeros
from lockstep.check.sampled import balls
from lockstep.check.sampled.certificate import admitted_multiplier, lifted_agent
from lockstep.check.sampled.inequality import Omega_matrix, Witness
from lockstep.check.sampled.inputs.input_limits import Radius, level, reaches
from lockstep.check.sampled.lifting import copies
from lockstep.check.sampled.loop import SampledLoop, inputs_of


@dataclass(frozen=True, eq=False)
class ClippedWitness:
    """A witness of the clipped loop: storage;  tau (N m,) >= 0;  h (N m, n_x), whose rows are the h_l."""

    storage: Witness
    tau: Annotated[np.ndarray, " l"]
    h: Annotated[np.ndarray, "l n_x"]


def clipped(loop: SampledLoop) -> SampledLoop:
    """Return the loop with u - q in the place of u: a column for each q_l, after all others."""
    inputs, network = len(loop.computed), loop.network
    minus, held = zeros(inputs, inputs, loop.held), zeros(len(loop.held), inputs, loop.held)
    minus[:] = -np.eye(inputs, dtype=int)
    advanced = zeros(len(loop.advanced), inputs, loop.held)
    if network.delay:
        advanced[len(advanced) - inputs :] = minus
    else:
        held = held - inputs_of(network)[1]

    def wide(matrix: Matrix) -> Matrix:
        return np.hstack([matrix, zeros(len(matrix), inputs, matrix)])

    return replace(
        loop,
        held=np.hstack([loop.held, held]),
        advanced=np.hstack([loop.advanced, advanced]),
        ways=tuple(way._replace(Y=wide(way.Y)) for way in loop.ways),
        seen=tuple(wide(rows) for rows in loop.seen),
        applied=wide(loop.applied) if network.delay else np.hstack([loop.applied, minus]),
        computed=wide(loop.computed),
    )


def sector_cost(loop: SampledLoop, witness: ClippedWitness) -> Matrix:
    """Return 2 sum_l tau_l q_l (h_l x_cl - q_l) as a form on z of the clipped loop."""
    number, n, inputs = converter(is_exact(loop.held)), loop.n_x, len(witness.tau)
    form, last = zeros(loop.n_z, loop.n_z, loop.held), slice(loop.n_z - inputs, loop.n_z)
    tau = number(np.diag(witness.tau))
    form[last, last] = -2 * tau
    form[last, :n] = tau @ number(witness.h)
    form[:n, last] = form[last, :n].T
    return form


def proves_clipped_radius(
    exact_loop: SampledLoop, witness: ClippedWitness, limits: Annotated[np.ndarray, " m"], *radii: Radius
) -> bool:
    """Decide in balls whether the clipped loop converges from all disagreements in each of some sets, controllers at rest.

    Args:
        exact_loop: assembled from the controllers as in the code, without clipping.
        witness: of the clipped loop.
        limits: (m,) of each agent's inputs; infinite where there is none.
        radii: of each set.
    """
    storage, inputs = witness.storage, len(exact_loop.computed)
    if witness.tau.shape != (inputs,) or witness.h.shape != (inputs, exact_loop.n_x):
        return False
    if not ((witness.tau >= 0).all() and np.isfinite(witness.h).all()):
        return False
    if not 0 < storage.decay < 1:
        return False
    with balls.working_precision():
        M, one, loop = admitted_multiplier(exact_loop, storage), lifted_agent(exact_loop), clipped(exact_loop)
        if M is None or one is None:
            return False
        Omega = Omega_matrix(loop, copies(one, M), storage, sector_cost(loop, witness))
        if not balls.is_positive_definite(Omega):
            return False
        rows = exact_loop.computed[:, : exact_loop.n_x] - exactly(witness.h)
        return reaches(exact_loop, storage, level(exact_loop, storage, limits, rows), *radii)
