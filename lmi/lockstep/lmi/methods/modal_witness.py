"""The certificate of the modes for given gains as a semidefinite program: the least sigma, or a witness inside."""

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from lockstep.check.continuous.inequality import Claim, performance_weight
from lockstep.check.continuous.modes import Modes
from lockstep.lmi.analysis.certificate_sdp import solve_sdp

if TYPE_CHECKING:
    import cvxpy as cp

HALVINGS, WORTHWHILE = 5, 0.01
"""For the gains found each segment is cut in two, at most so many times, until that lowers rho by less than this part of
it. One P for lambda from 1 to 4 costs a ring of carts a factor of 2.6 over a P for each lambda: the sampled loop, whose
certificate knows nothing of segments, would be proved a smaller rho than the continuous one. Ten arms with eigenvalues from
1.8 to 6.2 have no certificate with one P, none worth having with two, and 8.9 with eight."""

NARROW = 1e-6
"""A spectrum this narrow, relatively, is one lambda."""


@dataclass(frozen=True)
class ModalWitness:
    """P of each segment, mu of each sector, sigma and P_mean, in doubles."""

    P: tuple[Float[np.ndarray, "k k"], ...]
    mu: Float[np.ndarray, " sectors"]
    sigma: float
    P_mean: Float[np.ndarray, "n_C n_C"]


def witness(
    modes: Modes,
    K: Float[np.ndarray, "a b"],
    claim: Claim,
    ends: Float[np.ndarray, "s"],
    sigma: float | None = None,
) -> ModalWitness | None:
    """Minimise sigma, or, for a given one, go as far inside as possible; None where the solver finds nothing.

    Each segment is written in coordinates in which P = I solves the Lyapunov equation at its middle.
    """
    import cvxpy as cp

    segments = [(float(a), float(b)) for a, b in pairwise(ends)]
    bases = [storage_factor(modes, K, claim, float(np.sqrt(a * b))) for a, b in segments]
    P_mean = _mean(modes, K, claim)
    if P_mean is None or any(base is None for base in bases):
        return None
    L = [base for base in bases if base is not None]
    unit = max(float(np.linalg.norm(base, 2)) for base in L) ** 2
    mu, s2, room = cp.Variable(1 + len(claim.entries)), cp.Variable(), cp.Variable()
    n = len(modes.plant.A) + modes.order
    P = [cp.Variable((n, n), symmetric=True) for _ in segments]
    conditions = [mu >= 0, s2 >= 0]
    for one, base, pair in zip(P, L, segments, strict=True):
        conditions.append(one >> (room * np.eye(n) if sigma is not None else 0))
        for value in pair:
            F = _balanced(modes, K, claim, value, one, base, mu, s2, unit)
            conditions.append(F + (room * np.eye(F.shape[0]) if sigma is not None else 0) << 0)
    if sigma is None:
        problem = cp.Problem(cp.Minimize(s2), conditions)
    else:
        problem = cp.Problem(cp.Maximize(room), [*conditions, s2 == sigma / unit, room <= 1])
    if not solve_sdp(problem) or s2.value is None or (sigma is not None and float(room.value) <= 0):
        return None
    found = tuple(base @ (one.value + one.value.T) @ base.T / 2 for one, base in zip(P, L, strict=True))
    weights = np.maximum(mu.value, 0.0) * unit if modes.plant.G.shape[1] else np.zeros(1)
    return ModalWitness(found, weights, float(s2.value) * unit if sigma is None else sigma, P_mean)


def fine_witness(
    modes: Modes,
    K: Float[np.ndarray, "a b"],
    claim: Claim,
    ends: Float[np.ndarray, " s"],
    halvings: int = HALVINGS,
) -> tuple[Float[np.ndarray, " t"], ModalWitness | None]:
    """Return segments so fine that finer ones lower rho little, and the least sigma with them.

    Args:
        modes, K, claim: see `witness`.
        ends: of segments that may be cut, all of them in two, at most so many times (`halvings`).
    """
    least = witness(modes, K, claim, ends)
    for _ in range(halvings if ends[-1] > ends[0] * (1 + NARROW) else 0):
        finer = halved_segments(ends)
        found = witness(modes, K, claim, finer)
        if found is None and least is not None:
            break
        before, ends, least = least, finer, found
        if before is not None and found is not None and found.sigma > (1 - WORTHWHILE) ** 2 * before.sigma:
            break
    return ends, least


def halved_segments(ends: Float[np.ndarray, " s"]) -> Float[np.ndarray, " t"]:
    """Return the ends of segments twice as many, each cut at its geometric mean, in short decimals.

    >>> halved_segments(np.array([1.0, 4.0])).tolist()
    [1.0, 2.0, 4.0]
    """
    cuts = [float(f"{np.sqrt(a * b):.4g}") for a, b in pairwise(ends)]
    return np.unique(np.concatenate([ends, cuts]))


def storage_factor(
    modes: Modes, K: Float[np.ndarray, "a b"], claim: Claim, value: float
) -> Float[np.ndarray, "k k"] | None:
    """Return the Cholesky factor of P with He(P A(lambda)) = -diag(R, Q); None where A(lambda) is not stable."""
    loop = modes.at(value)
    return _lyapunov_factor(loop.A_cl(K[None]), performance_weight(loop, claim))


def _lyapunov_factor(
    A: Float[np.ndarray, "k k"], weight: Float[np.ndarray, "k k"]
) -> Float[np.ndarray, "k k"] | None:
    from scipy.linalg import solve_continuous_lyapunov

    if len(A) and np.linalg.eigvals(A).real.max() >= 0:
        return None
    try:
        P = solve_continuous_lyapunov(A.T, -weight)
        return np.asarray(np.linalg.cholesky((P + P.T) / 2))
    except (np.linalg.LinAlgError, ValueError):
        return None


def _mean(modes: Modes, K: Float[np.ndarray, "a b"], claim: Claim) -> Float[np.ndarray, "c c"] | None:
    """Return P_mean with He(P_mean A_C) = -2 (Q + C_C'W C_C): half of it is room for rounding."""
    if not modes.order:
        return np.zeros((0, 0))
    A_C = K[: modes.order, : modes.order] + modes.decay * np.eye(modes.order)
    C_C = K[modes.order :, : modes.order]
    L = _lyapunov_factor(A_C, 2 * (claim.Q + (C_C.T @ claim.W @ C_C if len(claim.W) else 0)))
    return None if L is None else np.asarray(L @ L.T)


def _balanced(
    modes: Modes,
    K: Float[np.ndarray, "a b"],
    claim: Claim,
    value: float,
    P: "cp.Variable",
    L: Float[np.ndarray, "k k"],
    mu: "cp.Variable",
    s2: "cp.Variable",
    unit: float,
) -> Any:
    """Return the matrix of a mode in balanced coordinates; mu and sigma in multiples of `unit`."""
    stated = modes.inequality(claim, value)
    D = np.eye(stated.size) / unit**0.5
    D[: len(L), : len(L)] = np.linalg.inv(L)
    half = np.eye(stated.size, len(L)) @ P @ (L.T @ stated.flow(K[None]) @ D.T)
    sigma, *sectors = unit * (D @ stated.slopes(K[None]) @ D.T)
    F = half + half.T + D @ stated.constant(K[None]) @ D.T + s2 * sigma
    F = F + sum(mu[c] * form for c, form in enumerate(sectors))
    return (F + F.T) / 2
