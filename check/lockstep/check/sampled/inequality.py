"""The dissipation inequality of the sampled loop: what is claimed, what witnesses it, and the matrix that decides it.

With the matrices of `loop` on z = (x_cl, e) and one lifted period (A_d, B_d B_d', C_d'C_d) of `lifting` for the multiplier M,

    x_cl+ = A_z z + E w_d,    A_z = [A_d start; advanced],   E = [I; 0],

    Omega = [ Pi_z - start' C_d'C_d start    A_z' P                 ]
            [ P A_z                          P - P E B_d B_d' E' P  ] > 0,
    Pi_z = diag(decay P - weight diag((T T')^-1 (x) I, 0), t_j I, kappa I, kappa_mu I) - sum_j t_j delta_j^2 Y_j' Y_j,

P > 0, m >= 0, t >= 0 prove, for V = x_cl' P x_cl, every nonlinearity with incremental bound alpha and every Delta_j,

    V(x_cl+) < decay V(x_cl) - weight x_d' ((T T')^-1 (x) I) x_d + kappa |zeta|^2 + kappa_mu |mu|^2

from one sampling instant to the next, whenever z != 0; x_d' ((T T')^-1 (x) I) x_d is the squared distance from consensus.

Proof: by Schur's complement Omega > 0 is  max over w_d of V(A_z z + E w_d) - w_d' (B_d B_d')^-1 w_d + a' C_d'C_d a < z'
Pi_z z, and by lifting the left side is no less than V(x_cl+) + int (sum_ij m_ij (alpha^2 |H (x_i - x_j)|^2 - |phi_i -
phi_j|^2)) dt, whose integrand alpha makes nonnegative. Everything but B_d B_d', of M^-1, is linear in (P, m, t, kappa), and
congruence makes that so too.

With performance, the lifted period also counts int x_d' (S (x) R) x_d, and a disturbance with rho^2; see `l2_gain`.
"""

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from lockstep.check.numbers import Matrix, Vector, converter, is_exact, zeros
from lockstep.check.sampled.balls import product
from lockstep.check.sampled.lifting import Lifted
from lockstep.check.sampled.loop import SampledLoop
from lockstep.check.system.disagreement import Disagreement

NUMBERS = ("decay", "kappa", "weight", "ratio", "kappa_mu")


@dataclass(frozen=True, eq=False)
class Witness:
    """P (n_x, n_x), m >= 0 for each pair of agents, t >= 0 for each way, and the numbers of the claim.

    kappa: what |zeta|^2, the messages' errors, counts;  kappa_mu: what |mu|^2 does, that of underflow;  ratio: c with
    x_d' ((T T')^-1 (x) I) x_d <= c V, which turns what is known of V into a distance from consensus.
    """

    P: Annotated[np.ndarray, "n_x n_x"]
    m: Annotated[np.ndarray, " pairs"]
    t: Annotated[np.ndarray, " ways"]
    decay: float
    kappa: float
    weight: float = 0.0
    ratio: float = math.inf
    kappa_mu: float = math.inf

    @property
    def rms(self) -> float:
        """The gain from zeta to the distance from consensus, both as root mean squares over all instants."""
        return root(self.kappa / self.weight) if self.weight > 0 else math.inf

    @property
    def ultimate(self) -> float:
        """The ultimate distance from consensus per length of zeta: sqrt(c kappa / (1 - decay))."""
        return root(self.ratio * self.kappa / (1 - self.decay)) if self.decay < 1 else math.inf

    @property
    def ultimate_mu(self) -> float:
        """The same per length of mu."""
        return root(self.ratio * self.kappa_mu / (1 - self.decay)) if self.decay < 1 else math.inf

    def fits(self, loop: SampledLoop) -> bool:
        """Tell whether the sizes are those of a loop."""
        sizes = len(self.P), len(self.m), len(self.t)
        return sizes == (loop.n_x, len(loop.network.d.pairs()), len(loop.ways))


def root(square: float) -> float:
    """Return the square root; infinite where doubles next to 0 may have lost digits, or all, on the way to the square.

    >>> root(4.0), root(1e-170 * 1e-170)
    (2.0, inf)
    """
    return math.sqrt(square) if square > 1e-280 else math.inf


def multiplier(d: Disagreement, m: Vector) -> Matrix:
    """Return M = sum_ij m_ij M_ij."""
    total = zeros(d.N - 1, d.N - 1, d.T)
    for weight, (i, j) in zip(m, d.pairs(), strict=True):
        total = total + weight * d.pair_multiplier(i, j)
    return total


def metric(loop: SampledLoop) -> Matrix:
    """Return (T T')^-1 (x) I, as of `Disagreement.squared_distance`."""
    return loop.network.d.squared_distance(len(loop.network.plant.A))


def step_matrix(loop: SampledLoop, lifted: Lifted) -> Matrix:
    """Return A_z, with x_cl+ = A_z z + E w_d."""
    return np.vstack([product(lifted.A_d, loop.start), loop.advanced])


def stored_matrix(loop: SampledLoop, witness: Witness, running: Matrix | None = None) -> Matrix:
    """Return Pi_z; `running` is a cost of z at each sampling instant, if there is one."""
    number = converter(is_exact(loop.held))
    P, t = number(witness.P), number(witness.t)
    decay, weight, kappa, kappa_mu = number(
        np.array([witness.decay, witness.weight, witness.kappa, witness.kappa_mu])
    )
    Pi = zeros(loop.n_z, loop.n_z, loop.held)
    Pi[: loop.n_x, : loop.n_x] = decay * P
    Pi[: loop.n_d, : loop.n_d] = Pi[: loop.n_d, : loop.n_d] - weight * metric(loop)
    places = [loop.messages, loop.underflows, *(way.place for way in loop.ways)]
    for place, cost in zip(places, [kappa, kappa_mu, *t], strict=True):
        for k in range(place.start, place.stop):
            Pi[k, k] = Pi[k, k] + cost
    for cost, way in zip(t, loop.ways, strict=True):
        if way.delta:
            delta = number(np.array([way.delta]))[0]
            # Of balls, too, only zeros themselves are left out.
            seen = np.flatnonzero(~(way.Y == 0).all(axis=0))
            Pi[np.ix_(seen, seen)] -= cost * delta * delta * (way.Y[:, seen].T @ way.Y[:, seen])
    return Pi if running is None else Pi - running


def Omega_matrix(
    loop: SampledLoop, lifted: Lifted, witness: Witness, running: Matrix | None = None
) -> Matrix:
    """Assemble Omega, in doubles or in balls, as the loop and the lifted period are."""
    P = converter(is_exact(loop.held))(witness.P)
    start, A_z = loop.start, step_matrix(loop, lifted)
    n_z, n_d = loop.n_z, loop.n_d
    side = product(P, A_z)
    Omega = zeros(n_z + loop.n_x, n_z + loop.n_x, loop.held)
    Omega[:n_z, :n_z] = stored_matrix(loop, witness, running) - product(start.T, lifted.CC_d, start)
    Omega[n_z:, :n_z], Omega[:n_z, n_z:] = side, side.T
    Omega[n_z:, n_z:] = P - product(P[:, :n_d], lifted.BB_d, P[:n_d])
    return Omega
