"""The common states around which the loop is weakest: where agents agree decides which slope of phi they meet.

Around agreement in a, small disagreements obey the linear loop with the slope of phi at H a. Its peak gain over all
frequencies, from xi_d to z, is reached by the nonlinear loop in the limit of small disturbances, so the largest over a
is a lower bound of what any certificate can claim, and a good place for `worst_disturbance` to start.
"""

import casadi as ca
import numpy as np
from jaxtyping import Float

from lockstep.check.system.loop import Gains
from lockstep.model.network import Network
from lockstep.model.simulation.equations import closed_loop
from lockstep.model.simulation.results.trajectory import RhoWeights

DRAWS, FREQUENCIES, REFINEMENTS = 48, 160, 40

OPEN_RANGE = np.pi
"""States without a domain are tried within +-pi: a whole turn of an angle."""


class PeakGain:
    """a -> sup over omega of the largest singular value from xi_d to z of the loop linearised around agreement in a."""

    def __init__(self, network: Network, gains: Gains, weights: RhoWeights) -> None:
        from scipy.linalg import block_diag

        n, N = network.agent.n, network.N
        self._n, self._N = n, N
        f = closed_loop(network, gains)
        X, xi = ca.SX.sym("X", f.size1_in(0)), ca.SX.sym("xi", N * n)
        self._jacobian = ca.Function("A", [X], [ca.jacobian(f(X, 0, xi), X)])
        self._rest = X.shape[0] - N * n
        values, vectors = np.linalg.eigh(weights.metric)
        into = np.kron(vectors[:, 1:] / np.sqrt(values[1:]), np.eye(n))
        back = np.kron((vectors[:, 1:] * np.sqrt(values[1:])).T, np.eye(n))
        self._into, self._back = (block_diag(one, np.eye(self._rest)) for one in (into, back))
        roots = [np.linalg.cholesky(np.kron(np.eye(N - 1), weights.R)).T]
        roots += [np.linalg.cholesky(np.kron(np.eye(N), weights.Q)).T] if self._rest else []
        self._root = block_diag(*roots)
        self.frequency = 0.0

    def __call__(self, a: Float[np.ndarray, " n"]) -> float:
        """Return the peak, infinite where the loop around a is unstable; keep its frequency in rad/s."""
        whole = np.asarray(self._jacobian(np.concatenate([np.tile(a, self._N), np.zeros(self._rest)])))
        A = self._back @ whole @ self._into
        poles = np.linalg.eigvals(A)
        if poles.real.max() >= 0:
            return np.inf
        sizes = np.abs(poles)
        grid = np.logspace(np.log10(sizes.min() / 30), np.log10(3 * sizes.max()), FREQUENCIES)
        omegas = np.concatenate([[0.0], grid, np.abs(poles.imag)])
        E = np.eye(len(A))[:, : self._n * (self._N - 1)]
        responses = self._root @ np.linalg.solve(1j * omegas[:, None, None] * np.eye(len(A)) - A, E)
        peaks = np.linalg.norm(responses, 2, axis=(1, 2))
        self.frequency = float(omegas[int(peaks.argmax())])
        return float(peaks.max())


def weakest_agreement(
    network: Network, gains: Gains, weights: RhoWeights, *, seed: int = 0
) -> tuple[Float[np.ndarray, " n"], float]:
    """Return the common state with the largest linear peak gain that a seeded search finds, and that gain."""
    from scipy.optimize import minimize

    peak, n = PeakGain(network, gains, weights), network.agent.n
    origin = np.zeros(n)
    if network.agent.lure.is_linear:
        return origin, peak(origin)
    low, high = np.clip(network.agent.box.T, -OPEN_RANGE, OPEN_RANGE)
    draws = np.random.default_rng(seed).uniform(low, high, size=(DRAWS, n))
    best = max([origin, *draws], key=peak)
    most = {"maxfev": REFINEMENTS * n}
    found = minimize(lambda a: -peak(np.clip(a, low, high)), best, method="Nelder-Mead", options=most)
    refined = np.clip(found.x, low, high)
    # Only H a matters to phi: the rest of a goes back to zero.
    refined = np.linalg.pinv(network.agent.lure.H) @ (network.agent.lure.H @ refined)
    best = max([best, refined], key=peak)
    return best, peak(best)
