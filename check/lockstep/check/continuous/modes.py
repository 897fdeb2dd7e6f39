"""Identical controllers on a graph that is symmetric in a metric w: independent modes, and their certificate.

Along a basis of eigenvectors of L, orthonormal in diag(w), the loop splits into one copy for each lambda_k,

    x_k' = A(lambda_k) x_k + E_G phi_k + E xi_k,     A(lambda) = A_0 + U K Y(lambda),     K = [A_C B_C; C_C D_C],
    A_0 = diag(A, 0),   U = [0 B; I 0],   Y(lambda) = [0 I; lambda C 0],

and for lambda_1 = 0, of which no disagreement is seen, into x_C' = A_C x_C. The nonlinearity couples the modes, but
its multiplier is the same number mu in each: sum_i w_i (alpha^2 |H(x_i - x_w)|^2 - |phi_i - phi_w|^2) >= 0, x_w the
w-mean, is the pair multiplier with m_ij = mu w_i w_j / sum w. So if for every lambda in [lower, upper] some P > 0 has

    [ He(P A(lambda)) + diag(R, Q) + mu alpha^2 diag(H'H, 0)   P E        P E_G  ]
    [                        *                                -rho_w^2 I  0     ]   < 0,
    [                        *                                  *          -mu I ]

(entries of the claim add their sectors and signals as in `inequality`, with a number mu of their own each: of the signals
w_l of a pair that add up to its phi, sum mu_l |w_l|^2 is at least |phi|^2 / sum 1/mu_l, which splits as |phi|^2 does) and
some P_mean > 0 has He(P_mean A_C) + Q < 0, then V = the sum of the modes' x_k'P x_k proves, in the metric w, the bound
rho_w; without the metric, |x|^2 <= |x|_w^2 / min w and |xi|_w^2 <= max w |xi|^2, so rho^2 = rho_w^2 max w / min w. **Two ends
suffice.** With one P on a segment, the flow is affine in lambda, by Y(lambda) and the noise, r = lambda (C x + D nu); u =
K (Y(lambda) x + ...) is too, and u'W u, which is on the left, is convex in it; nothing else depends on lambda. So the
matrix is convex in lambda, in the sense of definiteness: negative at both ends, it is on all of the segment, whatever N is.

**Every graph.** With one P on all of [a, b] and a symmetric L, V_d = sum_k x_k'P x_k = sum_i (x_i - mean)'P(x_i - mean),
x_i with its controller's state, depends on no eigenvector and on no eigenvalue: it is a storage function for every
undirected graph of any size with its nonzero eigenvalues in [a, b], and for arbitrary switching among those of one size, V
being the same before and after. When an agent joins N others with the state x_new, V_d rises by N / (N + 1) (x_new -
mean)'P(x_new - mean); when one leaves, it falls by N / (N - 1) (x_i - mean)'P(x_i - mean). So along any sequence of
switches, joins and leaves

    int (x_d'R x_d + x_Cd'Q x_Cd) dt <= V_d(0) + sum over joins of their rises + rho^2 int |xi_d|^2 dt,

x_Cd being the controllers' states less their mean, which moves by itself between changes of N, x_C' = A_C x_C.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Annotated, Any

import numpy as np

from lockstep.check.continuous.channels import Inequality
from lockstep.check.continuous.decide import decide_weights
from lockstep.check.continuous.inequality import Claim, inequality
from lockstep.check.errors import demand
from lockstep.check.numbers import Matrix, Vector, converter, exact, exactly, is_exact
from lockstep.check.psd import Definiteness, decide_positive_definite
from lockstep.check.system.disagreement import single_difference
from lockstep.check.system.laplacian_spectrum import REMEDY, decide_spectrum, metric
from lockstep.check.system.loop import Gains, Loop, Plant, build_loop
from lockstep.check.system.network import ExactNetwork


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
        found = f"the segments end at {', '.join(f'{end:g}' for end in ends)}"
        rising = len(ends) > 1 and all(a <= b for a, b in pairwise(ends))
        demand(rising, found, "certificate", "one or more segments in rising order")

    @property
    def ends(self) -> tuple[float, ...]:
        """Where the segments begin and end."""
        return (self.lower, *(segment.upper for segment in self.segments))


@dataclass(frozen=True)
class Modes:
    """A(lambda) = A_0 + U K Y(lambda), in doubles or in rationals; with a decay sigma, A_0 + sigma I in place of A_0."""

    plant: Plant
    order: int
    decay: float = 0.0

    def at(self, value: float) -> Loop:
        """Return the mode of lambda, which is the double it is, as a loop of one difference and one controller."""
        one = replace(self.plant, B=self.plant.B[:1])
        return build_loop(one, single_difference(one.A, value), self.order, self.decay)

    def inequality(self, claim: Claim, value: float) -> Inequality:
        """Return the inequality of one mode: the disturbance (rho_w^2), the nonlinearity (mu) as of a single difference."""
        return inequality(self.at(value), claim)


def mode_matrix(
    modes: Modes, K: Matrix, claim: Claim, value: float, P: Matrix, mu: Sequence[float], square: Any
) -> Matrix:
    """Assemble the matrix of one mode, in the kind of number of the plant; square: rho_w^2, of that kind.

    mu: one for each sector: alpha, then the entries.
    """
    stated = modes.inequality(claim, value)
    own = converter(is_exact(modes.plant.A))(np.array(mu))[: len(stated.channels[1].cone)]
    return stated.F(P, K[None], np.array([square, *own]))


def _covers(network: ExactNetwork, known: Vector, ends: tuple[float, ...]) -> Definiteness:
    """Decide whether the spectrum is within the segments; of many graphs, between which V must not change, within one."""
    if network.spectrum is None:
        return decide_spectrum(network.graph, known, ends[0], ends[-1])
    demand(len(ends) == 2, f"{len(ends) - 1} segments", "certificate", "one P for all of [network] spectrum")
    room = min(network.spectrum[0] - ends[0], ends[1] - network.spectrum[1])
    return Definiteness(room >= 0, "segment against [network] spectrum", room, value=room)


def check_covered(network: ExactNetwork, claim: Claim) -> Vector:
    """Return the metric w of the graph.

    Raises:
        ProblemError: a graph, agents or a request that do not split into modes.
    """
    known, where = metric(network.graph), '[design] method = "modal"'
    same = all(np.array_equal(B, network.plant.B[0]) for B in network.plant.B)
    demand(same, "the agents have input matrices of their own", where, "one B for all agents", REMEDY)
    found, plain = f'`coordinates` is "{network.coordinates}"', network.coordinates == "orthonormal"
    demand(plain, found, where, '"orthonormal"', REMEDY)
    demand(not claim.delta.any(), "`fragility` is asked for", where, "certain controllers", REMEDY)
    return known


def decide_modes(
    network: ExactNetwork, gains: Gains, claim: Claim, certificate: ModalCertificate
) -> Definiteness:
    """Decide exactly whether a certificate proves its rho for identical gains, R, Q and W included.

    Raises:
        ProblemError: the problem does not split into modes, or the gains differ.
    """
    known, c = check_covered(network, claim), certificate
    same = all(np.array_equal(block, gains.blocks[0]) for block in gains.blocks)
    demand(same, "they differ", "gains", 'the same for all agents, with a "modal" certificate')
    mu, wanted = (c.mu, *c.mu_entries), len(claim.entries)
    found = f"{len(c.mu_entries)} numbers mu"
    demand(len(c.mu_entries) == wanted, found, "certificate", f"{wanted}, one an entry")
    if min(mu) < 0:
        return Definiteness(False, "sign of mu", min(mu), value=min(mu))
    ends, answer = c.ends, decide_weights(claim)
    if answer.positive:
        answer = _covers(network, known, ends)
    modes = Modes(network.plant.in_numbers(True), gains.order, network.decay)
    K = exactly(gains.blocks[0])
    square = exact(c.rho) ** 2 / max(known)
    for start, segment in zip(ends, c.segments, strict=False):
        if not answer.positive:
            return answer
        P = exactly(segment.P)
        answer = decide_positive_definite(P)
        for value in (start, segment.upper):
            if answer.positive:
                answer = decide_positive_definite(-mode_matrix(modes, K, claim, value, P, mu, square))
    if answer.positive and gains.order:
        P, A_C = exactly(c.P_mean), K[: gains.order, : gains.order]
        answer = decide_positive_definite(P)
        if answer.positive:
            C_C = K[gains.order :, : gains.order]
            weight = exactly(claim.Q) + (C_C.T @ exactly(claim.W) @ C_C if len(claim.W) else 0)
            decay = exact(network.decay)
            answer = decide_positive_definite(-(P @ A_C + A_C.T @ P + 2 * decay * P + weight))
    return answer
