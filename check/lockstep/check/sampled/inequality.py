"""The dissipation inequality of the sampled loop: what is claimed, what witnesses it, and the matrix that decides it.

With the matrices of `loop` on z = (xi, e) and one lifted period (A_d, S, Q) of `lifting` for the multiplier M,

    xi+ = N z + J w_d,    N = [A_d start; advanced],   J = [I; 0],

    W = [ Z - start' Q start    N' P           ]      Z = diag(decay P - weight D, t_j I, kappa I, kappa_mu I)
        [ P N                   P - P J S J' P ] > 0,     - sum_j t_j delta_j^2 Y_j' Y_j,

P > 0, m >= 0, t >= 0 prove, for V = xi' P xi, every nonlinearity with incremental bound alpha and every Delta_j,

    V(xi+) < decay V(xi) - weight x_d' ((T T')^-1 (x) I) x_d + kappa |nu|^2 + kappa_mu |mu|^2

from one sampling instant to the next, whenever z != 0; D = diag((T T')^-1 (x) I, 0): x_d' D x_d is the squared
distance from consensus.

Proof: by Schur's complement W > 0 is  max over w_d of V(N z + J w_d) - w_d' S^-1 w_d + a' Q a < z' Z z, and by
lifting the left side is no less than V(xi+) + int (sum_ij m_ij (alpha^2 |H (x_i - x_j)|^2 - |phi_i - phi_j|^2))
dt, whose integrand alpha makes nonnegative. Everything but S = M^-1 (x) S_1 is linear in (P, m, t, kappa), and
congruence makes that so too.

With performance, the lifted period also counts int x_d' (S (x) R) x_d, and a disturbance with rho^2; see `l2_gain`.
"""

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from lockstep.check.numbers import Matrix, Vector, converter, inverse, is_exact, zeros
from lockstep.check.sampled.balls import product
from lockstep.check.sampled.lifting import Lifted
from lockstep.check.sampled.loop import SampledLoop
from lockstep.check.system.disagreement import Disagreement

NUMBERS = ("decay", "kappa", "weight", "ratio", "kappa_mu")


@dataclass(frozen=True, eq=False)
class Witness:
    """P (n_xi, n_xi), m >= 0 for each pair of agents, t >= 0 for each way, and the numbers of the claim.

    kappa: what |nu|^2, the messages' noise, counts;  kappa_mu: what |mu|^2 does, that of underflow;  ratio: c with
    x_d' ((T T')^-1 (x) I) x_d <= c V, which turns what is known of V into a distance from consensus.
    """

    P: Annotated[np.ndarray, "n_xi n_xi"]
    m: Annotated[np.ndarray, " pairs"]
    t: Annotated[np.ndarray, " ways"]
    decay: float
    kappa: float
    weight: float = 0.0
    ratio: float = math.inf
    kappa_mu: float = math.inf

    @property
    def rms(self) -> float:
        """The gain from nu to the distance from consensus, both as root mean squares over all instants."""
        return root(self.kappa / self.weight) if self.weight > 0 else math.inf

    @property
    def ultimate(self) -> float:
        """The ultimate distance from consensus per length of nu: sqrt(c kappa / (1 - decay))."""
        return root(self.ratio * self.kappa / (1 - self.decay)) if self.decay < 1 else math.inf

    @property
    def ultimate_mu(self) -> float:
        """The same per length of mu."""
        return root(self.ratio * self.kappa_mu / (1 - self.decay)) if self.decay < 1 else math.inf

    def fits(self, loop: SampledLoop) -> bool:
        """Tell whether the sizes are those of a loop."""
        sizes = len(self.P), len(self.m), len(self.t)
        return sizes == (loop.n_xi, len(loop.network.d.pairs()), len(loop.ways))


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
    """Return D = (T T')^-1 (x) I: x_d' D x_d is the squared distance of the states from consensus.

    In any coordinates: the S of `Disagreement`, in which rho is measured, is I in those of the paper.
    """
    unit = converter(is_exact(loop.held))(np.eye(loop.network.plant.A.shape[0]))
    T = loop.network.d.T
    return np.kron(inverse(T @ T.T), unit)


def step_matrix(loop: SampledLoop, lifted: Lifted) -> Matrix:
    """Return N, with xi+ = N z + J w_d."""
    return np.vstack([product(lifted.A_d, loop.start), loop.advanced])


def stored_matrix(loop: SampledLoop, witness: Witness, running: Matrix | None = None) -> Matrix:
    """Return Z; `running` is a cost of z at each sampling instant, if there is one."""
    number = converter(is_exact(loop.held))
    P, t = number(witness.P), number(witness.t)
    decay, weight, kappa, kappa_mu = number(
        np.array([witness.decay, witness.weight, witness.kappa, witness.kappa_mu])
    )
    Z = zeros(loop.n_z, loop.n_z, loop.held)
    Z[: loop.n_xi, : loop.n_xi] = decay * P
    Z[: loop.n_d, : loop.n_d] = Z[: loop.n_d, : loop.n_d] - weight * metric(loop)
    places = [loop.messages, loop.underflows, *(way.place for way in loop.ways)]
    for place, cost in zip(places, [kappa, kappa_mu, *t], strict=True):
        for k in range(place.start, place.stop):
            Z[k, k] = Z[k, k] + cost
    for cost, way in zip(t, loop.ways, strict=True):
        if way.delta:
            delta = number(np.array([way.delta]))[0]
            # Of balls, too, only zeros themselves are left out.
            seen = np.flatnonzero(~(way.Y == 0).all(axis=0))
            Z[np.ix_(seen, seen)] -= cost * delta * delta * (way.Y[:, seen].T @ way.Y[:, seen])
    return Z if running is None else Z - running


def W_matrix(loop: SampledLoop, lifted: Lifted, witness: Witness, running: Matrix | None = None) -> Matrix:
    """Assemble W, in doubles or in balls, as the loop and the lifted period are."""
    P = converter(is_exact(loop.held))(witness.P)
    start, N = loop.start, step_matrix(loop, lifted)
    n_z, n_d = loop.n_z, loop.n_d
    side = product(P, N)
    W = zeros(n_z + loop.n_xi, n_z + loop.n_xi, loop.held)
    W[:n_z, :n_z] = stored_matrix(loop, witness, running) - product(start.T, lifted.Q, start)
    W[n_z:, :n_z], W[:n_z, n_z:] = side, side.T
    W[n_z:, n_z:] = P - product(P[:, :n_d], lifted.S, P[:n_d])
    return W
