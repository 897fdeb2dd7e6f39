"""Gains for messages that are lost or late: a descent on rho of the sampled loop with the ages as one more channel of it.

With v(k) = d(k) - d(k - 1) of the links' differences d = Y x_cl, a message's error zeta is at most as large as D v in the
form X (`lockstep.check.sampled.messages`). So zeta is one more disturbance, priced X, and D v one more thing that is
weighed with X. Both enter the power mean of `response` through the state (x_cl, d(k - 1)):

    N = [N_xi 0; Y 0],   S = diag(S, 0) + N_nu X^-1 N_nu',   Q = diag(Q, 0) + D^2 V'X V,   V = [Y -I],

whose slopes in the gains, log m, rho and X are exact but for what zeta adds to the cost within its own period, which is left
out, and the outputs' noise. What chance loses counts as an age too. Nothing is claimed of what comes back: `witnesses`
and the checker decide.
"""

import numpy as np
from jaxtyping import Complex, Float

from lockstep.check.continuous.inequality import Performance
from lockstep.check.sampled.loop import SampledLoop
from lockstep.lmi.analysis.response import Poles, power_mean
from lockstep.lmi.sampled.synthesis.lifting_gradient import lifted_period
from lockstep.lmi.sampled.synthesis.power_means import ClosedLoopMaps, SampledObjective, ValueAndSlopes
from lockstep.lmi.shapes import GainBlocks, PairWeights


class AgedObjective(SampledObjective):
    """The loops of one problem whose messages are up to `age` periods old; `logs` holds log m, then the roots of X.

    A root of X, one for each link, is lower triangular, its diagonal as logarithms.
    """

    def __init__(self, loop: SampledLoop, weights: Performance, order: int, age: float) -> None:
        """Take what `SampledObjective` takes, and the age D in periods, not necessarily whole."""
        super().__init__(loop, weights, order)
        self.age, self.q = age, len(loop.network.plant.C)
        self.links = len(loop.differences) // self.q
        self.columns = np.r_[0 : loop.n_x, loop.messages.start : loop.messages.stop]
        Y = loop.differences[:, : loop.n_x]
        self.change = np.hstack([Y, -np.eye(len(Y))])

    def packed(self, m: PairWeights, X: Float[np.ndarray, "links q"]) -> Float[np.ndarray, " logs"]:
        """Return weights and forms of all links as one vector."""
        roots = np.linalg.cholesky(X.reshape(-1, self.q, self.q))
        for k in range(self.q):
            roots[:, k, k] = np.log(roots[:, k, k])
        return np.concatenate(
            [np.log(m) if self.has_phi else np.zeros(0), roots[:, *np.tril_indices(self.q)].ravel()]
        )

    def roots(self, logs: Float[np.ndarray, " logs"]) -> Float[np.ndarray, "links q q"]:
        """Return the lower triangular roots of X."""
        out = np.zeros((self.links, self.q, self.q))
        out[:, *np.tril_indices(self.q)] = logs[len(self.pairs) :].reshape(self.links, -1)
        for k in range(self.q):
            out[:, k, k] = np.exp(out[:, k, k])
        return out

    def sampled(
        self,
        K: GainBlocks,
        logs: Float[np.ndarray, " logs"],
        log_rho: float,
        points: Complex[np.ndarray, " s"],
        p: int,
    ) -> ValueAndSlopes | None:
        """Return g_p of the sampled loop with late messages; None where it is not stable, or the period exceeds rho."""
        n, n_d = self.loop.n_x, self.loop.n_d
        m, L = logs[: len(self.pairs)], self.roots(logs)
        one = lifted_period(*self._agents, *self._ways(m, log_rho), self.period)
        if one is None:
            return None
        start, advanced, applied = self.closed(K, self.columns)
        A_d, S, Q = one.lifted.A_d, one.lifted.BB_d, one.lifted.CC_d
        step = np.vstack([A_d @ start, advanced])
        into, own, u = step[:, n:], start[:, :n], applied[:, :n]
        size, links = n + into.shape[1], into.shape[1]
        X, X_inv = np.zeros((links, links)), np.zeros((links, links))
        for e, root in enumerate(L):
            at = slice(e * self.q, (e + 1) * self.q)
            X[at, at], X_inv[at, at] = root @ root.T, np.linalg.inv(root @ root.T)
        N, S_all, Q_all = (np.zeros((size, size)) for _ in range(3))
        N[:n, :n], N[n:, :n] = step[:, :n], self.change[:, :n]
        S_all[:n, :n] = into @ X_inv @ into.T
        S_all[:n_d, :n_d] += S
        Q_all[:n, :n] = own.T @ Q @ own + u.T @ self.weight @ u + self._running[:n, :n]
        Q_all += self.age**2 * self.change.T @ X @ self.change
        poles = Poles(N, continuous=False)
        if not poles.stable:
            return None
        mean = power_mean(poles, S_all, Q_all, points, p)
        by_step = np.hstack([mean.N[:n, :n], 2 * mean.S[:n, :n] @ into @ X_inv])
        by_start = A_d.T @ by_step[:n_d]
        by_start[:, :n] += 2 * Q @ own @ mean.Q[:n, :n]
        by_applied = np.zeros_like(applied)
        by_applied[:, :n] = 2 * self.weight @ u @ mean.Q[:n, :n]
        by_K = self.gains(K, self.columns, ClosedLoopMaps(by_start, by_step[n_d:], by_applied))
        EE, FF = one.pulled_back(by_step[:n_d] @ start.T, mean.S[:n_d, :n_d], own @ mean.Q[:n, :n] @ own.T)
        by_m, by_rho = self._numbers(m, log_rho, EE, FF)
        by_X = (
            self.age**2 * self.change @ mean.Q @ self.change.T
            - X_inv @ into.T @ mean.S[:n, :n] @ into @ X_inv
        )
        return ValueAndSlopes(mean.value, by_K, np.concatenate([by_m, self._of_roots(by_X, L)]), by_rho)

    def _of_roots(
        self, by_X: Float[np.ndarray, "l l"], L: Float[np.ndarray, "links q q"]
    ) -> Float[np.ndarray, " k"]:
        q, out = self.q, np.zeros_like(L)
        for e, root in enumerate(L):
            block = by_X[e * q : (e + 1) * q, e * q : (e + 1) * q]
            out[e] = (block + block.T) @ root
            for k in range(q):
                out[e, k, k] *= root[k, k]
        return out[:, *np.tril_indices(q)].ravel()
