"""A smooth stand-in for the H-infinity norm of the loop, as a function of the gains and the multipliers alone.

Eliminate P from F < 0 of `inequality` (the Kalman-Yakubovich-Popov lemma): for a stable loop there is a P if and only
if at every frequency, with X(omega) = (j omega I - A_cl)^-1 [E_G, X, E], W = sum_k w_k W_k and D = sum_k w_k D_k of
the multipliers w,

    x^H (diag(R, Q) + W) x - v^H D v < rho^2 |xi|^2,      x = X(omega) (v, xi),

(where the claim has them, u' W u beside x^H diag(R, Q) x and the noise of the outputs in xi: X and Psi then hold K too)
that is, rho^2 exceeds the largest eigenvalue lambda of Psi_xx + Psi_xv (D - Psi_vv)^-1 Psi_vx, where Psi =
X^H (diag(R, Q) + W) X, and D > Psi_vv. Where even that fails, the gain of the whole loop is lowered first: the largest
eigenvalue of Psi against diag(D, rho_0^2 I) for a rho_0 that is generous, which is below one where rho_0 has a
certificate. The maximum over the frequencies and eigenvalues is not smooth and a descent on it stalls at its kinks, so
what is lowered is

    log [ sum_omega sum_i lambda_i(omega)^p / n_omega ] / p - (b / p) sum_i log det(I - K_i K_i' / l^2)

with p growing and the gain limit l inside: a p-norm of the eigenvalues and a barrier, to which log tr of the Gramian of
each A_Ci + rate I is added where controllers are to be stable by themselves. Its slope costs one pass back
through the resolvent. From random stable gains it comes within a few tenths of the least rho in a second, where a
program that moves P along takes minutes, and it prefers gains that are well damped at all frequencies, because every
one of them counts.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float, Shaped

from lockstep.check.continuous.inequality import Claim
from lockstep.check.system.loop import Loop
from lockstep.lmi.analysis.certificate_sdp import AffineF, eliminates_P
from lockstep.lmi.analysis.frequency_multipliers import Form
from lockstep.lmi.analysis.gain_limit import limit_barrier
from lockstep.lmi.analysis.p_norm import are_stable, dominant, frequencies_of, gram, p_norm, thinned
from lockstep.lmi.analysis.response import Poles
from lockstep.lmi.quasi_newton import descend
from lockstep.lmi.shapes import GainBlocks, GainLimit, Multipliers, Vector

Stages = tuple[tuple[int, int], ...]
"""p and the number of steps of each stage; the frequencies are chosen anew before each."""

TO_A_CERTIFICATE: Stages = ((5, 30), (5, 30), (9, 30), (13, 60), (25, 60), (61, 60))
TO_SMALL_RHO: Stages = ((5, 60), (5, 60), (13, 60))
ON_TO_THE_MAXIMUM: Stages = ((13, 100), (33, 100), (101, 100))
NEXT_TO_IT: Stages = ((33, 60), (101, 60))
"""From stable gains to ones with some rho; from there to a small rho, which tells promising gains from others; on from
those; and on from gains that are next to a maximum already: of a smaller p they would only be led away from it."""

ENOUGH = 0.5
"""The square of the gain at rho_0 below which rho itself is lowered: less than one, with room."""

SETTLED, SETTLED_OF_LARGE = 1e-6, 1e-4
"""A descent ends where a step promises to lower the logarithm of rho^2 by less; of a large loop a step takes seconds."""

GENEROUS = 100.0
"""By how much W exceeds what R and Q need to begin with, and rho_0^2 what the disturbance needs."""

BARRIER = 0.25
"""b, the weight of the barrier: the larger p, the nearer the gains may come to their limit."""

SCALES, NEAR_SCALES = np.logspace(-6, 2, 17), np.logspace(-0.25, 0.25, 9)
"""What the multipliers are scaled by once there is a certificate: they began generous."""

GRID = 40
"""Frequencies over the range of the poles, besides those at the poles."""

RETRIES = 3
"""How often a stage is repeated with more frequencies where its gain turned out to lie between the chosen ones."""

REGULAR = 1e-14
"""What is added to Y Y^H, relative to the largest it may be, so that it has a factor."""

LARGEST = 60.0
"""Bound on the logarithm of a multiplier: beyond it doubles overflow where they are squared."""


@dataclass(frozen=True)
class Descended:
    """Gains and multipliers after a descent, at the last frequencies; infinite where there is none.

    gain: the square of the gain at rho_0;  rho: in the units of the loop.
    """

    K: GainBlocks
    w: Multipliers
    gain: float
    rho: float


_At = tuple[GainBlocks, Float[np.ndarray, "n n"], Complex[np.ndarray, "f n s"]]
"""K, W and X."""


class _Response(NamedTuple):
    """The resolvent by the modes of A_cl, the states X it makes of the signals, M whose eigenvalues count, and the signals of
    unit vectors, with which dM = (X s)^H dW (X s)."""

    modes: Complex[np.ndarray, "n n"]
    back: Complex[np.ndarray, "n n"]
    resolvent: Complex[np.ndarray, "f n"]
    X: Complex[np.ndarray, "f n s"]
    W: Float[np.ndarray, "n n"]
    M: Complex[np.ndarray, "f d d"]
    signals: Shaped[np.ndarray, "f s d"]


class SmoothedNorm:
    """The p-norm for one loop and claim, as a function of x = (K / units, log w).

    Args:
        loop: in units in which its numbers are near one.
        claim: alpha, R, Q and delta.
        gain_limit: of each agent's gains.
        units: the size of an entry of the gains.
        shared: whether all agents have the same gains, and all pairs the same weights: x then holds each once. The fragility
            multipliers stay apart.
        rate: that each A_Ci is to have by itself, Re lambda < -rate; None to ask nothing of them.
    """

    def __init__(
        self,
        loop: Loop,
        claim: Claim,
        gain_limit: GainLimit,
        units: Float[np.ndarray, "k l"],
        *,
        shared: bool = False,
        rate: float | None = None,
    ) -> None:
        self.loop, self.gain_limit, self.units = loop, gain_limit, units
        self.U, self.Y = np.stack(loop.U), np.stack(loop.Y)
        self.shape = len(loop.U), loop.U[0].shape[1], loop.Y[0].shape[0]
        form = AffineF(loop, np.zeros(self.shape), claim)
        first, n = form.stated.channels[0], loop.n_x
        inner = n + first.E.shape[1]
        unit = np.linalg.inv(np.linalg.cholesky(-form.slopes[-1][n:inner, n:inner])).T
        self.n_v = form.Z.shape[1] - inner
        self.into = np.hstack([form.Z[:, inner:], first.E @ unit])
        self.seen, self.noise = np.vstack(loop.Y), np.zeros((len(loop.Y) * self.shape[2], self.into.shape[1]))
        if first.Y:
            self.noise[:, self.n_v :] = np.vstack(first.Y) @ unit
        self.effort = np.zeros((self.shape[1],) * 2)
        self.effort[loop.order :, loop.order :] = claim.W if len(claim.W) else 0.0
        self.rate, self.order_kept = rate or 0.0, loop.order if rate is not None else 0
        self.weight, self.W = form.constant[:n, :n], form.slopes[:-1, :n, :n]
        self.D = -form.slopes[:-1, inner:, inner:]
        self.agents, pairs = (self.shape[0], len(loop.d.pairs())) if shared else (1, 1)
        self.alike = np.repeat([pairs, 1], [(len(self.W) - form.ways) // pairs, form.ways])
        self.first = np.cumsum(self.alike) - self.alike
        self.thins = eliminates_P(loop)

    def pack(self, K: GainBlocks, w: Multipliers) -> Vector:
        """Return x of gains and multipliers."""
        return np.concatenate([(K[:: self.agents] / self.units).ravel(), np.log(w[self.first])])

    def unpack(self, x: Vector) -> tuple[GainBlocks, Multipliers]:
        """Return the gains and the multipliers of x."""
        N, k, l = self.shape
        size = N // self.agents * k * l
        K, w = x[:size].reshape(-1, k, l) * self.units, np.exp(np.clip(x[size:], -LARGEST, LARGEST))
        return np.repeat(K, self.agents, axis=0), np.repeat(w, self.alike)

    def frequencies(self, x: Vector) -> Float[np.ndarray, " f"]:
        """Return frequencies at which the response of x is looked at: over the range of its poles, and about each."""
        found = frequencies_of(np.linalg.eigvals(self.loop.A_cl(self.unpack(x)[0])), GRID)
        return thinned(found) if self.thins else found

    def value(
        self, x: Vector, rho_0: float | None, p: int, frequencies: Float[np.ndarray, " f"]
    ) -> tuple[float, Vector]:
        """Return the smoothed logarithm of rho^2, or of the square of the gain at rho_0, and its slope.

        It is infinite where the loop is not stable, or the gains exceed their limit, or there is no rho.
        """
        K, w = self.unpack(x)
        barrier, here = self._barrier(K, BARRIER / p), self._response(K, w, rho_0, frequencies)
        norm, factor = (np.inf, None) if here is None else p_norm(here.M, p)
        if barrier is None or here is None or not np.isfinite(norm):
            return np.inf, np.zeros_like(x)
        signals = here.signals @ factor
        states = here.X @ signals
        force, of_K = _times(here.W, states), barrier[1]
        if self.effort.any():
            seen = _times(self.seen, states) + self.noise @ signals
            pushed = self._each(self.effort @ K, seen)
            force = force + _times(self.seen.T, self._each(K.swapaxes(1, 2), pushed))
            parts = (one.reshape(len(frequencies), len(K), -1, one.shape[2]) for one in (pushed.conj(), seen))
            of_K += 2 * np.einsum("fiad,fibd->iab", *parts, optimize=True).real
        # Of sum_f (back' (force_f^H modes resolvent_f)') (seen_f)' what does not depend on f is taken out of the sum.
        adjoint = (force.conj().swapaxes(1, 2) @ here.modes) * here.resolvent[:, None, :]
        turn = np.tensordot(adjoint, states, ([0, 1], [0, 2])) @ self.seen.T
        turn = turn + np.tensordot(adjoint, signals, ([0, 1], [0, 2])) @ self.noise.T
        turn = (here.back.T @ turn).real.reshape(-1, *self.shape[::2])
        of_K += 2 * np.einsum("ina,nil->ial", self.U, turn)
        v = signals[:, : self.n_v]
        granted = gram(v) if rho_0 is None else gram(v @ here.M, v)
        of_w = np.tensordot(self.W, gram(states), 2) - np.tensordot(self.D, granted, 2)
        value = norm - np.log(len(frequencies)) / p + barrier[0]
        each = (of_K * self.units).reshape(self.agents, -1).sum(axis=0)
        return float(value), np.concatenate([each, np.add.reduceat(w * of_w, self.first)])

    def level(self, x: Vector, rho_0: float | None, frequencies: Float[np.ndarray, " f"]) -> float:
        """Return the largest eigenvalue itself at the frequencies: rho^2, or the square of the gain at rho_0."""
        return float(self.levels(x, rho_0, frequencies).max())

    def levels(
        self, x: Vector, rho_0: float | None, frequencies: Float[np.ndarray, " f"]
    ) -> Float[np.ndarray, " f"]:
        """Return the largest eigenvalue at each frequency; infinite where there is none."""
        here = self._response(*self.unpack(x), rho_0, frequencies)
        return np.full(len(frequencies), np.inf) if here is None else np.linalg.eigvalsh(here.M)[:, -1]

    def _response(
        self, K: GainBlocks, w: Multipliers, rho_0: float | None, frequencies: Float[np.ndarray, " f"]
    ) -> "_Response | None":
        """Return the response at the frequencies; None where the loop is not stable or there is no rho."""
        poles, modes = np.linalg.eig(self.loop.A_cl(K))
        if not are_stable(poles):
            return None
        resolvent = 1 / (1j * frequencies[:, None] - poles)
        W, D = self.weight + np.tensordot(w, self.W, 1), np.tensordot(w, self.D, 1)
        try:
            back = np.linalg.inv(modes)
            X = modes @ (resolvent[:, :, None] * (back @ self._into(K)))
            at = K, W, X
            M, signals = self._rho(self._Psi(*at), D) if rho_0 is None else self._gain(at, D, rho_0)
        except np.linalg.LinAlgError:
            return None
        if not np.isfinite(M).all():
            return None
        return _Response(modes, back, resolvent, X, W, M, signals)

    def worst(
        self, K: GainBlocks, w: Multipliers, frequencies: Float[np.ndarray, " f"]
    ) -> tuple[float, float]:
        """Return the largest eigenvalues of Psi_vv against D of ones, and of Psi_xx, over the frequencies."""
        X = np.linalg.solve(
            1j * frequencies[:, None, None] * np.eye(self.loop.n_x) - self.loop.A_cl(K), self._into(K)
        )
        Psi = self._Psi(K, self.weight + np.tensordot(w, self.W, 1), X)
        vv, xx = Psi[:, : self.n_v, : self.n_v], Psi[:, self.n_v :, self.n_v :]
        root = np.linalg.inv(np.linalg.cholesky(self.D.sum(axis=0)))
        of_v = np.linalg.eigvalsh(root @ vv @ root.T).max(initial=0.0)
        return float(of_v), float(np.linalg.eigvalsh(xx).max())

    def _into(self, K: GainBlocks) -> Float[np.ndarray, "n s"]:
        """Return how the signals enter the states: the noise by the gains."""
        return np.asarray(self.into + np.hstack(list(self.U)) @ self._each(K, self.noise[None])[0])

    def _Psi(
        self, K: GainBlocks, W: Float[np.ndarray, "n n"], X: Complex[np.ndarray, "f n s"]
    ) -> Complex[np.ndarray, "f s s"]:
        Psi = X.conj().swapaxes(1, 2) @ _times(W, X)
        if self.effort.any():
            seen = self.seen @ X + self.noise
            Psi = Psi + seen.conj().swapaxes(1, 2) @ self._each(K.swapaxes(1, 2) @ self.effort @ K, seen)
        return np.asarray(Psi)

    def _each(
        self, blocks: Float[np.ndarray, "N a b"], signals: Shaped[np.ndarray, "f Nb d"]
    ) -> Shaped[np.ndarray, "f Na d"]:
        """Return each agent's block times its part of the signals."""
        parts = signals.reshape(len(signals), len(blocks), blocks.shape[2], -1)
        return np.asarray((blocks @ parts).reshape(len(signals), -1, signals.shape[2]))

    def _rho(self, Psi: Complex[np.ndarray, "f s s"], D: Float[np.ndarray, "v v"]) -> Form:
        """Return that of rho^2 at each frequency, the signals being (v, xi)."""
        n_v = self.n_v
        room = D - Psi[:, :n_v, :n_v]
        np.linalg.cholesky(room)
        answer = np.linalg.solve(room, Psi[:, :n_v, n_v:])
        unit = np.broadcast_to(np.eye(answer.shape[2]), (len(Psi), *(answer.shape[2],) * 2))
        return Psi[:, n_v:, n_v:] + Psi[:, n_v:, :n_v] @ answer, np.concatenate([answer, unit], axis=1)

    def _gain(self, at: _At, D: Float[np.ndarray, "v v"], rho_0: float) -> Form:
        """Return Psi against diag(D, rho_0^2 I) at each frequency.

        Where this is Y^H Y with fewer rows than signals: with L L^H = Y Y^H its eigenvalues are those of L^H L, and 0, and
        Q = Y^H L^-H makes Q L^H L Q^H of it, whatever the condition of L is.
        """
        K, W, X = at
        root = np.eye(X.shape[2]) / rho_0
        root[: self.n_v, : self.n_v] = np.linalg.inv(np.linalg.cholesky(D)).T
        rows, half = _half(self.effort), _half(W)
        if not 0 < len(half) + len(K) * len(rows) < len(root):
            return root.T @ self._Psi(*at) @ root, np.broadcast_to(root, (len(X), *root.shape))
        pushed = [self._each(rows @ K, self.seen @ X + self.noise)] if len(rows) else []
        Y = np.concatenate([_times(half, X), *pushed], axis=1) @ root
        room = REGULAR * np.abs(Y).max() ** 2 * Y.shape[2] * np.eye(Y.shape[1])
        L = np.linalg.cholesky(Y @ Y.conj().swapaxes(1, 2) + room)
        return L.conj().swapaxes(1, 2) @ L, root @ np.linalg.solve(L, Y).conj().swapaxes(1, 2)

    def _barrier(self, K: GainBlocks, weight: float) -> tuple[float, GainBlocks] | None:
        """Return the barrier of the limit, with the Gramians', and its slope; None outside."""
        room = limit_barrier(K, self.gain_limit)
        if room is None:
            return None
        value, slope, n_C = weight * room[0], weight * room[1], self.order_kept
        for i in range(len(K) if n_C else 0):
            poles = Poles(K[i, :n_C, :n_C] + self.rate * np.eye(n_C), continuous=True)
            if not poles.stable:
                return None
            near, turn = poles.log_gramian()
            value, slope[i, :n_C, :n_C] = value + weight * near, slope[i, :n_C, :n_C] + weight * turn
        return value, slope


def _times(
    matrix: Float[np.ndarray, "a b"], signals: Complex[np.ndarray, "f b d"]
) -> Complex[np.ndarray, "f a d"]:
    """Return a real matrix times complex signals, without making it complex: half of the work."""
    return np.asarray((matrix @ np.ascontiguousarray(signals).view(float)).view(complex))


def _half(form: Float[np.ndarray, "a a"]) -> Float[np.ndarray, "r a"]:
    """Return the rows of Y with Y' Y = form, positive semidefinite; none of a form that is not finite."""
    values, vectors = np.linalg.eigh(form)
    return np.asarray((vectors[:, values > 0] * np.sqrt(values[values > 0])).T)


def norm_descent(norm: SmoothedNorm, K: GainBlocks) -> Descended:
    """Take stable gains down to some rho, then down to a small one.

    Args:
        norm: of the loop.
        K: gains inside the limit, with which the loop is stable.
    """
    x, gain = norm.pack(K, np.ones(len(norm.W))), 0.0
    if not are_stable(np.linalg.eigvals(norm.loop.A_cl(K))):
        return Descended(*norm.unpack(x), np.inf, np.inf)
    if norm.n_v:
        x, rho_0 = _generous(norm, x)
        x, gain = _through(norm, x, rho_0, TO_A_CERTIFICATE, ENOUGH)
        if gain >= 1:
            return Descended(*norm.unpack(x), gain, np.inf)
        x = _with_multipliers_scaled(norm, x)
    x, square = _through(norm, x, None, TO_SMALL_RHO)
    return Descended(*norm.unpack(x), gain, float(np.sqrt(square)))


def with_multipliers(norm: SmoothedNorm, K: GainBlocks) -> Descended:
    """Return gains with the multipliers, all of them equal, for which their rho is least; infinite where there is none."""
    x = norm.pack(K, np.ones(len(norm.W)))
    if norm.n_v:
        x, _ = _generous(norm, x)
    for scales in (SCALES, NEAR_SCALES):
        x = _with_multipliers_scaled(norm, x, scales)
    return Descended(*norm.unpack(x), 0.0, float(np.sqrt(norm.level(x, None, norm.frequencies(x)))))


def refined_to_maximum(norm: SmoothedNorm, start: Descended, stages: Stages = ON_TO_THE_MAXIMUM) -> Descended:
    """Take gains that have a rho on, with p so large that the p-norm is next to the maximum."""
    x, square = _through(norm, norm.pack(start.K, start.w), None, stages)
    return Descended(*norm.unpack(x), start.gain, float(np.sqrt(square)))


def _through(
    norm: SmoothedNorm, x: Vector, rho_0: float | None, stages: Stages, enough: float = 0.0
) -> tuple[Vector, float]:
    level = np.inf
    for p, steps in stages:
        x, level = _stage(norm, x, rho_0, p, steps)
        if level < enough or not np.isfinite(level):
            break
    return x, level


def _stage(norm: SmoothedNorm, x: Vector, rho_0: float | None, p: int, steps: int) -> tuple[Vector, float]:
    """Lower the p-norm; where the new x peaks between the frequencies only, start again with those of the new x too."""
    frequencies = norm.frequencies(x)
    levels = norm.levels(x, rho_0, frequencies)
    before, settled = float(levels.max()), SETTLED_OF_LARGE if norm.thins else SETTLED
    for turn in range(RETRIES):
        used = frequencies[dominant(frequencies, levels, p)] if norm.thins and not turn else frequencies
        trial = descend(lambda at: norm.value(at, rho_0, p, used), x, steps, settled)  # noqa: B023
        seen = np.union1d(frequencies, norm.frequencies(trial))
        there = norm.levels(trial, rho_0, seen)
        level = float(there.max())
        if level <= before:
            return trial, level
        if len(used) == len(frequencies) and there[np.isin(seen, used)].max() > before:
            break  # the mean of order p fell and the maximum rose: not for want of frequencies
        frequencies, levels = seen, np.maximum(norm.levels(x, rho_0, seen), there)
    return x, before


def _generous(norm: SmoothedNorm, x: Vector) -> tuple[Vector, float]:
    """Return x with multipliers that outweigh R and Q, and a rho_0 that the disturbance does not come near."""
    K, w = norm.unpack(x)
    w = w * GENEROUS * max(norm.worst(K, 0.0 * w, norm.frequencies(x))[0], 1e-300)
    return norm.pack(K, w), float(np.sqrt(GENEROUS * norm.worst(K, w, norm.frequencies(x))[1]))


def _with_multipliers_scaled(
    norm: SmoothedNorm, x: Vector, scales: Float[np.ndarray, " s"] = SCALES
) -> Vector:
    """Return x with all multipliers scaled alike, so that rho is least."""
    K, w = norm.unpack(x)
    frequencies = norm.frequencies(x)
    trials = [norm.pack(K, scale * w) for scale in scales]
    return min(trials, key=lambda trial: norm.level(trial, None, frequencies))
