"""The frequency response of a loop as one smooth number, and its slopes in the loop's matrices: in doubles, for the search.

For x+ = N x + J w (or x' = N x + J w) with a disturbance that is measured by w' S^-1 w and enters the first n_d states,
S >= 0, and a cost x' Q x, the loop has a gain of at most 1 exactly if no eigenvalue of

    X(s) = L' J' Phi(s)* Q Phi(s) J L,    S = L L',    Phi(s) = (s I - N)^-1,    |s| = 1 (or Re s = 0)

exceeds 1. The largest of them is not smooth in N, S and Q; the power mean

    g_p = 1/p log( mean_s sum_k lambda_k(X(s))^p )

over points s is, and tends to the logarithm of the largest one on the points as p grows. With
d lambda = v' dX v it has the slopes, V = L (sum_k c_k v_k v_k') L', c_k = lambda_k^(p-1) / sum lambda^p,

    dg/dQ = Re sum Phi_d V Phi_d*,    dg/dN = 2 Re sum (Phi_d V Phi_d* Q Phi)',
    dg/dS = Re sum H L (sum_k c_k / lambda_k v_k v_k') L' H,    H = Phi_d* Q Phi_d,    Phi_d = Phi J,

where sum_k lambda_k^(p-1) v_k v_k' = X^(p/2-1) X X^(p/2-1): a few products, which take less time than the eigenvectors.

Between the points a narrow peak goes unseen. The trace of the loop's Gramian W, W = N W N' + I (or N W + W N' + I = 0),
sees every pole that comes near the edge of stability.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float

from lockstep.lmi.analysis.p_norm import gram, size_of

NEGLIGIBLE = 1e-13
"""What the points that are left out may add to the sum."""

WORST = 1e9
"""Condition of the eigenvectors beyond which they are not used."""


class Mean(NamedTuple):
    """g_p and its slopes in N, S and Q."""

    value: float
    N: Float[np.ndarray, "n n"]
    S: Float[np.ndarray, "n_d n_d"]
    Q: Float[np.ndarray, "n n"]


@dataclass(frozen=True, eq=False)
class Poles:
    """A loop by its eigenvalues: N (n, n) of x+ = N x, or of x' = N x where `continuous`."""

    N: Float[np.ndarray, "n n"]
    continuous: bool

    @cached_property
    def _eig(
        self,
    ) -> tuple[Complex[np.ndarray, " n"], Complex[np.ndarray, "n n"], Complex[np.ndarray, "n n"] | None]:
        poles, vectors = np.linalg.eig(self.N)
        poles, vectors = poles.astype(complex), vectors.astype(complex)
        return poles, vectors, np.linalg.inv(vectors) if np.linalg.cond(vectors) < WORST else None

    @property
    def stable(self) -> bool:
        """Whether all of them are inside."""
        poles = self._eig[0]
        return bool(poles.real.max() < 0 if self.continuous else np.abs(poles).max() < 1)

    def response(
        self, points: Complex[np.ndarray, " s"], B: Float[np.ndarray, "n w"]
    ) -> Complex[np.ndarray, "s n w"]:
        """Return (s I - N)^-1 B for each point."""
        poles, vectors, inverse = self._eig
        if inverse is None:
            return np.linalg.solve(points[:, None, None] * np.eye(len(B)) - self.N, B.astype(complex))
        left = vectors / (points[:, None] - poles)[:, None, :]
        return np.asarray((left.reshape(-1, len(B)) @ (inverse @ B)).reshape(len(points), *B.shape))

    def adjoint(
        self, points: Complex[np.ndarray, " s"], C: Complex[np.ndarray, "s z n"]
    ) -> Complex[np.ndarray, "s z n"]:
        """Return C (s I - N)^-1 for each point and its C."""
        poles, vectors, inverse = self._eig
        if inverse is None:
            whole = points[:, None, None] * np.eye(len(poles)) - self.N.T
            return np.linalg.solve(whole, C.swapaxes(1, 2)).swapaxes(1, 2)
        modal = (C.reshape(-1, len(poles)) @ vectors).reshape(C.shape) / (points[:, None] - poles)[:, None, :]
        return np.asarray((modal.reshape(-1, len(poles)) @ inverse).reshape(C.shape))

    def log_gramian(self) -> tuple[float, Float[np.ndarray, "n n"]]:
        """Return log tr W and its slope in N: 2 Z N W / tr W with Z = N' Z N + I (2 Z W / tr W where continuous)."""
        W, Z = self._gramian(self.N), self._gramian(self.N.T)
        slope = Z @ W if self.continuous else Z @ self.N @ W
        return float(np.log(np.trace(W))), 2 * slope / np.trace(W)

    def _gramian(self, N: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "n n"]:
        from scipy.linalg import solve_continuous_lyapunov, solve_discrete_lyapunov

        poles, vectors, inverse = self._eig
        if inverse is None:
            unit = np.eye(len(N))
            solve = solve_continuous_lyapunov if self.continuous else solve_discrete_lyapunov
            return np.asarray(solve(N, -unit if self.continuous else unit))
        if N is not self.N:
            vectors, inverse = inverse.T, vectors.T
        other = poles.conj()
        pairs = -np.add.outer(poles, other) if self.continuous else 1 - np.multiply.outer(poles, other)
        return np.asarray((vectors @ (inverse @ inverse.conj().T / pairs) @ vectors.conj().T).real)


def power_mean(
    poles: Poles,
    S: Float[np.ndarray, "n_d n_d"],
    Q: Float[np.ndarray, "n n"],
    points: Complex[np.ndarray, " s"],
    p: int,
) -> Mean:
    """Return g_p on the points; p is even: half of it is a power.

    >>> one = np.ones((1, 1))
    >>> mean = power_mean(Poles(0.5 * one, False), one, one, np.array([1.0 + 0j]), 4)
    >>> round(float(np.exp(mean.value)), 9)  # |1 / (1 - 0.5)|^2
    4.0
    """
    assert p % 2 == 0, "half of p is a power"
    states = poles.response(points, np.eye(len(Q), len(S)) @ root(S))
    weighed = Q @ states
    X = states.conj().swapaxes(1, 2) @ weighed
    sizes = np.trace(X, axis1=1, axis2=2).real
    seen = sizes > NEGLIGIBLE ** (1 / p) * sizes.max() / len(S)
    top = max(size_of(X[seen]), 1e-300)
    unit = X[seen] / top
    half = np.linalg.matrix_power(unit, p // 2 - 1)
    total = float(np.linalg.norm(unit @ half) ** 2)
    states, weighed = states[seen] @ half, weighed[seen] @ half
    across, back = states @ unit, poles.adjoint(points[seen], weighed.conj().swapaxes(1, 2))
    return Mean(
        float(np.log(top) + np.log(total / len(points)) / p),
        2 / (total * top) * np.tensordot(back, across, ((0, 1), (0, 2))).real,
        gram(back[:, :, : len(S)].swapaxes(1, 2)) / (total * top**2),
        gram(across, states) / (total * top),
    )


def root(square: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "n n"]:
    """Return L with L L' = a positive semidefinite matrix."""
    values, vectors = np.linalg.eigh((square + square.T) / 2)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
