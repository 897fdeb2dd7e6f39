"""Witnesses for the sampled, rounded loop of identical controllers mode by mode, in doubles: `check.sampled.modes` decides.

With P, mu and, through its factor S_1 = E E', the lifted period, W > 0 without errors is linear in (P, mu):

    [ P - running - mu start' Q_1 start - s R_d   N' P   0     ]
    [ P N                                         P      P J E ] >= 0,
    [ 0                                           E' J'P mu I  ]

at both ends of each segment; s is how much room there is, in multiples of what rho weighs during a period. With rho the lifted
period depends on mu and rho, which are searched one at a time. The prices of errors follow from P.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Float

from lockstep.check.inequality import LETTERS, Performance
from lockstep.check.modes import Segment
from lockstep.check.sampled.certify import SampledVerdict, refused
from lockstep.check.sampled.inequality import W_matrix, step_matrix
from lockstep.check.sampled.lifting import Lifted, copies
from lockstep.check.sampled.loop import SampledLoop
from lockstep.check.sampled.modes import ModalLoop, ModalWitness, decide_modal_sampled, proves_modal_rho
from lockstep.check.sampled.performance import running_cost
from lockstep.lmi.analysis.semidefinite import Block, least, symmetric_basis
from lockstep.lmi.sampled.certify import period_in_doubles
from lockstep.lmi.sampled.performance import lifted_with_performance
from lockstep.lmi.sampled.period import longest
from lockstep.lmi.sampled.storage import distance_ratio, holds_in_doubles, rounding_prices

Storage = Float[np.ndarray, "n n"]

PRICES_OF_ROUNDING = (1e6, 1e4, 1e8)
"""t in multiples of what the error's direction weighs in P."""

SLACKS = (1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.3)
"""How far above the least rho found the proof is tried."""

SCALES = (0.0, -0.15, 0.15, -0.3, 0.3, 0.6, -0.6)
"""Powers of ten that the mu of the continuous certificate is tried with."""

MOST_RHO, FINENESS = 100.0, 2e-3
"""The sampled rho is looked for up to so many times the continuous one, and as finely as that."""

DOUBLINGS_OF_PRICE = 60
MU = 1e6
"""What underflow counts relative to the messages' noise: it is some thirty decades smaller."""

LARGEST = 1e4
"""P <= LARGEST I in the coordinates of the linear loop: P and mu could be scaled up without end."""


@dataclass(frozen=True)
class _Mode:
    """One mode in doubles: its loop, its lifted period (w and z of mu = 1, or of a mu and a rho), and its running cost."""

    loop: SampledLoop
    lifted: Lifted
    running: Float[np.ndarray, "n_z n_z"]
    with_rho: bool

    @property
    def kept(self) -> Float[np.ndarray, " k"]:
        """The columns of z without errors: xi and the outputs' own noise."""
        return np.r_[0 : self.loop.n_xi, self.loop.outputs.start : self.loop.outputs.stop]

    @property
    def step(self) -> Float[np.ndarray, "n_xi n_xi"]:
        return step_matrix(self.loop, self.lifted)[:, : self.loop.n_xi]

    def block(self, base: Storage, weighed: Storage) -> Block:
        """Return the matrix above in x = (P, mu, s), P = base P~ base', scaled by the base."""
        kept, n, n_d = self.kept, self.loop.n_xi, self.loop.n_d
        N = step_matrix(self.loop, self.lifted)[:, kept]
        start, E = self.loop.start[:, kept], _factor(self.lifted.S)
        z, e = len(kept), E.shape[1]
        D = np.eye(z)
        D[:n, :n] = np.linalg.inv(base).T
        for k in range(n, z):
            D[k, k] = 1 / math.sqrt(max(-self.running[kept[k], kept[k]], 1e-300))
        size = z + n + e
        side = base.T @ N @ D
        PJE = base.T[:, :n_d] @ E
        constant, slopes = np.zeros((size, size)), []
        lost = D.T @ start.T @ self.lifted.Q @ start @ D
        constant[:z, :z] = -D.T @ self.running[np.ix_(kept, kept)] @ D
        if self.with_rho:
            constant[:z, :z] -= lost
            constant[z + n :, z + n :] = np.eye(e)
        for one in symmetric_basis(n):
            M = np.zeros((size, size))
            M[:n, :n] = M[z : z + n, z : z + n] = one
            M[z : z + n, :z] = one @ side
            M[z : z + n, z + n :] = one @ PJE
            M[:z, z : z + n], M[z + n :, z : z + n] = M[z : z + n, :z].T, M[z : z + n, z + n :].T
            slopes.append(M)
        M = np.zeros((size, size))
        if not self.with_rho:
            M[:z, :z], M[z + n :, z + n :] = -lost, np.eye(e)
        slopes.append(M)
        M = np.zeros((size, size))
        M[:n, :n] = -weighed
        slopes.append(M)
        return constant, np.stack(slopes)


def _factor(square: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "n k"]:
    values, vectors = np.linalg.eigh(square)
    kept = values > 1e-13 * max(float(values.max(initial=0.0)), 1e-300)
    return np.asarray(vectors[:, kept] * np.sqrt(values[kept]))


@dataclass(frozen=True)
class _Setting:
    """What witnesses are looked for: a loop, where segments end, what is weighed, and, with rho, a mu and a rho."""

    loop: ModalLoop
    ends: tuple[float, ...]
    weights: Performance
    mu: float = 1.0
    rho: float | None = None

    def mode(self, value: float) -> _Mode | None:
        """Return a mode; None where its period overflows or passes a conjugate point."""
        noise = self.weights.outputs if self.rho is not None else np.zeros(0)
        loop = self.loop.at(value, noise, exact=False)
        if self.rho is None:
            lifted, running = period_in_doubles(loop), np.zeros((loop.n_z, loop.n_z))
        else:
            own = self.weights
            if not loop.n_d:
                own = own._replace(R=np.zeros((0, 0)), states=np.zeros(0))
            with np.errstate(all="ignore"):
                try:
                    lifted = lifted_with_performance(loop, own, self.mu * np.eye(1), self.rho)
                except np.linalg.LinAlgError:
                    return None
            running = running_cost(loop, own, self.rho)
        if lifted is None or not _is_a_period(lifted):
            return None
        return _Mode(loop, lifted, running, self.rho is not None)

    def weighed(self, mode: _Mode) -> Storage:
        """Return T diag(R, Q, 0) of a mode, with a little of every other state."""
        n_C = len(self.weights.Q)
        form = 1e-6 * np.eye(mode.loop.n_xi)
        if mode.loop.n_d:
            form[: mode.loop.n_d, : mode.loop.n_d] = self.weights.R
        form[mode.loop.n_d : mode.loop.n_d + n_C, mode.loop.n_d : mode.loop.n_d + n_C] = self.weights.Q
        return self.loop.network.period * form


def _is_a_period(lifted: Lifted) -> bool:
    parts = (lifted.A_d, lifted.S, lifted.Q)
    if not all(np.isfinite(one).all() for one in parts):
        return False
    squares = (one for one in parts[1:] if len(one))
    return all(np.linalg.eigvalsh(one)[0] >= -1e-9 * np.abs(one).max() for one in squares)


def _segment(setting: _Setting, low: float, high: float) -> tuple[Storage, float, float] | None:
    """Return P, mu and the room s of a segment; None where there is no room."""
    modes = [setting.mode(value) for value in sorted({low, high})]
    middle = setting.mode(math.sqrt(low * high))
    if middle is None:
        return None
    base = _base(middle, setting)
    if base is None:
        return None
    inverse = np.linalg.inv(base)
    weighed = inverse @ setting.weighed(middle) @ inverse.T
    blocks: list[Block] = []
    for mode in modes:
        if mode is None:
            return None
        blocks.append(mode.block(base, weighed))
    k, n = blocks[0][1].shape[0], len(base)
    signs = np.zeros((k, n, n))
    signs[: k - 2] = symmetric_basis(n)
    one = np.ones((1, 1))
    blocks += [(0 * one, np.eye(k)[k - 2].reshape(k, 1, 1)), (one, -np.eye(k)[k - 1].reshape(k, 1, 1))]
    if setting.rho is None:
        blocks.append((LARGEST * np.eye(n), -signs))
    else:
        blocks.append((one, -np.eye(k)[k - 2].reshape(k, 1, 1)))
    solved = least(-np.eye(k)[k - 1], blocks)
    if solved is None or not solved.x[-1] > 0:
        return None
    P = base @ np.tensordot(solved.x[: k - 2], symmetric_basis(n), 1) @ base.T
    mu = setting.mu if setting.rho is not None else float(solved.x[k - 2])
    return (P + P.T) / 2, mu, float(solved.x[-1])


def _base(mode: _Mode, setting: _Setting) -> Storage | None:
    """Return the Cholesky factor of P = A'P A + T diag(R, Q); None where the loop is not stable."""
    from scipy.linalg import solve_discrete_lyapunov

    A, n = mode.step, mode.loop.n_xi
    if not n:
        return np.zeros((0, 0))
    if float(np.abs(np.linalg.eigvals(A)).max()) >= 1:
        return None
    weighed = setting.weighed(mode)
    applied = mode.loop.applied[:, :n]
    if len(setting.weights.W):
        weighed = weighed + setting.loop.network.period * applied.T @ setting.weights.W @ applied
    try:
        P = solve_discrete_lyapunov(A.T, weighed)
        return np.asarray(np.linalg.cholesky((P + P.T) / 2))
    except (np.linalg.LinAlgError, ValueError):
        return None


def _found(setting: _Setting) -> tuple[tuple[Storage, ...], float, Storage] | None:
    """Return P of each segment, mu, and P of the mean; of stability the segments are scaled to one mu."""
    storages, mu = [], setting.mu
    for low, high in pairwise(setting.ends):
        one = _segment(setting, low, high)
        if one is None:
            return None
        # Without rho everything is homogeneous in (P, mu).
        storages.append(one[0] if setting.rho is not None else one[0] / one[1] * mu)
    mean = setting.mode(0.0)
    base = None if mean is None else _base(mean, setting)
    if base is None:
        return None
    unit = 1.0 if setting.rho is not None else max((float(np.abs(P).max()) for P in storages)) / max(
        float(np.abs(base).max(initial=0.0)) ** 2, 1e-300
    )
    return tuple(storages), mu, 2 * unit * base @ base.T


def _priced(setting: _Setting, found: Any, dear: float) -> Iterator[ModalWitness]:
    """Yield a witness with prices of every error, as cheap a noise as holds, and the decay and weight that it has room for."""
    storages, mu, P_mean = found
    pairs = list(zip(pairwise(setting.ends), storages, strict=True))
    modes = [(P, setting.mode(value)) for (low, high), P in pairs for value in (low, high)]
    modes.append((P_mean, setting.mode(0.0)))
    t = np.full(len(LETTERS), 1e-300)
    noise = 0.0
    ready: list[tuple[Storage, _Mode, Lifted]] = []
    for P, mode in modes:
        if mode is None:
            return
        lifted = mode.lifted if mode.with_rho else copies(mode.lifted, mu * np.eye(1))
        ready.append((P, mode, lifted))
        prices = rounding_prices(mode.loop, lifted, P, dear)
        for way, price in zip(mode.loop.ways, prices, strict=True):
            k = LETTERS.index(way.letter)
            t[k] = max(t[k], price)
        into = step_matrix(mode.loop, lifted)[:, mode.loop.noise]
        noise = max(noise, float(np.linalg.norm(into.T @ P @ into, 2)), float(np.abs(mode.running).max()))
    segments = tuple(Segment(high, P) for (_, high), P in pairs)
    first = [(P, mode) for P, mode in modes[:-1] if mode is not None]
    ratio = max(distance_ratio(mode.loop, P) for P, mode in first)
    trial = ModalWitness(segments, P_mean, t, setting.ends[0], mu, 1.0, math.inf, 0.0, ratio, math.inf)

    def holds(witness: ModalWitness) -> bool:
        return all(
            holds_in_doubles(W_matrix(mode.loop, lifted, witness.of(P, mode.loop), mode.running))
            for P, mode, lifted in ready
        )

    def at(price: float, **other: float) -> ModalWitness:
        return replace(trial, kappa=price, kappa_mu=MU * price, **other)

    if setting.rho is not None:
        witness = at(1e8 * noise)
        if holds(witness):
            yield witness
        return
    price = next((p for k in range(DOUBLINGS_OF_PRICE) if holds(at(p := 1.5 * 4.0**k * noise))), None)
    if price is None:
        return
    low, high = 0.0, 1.0
    for _ in range(16):
        middle = (low + high) / 2 if low else high / 8
        low, high = (low, middle) if holds(at(4 * price, decay=middle)) else (middle, high)
    decay = 1 - (1 - high) / 2
    weight, most = 0.0, (1 - decay) / ratio
    for k in range(12):
        if holds(at(4 * price, decay=decay, weight=most / 2**k)):
            weight = most / 2 ** (k + 1)
            break
    yield at(4 * price, decay=decay, weight=weight)


def certify_modal(
    loop: ModalLoop, ends: Sequence[float], weights: Performance, witness: ModalWitness | None = None
) -> SampledVerdict:
    """Prove the sampled loop mode by mode, or say why it could not be.

    Args:
        loop: identical controllers.
        ends: where segments end, each with a P of its own.
        weights: for scaling alone.
        witness: a candidate that is put to the proof before any is searched for.
    """
    if witness is not None:
        replayed = decide_modal_sampled(loop, witness)
        if replayed.certified:
            return replayed
    said, at = "no certificate was found mode by mode", f"at {loop.network.period:g} s"
    setting = _Setting(loop, _outside(loop, ends), weights)
    found = _found(setting)
    for dear in PRICES_OF_ROUNDING if found is not None else ():
        for one in _priced(setting, found, dear):
            verdict = decide_modal_sampled(loop, one)
            if verdict.certified:
                return verdict
            said = verdict.reason
    return refused(loop.network, loop.controllers, f"{at} {said}", {})


def modal_rho(
    loop: ModalLoop, ends: Sequence[float], weights: Performance, mu: float, rho: float
) -> tuple[float, ModalWitness] | None:
    """Find and prove a small rho mode by mode, from the mu and the rho of the continuous certificate; None if none is proved."""
    ends = _outside(loop, ends)
    best: tuple[float, float] | None = None
    for scale in SCALES:
        least_one = _least_rho(_Setting(loop, ends, weights, mu * 10**scale), rho, best)
        if least_one is not None and (best is None or least_one < best[0]):
            best = least_one, mu * 10**scale
    if best is None:
        return None
    for slack in SLACKS:
        setting = _Setting(loop, ends, weights, best[1], float(f"{best[0] * (1 + slack):.4g}"))
        found = _found(setting)
        if found is None or setting.rho is None:
            continue
        for dear in PRICES_OF_ROUNDING:
            for witness in _priced(setting, found, dear):
                if proves_modal_rho(loop, weights, setting.rho, witness):
                    return setting.rho, witness
    return None


def _least_rho(setting: _Setting, rho: float, best: tuple[float, float] | None) -> float | None:
    """Bisect the least rho for a mu; None where it is no better than the best so far."""
    holds = lambda value: _found(replace(setting, rho=value)) is not None  # noqa: E731
    high = MOST_RHO * rho if best is None else best[0] * (1 - FINENESS)
    low = 0.9 * rho
    if best is None:
        high = next((f * rho for f in (1.02, 1.1, 1.5, 3.0, 10.0, MOST_RHO) if holds(f * rho)), 0.0)
        if not high:
            return None
    elif not holds(high):
        return None
    while high > low * (1 + FINENESS):
        middle = math.sqrt(low * high)
        low, high = (low, middle) if holds(middle) else (middle, high)
    return high


def longest_modal(
    loop_at: Callable[[float], ModalLoop], start: float, ends: Sequence[float], weights: Performance
) -> SampledVerdict | None:
    """Return the proved verdict at the largest period found; None if there is none."""

    def seems(period: float) -> bool:
        loop = loop_at(period)
        with np.errstate(all="ignore"):
            return _found(_Setting(loop, _outside(loop, ends), weights)) is not None

    return longest(start, seems, lambda period: certify_modal(loop_at(period), ends, weights))


def _outside(loop: ModalLoop, ends: Sequence[float]) -> tuple[float, ...]:
    """Return the ends of segments, the first and the last far enough outside for the weights in the code."""
    inner = [one for one in ends if loop.lower < one < loop.upper]
    return (loop.lower, *inner, loop.upper)
