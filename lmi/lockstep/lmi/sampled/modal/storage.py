"""Storage functions of modes, one P for each segment of eigenvalues: by semidefinite programs and Lyapunov equations."""

import math
from itertools import pairwise

import numpy as np

from lockstep.check.sampled.inequality import step_matrix
from lockstep.lmi.analysis.semidefinite import Block, minimise, symmetric_basis
from lockstep.lmi.sampled.modal.mode import LiftedMode, ModalSetting, Storage

CLAIMED = 0.7
"""The part of the decay that is claimed."""

LARGEST = 1e4
"""P <= LARGEST I in the coordinates of the linear loop: P and mu could be scaled up without end."""


def quiet_storages(
    setting: ModalSetting, rate: float, claimed: float
) -> tuple[float, float, tuple[Storage, ...], float, Storage] | None:
    """Return the decay claimed, kappa, P of each segment, mu and P of the mean that pass little noise on; None for none.

    The least kappa with V >= |x_d|^2, V shrinking by a part `rate` of what the linear loop does; `claimed` of that is.
    """
    if (most := linear_loss(setting)) is None:
        return None
    lost, storages, mu, kappa = rate * most, list[Storage](), None, 0.0
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
    return 1 - claimed * lost, kappa, tuple(storages), mu, 0.1 * kappa / max(spread, 1e-300) * _square(base)


def linear_loss(setting: ModalSetting) -> float | None:
    """Return the part of V that the slowest mode of the linear loop loses in a period; None where one is not stable."""
    ends = [setting.mode(value) for value in setting.ends]
    slowest = max((_radius(mode) for mode in ends if mode is not None), default=1.0)
    return None if None in ends or not slowest < 1 else 1 - slowest**2


def _radius(mode: LiftedMode) -> float:
    return float(np.abs(np.linalg.eigvals(mode.step)).max(initial=0.0))


def _least_noise(
    setting: ModalSetting, low: float, high: float, decay: float, mu: float | None
) -> tuple[Storage, float, float] | None:
    """Return P, mu and the least kappa of a segment, mu being free where none is given."""
    modes = [setting.mode(value) for value in sorted({low, high})]
    middle = setting.mode(math.sqrt(low * high))
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
    solved = minimise(np.eye(k)[k - 1], blocks)
    if solved is None or not solved.x[k - 2] > 0:
        return None
    P = unit * base @ np.tensordot(solved.x[: k - 2], basis, 1) @ base.T
    return (P + P.T) / 2, unit * of_mu * float(solved.x[k - 2]), unit * of_noise * float(solved.x[k - 1])


def _segment(setting: ModalSetting, low: float, high: float) -> tuple[Storage, float, float] | None:
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
    solved = minimise(-np.eye(k)[k - 1], blocks)
    if solved is None or not solved.x[-1] > 0 or max(map(_radius, filter(None, modes))) >= 1:
        return None
    P = base @ np.tensordot(solved.x[: k - 2], symmetric_basis(n), 1) @ base.T
    mu = setting.mu if setting.rho is not None else float(solved.x[k - 2]) * units[0]
    return (P + P.T) / 2, mu, float(solved.x[-1])


def _base(mode: LiftedMode, setting: ModalSetting) -> Storage | None:
    """Return the Cholesky factor of P = A'P A + T diag(R, Q); None where the loop is not stable."""
    from scipy.linalg import solve_discrete_lyapunov

    A, n = mode.step, mode.loop.n_x
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


def storages_of(setting: ModalSetting) -> tuple[tuple[Storage, ...], float, Storage] | None:
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


def _square(base: Storage) -> Storage:
    P = base @ base.T
    return np.asarray((P + P.T) / 2)
