"""Witnesses for the sampled, rounded loop of identical controllers mode by mode, in doubles: `check.sampled.modes` decides.

With S_1 = E E', W > 0 without errors is V(N z + J E w) - mu |w|^2 < z' Z z for all z and w, and so linear in (P, mu):

    [ P - running - mu start' Q_1 start - N' P N - s R_d   -N' P J E            ]
    [ -E' J' P N                                           mu I - E' J' P J E   ] >= 0

at both ends of each segment; s is how much room there is, in multiples of what rho weighs during a period. With rho the
lifted period depends on mu and rho, which are searched one at a time. The prices of errors follow from P.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Float

from lockstep.check.continuous.inequality import LETTERS, Performance
from lockstep.check.continuous.modes import Segment
from lockstep.check.sampled.certify import SampledVerdict, refused
from lockstep.check.sampled.inequality import W_matrix, step_matrix
from lockstep.check.sampled.lifting import Lifted, copies
from lockstep.check.sampled.loop import SampledLoop
from lockstep.check.sampled.modes import (
    ModalLoop,
    SampledModalWitness,
    decide_modal_sampled,
    proves_modal_rho,
)
from lockstep.check.sampled.performance import running_cost
from lockstep.lmi.analysis.semidefinite import Block, least, symmetric_basis
from lockstep.lmi.sampled.certify import period_in_doubles
from lockstep.lmi.sampled.performance import lifted_with_performance
from lockstep.lmi.sampled.period import longest
from lockstep.lmi.sampled.storage import distance_ratio, holds_in_doubles

Storage = Float[np.ndarray, "n n"]

PRICES_OF_ROUNDING = (1.0, 10.0, 0.1, 100.0)
"""t in multiples of what makes an error e = delta Y xi cost as much entering, by E'P E, as leaving, by Y P^-1 Y'."""

CERTAIN = 1e-12
"""The delta of a coefficient without error, in place of 0."""

SLACKS = (1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.3)
"""How far above the least rho found the proof is tried."""

SCALES = (0.0, -0.15, 0.15, -0.3, 0.3, 0.6, -0.6)
"""Powers of ten that the mu of the continuous certificate is tried with."""

MOST_RHO, FINENESS = 100.0, 2e-3
"""The sampled rho is looked for up to so many times the continuous one, and as finely as that."""

RATES = (0.3, 0.1, 0.03, 0.01)
"""How fast V is asked to decay, as parts of how fast the linear loop does."""

CLAIMED, TRIES = 0.7, 3
"""The part of the decay that is claimed, and how many witnesses are put to the proof."""

DOUBLINGS_OF_PRICE = 60
MU = 1e6
"""What underflow counts relative to the messages' noise: it is some thirty decades smaller."""

MOST_SEGMENTS = 8
"""Segments with a P each: a continuous certificate may have more."""

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
    def step(self) -> Float[np.ndarray, "n_xi n_xi"]:
        return step_matrix(self.loop, self.lifted)[:, : self.loop.n_xi]

    def block(
        self, base: Storage, weighed: Storage, units: tuple[float, float], decay: float | None = None
    ) -> Block:
        """Return the matrix above in x = (P, mu, s), P = base P~ base', scaled so that weighed = I; mu, kappa in `units`.

        With a decay, that times P in the place of the first P, and kappa on the messages' noise in that of s.
        """
        n, n_d = self.loop.n_xi, self.loop.n_d
        others = self.loop.outputs if decay is None else self.loop.messages
        kept = np.r_[0:n, others.start : others.stop]
        E, (of_mu, of_noise) = _factor(self.lifted.S), units
        z, e = len(kept), E.shape[1]
        D = np.zeros((z, z))
        D[:n, :n] = np.linalg.inv(np.linalg.cholesky(weighed)).T
        for k in range(n, z):
            D[k, k] = (
                of_noise**-0.5 if decay is not None else max(-self.running[kept[k], kept[k]], 1e-300) ** -0.5
            )
        N, start = step_matrix(self.loop, self.lifted)[:, kept] @ D, self.loop.start[:, kept] @ D
        here, after = np.zeros((n, z + e)), np.zeros((n, z + e))
        here[:, :n] = (1.0 if decay is None else decay**0.5) * base.T @ D[:n, :n]
        after[:, :z], after[:, z:] = base.T @ N, base.T[:, :n_d] @ E / of_mu**0.5
        basis = symmetric_basis(n)
        slopes = np.zeros((len(basis) + 2, z + e, z + e))
        slopes[:-2] = here.T @ basis @ here - after.T @ basis @ after
        constant, of_w = np.zeros((z + e, z + e)), slopes[-2]
        constant[:z, :z] = -D.T @ self.running[np.ix_(kept, kept)] @ D
        lost = start.T @ self.lifted.Q @ start
        if self.with_rho:
            constant[:z, :z] -= lost
            constant[z:, z:] = np.eye(e) / of_mu
        else:
            of_w[:z, :z], of_w[z:, z:] = -of_mu * lost, np.eye(e)
        if decay is None:
            slopes[-1][:n, :n] = -np.eye(n)
        else:
            slopes[-1][n:z, n:z] = np.eye(z - n)
        return constant, slopes

    def units(self, base: Storage, weighed: Storage) -> tuple[float, float]:
        """Return what mu and kappa are about, for P = base base' and a form that weighs the state."""
        step, n = step_matrix(self.loop, self.lifted), self.loop.n_xi
        N, noise = (
            base.T @ step[:, :n] @ np.linalg.inv(np.linalg.cholesky(weighed)).T,
            base.T @ step[:, self.loop.messages],
        )
        E = base.T[:, : self.loop.n_d] @ _factor(self.lifted.S)
        sizes = [float(np.linalg.norm(N.T @ one, 2)) ** 2 if one.size else 0.0 for one in (E, noise)]
        return sizes[0] or 1.0, sizes[1] or 1.0


def _square(base: Storage) -> Storage:
    P = base @ base.T
    return np.asarray((P + P.T) / 2)


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
    loops: dict[tuple[float, bool], SampledLoop] = field(default_factory=dict)
    periods: dict[int, Lifted | None] = field(default_factory=dict)

    def mode(self, value: float) -> _Mode | None:
        """Return a mode; None where its period overflows or passes a conjugate point."""
        key = (value, self.rho is not None)
        if key not in self.loops:
            noise = self.weights.outputs if self.rho is not None else np.zeros(0)
            self.loops[key] = self.loop.at(value, noise, exact=False)
        loop, own = self.loops[key], self.weights
        if not loop.n_d:
            own = own._replace(R=np.zeros((0, 0)), states=np.zeros(0))
        # A period is the same for all lambda: only what is held during it is not.
        if loop.n_d not in self.periods:
            self.periods[loop.n_d] = self._period(loop, own)
        lifted = self.periods[loop.n_d]
        if lifted is None:
            return None
        running = np.zeros((loop.n_z, loop.n_z)) if self.rho is None else running_cost(loop, own, self.rho)
        return _Mode(loop, lifted, running, self.rho is not None)

    def _period(self, loop: SampledLoop, weights: Performance) -> Lifted | None:
        if self.rho is None:
            lifted = period_in_doubles(loop)
        else:
            with np.errstate(all="ignore"):
                try:
                    lifted = lifted_with_performance(loop, weights, self.mu * np.eye(1), self.rho)
                except np.linalg.LinAlgError:
                    return None
        return lifted if lifted is not None and _is_a_period(lifted) else None

    def at(self, mu: float, rho: float) -> "_Setting":
        """Return the setting with another mu and rho."""
        return replace(self, mu=mu, rho=rho, periods={})

    def weighed(self, mode: _Mode) -> Storage:
        """Return T diag(R, Q, 0) of a mode, with a little of every other state."""
        n_C = len(self.weights.Q)
        form = 1e-6 * np.eye(mode.loop.n_xi)
        if mode.loop.n_d:
            form[: mode.loop.n_d, : mode.loop.n_d] = self.weights.R
        form[mode.loop.n_d : mode.loop.n_d + n_C, mode.loop.n_d : mode.loop.n_d + n_C] = self.weights.Q
        return self.loop.network.period * form


def _quiet(setting: _Setting, rate: float) -> tuple[float, float, tuple[Storage, ...], float, Storage] | None:
    """Return the decay claimed, kappa, P of each segment, mu and P of the mean that pass little noise on; None for none.

    The least kappa with V >= |x_d|^2, V shrinking by a part `rate` of what the linear loop does.
    """
    ends = [setting.mode(value) for value in setting.ends]
    slowest = max((_radius(mode) for mode in ends if mode is not None), default=1.0)
    if None in ends or not slowest < 1:
        return None
    lost, storages, mu, kappa = rate * (1 - slowest**2), list[Storage](), None, 0.0
    for low, high in pairwise(setting.ends):
        found = _least_noise(setting, low, high, 1 - lost, mu)
        if found is None:
            return None
        storages.append(found[0])
        mu, kappa = found[1], max(kappa, found[2])
    mean = setting.mode(0.0)
    base = None if mean is None else _base(mean, setting)
    if mean is None or base is None or mu is None:
        return None
    into = step_matrix(mean.loop, mean.lifted)[:, mean.loop.messages]
    spread = float(np.linalg.norm(into.T @ base, 2)) ** 2 if len(base) else 1.0
    return 1 - CLAIMED * lost, kappa, tuple(storages), mu, 0.1 * kappa / max(spread, 1e-300) * _square(base)


def _radius(mode: _Mode) -> float:
    return float(np.abs(np.linalg.eigvals(mode.step)).max(initial=0.0))


def _least_noise(
    setting: _Setting, low: float, high: float, decay: float, mu: float | None
) -> tuple[Storage, float, float] | None:
    """Return P, mu and the least kappa of a segment, mu being free where none is given."""
    modes, middle = (
        [setting.mode(value) for value in sorted({low, high})],
        setting.mode(math.sqrt(low * high)),
    )
    base = None if middle is None else _base(middle, setting)
    if base is None or middle is None or None in modes:
        return None
    n, n_d, basis = len(base), middle.loop.n_d, symmetric_basis(len(base))
    metric = np.zeros((n, n))
    metric[:n_d, :n_d] = np.eye(n_d)
    inverse = np.linalg.inv(base)
    # In units in which the metric is at most 1.
    unit = float(np.linalg.norm(inverse @ metric @ inverse.T, 2))
    weighed = setting.weighed(middle)
    units = middle.units(base, weighed)
    blocks = [mode.block(base, weighed, units, decay) for mode in modes if mode is not None]
    k = len(basis) + 2
    signs = np.zeros((k, n, n))
    signs[: k - 2] = basis
    blocks.append((-inverse @ metric @ inverse.T / unit, signs))
    chosen, one, (of_mu, of_noise) = np.eye(k)[k - 2].reshape(k, 1, 1), np.ones((1, 1)), units
    blocks.append((0 * one if mu is None else -mu / unit / of_mu * one, chosen))
    if mu is not None:
        blocks.append((mu / unit / of_mu * one, -chosen))
    solved = least(np.eye(k)[k - 1], blocks)
    if solved is None or not solved.x[k - 2] > 0:
        return None
    P = unit * base @ np.tensordot(solved.x[: k - 2], basis, 1) @ base.T
    return (P + P.T) / 2, unit * of_mu * float(solved.x[k - 2]), unit * of_noise * float(solved.x[k - 1])


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
    weighed = setting.weighed(middle)
    units = middle.units(base, weighed)
    blocks: list[Block] = []
    for mode in modes:
        if mode is None:
            return None
        blocks.append(mode.block(base, weighed, units))
    k, n = blocks[0][1].shape[0], len(base)
    signs = np.zeros((k, n, n))
    signs[: k - 2] = symmetric_basis(n)
    one = np.ones((1, 1))
    blocks += [(0 * one, np.eye(k)[k - 2].reshape(k, 1, 1)), (one, -np.eye(k)[k - 1].reshape(k, 1, 1))]
    blocks.append((np.zeros((n, n)), signs))
    if setting.rho is None:
        blocks.append((LARGEST * np.eye(n), -signs))
    else:
        blocks.append((one, -np.eye(k)[k - 2].reshape(k, 1, 1)))
    solved = least(-np.eye(k)[k - 1], blocks)
    if solved is None or not solved.x[-1] > 0 or max(map(_radius, filter(None, modes))) >= 1:
        return None
    P = base @ np.tensordot(solved.x[: k - 2], symmetric_basis(n), 1) @ base.T
    mu = setting.mu if setting.rho is not None else float(solved.x[k - 2]) * units[0]
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
    unit = (
        1.0
        if setting.rho is not None
        else max(float(np.abs(P).max()) for P in storages)
        / max(float(np.abs(base).max(initial=0.0)) ** 2, 1e-300)
    )
    return tuple(storages), mu, 2 * unit * _square(base)


def _priced(
    setting: _Setting, found: Any, dear: float, claimed: tuple[float, float] | None = None
) -> Iterator[SampledModalWitness]:
    """Yield a witness with prices of every error, as cheap a noise as holds, and the decay and weight that it has room for.

    claimed: a decay and a kappa from which the price of the noise is raised.
    """
    storages, mu, P_mean = found
    pairs = list(zip(pairwise(setting.ends), storages, strict=True))
    modes = [(P, setting.mode(value)) for (low, high), P in pairs for value in (low, high)]
    modes.append((P_mean, setting.mode(0.0)))
    t = np.full(len(LETTERS), 1e-300)
    noise = 1e-300
    ready: list[tuple[Storage, _Mode, Lifted]] = []
    for P, mode in modes:
        if mode is None:
            return
        lifted = mode.lifted if mode.with_rho else copies(mode.lifted, mu * np.eye(1))
        ready.append((P, mode, lifted))
        N = step_matrix(mode.loop, lifted)
        for way in mode.loop.ways:
            k, E, Y = LETTERS.index(way.letter), N[:, way.place], way.Y[:, : mode.loop.n_xi]
            enters = float(np.linalg.norm(E.T @ P @ E, 2)) if len(P) else 0.0
            out = float(np.linalg.norm(Y @ np.linalg.solve(P, Y.T), 2)) if Y.size else 0.0
            t[k] = max(
                t[k],
                dear * math.sqrt(enters / max(out, 1e-300)) / max(way.delta, CERTAIN)
                if out
                else 1e6 * enters,
            )
        into = N[:, mode.loop.noise]
        noise = max(noise, float(np.linalg.norm(into.T @ P @ into, 2)), float(np.abs(mode.running).max()))
    segments = tuple(Segment(high, P) for (_, high), P in pairs)
    first = [(P, mode) for P, mode in modes[:-1] if mode is not None]
    ratio = max(distance_ratio(mode.loop, P) for P, mode in first)
    trial = SampledModalWitness(segments, P_mean, t, setting.ends[0], mu, 1.0, math.inf, 0.0, ratio, math.inf)

    def holds(witness: SampledModalWitness) -> bool:
        return all(
            holds_in_doubles(W_matrix(mode.loop, lifted, witness.of(P, mode.loop), mode.running))
            for P, mode, lifted in ready
        )

    def at(price: float, decay: float = 1.0, weight: float = 0.0) -> SampledModalWitness:
        return replace(trial, kappa=price, kappa_mu=MU * price, decay=decay, weight=weight)

    if setting.rho is not None:
        witness = at(1e8 * noise)
        if holds(witness):
            yield witness
        return
    if claimed is not None:
        decay, least_price = claimed
        prices_tried = (1.1 * 1.3**k * least_price for k in range(12))
        price = next((p for p in prices_tried if holds(at(p, decay=decay))), None)
        if price is not None:
            price, most = 1.5 * price, (1 - decay) / ratio
            halves = (most / 2**k for k in range(8))
            weight = next((w for w in halves if holds(at(price, decay=decay, weight=w))), 0.0)
            yield at(price, decay=decay, weight=0.98 * weight)
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
    loop: ModalLoop, ends: Sequence[float], weights: Performance, witness: SampledModalWitness | None = None
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
    trials = list[tuple[float, SampledModalWitness]]()
    for rate in RATES:
        quiet = _quiet(setting, rate)
        for dear in PRICES_OF_ROUNDING:
            if quiet is None:
                break
            one = next(_priced(setting, quiet[2:], dear, quiet[:2]), None)
            if one is not None:
                trials.append((one.ultimate, one))
                break
    for _, one in sorted(trials, key=lambda pair: pair[0])[:TRIES]:
        verdict = decide_modal_sampled(loop, one)
        if verdict.certified:
            return verdict
        said = verdict.reason
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
) -> tuple[float, SampledModalWitness] | None:
    """Find and prove a small rho mode by mode, from mu and rho of the continuous certificate; None if none is proved."""
    ends = _outside(loop, ends)
    best: tuple[float, float] | None = None
    first = _Setting(loop, ends, weights)
    for scale in SCALES if len(ends) == 2 else SCALES[:1]:
        least_one = _least_rho(first, mu * 10**scale, rho, best)
        if least_one is not None and (best is None or least_one < best[0]):
            best = least_one, mu * 10**scale
    if best is None:
        return None
    for slack in SLACKS:
        setting = first.at(best[1], float(f"{best[0] * (1 + slack):.4g}"))
        found = _found(setting)
        if found is None or setting.rho is None:
            continue
        for dear in PRICES_OF_ROUNDING:
            for witness in _priced(setting, found, dear):
                if proves_modal_rho(loop, weights, setting.rho, witness):
                    return setting.rho, witness
    return None


def _least_rho(setting: _Setting, mu: float, rho: float, best: tuple[float, float] | None) -> float | None:
    """Bisect the least rho for a mu; None where it is no better than the best so far."""

    def holds(value: float) -> bool:
        return _found(setting.at(mu, value)) is not None

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
    inner = [one for one in ends[1:-1] if loop.lower < one < loop.upper]
    step = -(-(len(inner) + 1) // MOST_SEGMENTS)
    return (loop.lower, *inner[step - 1 :: step], loop.upper)
