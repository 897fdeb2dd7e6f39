"""The certificate inequality for given gains: what is claimed, what witnesses it, and what decides it.

With A_cl = A_0 + sum_i U_i K_i Y_i (15), claims alpha, rho, R, Q, delta and witnesses P, m, t,

    F = [ F_11   P E              P [E_G, 0]      P X      ]
        [ *      -rho^2 S (x) I   0               0        ]
        [ *      *                -sum_c Pi_c     0        ]
        [ *      *                *              -diag(t)  ],

    F_11 = He(P A_cl) + diag(S (x) R, I (x) Q) + sum_c M_c (x) r_c^2 H_c'H_c + sum_j t_j delta_j^2 Y_j'Y_j,

and P > 0, m >= 0, t >= 0, F < 0 prove, for V = x_cl' P x_cl,

    V' + x_d' (S (x) R) x_d + x_C' (I (x) Q) x_C < rho^2 xi_d' (S (x) I) xi_d   whenever (x_cl, xi_d) != 0,

for every h with |phi(a, t) - phi(b, t)| <= alpha |a - b| and every Delta with |Delta_j| <= delta_j (11). It
is (33) of the paper with a full P, with the sound bound (29), |C_r|^2 replaced by the exact Y_j, and with
multipliers M_c = sum_ij m_c,ij M_ij on all pairs of agents in place of (30), which does not follow from (3).

Where the claim has them: u' (I (x) W) u is added on the left; each state's xi is scaled; and noise nu of the outputs, which
the controllers see as r = L_q C (y + D_nu nu), stands beside xi on the right.

The sectors c: phi as a whole, r_c = alpha, H_c = H, Pi_c = M_c (x) I; and, where each slope d phi_k / d v_l has a bound
r_kl of its own, one for each (k, l), with H_c the row l of H. For a pair of agents the mean value theorem gives numbers

    phi_k(v_i, t) - phi_k(v_j, t) = sum_l w_kl,ij,    |w_kl,ij| <= r_kl |v_l,i - v_l,j|,

which belong to the pair: for four agents or more there are in general no w_kl,i of the single agents with
w_kl,ij = w_kl,i - w_kl,j. So all but the last w_kl,ij of each component and pair are signals of F, the last is what they
leave of phi_k,i - phi_k,j, and w'Pi_c w = sum_ij m_c,ij w_kl,ij^2. The solver mixes alpha and the entries.

`inequality` states it as channels, and `channels` assembles F from them: from doubles for a filter and for the programs
that look for witnesses, from rationals for the proof.
"""

from dataclasses import dataclass, field
from typing import Annotated, NamedTuple

import numpy as np

from lockstep.check.bound.slope_bounds import Entry
from lockstep.check.continuous.channels import Channel, Inequality, Term, widened
from lockstep.check.numbers import Matrix, Vector, block_diagonal, converter, eye, is_exact, zeros
from lockstep.check.system.loop import Loop, Plant

LETTERS = ("A", "B", "C", "D")


class Performance(NamedTuple):
    """What rho is a gain to and from: R (n, n), Q (n_C, n_C), W (m, m) and the scales of states and outputs of `Claim`."""

    R: Annotated[np.ndarray, "n n"]
    Q: Annotated[np.ndarray, "n_C n_C"]
    W: Annotated[np.ndarray, "m m"] = np.zeros((0, 0))
    states: Annotated[np.ndarray, " n"] = np.zeros(0)
    outputs: Annotated[np.ndarray, " q"] = np.zeros(0)

    @property
    def covers_xi(self) -> bool:
        """Whether rho bounds the gain from xi itself: every state is disturbed, with a scale of 1 at least."""
        return not len(self.states) or bool(self.states.min() >= 1)


@dataclass(frozen=True)
class Claim:
    """What a certificate claims, besides rho: alpha, what rho is a gain from and to, and how much the gains may be off.

    alpha: the incremental bound of phi;  R: (n, n) weight of the disagreement;  Q: (n_C, n_C) weight of each controller's
    state;  delta: (N, 4), the bounds (11) on |Delta A_Ci|, |Delta B_Ci|, |Delta C_Ci|, |Delta D_Ci|;  entries: the
    bounds of single slopes of phi that may be used besides alpha: all that are not 0, or none;  W: (m, m) weight of each
    agent's u, 0 x 0 where u weighs nothing;  states: (n,) scale of the disturbance of each state, none for 1 each;
    outputs: (q,) scale of the noise on each output, none where nothing is noisy.
    """

    alpha: float
    R: Annotated[np.ndarray, "n n"]
    Q: Annotated[np.ndarray, "n_C n_C"]
    delta: Annotated[np.ndarray, "N 4"]
    entries: tuple[Entry, ...] = ()
    W: Annotated[np.ndarray, "m m"] = field(default_factory=lambda: np.zeros((0, 0)))
    states: Annotated[np.ndarray, " n"] = field(default_factory=lambda: np.zeros(0))
    outputs: Annotated[np.ndarray, " q"] = field(default_factory=lambda: np.zeros(0))

    @property
    def performance(self) -> Performance:
        """What rho is a gain to and from."""
        return Performance(self.R, self.Q, self.W, self.states, self.outputs)


class GainError(NamedTuple):
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


def gain_errors(loop: Loop, delta: Annotated[np.ndarray, "N 4"]) -> list[GainError]:
    """Return the gain errors that are not excluded, agent by agent, in the order A, B, C, D."""
    n_C = loop.order
    found = []
    for i, (U, Y) in enumerate(zip(loop.U, loop.Y, strict=True)):
        state_in, input_in, state_out, output_out = U[:, :n_C], U[:, n_C:], Y[:n_C], Y[n_C:]
        ways = ((state_in, state_out), (state_in, output_out), (input_in, state_out), (input_in, output_out))
        found += [
            GainError(i, k, X, row, float(delta[i, k]))
            for k, (X, row) in enumerate(ways)
            if delta[i, k] > 0 and X.shape[1] and row.shape[0]
        ]
    return found


def disturbance(loop: Loop, claim: Claim) -> Channel:
    """Return w = (xi_d, nu_d), its multiplier rho^2, and what rho is a gain to: x_cl'diag(S (x) R, I (x) Q) x_cl + u'W u.

    xi_d = (T (x) I) xi is scaled by state, nu_d = (T (x) I) nu by output; states and outputs with the scale 0 have none.
    """
    number, d, (n, _, q, _, _) = converter(loop.exact), loop.d, loop.plant.sizes
    driven = np.flatnonzero(claim.states) if len(claim.states) else np.arange(n)
    noisy = np.flatnonzero(claim.outputs)
    scale = number(claim.states if len(claim.states) else np.ones(n))
    columns = [k * n + j for k in range(d.N - 1) for j in driven]
    E, Y = loop.E[:, columns] * np.tile(scale[driven], d.N - 1), []
    if len(noisy):
        seen = number(np.diag(claim.outputs)[:, noisy])
        E = widened(E, E.shape[1] + (d.N - 1) * len(noisy))
        for i in range(len(loop.Y)):
            rows = zeros(loop.order + q, E.shape[1], loop.A_0)
            rows[loop.order :, len(columns) :] = np.kron(d.L_r[i : i + 1], seen)
            Y.append(rows)
    metric = block_diagonal(*(np.kron(d.S, eye(len(part), loop.A_0)) for part in (driven, noisy)))
    one, none = eye(loop.n_x, loop.A_0), loop.A_0[:0, :0]
    nothing = zeros(0, len(metric), loop.A_0)
    gain = Term(one[:0], none, eye(len(metric), loop.A_0), metric)
    fixed = [Term(one, performance_weight(loop, claim), nothing, none)]
    if len(claim.W):
        errors, W, D_z = _inputs(loop, claim, E.shape[1])
        fixed.append(Term(errors, W, nothing, none, D_z))
    return Channel("disturbance", E, (gain,), tuple(fixed), tuple(Y))


def _inputs(loop: Loop, claim: Claim, width: int) -> tuple[Matrix, Matrix, tuple[Matrix, ...]]:
    """Return how all u are weighed: what gain errors add to u, W (N m, N m), and D_zi that take u out of agents' outputs.

    The errors of C and D are added to u; their columns stand behind the disturbance and the nonlinearity.
    """
    d, m, like, N = loop.d, len(claim.W), loop.A_0, len(loop.U)
    errors = gain_errors(loop, claim.delta)
    place = loop.n_x + width + nonlinear_signals(loop.plant, claim, len(d.pairs()), d.N - 1)
    total = zeros(N * m, place + sum(error.X.shape[1] for error in errors), like)
    for error in errors:
        if LETTERS[error.letter] in "CD":
            total[error.agent * m : (error.agent + 1) * m, place : place + m] = eye(m, like)
        place += error.X.shape[1]
    unit, rows = eye(N, like), np.hstack([zeros(m, loop.order, like), eye(m, like)])
    D_z = tuple(np.kron(unit[:, i : i + 1], rows) for i in range(N))
    return total if errors else total[:, : loop.n_x], np.kron(unit, converter(loop.exact)(claim.W)), D_z


def nonlinearity(plant: Plant, claim: Claim, differences: list[Vector], n_x: int) -> Channel:
    """Return phi_d and the signals of the entries, with the sectors of phi as a whole and of each entry of the claim.

    One multiplier for each sector and pair of agents: m, then m_entries row by row; none where there is no nonlinearity.
    The last entry of a component needs no signals of its own: it is what the others leave of phi_k,i - phi_k,j.

    Args:
        plant: in the kind of number wanted.
        claim: alpha and the entries.
        differences: for each pair, d with x_i - x_j = (d (x) I) x_d and phi_i - phi_j = (d (x) I) phi_d.
        n_x: length of x_cl, which x_d begins.
    """
    r, pairs, copies, A = plant.G.shape[1], len(differences), len(differences[0]), plant.A
    place, width, number = r * copies, nonlinear_signals(plant, claim, pairs, copies), converter(is_exact(A))
    E = zeros(n_x, width, A)
    E[: len(A) * copies, :place] = np.kron(eye(copies, A), plant.G)
    if not r:
        return Channel("nonlinearity", E, ())
    phi = [widened(np.kron(row[None, :], eye(r, A)), width) for row in differences]
    found = _sector(claim.alpha, plant.H, differences, phi, n_x)
    left = [[rows[k : k + 1] for rows in phi] for k in range(r)]
    for c, entry in enumerate(claim.entries):
        k, own = entry.component, left[entry.component]
        if any(later.component == k for later in claim.entries[c + 1 :]):
            own = [number(np.eye(1, width, place + pair)) for pair in range(pairs)]
            left[k] = [whole - part for whole, part in zip(left[k], own, strict=True)]
            place += pairs
        found += _sector(entry.bound, plant.H[entry.argument : entry.argument + 1], differences, own, n_x)
    return Channel("nonlinearity", E, tuple(found))


def _sector(bound: float, H: Matrix, differences: list[Vector], own: list[Matrix], n_x: int) -> list[Term]:
    """Return bound^2 |H (x_i - x_j)|^2 - |own_ij w|^2 for each pair."""
    r_c = converter(is_exact(H))(np.array([bound]))[0]
    Pi_z, Pi_w = r_c * r_c * eye(len(H), H), eye(len(own[0]), H)
    rows = [widened(np.kron(row[None, :], H), n_x) for row in differences]
    return [Term(C_z, Pi_z, C_w, Pi_w) for C_z, C_w in zip(rows, own, strict=True)]


def nonlinear_signals(plant: Plant, claim: Claim, pairs: int, copies: int) -> int:
    """Return how many signals the nonlinearity has: phi_d, and for each pair one less than a component has entries."""
    r = int(plant.G.shape[1])
    own = len(claim.entries) - len({one.component for one in claim.entries})
    return r * copies + (pairs * own if r else 0)


def performance_weight(loop: Loop, claim: Claim) -> Matrix:
    """Return diag(S (x) R, I (x) Q)."""
    number = converter(loop.exact)
    return block_diagonal(np.kron(loop.d.S, number(claim.R)), *[number(claim.Q)] * len(loop.U))


def inequality(loop: Loop, claim: Claim) -> Inequality:
    """Return the inequality of a claim: the disturbance (rho^2), the nonlinearity (m, m_entries), the gain errors (t)."""
    d = loop.d
    differences = [d.right[i] - d.right[j] for i, j in d.pairs()]
    first, errors = disturbance(loop, claim), []
    for error in gain_errors(loop, claim.delta):
        # e = Delta (Y x_cl + Y_w w) with delta^2 |Y x_cl + Y_w w|^2 - |e|^2; Y_w is what the noise adds to r.
        sees_noise = first.Y and LETTERS[error.letter] in "BD"
        noise = first.Y[error.agent][loop.order :] if sees_noise else error.Y[:, :0]
        delta = converter(loop.exact)(np.array([error.delta]))[0]
        one, seen = eye(error.X.shape[1], error.X), np.hstack([error.Y, noise])
        term = Term(seen, delta * delta * eye(len(seen), error.X), one, one)
        name = f"error of {LETTERS[error.letter]}, agent {error.agent + 1}"
        errors.append(Channel(name, error.X, (term,)))
    found = (first, nonlinearity(loop.plant, claim, differences, loop.n_x), *errors)
    return Inequality(loop.A_0, loop.U, loop.Y, found)


def multipliers(stated: Inequality, certificate: Certificate) -> Vector:
    """Return (rho^2, m, m_entries, t) of a certificate, in the kind of number of the inequality."""
    number = converter(is_exact(stated.A_0))
    rho = number(np.array([certificate.rho]))
    weights = number(certificate.pair_weights if stated.channels[1].cone else certificate.m[:0])
    return np.concatenate([rho * rho, weights, number(certificate.t)])


def F_matrix(
    loop: Loop, gains: Annotated[np.ndarray, "N k l"], claim: Claim, certificate: Certificate
) -> Matrix:
    """Assemble F, in doubles or in the rationals the doubles are, as the loop is."""
    number, stated = converter(loop.exact), inequality(loop, claim)
    return stated.F(number(certificate.P), number(gains), multipliers(stated, certificate))
