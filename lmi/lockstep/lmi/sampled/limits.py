"""The largest disagreement from which no input meets its limit is looked for here, in doubles, and put to the checker.

Without rounding, for some decay, the witness with the largest radius is a semidefinite program in P and the pair weights m:

    [ decay P - start' (M (x) Q_1) start    N' P    0         ]
    [ P N                                   P       P J F     ]  >= 0,    F F' = I (x) S_1,   M = sum m_ij M_ij,
    [ 0                                     F'J'P   M (x) I   ]

written for (xi+ - xi) / T in coordinates in which P is near the identity, with P >= k_l' k_l / u_max,l^2 for every input,
gamma (T T')^-1 (x) I >= P_dd, gamma least: radius = gamma^-1/2.
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from lockstep.check.sampled.controller import HeldController, Network
from lockstep.check.sampled.inequality import Witness, metric, multiplier, step_matrix
from lockstep.check.sampled.lifting import Lifted, copies
from lockstep.check.sampled.limits import proves_radius
from lockstep.check.sampled.loop import SampledLoop, sampled_loop
from lockstep.lmi.analysis.solve import run
from lockstep.lmi.sampled.candidates import ROUNDINGS, confirmed, priced
from lockstep.lmi.sampled.certify import in_doubles, period_in_doubles
from lockstep.lmi.sampled.search import spectral_radius
from lockstep.lmi.sampled.storage import rounding_prices

RATES = (0.005, 0.02, 0.1)
"""How fast V is asked to decay, as parts of how fast the linear loop does."""

KEPT = (0.995, 0.97, 0.9)
"""Parts of the radius found that are claimed: rounding needs some room."""

CLAIMED = 0.5
"""The part of the decay that is claimed: the rest is room for rounding."""

FLATTEST = 1e-5
"""P in units of gamma, at least: the room is a part of P."""

DEAR = 1e8
"""What the messages' noise costs, in multiples of what it weighs in P: there is none in this claim."""


def largest_radius(
    network: Network, controllers: tuple[HeldController, ...], limits: Float[np.ndarray, " m"]
) -> tuple[float, Witness] | None:
    """Find and prove a large radius, in short decimals; None if none is proved.

    Args:
        network: agents, coordinates, alpha, period, delay, the matrices exact.
        controllers: one per agent, with the coefficients of the code.
        limits: (m,) of each agent's inputs.
    """
    loop, exact_loop = in_doubles(network, controllers), sampled_loop(network, controllers)
    one = period_in_doubles(loop)
    if one is None or not np.isfinite(limits).any():
        return None
    spread = 1 - spectral_radius(loop, one) ** 2
    found = [_least(loop, one, limits, 1 - rate * spread) for rate in RATES] if spread > 0 else []
    for gamma, witness in sorted((each for each in found if each is not None), key=lambda each: each[0]):
        for candidate in _rounded(loop, one, witness):
            for part in KEPT:
                radius = float(f"{part / gamma**0.5:.4g}")
                if proves_radius(exact_loop, controllers, candidate, limits, radius):
                    return radius, candidate
    return None


def _least(
    loop: SampledLoop, one: Lifted, limits: Float[np.ndarray, " m"], decay: float
) -> tuple[float, Witness] | None:
    """Return gamma and its witness without prices of the errors, or None."""
    import cvxpy as cp

    d, n_xi, n_d, T = loop.network.d, loop.n_xi, loop.n_d, loop.network.period
    lifted, pairs, start = copies(one, np.eye(d.N - 1)), d.pairs(), loop.start[:, :n_xi]
    N = np.vstack([lifted.A_d @ start, loop.advanced[:, :n_xi]])
    rows = np.array([row / limits[k % len(limits)] for k, row in enumerate(loop.computed[:, :n_xi])])
    L = _basis(N, rows)
    if L is None:
        return None
    inverse = np.linalg.inv(L)
    values, vectors = np.linalg.eigh(one.S)
    root = (vectors * np.sqrt(np.maximum(values, 0.0)))[:, values > 1e-14 * values.max(initial=0.0)]
    F = L[:n_d].T @ np.kron(np.eye(d.N - 1), root) / np.sqrt(T)
    D, rate = L.T @ (N - np.eye(n_xi)) @ inverse.T / T, (1 - decay) / T
    V, m = cp.Variable((n_xi, n_xi), symmetric=True), cp.Variable(len(pairs), nonneg=True)
    P, gamma = L @ V @ L.T, cp.Variable()
    # Linear in M, and `copies` wants a regular one.
    whole, unit = np.eye(d.N - 1), np.eye(root.shape[1])
    Q_of = [copies(one, whole + d.pair_multiplier(i, j)).Q - lifted.Q for i, j in pairs]
    costs = [inverse @ start.T @ each @ start @ inverse.T / T for each in Q_of]
    M = sum(m[k] * np.kron(d.pair_multiplier(i, j), unit) for k, (i, j) in enumerate(pairs))
    Q = sum(m[k] * cost for k, cost in enumerate(costs))
    along, into = V @ D, V @ F
    first, across = -rate * V - Q - along - along.T, np.sqrt(T) * along
    form = cp.bmat(
        [[first, across.T, -into], [across, V, np.sqrt(T) * into], [-into.T, np.sqrt(T) * into.T, M]]
    )
    conditions = [
        (form + form.T) / 2 >> 0,
        V - FLATTEST * gamma * np.eye(n_xi) >> 0,
        gamma * np.asarray(metric(loop)) - P[:n_d, :n_d] >> 0,
    ]
    conditions += [V - np.outer(inner, inner) >> 0 for inner in rows @ inverse.T if inner.any()]
    problem = cp.Problem(cp.Minimize(gamma), conditions)
    if not run(problem) or V.value is None or m.value is None:
        return None
    weights = np.maximum(m.value, 1e-9 * max(float(m.value.max()), 1e-300))
    found = Witness((P.value + P.value.T) / 2, weights, np.zeros(len(loop.ways)), decay, 0.0)
    return float(gamma.value), found


def _basis(N: Float[np.ndarray, "n n"], rows: Float[np.ndarray, "k n"]) -> Float[np.ndarray, "n n"] | None:
    """Return L, |L'xi|^2 a multiple of the sum of |N^k xi|^2 in which the longest row is about 1; None if N is not stable."""
    from scipy.linalg import solve_discrete_lyapunov

    try:
        L = np.linalg.cholesky(solve_discrete_lyapunov(N.T, np.eye(len(N))))
    except (np.linalg.LinAlgError, ValueError):
        return None
    return np.asarray(L * np.linalg.norm(np.linalg.solve(L, rows.T), axis=0).max())


def _rounded(loop: SampledLoop, one: Lifted, found: Witness) -> Iterator[Witness]:
    """Yield the witness with prices of every error."""
    lifted = copies(one, multiplier(loop.network.d, found.m))
    decay = 1 - CLAIMED * (1 - found.decay)
    N = step_matrix(loop, lifted)
    kappa = DEAR * float(np.linalg.norm(N[:, loop.noise].T @ found.P @ N[:, loop.noise], 2) or 1.0)
    for dear in ROUNDINGS:
        t = rounding_prices(loop, lifted, found.P, dear)
        candidate = confirmed(loop, lifted, priced(loop, found.m, t, kappa, decay=decay, P=found.P))
        if candidate is not None:
            yield candidate
