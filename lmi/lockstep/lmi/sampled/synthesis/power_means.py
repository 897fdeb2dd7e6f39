"""Power means of the sampled loop and of the continuous one as smooth functions of gains, multipliers and rho.

The unknowns are the gains K of every agent, sampled by Tustin's rule, log m of the sampled multiplier and log rho. The
lifted period depends on M and rho alone (`performance`), the closed loop on the discrete controllers, affinely:

    a = start x_cl,   x_cl+ = N x_cl + J w_d,   N = [A_d start; advanced],
    cost x_cl' (start' C_d'C_d start + T_s diag(0, I (x) Q)) x_cl.

The weight W of the inputs adds T_s u' (I (x) W) u to the cost. Noise nu of the outputs counts rho^2 T_s nu' (S (x) I) nu, S
as in `check.sampled.l2_gain`: it enters the state (x_d, nu, the rest of x_cl), one step late, which changes no gain.

The continuous loop has a multiplier of its own, and M^-1 (x) G G' + rho^-2 S^-1 (x) I and M (x) alpha^2 H'H + S (x) R in
place of B_d B_d' and C_d'C_d: it only keeps rho below a limit that is a choice, so W and the noise are left out there.
Where the gains are to keep a decay sigma it is the loop of e^(sigma t) x_cl. `response` makes one number of either, at most
0 where rho is a bound, as far as its points show.
"""

from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float, Int

from lockstep.check.continuous.inequality import Performance
from lockstep.check.numbers import as_floats
from lockstep.check.sampled.l2_gain import running_cost
from lockstep.check.sampled.loop import SampledLoop
from lockstep.check.system.loop import build_loop
from lockstep.lmi.analysis.response import Poles, power_mean
from lockstep.lmi.sampled.synthesis.lifting_gradient import lifted_period
from lockstep.lmi.sampled.synthesis.tustin import pulled_back, tustin
from lockstep.lmi.shapes import GainBlocks, PairWeights

PENALTY = 10.0
"""What the square of the continuous loop's g_p counts where it exceeds 0."""

BESIDE = np.array([-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0])
FREQUENCIES = 100
"""Points of a grid, besides those of the loop's poles."""


class ValueAndSlopes(NamedTuple):
    """A value and its slopes in the gains, log m and log rho."""

    value: float
    K: GainBlocks
    logs: PairWeights
    log_rho: float


class ClosedLoopMaps(NamedTuple):
    """The sampled loop with discrete controllers, on some of z: a = start z, the rest of x_cl+, and u; or slopes in them."""

    start: Float[np.ndarray, "a z"]
    advanced: Float[np.ndarray, "r z"]
    applied: Float[np.ndarray, "u z"]


class SampledObjective:
    """The two loops of one problem, for any gains.

    columns: where (x_d, nu, the rest of x_cl) are in z;  x_cl: where it is;  seen: (N, n_C + q, n_z), (x_C, r) of all agents;
    weight: T_s (I (x) W).
    """

    def __init__(self, loop: SampledLoop, weights: Performance, order: int, decay: float = 0.0) -> None:
        """Take the sampled loop in doubles with controllers that are zero, and the decay of the continuous one."""
        self.loop, self.weights, self.order = loop, weights, order
        plant, d = loop.network.plant, loop.network.d
        self.continuous = build_loop(plant, d, order, decay)
        self._U_t = np.stack([U.T for U in self.continuous.U])
        self._Y_t = np.stack([Y.T for Y in self.continuous.Y])
        self.period = loop.network.period
        self.has_phi = bool(plant.sizes[3] and plant.sizes[4] and loop.network.alpha > 0)
        self.pairs = (
            np.array([as_floats(d.pair_multiplier(i, j)) for i, j in d.pairs()])
            if self.has_phi
            else np.zeros((0, 0, 0))
        )
        self.x_cl = np.arange(loop.n_x)
        self.columns = np.r_[: loop.n_d, loop.outputs.start : loop.outputs.stop, loop.n_d : loop.n_x]
        self.seen = np.stack(loop.seen)
        self.weight = np.zeros((len(loop.applied),) * 2)
        if len(weights.W):
            self.weight = self.period * np.kron(np.eye(d.N), weights.W)

    # The sampled loop.

    def closed(self, K: GainBlocks, columns: Int[np.ndarray, " z"]) -> ClosedLoopMaps:
        """Return the sampled loop with these gains, on these entries of z."""
        into = self.loop.underflows
        computed = (tustin(K, self.order, self.period) @ self.seen[:, :, columns]).reshape(-1, len(columns))
        return ClosedLoopMaps(*(part[:, columns] + part[:, into] @ computed for part in self._parts))

    def gains(self, K: GainBlocks, columns: Int[np.ndarray, " z"], slopes: ClosedLoopMaps) -> GainBlocks:
        """Return the slope in K from those in the parts of `closed`."""
        into = self.loop.underflows
        computed = sum(part[:, into].T @ slope for part, slope in zip(self._parts, slopes, strict=True))
        rows = computed.reshape(len(K), -1, len(columns))
        return pulled_back(K, rows @ self.seen[:, :, columns].swapaxes(1, 2), self.order, self.period)

    @property
    def _parts(self) -> tuple[Float[np.ndarray, "_ n_z"], ...]:
        return self.loop.start, self.loop.advanced, self.loop.applied

    def _of_step(self, K: GainBlocks, slope: Float[np.ndarray, "n_x n_x"]) -> GainBlocks:
        """Return the slope in K from that in `step`."""
        n_d, none = self.loop.n_d, np.zeros((len(self.loop.applied), self.loop.n_x))
        return self.gains(K, self.x_cl, ClosedLoopMaps(self._flow.T @ slope[:n_d], slope[n_d:], none))

    @cached_property
    def _agents(self) -> tuple[Float[np.ndarray, "n_d n_d"], Float[np.ndarray, "n_d k"]]:
        unit = np.eye(self.loop.network.d.N - 1)
        return np.kron(unit, self.loop.network.plant.A), np.kron(unit, self.loop.into)

    @cached_property
    def _running(self) -> Float[np.ndarray, "z z"]:
        form = running_cost(self.loop, Performance(self.weights.R, self.weights.Q), 1.0)
        form[self.loop.outputs, self.loop.outputs] = 0.0
        return np.asarray(form[np.ix_(self.columns, self.columns)])

    @cached_property
    def _noise(self) -> Float[np.ndarray, "k k"]:
        """1 / T_s S^-1 (x) I of the outputs' noise, at rho = 1."""
        d, count = self.loop.network.d, self.loop.outputs.stop - self.loop.outputs.start
        return np.asarray(np.kron(np.linalg.inv(d.S), np.eye(count // (d.N - 1))) / self.period)

    def _ways(
        self, logs: PairWeights, log_rho: float
    ) -> tuple[Float[np.ndarray, "n_d n_d"], Float[np.ndarray, "n_d n_d"]]:
        """Return E E' and F'F."""
        EE, FF = np.exp(-2 * log_rho) * self._disturbed, self._weighed
        if self.has_phi:
            M, (GG, HH) = self._M(logs), self.loop.network.squares
            EE, FF = EE + np.kron(np.linalg.inv(M), GG), FF + np.kron(M, HH)
        return EE, FF

    def _M(self, logs: PairWeights) -> Float[np.ndarray, "d d"]:
        return np.asarray(np.tensordot(np.exp(logs), self.pairs, 1))

    @cached_property
    def _disturbed(self) -> Float[np.ndarray, "n_d n_d"]:
        scales = self.weights.states if len(self.weights.states) else np.ones(len(self.loop.network.plant.A))
        return np.kron(np.linalg.inv(self.loop.network.d.S), np.diag(scales**2))

    @cached_property
    def _weighed(self) -> Float[np.ndarray, "n_d n_d"]:
        return np.kron(self.loop.network.d.S, self.weights.R)

    def _numbers(
        self,
        logs: PairWeights,
        log_rho: float,
        EE: Float[np.ndarray, "n_d n_d"],
        FF: Float[np.ndarray, "n_d n_d"],
    ) -> tuple[PairWeights, float]:
        """Return the slopes in log m and log rho from those in E E' and F'F."""
        slope_rho = -2 * np.exp(-2 * log_rho) * float((EE * self._disturbed).sum())
        if not self.has_phi:
            return np.zeros(0), slope_rho
        GG, HH = self.loop.network.squares
        n, copies = len(GG), len(self.pairs[0])
        inverse = np.linalg.inv(self._M(logs))
        by_inverse = np.einsum("ikjl,kl->ij", EE.reshape(copies, n, copies, n), GG)
        by_M = np.einsum("ikjl,kl->ij", FF.reshape(copies, n, copies, n), HH)
        slope_M = by_M - inverse.T @ by_inverse @ inverse.T
        return np.exp(logs) * np.einsum("kij,ij->k", self.pairs, slope_M), slope_rho

    def sampled(
        self, K: GainBlocks, logs: PairWeights, log_rho: float, points: Complex[np.ndarray, " s"], p: int
    ) -> ValueAndSlopes | None:
        """Return g_p of the sampled loop; None where it is not stable, or the period alone exceeds rho."""
        from scipy.linalg import block_diag

        one = lifted_period(*self._agents, *self._ways(logs, log_rho), self.period)
        if one is None:
            return None
        n_d, noise = self.loop.n_d, np.exp(-2 * log_rho) * self._noise
        closed = self.closed(K, self.columns)
        start, A_d, Q = closed.start, one.lifted.A_d, one.lifted.CC_d
        late = np.zeros((len(noise), len(self.columns)))
        poles = Poles(np.vstack([A_d @ start, late, closed.advanced]), continuous=False)
        if not poles.stable:
            return None
        cost = start.T @ Q @ start + closed.applied.T @ self.weight @ closed.applied + self._running
        mean = power_mean(poles, block_diag(one.lifted.BB_d, noise), cost, points, p)
        slopes = ClosedLoopMaps(
            A_d.T @ mean.N[:n_d] + 2 * Q @ start @ mean.Q,
            mean.N[n_d + len(noise) :],
            2 * self.weight @ closed.applied @ mean.Q,
        )
        EE, FF = one.pulled_back(mean.N[:n_d] @ start.T, mean.S[:n_d, :n_d], start @ mean.Q @ start.T)
        by_logs, by_rho = self._numbers(logs, log_rho, EE, FF)
        by_rho -= 2 * float((mean.S[n_d:, n_d:] * noise).sum())
        return ValueAndSlopes(mean.value, self.gains(K, self.columns, slopes), by_logs, by_rho)

    def angles(self, K: GainBlocks) -> Complex[np.ndarray, " s"]:
        """Return points on the unit circle: a grid of frequencies, and the angles of the linear loop's poles."""
        poles = np.linalg.eigvals(self.step(K)).astype(complex)
        rates = np.log(poles[np.abs(poles) > 1e-9])
        slow = 0.1 * float(np.abs(rates).min(initial=1.0))
        beside = _beside(rates)
        grid = np.concatenate([[0.0], np.geomspace(slow, np.pi, FREQUENCIES), beside[beside < np.pi]])
        return np.exp(1j * np.unique(grid.round(12)))

    def step(self, K: GainBlocks) -> Float[np.ndarray, "n_x n_x"]:
        """Return the matrix of the linear loop over one period."""
        closed = self.closed(K, self.x_cl)
        return np.vstack([self._flow @ closed.start, closed.advanced])

    @cached_property
    def _flow(self) -> Float[np.ndarray, "n_d a"]:
        from scipy.linalg import expm

        A, B = self._agents
        whole = np.zeros((len(A) + B.shape[1],) * 2)
        whole[: len(A)] = np.hstack([A, B])
        return np.asarray(expm(self.period * whole)[: len(A)])

    def growth(self, K: GainBlocks) -> tuple[float, GainBlocks]:
        """Return log |lambda| / T of the sampled linear loop's largest eigenvalue, in 1/s, and its slope in K."""
        from scipy.linalg import eig

        values, left, right = eig(self.step(K), left=True, right=True)
        worst = int(np.argmax(np.abs(values)))
        size = max(float(np.abs(values[worst])), 1e-300)
        l, r = left[:, worst].conj(), right[:, worst]
        slope = (np.outer(l, r) / (l @ r) / values[worst]).real / self.period
        return float(np.log(size)) / self.period, self._of_step(K, slope)

    def edge(self, K: GainBlocks) -> tuple[float, GainBlocks] | None:
        """Return log tr of the sampled linear loop's Gramian, and its slope in K; None where it is not stable."""
        poles = Poles(self.step(K), continuous=False)
        if not poles.stable:
            return None
        value, slope = poles.log_gramian()
        return value, self._of_step(K, slope)

    # The continuous loop.

    def in_continuous_time(
        self,
        K: GainBlocks,
        logs: PairWeights,
        log_rho: float,
        points: Complex[np.ndarray, " s"],
        p: int,
        edge: float = 0.0,
    ) -> ValueAndSlopes | None:
        """Return PENALTY max(0, g_p)^2 of the continuous loop, and its edge; None where it is not stable."""
        loop, n_d = self.continuous, self.loop.n_d
        A_cl = loop.A_cl(K)
        poles = Poles(A_cl, continuous=True)
        if not poles.stable:
            return None
        EE, FF = self._ways(logs, log_rho)
        cost = np.zeros_like(A_cl)
        cost[:n_d, :n_d] = FF
        cost[n_d:, n_d:] = np.kron(np.eye(loop.d.N), self.weights.Q)
        mean = power_mean(poles, EE, cost, points, p)
        near, near_slope = poles.log_gramian()
        excess = max(0.0, mean.value)
        rate = 2 * PENALTY * excess
        slope = self._U_t @ (rate * mean.N + edge * near_slope) @ self._Y_t
        by_logs, by_rho = self._numbers(logs, log_rho, rate * mean.S, rate * mean.Q[:n_d, :n_d])
        return ValueAndSlopes(PENALTY * excess**2 + edge * near, slope, by_logs, by_rho)

    def frequencies(self, K: GainBlocks) -> Complex[np.ndarray, " s"]:
        """Return points on the imaginary axis: a grid over the loop's poles, and their frequencies."""
        poles = np.linalg.eigvals(self.continuous.A_cl(K))
        sizes = np.abs(poles)[np.abs(poles) > 1e-9]
        low, high = 0.1 * sizes.min(initial=1.0), 10 * sizes.max(initial=1.0)
        grid = np.concatenate([[0.0], np.geomspace(low, high, FREQUENCIES // 2), _beside(poles)])
        return 1j * np.unique(grid)


def _beside(poles: Complex[np.ndarray, " n"]) -> Float[np.ndarray, " k"]:
    """Return frequencies at the poles and on their slopes."""
    found = (np.abs(poles.imag) + np.multiply.outer(BESIDE, np.abs(poles.real))).ravel()
    return np.asarray(found[found >= 0])
