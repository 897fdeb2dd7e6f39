"""Multipliers of a large loop by its frequency response: no unknown P, so that they are all there is to look for.

For given gains, F < 0 of `inequality` holds with some P if and only if at every frequency, with x = (j omega I - A)^-1 B s
for the signals s = (xi, v) of Z = [A, B] (the Kalman-Yakubovich-Popov lemma; Rantzer 1996),

    y^H (F_0 + sum_k w_k F_k) y < rho^2 |xi|^2,    y = (x, s).

P has n (n + 1) / 2 entries, 6 786 for twenty arms of order 2, and a dense interior method costs their third power; the
multipliers are a few hundred, and log rho^2 is lowered as a p-norm over the frequencies, by BFGS. First, without F_0, the
gain around v alone is brought below one, where it does not depend on the scale of w; P then comes of a Riccati equation
(`strict_feasibility`).
Nothing is believed: frequencies between those looked at count when P is found, and all when it is decided.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float, Shaped

from lockstep.lmi.analysis.p_norm import are_stable, dominant, frequencies_of, gram, near_top, p_norm, thinned
from lockstep.lmi.analysis.strict_feasibility import strictly_feasible_point

MOST_ENTRIES, PAIR = 300, 4
"""Entries of P, each pair's multiplier counted as four, above which a search does without semidefinite programs: those take
seconds there, and their time grows with the third power. Ten pendulums took longer with 171 entries and 45 pairs than twenty
did without P."""

STAGES = ((9, 60), (41, 60), (201, 80))
"""p and the number of steps, one after the other: the frequencies are chosen anew before each."""

ENOUGH = 0.9
"""The square of the gain around v below which the search for rho begins."""

SCALES = np.logspace(0.02, 6, 13)
"""Of the multipliers, in multiples of the least one that outweighs F_0."""

SETTLED = 1e-5
"""A descent ends where a step promises to lower log rho^2 by less."""

ROOMS = (3e-3, 1e-3, 3e-4, 1e-4)
"""By how much the multipliers are raised at a given rho, the most first: it is what rounding has."""

REFINEMENTS, BETWEEN, SAME = 3, 7, 1.001
"""How often frequencies are added between those near the top, how many, and the growth of rho^2 that does not matter."""

OVERS = (1e-4, 1e-3, 5e-3, 2e-2, 0.1)
"""How far above the rho of the frequencies looked at a P is tried for, as a part of it."""

Form = tuple[Complex[np.ndarray, "f d d"], Shaped[np.ndarray, "f s d"]]
"""M at each frequency, whose eigenvalues count, and the signals s of unit vectors: dM = (y s)^H dF (y s)."""


def least_by_frequencies(
    Z: Float[np.ndarray, "n_x n_F"],
    constant: Float[np.ndarray, "n_F n_F"],
    slopes: Float[np.ndarray, "w n_F n_F"],
    near: Float[np.ndarray, " w"] | None = None,
    *,
    any_rho: bool = False,
) -> tuple[Float[np.ndarray, "n_x n_x"], Float[np.ndarray, " w"]] | None:
    """Return P and multipliers, rho^2 the last and small, with F < 0; None where none were found.

    Args:
        Z, constant, slopes: F = J P Z + (J P Z)' + constant + sum_k w_k slopes_k, J = [I; 0].
        near: multipliers to start from.
        any_rho: whether rho^2 may be as it comes.
    """
    if not are_stable(np.linalg.eigvals(Z[:, : len(Z)])):
        return None
    response = Response.of(Z, constant, slopes)
    logs = np.zeros(len(slopes) - 1) if near is None else np.log(np.maximum(near[:-1], 1e-300))
    if len(logs) and (near is None or not np.isfinite(response.level(response.rho, logs))):
        logs, gain = _lowered(response, response.gain, logs - logs.mean(), ENOUGH)
        if gain >= 1:
            return None
        try:
            logs = response.scaled(logs)
        except np.linalg.LinAlgError:  # the multipliers left the range of doubles on their way
            return None
    logs, square = _lowered(response, response.rho, logs, stages=() if any_rho else STAGES)
    for _ in range(0 if any_rho else REFINEMENTS):
        response = Response.of(Z, constant, slopes, response.between(logs))
        if response.level(response.rho, logs) <= SAME * square:
            break
        logs, square = _lowered(response, response.rho, logs, stages=STAGES[-1:])
    for over in OVERS if np.isfinite(square) else ():
        found = storage_at(Z, constant, slopes, np.append(np.exp(logs), square * (1 + over) ** 2), (over,))
        if found is not None:
            return found
    return None


def storage_at(
    Z: Float[np.ndarray, "n_x n_F"],
    constant: Float[np.ndarray, "n_F n_F"],
    slopes: Float[np.ndarray, "w n_F n_F"],
    w: Float[np.ndarray, " w"],
    rooms: tuple[float, ...] = ROOMS,
) -> tuple[Float[np.ndarray, "n_x n_x"], Float[np.ndarray, " w"]] | None:
    """Return the smallest P for multipliers raised by some room, and these, rho^2 as it is; None if there is none."""
    found = strictly_feasible_point(Z, constant, slopes, w, rooms=rooms, over=(1.0,))
    return None if found is None else found[:2]


@dataclass(frozen=True, eq=False)
class Response:
    """y of unit signals at each frequency, the signals in units in which rho^2 multiplies |xi|^2.

    constant, slopes: of F;  y: (f, n_F, s);  n_x, n_xi: how many states and disturbances there are.
    """

    constant: Float[np.ndarray, "n_F n_F"]
    slopes: Float[np.ndarray, "w n_F n_F"]
    y: Complex[np.ndarray, "f n_F s"]
    frequencies: Float[np.ndarray, " f"]
    n_x: int
    n_xi: int

    @classmethod
    def of(
        cls,
        Z: Float[np.ndarray, "n_x n_F"],
        constant: Float[np.ndarray, "n_F n_F"],
        slopes: Float[np.ndarray, "w n_F n_F"],
        frequencies: Float[np.ndarray, " f"] | None = None,
    ) -> "Response":
        """Return the response of x' = Z (x, s), by default at the frequencies of its poles."""
        (n, size), n_xi = Z.shape, int(np.count_nonzero(np.diag(slopes[-1])))
        unit = np.eye(size - n)
        metric = -slopes[-1][n : n + n_xi, n : n + n_xi]
        unit[:n_xi, :n_xi] = np.linalg.inv(np.linalg.cholesky(metric)).T
        if frequencies is None:
            frequencies = thinned(frequencies_of(np.linalg.eigvals(Z[:, :n])))
        # Solved, not diagonalised: a chain of equal agents has eigenvectors next to each other.
        X = np.linalg.solve(1j * frequencies[:, None, None] * np.eye(n) - Z[:, :n], Z[:, n:] @ unit)
        y = np.concatenate([X, np.broadcast_to(unit, (len(X), *unit.shape))], axis=1)
        return cls(constant, slopes, y, frequencies, n, n_xi)

    @property
    def v(self) -> slice:
        """Where v is among the signals."""
        return slice(self.n_xi, None)

    @property
    def of_v(self) -> Float[np.ndarray, "w v v"]:
        """What each multiplier grants v itself, with its sign in F."""
        inner = self.n_x + self.n_xi
        return np.asarray(self.slopes[:-1, inner:, inner:])

    def forms(
        self, y: Complex[np.ndarray, "f n_F s"], w: Float[np.ndarray, " w"], constant: float
    ) -> Complex[np.ndarray, "f s s"]:
        """Return y^H (constant F_0 + sum_k w_k F_k) y."""
        F = constant * self.constant + np.tensordot(w, self.slopes[:-1], 1)
        return np.asarray(y.conj().swapaxes(1, 2) @ (F @ y))

    def rho(self, y: Complex[np.ndarray, "f n_F s"], w: Float[np.ndarray, " w"]) -> Form:
        """Return that of rho^2.

        Raises:
            numpy.linalg.LinAlgError: there is none.
        """
        Phi, v, n_xi = self.forms(y, w, 1.0), self.v, self.n_xi
        room = -Phi[:, v, v]
        np.linalg.cholesky(room)
        answer = np.linalg.solve(room, Phi[:, v, :n_xi])
        unit = np.broadcast_to(np.eye(n_xi), (len(y), n_xi, n_xi))
        return Phi[:, :n_xi, :n_xi] + Phi[:, :n_xi, v] @ answer, np.concatenate([unit, answer], axis=1)

    def gain(self, y: Complex[np.ndarray, "f n_F s"], w: Float[np.ndarray, " w"]) -> Form:
        """Return that of the square of the gain around v, against what the multipliers grant v itself."""
        granted = -np.tensordot(w, self.of_v, 1)
        root = np.linalg.inv(np.linalg.cholesky(granted)).T
        Psi = self.forms(y[:, :, self.v], w, 0.0) + granted
        signals = np.concatenate([np.zeros((self.n_xi, len(root))), root])
        return root.T @ Psi @ root, np.broadcast_to(signals, (len(y), *signals.shape))

    def level(self, kind: "Kind", logs: Float[np.ndarray, " w"]) -> float:
        """Return the largest eigenvalue over all frequencies; infinite where there is none."""
        return float(self.levels(kind, logs).max())

    def levels(self, kind: "Kind", logs: Float[np.ndarray, " w"]) -> Float[np.ndarray, " f"]:
        """Return the largest eigenvalue at each frequency."""
        try:
            return np.asarray(np.linalg.eigvalsh(kind(self.y, np.exp(logs))[0])[:, -1])
        except np.linalg.LinAlgError:
            return np.full(len(self.y), np.inf)

    def between(self, logs: Float[np.ndarray, " w"]) -> Float[np.ndarray, " f"]:
        """Return the frequencies with more between those near the largest eigenvalue and their neighbours."""
        levels, f = self.levels(self.rho, logs), self.frequencies
        near = near_top(levels, STAGES[-1][0])
        ends = np.flatnonzero(near[:-1] | near[1:])
        return np.unique(np.concatenate([f, np.linspace(f[ends], f[ends + 1], BETWEEN).ravel()]))

    def scaled(self, logs: Float[np.ndarray, " w"]) -> Float[np.ndarray, " w"]:
        """Return the multipliers in the best scale."""
        y, w = self.y[:, :, self.v], np.exp(logs)
        weight = self.forms(y, 0.0 * w, 1.0)
        root = np.linalg.inv(np.linalg.cholesky(-self.forms(y, w, 0.0)))
        least = float(np.linalg.eigvalsh(root @ weight @ root.conj().swapaxes(1, 2)).max())
        trials = [logs + np.log(scale * max(least, 1e-300)) for scale in SCALES]
        return min(trials, key=lambda one: self.level(self.rho, one))

    def value(
        self, kind: "Kind", logs: Float[np.ndarray, " w"], p: int, y: Complex[np.ndarray, "f n_F s"]
    ) -> tuple[float, Float[np.ndarray, " w"]]:
        """Return log of the p-norm of the eigenvalues and its slope in log w; infinite where there are none."""
        w = np.exp(logs)
        try:
            M, signals = kind(y, w)
            norm, factor = p_norm(M, p)
        except np.linalg.LinAlgError:
            norm = np.inf
        if not np.isfinite(norm):
            return np.inf, np.zeros_like(logs)
        signals = signals @ factor
        slope = np.tensordot(self.slopes[:-1], gram(y @ signals), 2)
        if kind == self.gain:  # what is granted counts in M and is what M is measured in
            v = signals[:, self.v]
            slope += np.tensordot(self.of_v, gram(v @ M, v) - gram(v), 2)
        return norm, w * slope


Kind = Callable[[Complex[np.ndarray, "f n_F s"], Float[np.ndarray, " w"]], Form]


def _lowered(
    response: Response,
    kind: Kind,
    logs: Float[np.ndarray, " w"],
    enough: float = 0.0,
    stages: Sequence[tuple[int, int]] = STAGES,
) -> tuple[Float[np.ndarray, " w"], float]:
    """Lower the largest eigenvalue, at the frequencies near the top; return the multipliers and the eigenvalue reached."""
    from lockstep.lmi.quasi_newton import descend

    level = response.level(kind, logs)
    for p, steps in stages:
        if level < enough or not np.isfinite(level):
            break
        here = response.levels(kind, logs)
        for _ in range(len(STAGES)):
            y = response.y[dominant(response.frequencies, here, p)]
            trial = descend(lambda at: response.value(kind, at, p, y), logs, steps, SETTLED)  # noqa: B023
            there = response.levels(kind, trial)
            if there.max() <= level:
                logs, level = trial, float(there.max())
                break
            here = np.maximum(here, there)
    return logs, level
