"""The worst L2 disturbance that a search finds: it holds the measured gain against the certified rho from below.

    maximise |z|_L2 / |xi_d|_L2  over held disturbances xi of a finite horizon, x_d(0) = 0, x_C(0) = 0,

for the nonlinear loop (12). With J(w) = int |z|^2 dt as a function of the samples w of xi_d, power iteration is
w <- E grad J(w) / |grad J(w)|. Where the loop is linear, J = |G w|^2 and this is the iteration with G*G, G* the
adjoint: it ends at the largest singular value. At larger energies E it climbs on the sphere |w| = E: a step that does
not raise J is shortened. The gradient is CasADi's reverse mode through the integrator.

All agents may start at any common state a, and their mean may be kept there by a disturbance common to all
(`Scenario.pinned`): neither has a part in x_d(0) or xi_d. So the slopes of phi that the disagreement meets are those
around any a, and the smallest energies see the linear loop with that slope.

What is found is a lower bound of the gain; that nothing worse exists is what the certificate proves.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from jaxtyping import Float

from lockstep.check.system.loop import Gains
from lockstep.model.network import Network
from lockstep.model.simulation.disturbance import Samples
from lockstep.model.simulation.equations import closed_loop
from lockstep.model.simulation.integrate import runge_kutta_step
from lockstep.model.simulation.results.trajectory import RhoWeights
from lockstep.model.simulation.scenario import Scenario

ENERGIES = (1e-3, 1.0, 10.0)
"""|xi_d| tried: the search starts where the loop is linear, and far above rounding."""

HALVINGS = 4


@dataclass(frozen=True, eq=False)
class Worst:
    """What was found: xi (K, N, n) held for `step` s, the common start a (n,), the energy |xi_d| and the gain.

    gain: of the run as integrated in the search, a step per sample; `energies(...).gain` of a finer run (`scenario`) is
    the figure to report.
    """

    samples: Float[np.ndarray, "K N n"]
    step: float
    common: Float[np.ndarray, " n"]
    energy: float
    gain: float

    @property
    def disturbance(self) -> Samples:
        """What to simulate."""
        return Samples(self.samples, self.step)

    def scenario(self, *, step: float, tail: float = 1.5) -> Scenario:
        """Return the run that shows the gain, `tail` times as long as the disturbance."""
        horizon = tail * len(self.samples) * self.step
        return Scenario(self.start, horizon, step, self.disturbance, pinned=True)

    @property
    def start(self) -> Float[np.ndarray, "N n"]:
        """The states to start from: all agents in a."""
        return np.tile(self.common, (self.samples.shape[1], 1))


def worst_disturbance(
    network: Network,
    gains: Gains,
    weights: RhoWeights,
    *,
    horizon: float = 10.0,
    step: float = 0.02,
    energies: Sequence[float] = ENERGIES,
    common: Sequence[Float[np.ndarray, " n"]] | None = None,
    iterations: int = 30,
    seed: int = 0,
) -> Worst:
    """Return the worst disturbance found over common states and energies.

    Args:
        network, gains: the loop (12), continuous.
        weights: what z is; what u weighs in it is left out of the search, so that `Worst.gain` is that of the rest.
        horizon, step: the disturbance is held for `step` s at a time and ends after `horizon` s; a gain that builds
            up slowly needs a longer horizon.
        energies: |xi_d|_L2 tried, ascending; each starts from where the one before ended.
        common: the common states tried; by default the origin.
        iterations: of each climb.
        seed: of the first direction.
    """
    climb = _Climb(network, gains, weights, round(horizon / step), step)
    tried = [np.zeros(network.agent.n)] if common is None else [np.asarray(a, dtype=float) for a in common]
    best: Worst | None = None
    for a in tried:
        for found in climb.from_common(a, energies, iterations, seed):
            if best is None or found.gain > best.gain:
                best = found
    assert best is not None
    return best


class _Climb:
    """J and its gradient for disturbances of K samples, in coordinates w with |w|^2 = int |xi_d|^2 dt."""

    def __init__(self, network: Network, gains: Gains, weights: RhoWeights, K: int, step: float) -> None:
        self._network, self._K, self._step = network, K, step
        scales = weights.scales if len(weights.scales) else np.ones(network.agent.n)
        self._lift = np.kron(_factor(weights), np.diag(scales)) / np.sqrt(step)
        self._both = self._value_and_gradient(gains, weights)

    def from_common(
        self, a: Float[np.ndarray, " n"], energies: Sequence[float], iterations: int, seed: int
    ) -> Iterator[Worst]:
        """Climb at each energy in turn, starting from a."""
        w = np.random.default_rng(seed).standard_normal((self._lift.shape[1], self._K))
        for energy in energies:
            w, J = self._at(w * (energy / np.linalg.norm(w)), a, iterations)
            xi = (self._lift @ w).T.reshape(self._K, self._network.N, self._network.agent.n)
            yield Worst(xi, self._step, a, energy, float(np.sqrt(J)) / energy)

    def _at(
        self, w: Float[np.ndarray, "d K"], a: Float[np.ndarray, " n"], iterations: int
    ) -> tuple[Float[np.ndarray, "d K"], float]:
        energy = float(np.linalg.norm(w))
        J, slope = self._evaluate(w, a)
        for _ in range(iterations):
            length = float(np.linalg.norm(slope))
            if not (np.isfinite(J) and 0 < length < np.inf):
                break
            goal = slope * (energy / length)
            for _ in range(HALVINGS):
                value, gradient = self._evaluate(goal, a)
                if value > J:
                    break
                goal = goal + w
                goal *= energy / np.linalg.norm(goal)
            else:
                break
            done = value < J * (1 + 1e-6)
            w, J, slope = goal, value, gradient
            if done:
                break
        return w, J if np.isfinite(J) else 0.0

    def _evaluate(
        self, w: Float[np.ndarray, "d K"], a: Float[np.ndarray, " n"]
    ) -> tuple[float, Float[np.ndarray, "d K"]]:
        J, slope = self._both(w, a)
        return float(J), np.asarray(slope)

    def _value_and_gradient(self, gains: Gains, weights: RhoWeights) -> ca.Function:
        """Build (w, a) -> (J, dJ/dw), J by trapezoids over the samples."""
        N, n, h = self._network.N, self._network.agent.n, self._step
        f = closed_loop(self._network, gains, pinned=True)
        size = f.size1_in(0)
        X, xi = ca.SX.sym("X", size), ca.SX.sym("xi", N * n)
        ahead = runge_kutta_step(f)(X, ca.vertcat(0, h, xi, xi, xi))
        run = ca.Function("held", [X, xi], [ahead]).mapaccum(self._K)
        W = ca.DM(_output_form(weights, N))
        cost = ca.Function("cost", [X], [ca.bilin(W, X, X)])
        w, a = ca.MX.sym("w", self._lift.shape[1], self._K), ca.MX.sym("a", n)
        start = ca.vertcat(ca.repmat(a, N), ca.MX.zeros(size - N * n))
        states = run(start, ca.DM(self._lift) @ w)
        each = cost.map(self._K)(states)
        J = h * (ca.sum2(each) - each[-1] / 2)
        return ca.Function("J", [w, a], [J, ca.gradient(J, w)])


def _factor(weights: RhoWeights) -> Float[np.ndarray, "N N-1"]:
    """Return F with F' (T'ST) F = I whose columns span the disagreements."""
    values, vectors = np.linalg.eigh(weights.metric)
    return np.asarray(vectors[:, 1:] / np.sqrt(values[1:]))


def _output_form(weights: RhoWeights, N: int) -> Float[np.ndarray, "X X"]:
    """Return |z|^2 as a form on X."""
    from scipy.linalg import block_diag

    return np.asarray(block_diag(np.kron(weights.metric, weights.R), np.kron(np.eye(N), weights.Q)))
