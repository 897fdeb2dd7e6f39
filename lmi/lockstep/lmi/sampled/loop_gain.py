"""The gain around the nonlinearity by frequencies, and the multiplier that makes it small: in doubles, for the search.

Nothing here is believed: what is found is proved elsewhere.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from lockstep.check.bound.slope_bounds import Entry
from lockstep.check.continuous.inequality import Certificate
from lockstep.check.sampled.inequality import multiplier
from lockstep.check.sampled.lifting import Lifted
from lockstep.check.sampled.loop import SampledLoop
from lockstep.check.sampled.sector import Sector
from lockstep.lmi.analysis.semidefinite import square_root_factor
from lockstep.lmi.shapes import PairWeights

FREQUENCIES = np.concatenate([[0.0], np.geomspace(1e-4, np.pi, 160)])
"""In rad per period. A peak between two of them only makes the multiplier a little worse."""

COMFORTABLE = 0.9
"""A gain below this leaves room enough: the multiplier is not improved further."""

EVALUATIONS = 200


def gain(loop: SampledLoop, one: Lifted, m: PairWeights) -> float:
    """Return the largest gain of the discrete loop from w to z under a multiplier; infinite if the loop is unstable.

    Below 1 the nonlinear loop is proved stable, on these frequencies at least.
    """
    return _Response(loop, one).gain(m)


def spectral_radius(loop: SampledLoop, one: Lifted) -> float:
    """Return the largest |eigenvalue| of a period without errors: of the linear loop where alpha is 0.

    Where `one` has the nonlinearity lifted into it, it is that of the equivalent step: stable if the gain is below 1.
    """
    return float(np.abs(np.linalg.eigvals(_step_of_state(loop, one))).max(initial=0.0))


def _step_of_state(loop: SampledLoop, one: Lifted) -> Float[np.ndarray, "n_x n_x"]:
    unit = np.eye(loop.network.d.N - 1)
    n = one.n
    A_d = np.hstack([np.kron(unit, one.A_d[:, :n]), np.kron(unit, one.A_d[:, n:])])
    return np.vstack([A_d @ loop.start, loop.advanced])[:, : loop.n_x]


class _Response:
    """The discrete frequency response from w to z, one agent's factors of S and Q in each copy."""

    def __init__(self, loop: SampledLoop, one: Lifted) -> None:
        self.d = loop.network.d
        copies_ = self.d.N - 1
        into, out = square_root_factor(one.BB_d, 1e-14), square_root_factor(one.CC_d, 1e-14).T
        self.into, self.out = into.shape[1], out.shape[0]
        unit, n = np.eye(copies_), one.n
        C = np.hstack([np.kron(unit, out[:, :n]), np.kron(unit, out[:, n:])]) @ loop.start[:, : loop.n_x]
        B = np.vstack([np.kron(unit, into), np.zeros((loop.n_x - loop.n_d, copies_ * self.into))])
        poles, vectors = np.linalg.eig(_step_of_state(loop, one))
        self.stable = bool(np.abs(poles).max(initial=0.0) < 1)
        resolvent = 1 / (np.exp(1j * FREQUENCIES)[:, None] - poles)
        # The grid also holds the angles of the poles, where a lightly damped loop peaks.
        angles = np.abs(np.angle(poles[np.abs(poles) > 1e-9]))
        if len(angles):
            resolvent = np.vstack([resolvent, 1 / (np.exp(1j * angles)[:, None] - poles)])
        right = np.linalg.lstsq(vectors, B.astype(complex), rcond=None)[0]
        self.response = np.einsum("ij,kj,jl->kil", C @ vectors, resolvent, right)

    def gain(self, m: PairWeights) -> float:
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


def best_multiplier(
    loop: SampledLoop, one: Lifted, m: PairWeights, *, least: float = 0.0
) -> tuple[PairWeights, float]:
    """Return pair weights of sum 1 under which the gain is small, and that gain, from a first guess.

    A first guess with a gain below `COMFORTABLE`, or `least`, is taken as it is; one below `least` is not lowered further.
    """
    from scipy.optimize import OptimizeResult, minimize

    def end(intermediate_result: OptimizeResult) -> None:
        if intermediate_result.fun < least:
            raise StopIteration

    response = _Response(loop, one)
    m = _scaled(m)
    first = response.gain(m)
    if first < max(COMFORTABLE, least) or not response.stable or len(m) < 2:
        return m, first
    found = minimize(
        lambda logs: min(response.gain(_scaled(np.exp(np.clip(logs, -40, 0)))), 1e9),
        np.log(m),
        method="Nelder-Mead",
        callback=end,
        options={"maxfev": EVALUATIONS, "adaptive": True, "xatol": 1e-3, "fatol": 1e-5},
    )
    best = _scaled(np.exp(np.clip(found.x, -40, 0)))
    return (best, float(found.fun)) if found.fun < first else (m, first)


def _scaled(m: PairWeights) -> PairWeights:
    """Return weights of sum 1, none below 1e-9 of it: only their ratios count."""
    total = m.sum()
    return np.asarray(np.maximum(m / total if total > 0 else np.full(len(m), 1 / max(len(m), 1)), 1e-9))


def common_pair_weights(entries: Sequence[Entry], certificate: Certificate, sector: Sector) -> PairWeights:
    """Return weights with which the sector is about what each pair has in the continuous certificate: a first guess."""
    total = len(sector.Pi_w) * certificate.m
    for k in {one.component for one in entries}:
        rows = [c for c, one in enumerate(entries) if one.component == k]
        with np.errstate(divide="ignore"):
            total = total + 1 / (1 / certificate.m_entries[rows]).sum(axis=0)
    return np.asarray(total / sector.Pi_w.sum())
