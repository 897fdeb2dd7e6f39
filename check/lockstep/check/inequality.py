"""The certificate inequality for given gains: what is claimed, what witnesses it, and what decides it.

With A_cl = A_0 + sum_i U_i K_i Y_i (15), claims alpha, rho, R, Q, delta and witnesses P, m, t,

    F = [ F_11   P E              P [E_G, 0]      P X      ]
        [ *      -rho^2 S (x) I   0               0        ]
        [ *      *                -sum_c W_c      0        ]
        [ *      *                *              -diag(t)  ],

    F_11 = He(P A_cl) + diag(S (x) R, I (x) Q) + sum_c M_c (x) r_c^2 H_c'H_c + sum_j t_j delta_j^2 Y_j'Y_j,

and P > 0, m >= 0, t >= 0, F < 0 prove, for V = x_cl' P x_cl,

    V' + x_d' (S (x) R) x_d + x_C' (I (x) Q) x_C < rho^2 xi_d' (S (x) I) xi_d   whenever (x_cl, xi_d) != 0,

for every h with |phi(a, t) - phi(b, t)| <= alpha |a - b| and every Delta with |Delta_j| <= delta_j (11). It
is (33) of the paper with a full P, with the sound bound (29), |C_r|^2 replaced by the exact Y_j, and with
multipliers M_c = sum_ij m_c,ij M_ij on all pairs of agents in place of (30), which does not follow from (3).

The sectors c: phi as a whole, r_c = alpha, H_c = H, W_c = M_c (x) I; and, where each slope d phi_k / d v_l has a bound
r_kl of its own, one for each (k, l), with H_c the row l of H. For a pair of agents the mean value theorem gives numbers

    phi_k(v_i, t) - phi_k(v_j, t) = sum_l w_kl,ij,    |w_kl,ij| <= r_kl |v_l,i - v_l,j|,

which belong to the pair: for four agents or more there are in general no w_kl,i of the single agents with
w_kl,ij = w_kl,i - w_kl,j. So all but the last w_kl,ij of each component and pair are signals of F, the last is what they
leave of phi_k,i - phi_k,j, and W_c = sum_ij m_c,ij w_kl,ij^2. The solver mixes alpha and the entries.

The same function assembles F from doubles, for a filter, and from rationals, for the proof.
"""

from dataclasses import dataclass, field, replace
from typing import Annotated, NamedTuple

import numpy as np

from lockstep.check.bound.result import Entry
from lockstep.check.loop import Loop, Plant
from lockstep.check.numbers import Matrix, Vector, converter, eye, zeros

LETTERS = ("A", "B", "C", "D")


@dataclass(frozen=True)
class Claim:
    """What a certificate claims, besides rho: alpha, the weights, and how much the gains may be off.

    alpha: the incremental bound of phi;  R: (n, n) weight of the disagreement;  Q: (n_C, n_C) weight of each
    controller's
    state;  delta: (N, 4), the bounds (11) on |Delta A_Ci|, |Delta B_Ci|, |Delta C_Ci|, |Delta D_Ci|;  entries: the
    bounds of single slopes of phi that may be used besides alpha: all that are not 0, or none.
    """

    alpha: float
    R: Annotated[np.ndarray, "n n"]
    Q: Annotated[np.ndarray, "n_C n_C"]
    delta: Annotated[np.ndarray, "N 4"]
    entries: tuple[Entry, ...] = ()

    @property
    def alpha_of_floor(self) -> float:
        """The alpha for which a floor of rho is one of this claim: 0 with entries, which may certify what alpha does not."""
        return 0.0 if self.entries else self.alpha

    def at(self, *, alpha: float | None = None, fraction_of_delta: float = 1.0) -> "Claim":
        """Return an easier or harder claim, for continuation: the entries are scaled as alpha is."""
        alpha = self.alpha if alpha is None else alpha
        part = alpha / self.alpha if self.alpha else 1.0
        entries = tuple(replace(one, bound=part * one.bound) for one in self.entries)
        return replace(self, alpha=alpha, delta=self.delta * fraction_of_delta, entries=entries)


class Channel(NamedTuple):
    """One way in for a gain error: A_cl gains X Delta Y with |Delta| <= delta."""

    agent: int
    letter: int
    X: Matrix
    Y: Matrix
    delta: float


@dataclass(frozen=True)
class Certificate:
    """The witnesses: P (n_x, n_x), m >= 0 for each pair of agents, t >= 0 for each channel, and rho.

    m_entries: as m, for each entry of the claim.
    """

    rho: float
    P: Annotated[np.ndarray, "n_x n_x"]
    m: Annotated[np.ndarray, " pairs"]
    t: Annotated[np.ndarray, " channels"] = field(default_factory=lambda: np.zeros(0))
    m_entries: Annotated[np.ndarray, "entries _pairs"] = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def pair_weights(self) -> Annotated[np.ndarray, " weights"]:
        """m, then m_entries row by row: one row for each of `sectors`."""
        return np.concatenate([self.m, self.m_entries.ravel()])


class Sector(NamedTuple):
    """sum_ij m_ij (bound^2 |H (x_i - x_j)|^2 - |w_ij|^2) >= 0 for all m >= 0, where w_ij = W_ij w.

    w: phi_d and the signals of the entries;  W: W_ij for each pair of agents.
    """

    bound: float
    H: Matrix
    W: list[Matrix]


def channels(loop: Loop, delta: Annotated[np.ndarray, "N 4"]) -> list[Channel]:
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


def sectors(loop: Loop, claim: Claim) -> list[Sector]:
    """Return phi as a whole and the entries of the claim; none where there is no nonlinearity."""
    return sectors_of(loop.plant, claim, [loop.d.right[i] - loop.d.right[j] for i, j in loop.d.pairs()])


def sectors_of(plant: Plant, claim: Claim, differences: list[Vector]) -> list[Sector]:
    """Return the sectors for rows d with phi_i - phi_j = (d (x) I) phi_d, one for each pair.

    The last entry of a component needs no signals of its own: it is what the others leave of phi_k,i - phi_k,j.
    """
    r, pairs = plant.G.shape[1], len(differences)
    if not r:
        return []
    width, place = r * len(differences[0]) + entry_signals(claim, pairs), r * len(differences[0])
    phi = [_padded(np.kron(row[None, :], eye(r, plant.A)), 0, width) for row in differences]
    found, left = [Sector(claim.alpha, plant.H, phi)], {k: [W[k : k + 1] for W in phi] for k in range(r)}
    for c, entry in enumerate(claim.entries):
        k, W = entry.component, left[entry.component]
        if any(later.component == k for later in claim.entries[c + 1 :]):
            W = [_padded(eye(1, plant.A), place + pair, width) for pair in range(pairs)]
            left[k] = [whole - part for whole, part in zip(left[k], W, strict=True)]
            place += pairs
        found.append(Sector(entry.bound, plant.H[entry.argument : entry.argument + 1], W))
    return found


def entry_signals(claim: Claim, pairs: int) -> int:
    """Return how many signals the entries add to phi_d: for each pair, one less than a component has entries."""
    return pairs * (len(claim.entries) - len({one.component for one in claim.entries}))


def split(
    loop: Loop, claim: Claim, weights: Annotated[np.ndarray, " weights"]
) -> tuple[Annotated[np.ndarray, " pairs"], Annotated[np.ndarray, "entries pairs"]]:
    """Return m and m_entries from one vector of them, which is empty where there is no nonlinearity: then m is 0."""
    pairs = len(loop.d.pairs())
    m = weights[:pairs] if len(weights) else np.zeros(pairs)
    return m, weights[pairs:].reshape(len(claim.entries), pairs)


def incoming(loop: Loop, claim: Claim) -> Matrix:
    """Return [E, E_G, 0, X]: how the disturbance, phi, the signals of the entries and the gain errors enter."""
    none = zeros(loop.n_x, entry_signals(claim, len(loop.d.pairs())), loop.A_0)
    return np.hstack([loop.E, loop.E_G, none, *[way.X for way in channels(loop, claim.delta)]])


def performance_weight(loop: Loop, claim: Claim) -> Matrix:
    """Return diag(S (x) R, I (x) Q)."""
    number = converter(loop.exact)
    weight = loop.on_disagreement(np.kron(loop.d.S, number(claim.R)))
    Q = number(claim.Q)
    for i in range(loop.d.N):
        place = slice(loop.n_d + i * loop.order, loop.n_d + (i + 1) * loop.order)
        weight[place, place] = Q
    return weight


def F_matrix(
    loop: Loop, gains: Annotated[np.ndarray, "N k l"], claim: Claim, certificate: Certificate
) -> Matrix:
    """Assemble F, in doubles or in the rationals the doubles are, as the loop is."""
    number = converter(loop.exact)
    P, m = number(certificate.P), number(certificate.pair_weights)
    rho, t = number(np.array([certificate.rho]))[0], number(certificate.t)
    ways, pairs = channels(loop, claim.delta), len(loop.d.pairs())
    top = P @ loop.A_cl(number(gains))
    top = top + top.T + performance_weight(loop, claim)
    n_w = loop.E_G.shape[1] + entry_signals(claim, pairs)
    signals = zeros(n_w, n_w, P)
    for c, sector in enumerate(sectors(loop, claim)):
        own, bound = m[c * pairs : (c + 1) * pairs], number(np.array([sector.bound]))[0]
        if sector.H.shape[0]:
            square = bound * bound * (sector.H.T @ sector.H)
            top = top + loop.on_disagreement(np.kron(multiplier(loop, own), square))
        for weight, W in zip(own, sector.W, strict=True):
            signals = signals + weight * (W.T @ W)
    for weight, way in zip(t, ways, strict=True):
        delta = number(np.array([way.delta]))[0]
        top = top + weight * delta * delta * (way.Y.T @ way.Y)
    middle = [rho * rho * np.kron(loop.d.S, eye(loop.plant.A.shape[0], P)), signals]
    middle += [weight * eye(way.X.shape[1], P) for weight, way in zip(t, ways, strict=True)]
    return _bordered(top, P @ incoming(loop, claim), middle)


def _padded(block: Matrix, at: int, width: int) -> Matrix:
    whole = zeros(len(block), width, block)
    whole[:, at : at + block.shape[1]] = block
    return whole


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
