"""The baseline: the static relative-state protocol of Li, Liu and Fu for Lipschitz agents.

Z. Li, X. Liu, M. Fu, Global consensus control of Lipschitz nonlinear multi-agent systems, IFAC World
Congress 2011. For agents x_i' = A x_i + G phi(H x_i, t) + B u_i with |phi(v) - phi(w)| <= alpha |v - w| it
takes u_i = c K sum_j a_ij (x_i - x_j) with

    step 1   P > 0, tau > 0: [A P + P A' - tau B B' + alpha^2 G G', P H'; H P, -I] < 0;  K = -1/2 B' P^-1
    step 2   c = tau / a, with a the generalised algebraic connectivity of the graph (`connectivity`)

Printed with G = D and H = I; a structured H is the same argument with |H (x_i - x_j)| for |x_i - x_j|.

Step 1 has many solutions and the source does not say which one it takes. Here, with X = P / tau, s = 1 / tau,

    [A X + X A' + 2 beta X - B B' + s alpha^2 G G', X H'; H X, -s I] <= 0,     least trace(B' X^-1 B),

where beta is a rate of decay, and trace(B' X^-1 B) / (2 a) is by how much the protocol shifts the trace of
the loop, the same in all coordinates of the state: the gentlest protocol of that decay. c K = -B' X^-1 / (2 a).
Of the rates in `DECAYS` the protocol takes the one with the least rho whose gains are within the limit.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lockstep.check.continuous.inequality import Claim
from lockstep.check.errors import Infeasible, demand
from lockstep.check.system.loop import Gains, Plant
from lockstep.lmi.analysis.certificate_sdp import least_rho, solve_sdp
from lockstep.lmi.analysis.connectivity import connectivity
from lockstep.lmi.analysis.gain_limit import limit_text
from lockstep.lmi.shapes import GainLimit
from lockstep.model.network import Network

DECAYS = (0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0)
"""Rates beta tried, 1/s, times the norm of A where that is below 1, so that slow agents get slow rates."""

BISECTIONS = 12
"""Halvings of the bracket in which the largest reachable alpha is looked for: 1 part in 4096 of a decade."""


@dataclass(frozen=True)
class FirstStep:
    """A solution of step 1: tau, P (n, n) and K (m, n)."""

    tau: float
    P: Float[np.ndarray, "n n"]
    K: Float[np.ndarray, "m n"]


@dataclass(frozen=True)
class Protocol:
    """u_i = c K sum_j a_ij (x_i - x_j), with the rate and the connectivity a it was designed for."""

    first: FirstStep
    decay: float
    connectivity: float

    @property
    def c(self) -> float:
        """The coupling gain c = tau / a of step 2."""
        return self.first.tau / self.connectivity


def step_1_matrix(
    plant: Plant, alpha: float, tau: float, P: Float[np.ndarray, "n n"]
) -> Float[np.ndarray, "k k"]:
    """Return [A P + P A' - tau B B' + alpha^2 G G', P H'; H P, -I], negative definite in step 1."""
    A, B, G, H = plant.A, plant.B[0], plant.G, plant.H
    head = A @ P + P @ A.T - tau * B @ B.T + alpha**2 * G @ G.T
    return np.block([[head, P @ H.T], [H @ P, -np.eye(H.shape[0])]])


def first_step(plant: Plant, alpha: float, decay: float) -> FirstStep | None:
    """Solve step 1 for the gentlest protocol of a rate of decay; None where there is none."""
    import cvxpy as cp

    A, B, G, H = plant.A, plant.B[0], plant.G, plant.H
    n, m, v = len(A), B.shape[1], H.shape[0]
    X, W, s = cp.Variable((n, n), symmetric=True), cp.Variable((m, m), symmetric=True), cp.Variable()
    head = A @ X + X @ A.T + 2 * decay * X - B @ B.T + s * alpha**2 * (G @ G.T)
    whole = cp.bmat([[head, X @ H.T], [H @ X, -s * np.eye(v)]]) if v else head
    conditions = [(whole + whole.T) / 2 << 0, cp.bmat([[W, B.T], [B, X]]) >> 0, s >= 1e-9]
    if not solve_sdp(cp.Problem(cp.Minimize(cp.trace(W)), conditions)) or X.value is None or s.value is None:
        return None
    tau = 1.0 / float(s.value) if v else 1.0
    P = tau * (X.value + X.value.T) / 2
    return FirstStep(tau, P, -0.5 * np.linalg.solve(P, B).T) if _holds(plant, alpha, tau, P) else None


def _holds(plant: Plant, alpha: float, tau: float, P: Float[np.ndarray, "n n"]) -> bool:
    """Check step 1 outside the solver, where P = I: the rate of decay leaves it a margin there."""
    try:
        L = np.linalg.cholesky(P)
    except np.linalg.LinAlgError:
        return False
    F = step_1_matrix(plant, alpha, tau, P)
    D = np.eye(len(F))
    D[: len(P), : len(P)] = np.linalg.inv(L)
    return float(np.linalg.eigvalsh(D @ F @ D.T)[-1]) < 0


def protocol_gains(network: Network, protocol: Protocol) -> Gains:
    """Return the protocol as static output feedback of every agent: D_i = c K C^-1."""
    n, m = network.plant.B[0].shape
    D = protocol.c * np.linalg.solve(network.plant.C.T, protocol.first.K.T).T
    N = network.N
    return Gains((np.zeros((0, 0)),) * N, (np.zeros((0, n)),) * N, (np.zeros((m, 0)),) * N, (D,) * N)


def design_protocol(network: Network, claim: Claim, gain_limit: GainLimit) -> Protocol:
    """Design the protocol whose certified rho is least, within the gain limit.

    Args:
        network: agents with one B that measure their whole state (C square and invertible).
        claim: alpha and the weights that rho is measured with.
        gain_limit: on c K C^-1.

    Raises:
        ProblemError: part of the state is not measured, the agents' B differ, or the graph is not covered.
        Infeasible: step 1 has no solution for this alpha, or none within the limit is certified; the figures
            have the largest alpha that has a solution, or the least gain.
    """
    check_covered(network)
    a = connectivity(network.graph)
    unit = min(1.0, float(np.linalg.norm(network.plant.A, 2)) or 1.0)
    found = [(rate * unit, first_step(network.plant, claim.alpha, rate * unit)) for rate in DECAYS]
    protocols = [Protocol(first, rate, a) for rate, first in found if first is not None]
    if not protocols:
        raise _no_solution(network.plant, claim.alpha)
    best: tuple[float, Protocol] | None = None
    norms = []
    for protocol in protocols:
        gains = protocol_gains(network, protocol)
        norms.append(float(np.linalg.norm(gains.blocks, 2, axis=(1, 2)).max()))
        if np.linalg.norm(gains.blocks[0] / gain_limit, 2) > 1:
            continue
        certificate = least_rho(network.loop(0), gains.blocks, claim)
        if certificate is not None and (best is None or certificate.rho < best[0]):
            best = (certificate.rho, protocol)
    if best is None:
        raise Infeasible(
            f"the protocols that step 1 gives have gains of {min(norms):.4g} to {max(norms):.4g}, and none"
            f" within {limit_text(gain_limit)} is certified",
            least_gain=min(norms),
        )
    return best[1]


def check_covered(network: Network) -> None:
    """Refuse a network whose agents do not measure their whole state or differ in B."""
    q, n = network.plant.C.shape
    rank, where = np.linalg.matrix_rank(network.plant.C), '[design] method = "lipschitz"'
    found = f"the agents measure {rank} independent outputs of {n} states"
    expected = "outputs that give the whole state: its protocol feeds back x_i - x_j"
    demand(q == n == rank, found, where, expected, 'measure every state, or use method = "certified"')
    found, remedy = "the agents have input matrices of their own", 'use method = "certified"'
    one_B = all(np.array_equal(B, network.plant.B[0]) for B in network.plant.B)
    demand(one_B, found, where, "one B for all agents", remedy)


def _no_solution(plant: Plant, alpha: float) -> Infeasible:
    """Say up to which alpha step 1 has a solution, found by halving on a logarithmic scale."""
    low, high = alpha * 1e-3, alpha
    slowest = DECAYS[0] * min(1.0, float(np.linalg.norm(plant.A, 2)) or 1.0)
    for _ in range(BISECTIONS):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if first_step(plant, middle, slowest) is not None else (low, middle)
    return Infeasible(
        f"step 1 has no solution at alpha = {alpha:.6g}; it has one up to about {low:.3g}",
        alpha=alpha,
        reachable_alpha=low,
    )
