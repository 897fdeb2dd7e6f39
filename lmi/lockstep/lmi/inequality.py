"""The certificate inequality for given gains: what is claimed, what witnesses it, and what decides it.

With A_cl = A_0 + sum_i U_i K_i Y_i (15), claims alpha, rho, R, Q, delta and witnesses P, m, t,

    F = [ F_11   P E              P E_G      P X      ]
        [ *      -rho^2 S (x) I   0          0        ]
        [ *      *                -M (x) I   0        ]
        [ *      *                *          -diag(t) ],

    F_11 = He(P A_cl) + diag(S (x) R, I (x) Q) + M (x) alpha^2 H'H + sum_j t_j delta_j^2 Y_j'Y_j,

and P > 0, m >= 0, t >= 0, F < 0 prove, for V = x_cl' P x_cl,

    V' + x_d' (S (x) R) x_d + x_C' (I (x) Q) x_C < rho^2 xi_d' (S (x) I) xi_d   whenever (x_cl, xi_d) != 0,

for every h with |phi(a, t) - phi(b, t)| <= alpha |a - b| and every Delta with |Delta_j| <= delta_j (11). It
is (33) of the paper with a full P, with the sound bound (29), |C_r|^2 replaced by the exact Y_j, and with a
multiplier M = sum_ij m_ij M_ij on all pairs of agents in place of (30), which does not follow from (3).

The same function assembles F from doubles, for a filter, and from rationals, for the proof.
"""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lockstep.model.loop import Loop
from lockstep.model.numbers import Matrix, Vector, converter, eye, zeros

LETTERS = ("A", "B", "C", "D")


@dataclass(frozen=True)
class Claim:
    """What a certificate claims, besides rho: alpha, the weights, and how much the gains may be off.

    alpha: the incremental bound of phi;  R: (n, n) weight of the disagreement;  Q: (n_C, n_C) weight of each
    controller's
    state;  delta: (N, 4), the bounds (11) on |Delta A_Ci|, |Delta B_Ci|, |Delta C_Ci|, |Delta D_Ci|.
    """

    alpha: float
    R: Float[np.ndarray, "n n"]
    Q: Float[np.ndarray, "n_C n_C"]
    delta: Float[np.ndarray, "N 4"]

    def at(self, *, alpha: float | None = None, fraction_of_delta: float = 1.0) -> "Claim":
        """Return an easier or harder claim, for continuation."""
        return replace(
            self, alpha=self.alpha if alpha is None else alpha, delta=self.delta * fraction_of_delta
        )


class Channel(NamedTuple):
    """One way in for a gain error: A_cl gains X Delta Y with |Delta| <= delta."""

    agent: int
    letter: int
    X: Matrix
    Y: Matrix
    delta: float


@dataclass(frozen=True)
class Certificate:
    """The witnesses: P (n_x, n_x), m >= 0 for each pair of agents, t >= 0 for each channel, and rho."""

    rho: float
    P: Float[np.ndarray, "n_x n_x"]
    m: Float[np.ndarray, " pairs"]
    t: Float[np.ndarray, " channels"] = field(default_factory=lambda: np.zeros(0))


def channels(loop: Loop, delta: Float[np.ndarray, "N 4"]) -> list[Channel]:
    """Return the gain errors that are not excluded, agent by agent, in the order A, B, C, D."""
    n_C = loop.order
    found = []
    for i, (U, Y) in enumerate(zip(loop.U, loop.Y, strict=True)):
        state_in, input_in, state_out, output_out = U[:, :n_C], U[:, n_C:], Y[:n_C], Y[n_C:]
        ways = ((state_in, state_out), (state_in, output_out), (input_in, state_out), (input_in, output_out))
        found += [
            Channel(i, k, X, row, float(delta[i, k]))
            for k, (X, row) in enumerate(ways)
            if delta[i, k] > 0 and X.shape[1] and row.shape[0]
        ]
    return found


def multiplier(loop: Loop, m: Vector) -> Matrix:
    """Return M = sum_ij m_ij M_ij, for which x_d' (M (x) X) x_d = sum_ij m_ij (x_i - x_j)' X (x_i - x_j)."""
    N = loop.d.N
    total = zeros(N - 1, N - 1, loop.A_0)
    for weight, (i, j) in zip(m, loop.d.pairs(), strict=True):
        total = total + weight * loop.d.pair_multiplier(i, j)
    return total


def incoming(loop: Loop, ways: list[Channel]) -> Matrix:
    """Return [E, E_G, X]: how the disturbance, phi and the gain errors enter."""
    return np.hstack([loop.E, loop.E_G, *[way.X for way in ways]])


def performance_weight(loop: Loop, claim: Claim) -> Matrix:
    """Return diag(S (x) R, I (x) Q)."""
    number = converter(loop.exact)
    weight = loop.on_disagreement(np.kron(loop.d.S, number(claim.R)))
    Q = number(claim.Q)
    for i in range(loop.d.N):
        place = slice(loop.n_d + i * loop.order, loop.n_d + (i + 1) * loop.order)
        weight[place, place] = Q
    return weight


def F_matrix(loop: Loop, gains: Float[np.ndarray, "N k l"], claim: Claim, certificate: Certificate) -> Matrix:
    """Assemble F, in doubles or in the rationals the doubles are, as the loop is."""
    number = converter(loop.exact)
    P, alpha = number(certificate.P), number(np.array([claim.alpha]))[0]
    rho, t = number(np.array([certificate.rho]))[0], number(certificate.t)
    ways = channels(loop, claim.delta)
    M = multiplier(loop, number(certificate.m))
    H, r = loop.plant.H, loop.plant.G.shape[1]
    top = P @ loop.A_cl(number(gains))
    top = top + top.T + performance_weight(loop, claim)
    if H.shape[0]:
        top = top + loop.on_disagreement(np.kron(M, alpha * alpha * (H.T @ H)))
    for weight, way in zip(t, ways, strict=True):
        delta = number(np.array([way.delta]))[0]
        top = top + weight * delta * delta * (way.Y.T @ way.Y)
    middle = [
        rho * rho * np.kron(loop.d.S, eye(loop.plant.A.shape[0], P)),
        np.kron(M, eye(r, P)) if r else zeros(0, 0, P),
    ]
    middle += [weight * eye(way.X.shape[1], P) for weight, way in zip(t, ways, strict=True)]
    side = P @ incoming(loop, ways)
    return _bordered(top, side, middle)


def _bordered(top: Matrix, side: Matrix, middle: list[Matrix]) -> Matrix:
    n = top.shape[0]
    size = n + sum(block.shape[0] for block in middle)
    F = zeros(size, size, top)
    F[:n, :n], F[:n, n:], F[n:, :n] = top, side, side.T
    place = n
    for block in middle:
        F[place : place + len(block), place : place + len(block)] = -block
        place += len(block)
    return F
