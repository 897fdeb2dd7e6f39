"""Identical controllers on a graph that is symmetric in a metric W: independent modes, and their certificate.

Along a W-orthonormal basis of eigenvectors of L the loop splits into one copy for each lambda_k,

    x_k' = A(lambda_k) x_k + E_G phi_k + E xi_k,     A(lambda) = A_0 + U K Y(lambda),     K = [A_C B_C; C_C D_C],
    A_0 = diag(A, 0),   U = [0 B; I 0],   Y(lambda) = [0 I; lambda C 0],

and for lambda_1 = 0, of which no disagreement is seen, into x_C' = A_C x_C. The nonlinearity couples the modes, but
its multiplier is the same number mu in each: sum_i w_i (alpha^2 |H(x_i - x_w)|^2 - |phi_i - phi_w|^2) >= 0, x_w the
w-mean, is the pair multiplier with m_ij = mu w_i w_j / sum w. So if for every lambda in [lower, upper] some P > 0 has

    [ He(P A(lambda)) + diag(R, Q) + mu alpha^2 diag(H'H, 0)   P E        P E_G  ]
    [                        *                                -sigma I     0     ]   < 0,
    [                        *                                  *         -mu I  ]

(entries of the claim add their sectors and signals as in `inequality`, with a number mu of their own each)
and some P_mean > 0 has He(P_mean A_C) + Q < 0, then V = the sum of the modes' x_k'P x_k proves, in the metric W, the
bound sigma = rho_W^2; without the metric, |x|^2 <= |x|_W^2 / min w and |xi|_W^2 <= max w |xi|^2, so
rho^2 = sigma max w / min w.
The matrix is affine in lambda: with one P on a segment its two ends suffice, whatever N is.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Annotated, Any

import numpy as np

from lockstep.check.channels import Inequality
from lockstep.check.errors import ProblemError
from lockstep.check.inequality import Claim, disturbance, nonlinearity
from lockstep.check.loop import Gains, Plant
from lockstep.check.network import ExactNetwork
from lockstep.check.numbers import Matrix, converter, exactly, eye, is_exact, zeros
from lockstep.check.psd import Definiteness, decide_positive_definite
from lockstep.check.spectrum import REMEDY, Metric, decide_spectrum, metric


@dataclass(frozen=True)
class Segment:
    """One P for all lambda up to `upper`, from where the segment before it ends."""

    upper: float
    P: Annotated[np.ndarray, "k k"]


@dataclass(frozen=True)
class ModalCertificate:
    """The witnesses: rho, where the spectrum begins, segments that cover it, mu, P_mean, and a mu for each entry."""

    rho: float
    lower: float
    segments: tuple[Segment, ...]
    mu: float
    P_mean: Annotated[np.ndarray, "n_C n_C"]
    mu_entries: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        """Check that the segments follow each other."""
        ends = self.ends
        if len(ends) < 2 or any(b < a for a, b in pairwise(ends)):
            raise ProblemError(
                f"the segments end at {', '.join(f'{end:g}' for end in ends)}",
                where="certificate",
                expected="one or more segments in rising order",
            )

    @property
    def ends(self) -> tuple[float, ...]:
        """Where the segments begin and end."""
        return (self.lower, *(segment.upper for segment in self.segments))


@dataclass(frozen=True)
class Modes:
    """A(lambda) = A_0 + U K Y(lambda), in doubles or in rationals."""

    plant: Plant
    order: int

    @property
    def size(self) -> int:
        """n + n_C."""
        return int(self.plant.A.shape[0]) + self.order

    @property
    def A_0(self) -> Matrix:
        """diag(A, 0)."""
        n = self.plant.A.shape[0]
        A_0 = zeros(self.size, self.size, self.plant.A)
        A_0[:n, :n] = self.plant.A
        return A_0

    @property
    def U(self) -> Matrix:
        """[0 B; I 0]."""
        n, m = self.plant.B[0].shape
        U = zeros(self.size, self.order + m, self.plant.A)
        U[:n, self.order :], U[n:, : self.order] = self.plant.B[0], eye(self.order, self.plant.A)
        return U

    def Y(self, value: float) -> Matrix:
        """[0 I; lambda C 0]; lambda is the double it is."""
        q, n = self.plant.C.shape
        Y = zeros(self.order + q, self.size, self.plant.A)
        scale = converter(is_exact(self.plant.A))(np.array([value]))[0]
        Y[: self.order, n:], Y[self.order :, :n] = eye(self.order, self.plant.A), scale * self.plant.C
        return Y

    def weight(self, claim: Claim) -> Matrix:
        """diag(R, Q)."""
        number, n = converter(is_exact(self.plant.A)), self.plant.A.shape[0]
        weight = zeros(self.size, self.size, self.plant.A)
        weight[:n, :n], weight[n:, n:] = number(claim.R), number(claim.Q)
        return weight

    def inequality(self, claim: Claim, value: float) -> Inequality:
        """Return the inequality of one mode: the disturbance (sigma), and the nonlinearity (mu) as of a single difference."""
        unit, A = eye(1, self.plant.A)[0], self.plant.A
        found = (
            disturbance(eye(self.size, A)[:, : len(A)], self.weight(claim), eye(len(A), A)),
            nonlinearity(self.plant, claim, [unit], self.size),
        )
        return Inequality(self.A_0, (self.U,), (self.Y(value),), found)


def mode_matrix(
    modes: Modes, K: Matrix, claim: Claim, value: float, P: Matrix, mu: Sequence[float], sigma: Any
) -> Matrix:
    """Assemble the matrix of one mode, in the kind of number of the plant; sigma is a number of that kind.

    mu: one for each sector: alpha, then the entries.
    """
    stated = modes.inequality(claim, value)
    own = converter(is_exact(modes.plant.A))(np.array(mu))[: len(stated.channels[1].cone)]
    return stated.F(P, K[None], np.array([sigma, *own]))


def check_covered(network: ExactNetwork, claim: Claim) -> Metric:
    """Return the metric of the graph.

    Raises:
        ProblemError: a graph, agents or a request that do not split into modes.
    """
    known, where = metric(network.graph), '[design] method = "modal"'
    if any(not np.array_equal(B, network.plant.B[0]) for B in network.plant.B):
        raise ProblemError(
            "the agents have input matrices of their own",
            where=where,
            expected="one B for all agents",
            remedy=REMEDY,
        )
    if network.coordinates != "orthonormal":
        raise ProblemError(
            f'`coordinates` is "{network.coordinates}"', where=where, expected='"orthonormal"', remedy=REMEDY
        )
    if claim.delta.any():
        raise ProblemError(
            "`fragility` is asked for", where=where, expected="certain controllers", remedy=REMEDY
        )
    return known


def decide_modes(
    network: ExactNetwork, gains: Gains, claim: Claim, certificate: ModalCertificate
) -> Definiteness:
    """Decide exactly whether a certificate proves its rho for identical gains: the whole proof, R > 0 and Q > 0 included.

    Raises:
        ProblemError: the problem does not split into modes, or the gains differ.
    """
    known, c = check_covered(network, claim), certificate
    if any(not np.array_equal(block, gains.blocks[0]) for block in gains.blocks):
        raise ProblemError(
            "they differ", where="gains", expected='the same for all agents, with a "modal" certificate'
        )
    mu = (c.mu, *c.mu_entries)
    if len(c.mu_entries) != len(claim.entries):
        raise ProblemError(
            f"{len(c.mu_entries)} numbers mu",
            where="certificate",
            expected=f"{len(claim.entries)}, one an entry",
        )
    if min(mu) < 0:
        return Definiteness(False, "sign of mu", min(mu), value=min(mu))
    for name, weight in (("R", claim.R), ("Q", claim.Q)):
        answer = decide_positive_definite(exactly(weight))
        if not answer.positive:
            return replace(answer, method=f"{answer.method}, M = {name}")
    ends = c.ends
    answer = decide_spectrum(network.graph, known, ends[0], ends[-1])
    modes = Modes(network.plant.in_numbers(True), gains.order)
    K = exactly(gains.blocks[0])
    rho = exactly(np.array([c.rho]))[0]
    sigma = rho * rho / known.spread
    for start, segment in zip(ends, c.segments, strict=False):
        if not answer.positive:
            return answer
        P = exactly(segment.P)
        answer = decide_positive_definite(P)
        for value in (start, segment.upper):
            if answer.positive:
                answer = decide_positive_definite(-mode_matrix(modes, K, claim, value, P, mu, sigma))
    if answer.positive and gains.order:
        P, A_C = exactly(c.P_mean), K[: gains.order, : gains.order]
        answer = decide_positive_definite(P)
        if answer.positive:
            answer = decide_positive_definite(-(P @ A_C + A_C.T @ P + exactly(claim.Q)))
    return answer
