"""rho of the sampled loop: the gain from the disturbances to what the design weighs, between the samples too.

    int_0^inf x_d' (S (x) R) x_d dt + T_s sum_k x_C(t_k)' (I (x) Q) x_C(t_k)
        <= V(x_cl(0)) + rho^2 int_0^inf xi_d' (S (x) I) xi_d dt + kappa sum_k (|zeta_k|^2 + |mu_k|^2),

the continuous rho's weights, the controllers' states being counted at the sampling instants and held for a period, as
the controllers hold them; where the claim has them, int u' (I (x) W) u dt on the left, u being held, xi scaled by state,
and on the right rho^2 T_s sum_k nu_d(t_k)' (S (x) I) nu_d(t_k) for the outputs' own noise nu, which the samples see. The
disturbance is one more way into the period that is lifted, and the weighted state one more way out:

    E E' = M^-1 (x) G G' + rho^-2 S^-1 (x) D_xi^2,     C_z'C_z = M (x) alpha^2 H'H + S (x) R.

M and S do not commute, so all of x_d is lifted at once, and anew for each M and rho. A stored rho and its witness are decided
here; looking for small ones is not done here.
"""

import numpy as np

from lockstep.check.continuous.inequality import Performance
from lockstep.check.numbers import Matrix, converter, eye, is_exact, zeros
from lockstep.check.sampled import balls
from lockstep.check.sampled.certificate import admitted_multiplier
from lockstep.check.sampled.conjugate_points import lifted_if_regular
from lockstep.check.sampled.inequality import Omega_matrix, Witness
from lockstep.check.sampled.loop import SampledLoop


def proves_rho(exact_loop: SampledLoop, weights: Performance, rho: float, witness: Witness) -> bool:
    """Decide in balls whether a witness (decay 1, no weight) proves a rho.

    P > 0, m >= 0, t >= 0, M > 0 and Omega > 0, and the period holds no conjugate point.
    """
    if not (witness.decay == 1 and witness.weight == 0 and rho > 0):
        return False
    with balls.working_precision():
        return dissipates(exact_loop, weights, witness, rho)


def dissipates(exact_loop: SampledLoop, weights: Performance, witness: Witness, rho: float) -> bool:
    """Decide, within the working precision, all of that but what the witness's decay and weight are to be."""
    M, network = admitted_multiplier(exact_loop, witness), exact_loop.network
    if M is None:
        return False
    A, B = (np.kron(eye(network.d.N - 1, M), one) for one in (network.plant.A, exact_loop.into))
    one = lifted_if_regular(A, B, *ways(exact_loop, weights, M, rho), network.period)
    running = running_cost(exact_loop, weights, rho)
    return one is not None and balls.is_positive_definite(Omega_matrix(exact_loop, one, witness, running))


def running_cost(loop: SampledLoop, weights: Performance, rho: float) -> Matrix:
    """Return T_s (x_C' (I (x) Q) x_C + u' (I (x) W) u - rho^2 nu_d' (S (x) I) nu_d) as a form on z."""
    number, d = converter(is_exact(loop.held)), loop.network.d
    T_s, square = number(np.array([loop.network.period, rho]))
    form, n_C = zeros(loop.n_z, loop.n_z, loop.held), len(weights.Q)
    for i in range(len(loop.seen)):
        place = slice(loop.n_d + i * n_C, loop.n_d + (i + 1) * n_C)
        form[place, place] = T_s * number(weights.Q)
    if len(weights.W):
        W = np.kron(eye(len(loop.seen), loop.held), number(weights.W))
        form = form + T_s * (loop.applied.T @ W @ loop.applied)
    noisy = (loop.outputs.stop - loop.outputs.start) // (d.N - 1)
    form[loop.outputs, loop.outputs] = -(T_s * square * square) * np.kron(d.S, eye(noisy, loop.held))
    return form


def ways(loop: SampledLoop, weights: Performance, M: Matrix, rho: float) -> tuple[Matrix, Matrix]:
    """Return E E' and C_z'C_z, for a multiplier and a rho."""
    number, S = converter(is_exact(loop.held)), loop.network.d.S
    square = number(np.array([[rho]]))[0, 0] ** 2
    GG, HH = loop.network.squares
    scale = number(np.diag(weights.states)) if len(weights.states) else eye(len(GG), M)
    EE = np.kron(balls.inverse(M), GG) + np.kron(balls.inverse(S), scale * scale) / square
    return EE, np.kron(M, HH) + np.kron(S, number(weights.R))
