"""Witnesses for the inequality of the sampled loop, in doubles: nothing here is believed, it is proved elsewhere.

m      the multiplier under which the loop from w to z has the least gain over all frequencies
P      from the Riccati equation of that gain, with part of what room there is kept for the rest
t      a share of that room for each way in of rounding
kappa  the least that the messages' noise then needs
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from lockstep.lmi.sampled.inequality import W_matrix, Witness, metric, multiplier, step_matrix
from lockstep.lmi.sampled.lifting import Lifted, copies
from lockstep.lmi.sampled.loop import SampledLoop
from lockstep.lmi.sampled.riccati import smallest_storage

FREQUENCIES = np.concatenate([[0.0], np.geomspace(1e-4, np.pi, 160)])
"""In rad per period. A peak between two of them only makes the multiplier a little worse."""

COMFORTABLE = 0.9
"""A gain below this leaves room enough: the multiplier is not improved further."""

EVALUATIONS = 200

RATES = (0.03, 0.1, 0.003)
"""How fast V is asked to decay, as parts of how fast the linear loop does."""

WEIGHTS = (0.1, 0.03, 0.01, 1e-3, 1e-5)
"""Weights of the disagreement at the sampling instants beside the lifted cost, relative to it."""

KAPPA_STEPS = 10
"""Halvings of 24 decades in the search for the least kappa: to 6 %."""

ROUNDING_SHARE = 0.25
"""The part of the room that the rounding errors of all coefficients get together."""


def gain(loop: SampledLoop, one: Lifted, m: Float[np.ndarray, " pairs"]) -> float:
    """Return the largest gain of the discrete loop from w to z under a multiplier; infinite if the loop is unstable.

    Below 1 the nonlinear loop is proved stable, on these frequencies at least.
    """
    return _Response(loop, one).gain(m)


def spectral_radius(loop: SampledLoop, one: Lifted) -> float:
    """Return the largest absolute value among the eigenvalues of the loop without nonlinearity and errors."""
    return float(np.abs(np.linalg.eigvals(_step_of_state(loop, one))).max(initial=0.0))


def _step_of_state(loop: SampledLoop, one: Lifted) -> Float[np.ndarray, "n_xi n_xi"]:
    unit = np.eye(loop.network.d.N - 1)
    n = one.n
    A_d = np.hstack([np.kron(unit, one.A_d[:, :n]), np.kron(unit, one.A_d[:, n:])])
    return np.vstack([A_d @ loop.start, loop.advanced])[:, : loop.n_xi]


class _Response:
    """The discrete frequency response from w to z, one agent's factors of S and Q in each copy."""

    def __init__(self, loop: SampledLoop, one: Lifted) -> None:
        self.d = loop.network.d
        copies_ = self.d.N - 1
        into, out = _factor(one.S), _factor(one.Q).T
        self.into, self.out = into.shape[1], out.shape[0]
        unit, n = np.eye(copies_), one.n
        C = np.hstack([np.kron(unit, out[:, :n]), np.kron(unit, out[:, n:])]) @ loop.start[:, : loop.n_xi]
        B = np.vstack([np.kron(unit, into), np.zeros((loop.n_xi - loop.n_d, copies_ * self.into))])
        poles, vectors = np.linalg.eig(_step_of_state(loop, one))
        self.stable = bool(np.abs(poles).max(initial=0.0) < 1)
        resolvent = 1 / (np.exp(1j * FREQUENCIES)[:, None] - poles)
        # The grid also holds the angles of the poles, where a lightly damped loop peaks.
        angles = np.abs(np.angle(poles[np.abs(poles) > 1e-9]))
        if len(angles):
            resolvent = np.vstack([resolvent, 1 / (np.exp(1j * angles)[:, None] - poles)])
        right = np.linalg.lstsq(vectors, B.astype(complex), rcond=None)[0]
        self.response = np.einsum("ij,kj,jl->kil", C @ vectors, resolvent, right)

    def gain(self, m: Float[np.ndarray, " pairs"]) -> float:
        if not self.stable:
            return np.inf
        if 0 in self.response.shape[1:]:
            return 0.0
        try:
            W = np.linalg.cholesky(multiplier(self.d, m)).T
        except np.linalg.LinAlgError:
            return np.inf
        left, right = np.kron(W, np.eye(self.out)), np.kron(np.linalg.inv(W), np.eye(self.into))
        return float(np.linalg.norm(left @ self.response @ right, 2, axis=(1, 2)).max())


def _factor(square: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "n k"]:
    """Return F with F F' = a positive semidefinite matrix, as far as doubles tell it from zero."""
    values, vectors = np.linalg.eigh(square)
    kept = values > 1e-14 * max(values.max(initial=0.0), 1e-300)
    factor: np.ndarray = vectors[:, kept] * np.sqrt(values[kept])
    return factor


def best_multiplier(
    loop: SampledLoop, one: Lifted, m: Float[np.ndarray, " pairs"], *, enough: float = COMFORTABLE
) -> tuple[Float[np.ndarray, " pairs"], float]:
    """Return pair weights of sum 1 under which the gain is small, and that gain, from a first guess.

    A first guess whose gain is below `enough` is taken as it is.
    """
    from scipy.optimize import minimize

    response = _Response(loop, one)
    m = _scaled(m)
    first = response.gain(m)
    if first < enough or not response.stable or len(m) < 2:
        return m, first
    found = minimize(
        lambda logs: min(response.gain(_scaled(np.exp(np.clip(logs, -40, 0)))), 1e9),
        np.log(m),
        method="Nelder-Mead",
        options={"maxfev": EVALUATIONS, "adaptive": True, "xatol": 1e-3, "fatol": 1e-5},
    )
    best = _scaled(np.exp(np.clip(found.x, -40, 0)))
    return (best, float(found.fun)) if found.fun < first else (m, first)


def _scaled(m: Float[np.ndarray, " pairs"]) -> Float[np.ndarray, " pairs"]:
    """Return weights of sum 1, none below 1e-9 of it: only their ratios count."""
    total = m.sum()
    share = m / total if total > 0 else np.full(len(m), 1 / max(len(m), 1))
    return np.asarray(np.maximum(share, 1e-9))


@dataclass(frozen=True, eq=False)
class Room:
    """P with the room it leaves: W stays positive definite with `slack` taken off the block of xi."""

    P: Float[np.ndarray, "n_xi n_xi"]
    slack: Float[np.ndarray, "n_xi n_xi"]
    decay: float
    weight: float


def candidates(
    loop: SampledLoop, one: Lifted, m: Float[np.ndarray, " pairs"], *, thorough: bool = True
) -> Iterator[Witness]:
    """Yield witnesses with which W is positive definite in doubles; the one that passes the least noise on is first.

    Unless thorough: then each as it is found.
    """
    lifted = copies(one, multiplier(loop.network.d, m))
    found = []
    for weight in WEIGHTS:
        for rate in RATES:
            room = _room(loop, lifted, rate, weight)
            witness = None if room is None else fitted(loop, lifted, m, room)
            if witness is None:
                continue
            if thorough:
                found.append((witness.ultimate * witness.rms, witness))
            else:
                yield witness
    yield from (witness for _, witness in sorted(found, key=lambda pair: pair[0]))


def _room(loop: SampledLoop, lifted: Lifted, rate: float, weight: float) -> Room | None:
    """Return the V that decays by `rate` of what it could and passes the least noise on, with some room kept.

    A quarter of the decay and a quarter of kappa are kept as room.
    """
    radius = float(np.abs(np.linalg.eigvals(step_matrix(loop, lifted)[:, : loop.n_xi])).max())
    spread = rate * (1 - radius**2)
    if spread <= 0:
        return None
    problem = _Noisy(loop, lifted, weight)
    low, high, P = -12.0, 12.0, problem.storage(1e12 * problem.size, 1 - spread)
    if P is None:
        return None
    for _ in range(KAPPA_STEPS):
        middle = (low + high) / 2
        found = problem.storage(10**middle * problem.size, 1 - spread)
        low, high, P = (middle, high, P) if found is None else (low, middle, found)
    relaxed = problem.storage(1.33 * 10**high * problem.size, 1 - spread)
    P = P if relaxed is None else relaxed
    return Room(P, spread / 4 * P, 1 - 0.75 * spread, problem.weight)


class _Noisy:
    """The Riccati equation with the noise as a second input, which kappa weighs, and a cost of the disagreement.

    Completing the square in the noise nu, with R = kappa I - start_nu' Q start_nu, makes it a standard one.
    """

    def __init__(self, loop: SampledLoop, lifted: Lifted, weight: float) -> None:
        N, start, n_xi = step_matrix(loop, lifted), loop.start, loop.n_xi
        self.A, self.B = N[:, :n_xi], N[:, loop.noise]
        self.cost = start[:, :n_xi].T @ lifted.Q @ start[:, :n_xi]
        self.cross = start[:, loop.noise].T @ lifted.Q @ start[:, :n_xi]
        self.through = start[:, loop.noise].T @ lifted.Q @ start[:, loop.noise]
        self.S = padded(loop, lifted.S)
        distance = metric_of(loop)
        self.size = float(np.abs(self.cost).max()) or 1.0
        own = np.diag(np.concatenate([np.zeros(loop.n_d), np.full(n_xi - loop.n_d, 1e-6)]))
        self.weight = weight * self.size / float(np.abs(distance).max())
        self.cost = self.cost + self.weight * distance + weight * self.size * own

    def storage(self, kappa: float, decay: float) -> Float[np.ndarray, "n_xi n_xi"] | None:
        R = kappa * np.eye(len(self.through)) - self.through
        if len(R) and np.linalg.eigvalsh(R)[0] <= 0:
            return None
        back = np.linalg.solve(R, np.hstack([self.cross, self.B.T]))
        n = len(self.A)
        A = self.A + self.B @ back[:, :n]
        cost = self.cost + self.cross.T @ back[:, :n]
        S = self.S + self.B @ back[:, n:]
        return smallest_storage(A / np.sqrt(decay), (S + S.T) / 2, (cost + cost.T) / 2 / decay)


def fitted(
    loop: SampledLoop,
    lifted: Lifted,
    m: Float[np.ndarray, " pairs"],
    room: Room,
    running: Float[np.ndarray, "n_z n_z"] | None = None,
) -> Witness | None:
    """Return P with t from its room and the least kappa, or None if W is not positive definite even so."""
    inverse = np.linalg.pinv(room.slack, hermitian=True)
    t = []
    for way in loop.ways:
        Y = way.Y[:, : loop.n_xi]
        seen = float(np.linalg.norm(Y @ inverse @ Y.T, 2)) if len(Y) else 0.0
        t.append(ROUNDING_SHARE / (len(loop.ways) * way.delta**2 * seen) if seen > 0 else 1.0)
    trial = Witness(room.P, m, np.array(t), room.decay, 0.0, room.weight)
    kappa = _least_kappa(loop, W_matrix(loop, lifted, trial, running))
    return None if kappa is None else replace(trial, kappa=kappa, ratio=_distance_ratio(loop, room.P))


def _least_kappa(loop: SampledLoop, W: Float[np.ndarray, "w w"]) -> float | None:
    """Return 1.05 times the least kappa with W > 0, by Schur's complement of everything but the noise."""
    noise = np.zeros(len(W), dtype=bool)
    noise[loop.noise] = True
    # A congruence to a unit diagonal: t and P differ by many orders of magnitude.
    diagonal = np.diag(W)[~noise]
    if not np.isfinite(W).all() or not (diagonal > 0).all():
        return None
    scale = 1 / np.sqrt(diagonal)
    rest = W[np.ix_(~noise, ~noise)] * np.outer(scale, scale)
    if np.linalg.eigvalsh(rest)[0] <= 0:
        return None
    side = W[np.ix_(~noise, noise)] * scale[:, None]
    if not noise.any():
        return 1.0
    complement = W[np.ix_(noise, noise)] - side.T @ np.linalg.solve(rest, side)
    return float(1.05 * max(-np.linalg.eigvalsh(complement)[0], 0.0)) or 1.0


def metric_of(loop: SampledLoop) -> Float[np.ndarray, "n_xi n_xi"]:
    """Return the squared distance of the states from consensus as a form on xi."""
    return padded(loop, metric(loop))


def padded(loop: SampledLoop, S: Float[np.ndarray, "n_d n_d"]) -> Float[np.ndarray, "n_xi n_xi"]:
    """Return S on x_d, zero elsewhere."""
    out = np.zeros((loop.n_xi, loop.n_xi))
    out[: loop.n_d, : loop.n_d] = S
    return out


def _distance_ratio(loop: SampledLoop, P: Float[np.ndarray, "n_xi n_xi"]) -> float:
    """Return c with x_d' (S (x) I) x_d <= c V, a little above the least."""
    L = np.linalg.cholesky(P)
    inner = np.linalg.solve(L, np.linalg.solve(L, metric_of(loop)).T)
    return float(1.001 * np.linalg.eigvalsh((inner + inner.T) / 2)[-1])
