"""Networks and controllers for the tests of the sampled certificate, and brute force that shares none of its
formulas."""

import numpy as np
from scipy.linalg import block_diag, expm

from lockstep.check.numbers import as_floats
from lockstep.check.system.disagreement import disagreement
from lockstep.check.system.loop import Plant
from lockstep.lmi.sampled import HeldController, SampledNetwork
from lockstep.model.graphs.graph import Graph

SLOPES = np.linspace(-1, 1, 9)
"""Constant slopes tried, as parts of alpha: both ends, and zero."""


def network(A, B, C, G, H, edges, *, N=3, alpha=1.0, period=0.1, delay=0) -> SampledNetwork:
    A, B, C, G, H = (np.atleast_2d(np.array(M, dtype=float)) for M in (A, B, C, G, H))
    plant = Plant(A, (B,) * N, C, G, H).in_numbers(True)
    return SampledNetwork(
        plant, disagreement(Graph.from_edges(N, edges), exact_arithmetic=True), alpha, period, delay
    )


def controllers(tables, order, edges) -> tuple[HeldController, ...]:
    """One controller per agent from tables [A B; C D], rounded to float32."""
    heard = [
        [(source - 1, weight) for listener, source, weight in edges if listener == i + 1]
        for i in range(len(tables))
    ]
    return tuple(
        HeldController.row_by_row(
            np.asarray(table, dtype=np.float32).astype(float),
            order,
            tuple(j for j, _ in listened),
            np.array([weight for _, weight in listened], dtype=float),
        )
        for table, listened in zip(tables, heard, strict=True)
    )


def one_period(net: SampledNetwork, ones, slope: float, steps=(1.0,)) -> np.ndarray:
    """The matrix of (x, x_C[, u]) of all agents over one period, phi_i = slope H x_i: full coordinates, plain expm.

    steps: parts of the period, each with its own factor on the slope.
    """
    A, C, G, H = (as_floats(M) for M in (net.plant.A, net.plant.C, net.plant.G, net.plant.H))
    B = [as_floats(b) for b in net.plant.B]
    n, m, q, N, n_C = len(A), B[0].shape[1], len(C), len(ones), ones[0].order
    size = N * (n + n_C + m)
    x, xc, uu = slice(0, N * n), slice(N * n, N * (n + n_C)), slice(N * (n + n_C), size)
    L = np.zeros((N, N))
    for i, one in enumerate(ones):
        for j, a in zip(one.sources, one.weights, strict=True):
            L[i, i] += a
            L[i, j] -= a
    table = [one.table for one in ones]
    blocks = [
        block_diag(*[t[r, c] for t in table])
        for r in (slice(0, n_C), slice(n_C, None))
        for c in (slice(0, n_C), slice(n_C, None))
    ]
    blocks = [
        b.reshape(N * k, N * l)
        for b, (k, l) in zip(blocks, ((n_C, n_C), (n_C, q), (m, n_C), (m, q)), strict=True)
    ]
    A_C, B_C, C_C, D_C = blocks
    measure = np.kron(L, C)
    compute = np.zeros((size, size))
    compute[x, x], compute[xc, xc], compute[xc, x] = np.eye(N * n), A_C, B_C @ measure
    compute[uu, xc], compute[uu, x] = C_C, D_C @ measure
    total = np.eye(N * (n + m))
    for part, factor in zip(np.full(len(steps), 1 / len(steps)), steps, strict=True):
        F = np.zeros((N * (n + m),) * 2)
        F[: N * n, : N * n] = np.kron(np.eye(N), A + slope * factor * G @ H)
        F[: N * n, N * n :] = block_diag(*B)
        total = expm(F * net.period * part) @ total
    flow = np.eye(size)
    flow[x, x], flow[x, uu] = total[: N * n, : N * n], total[: N * n, N * n :]
    # Without delay u is computed, then held; with one, what was computed before is held and u is for the next period.
    if not net.delay:
        return flow @ compute
    return np.vstack([flow[x], compute[xc], compute[uu]])


def disagreement_radius(net: SampledNetwork, matrix: np.ndarray) -> float:
    """The spectral radius on the quotient by consensus: x_1 = ... = x_N with the controllers at rest is invariant."""
    N, n = net.d.N, net.plant.A.shape[0]
    difference = np.hstack([np.eye(N - 1), -np.ones((N - 1, 1))])
    rest = len(matrix) - N * n
    down = block_diag(np.kron(difference, np.eye(n)), np.eye(rest))
    up = block_diag(np.kron(np.vstack([np.eye(N - 1), np.zeros((1, N - 1))]), np.eye(n)), np.eye(rest))
    return float(np.abs(np.linalg.eigvals(down @ matrix @ up)).max())


def brute_force_radius(net: SampledNetwork, ones, rng=None, switching: int = 0) -> float:
    """The worst growth per period over constant slopes in [-alpha, alpha], and over some that switch within periods."""
    worst = max(disagreement_radius(net, one_period(net, ones, s * net.alpha)) for s in SLOPES)
    for _ in range(switching):
        length = int(rng.integers(1, 5))
        product = np.eye(len(one_period(net, ones, 0.0)))
        for _ in range(length):
            product = one_period(net, ones, net.alpha, tuple(rng.choice([-1.0, 1.0], 4))) @ product
        worst = max(worst, disagreement_radius(net, product) ** (1 / length))
    return worst


def random_problem(seed: int):
    """Three agents of two states that agree for short periods: a lightly damped oscillator under relative feedback."""
    rng = np.random.default_rng(seed)
    edges = [(1, 2, 1.0), (2, 3, 1.0), (3, 1, float(rng.uniform(0.5, 1.5)))] + (
        [(1, 3, 0.5)] if seed % 2 else []
    )
    A = [[0.0, 1.0], [-rng.uniform(1, 4), -rng.uniform(0.2, 1.0)]]
    alpha, period = float(rng.uniform(0.3, 2.0)), float(10 ** rng.uniform(-2, 0.3))
    net = network(
        A,
        [[0.0], [1.0]],
        np.eye(2),
        [[0.0], [1.0]],
        [[1.0, 0.0]],
        edges,
        alpha=alpha,
        period=period,
        delay=seed % 3 == 0,
    )
    tables = [
        [
            [np.exp(-period), *(0.1 * period * rng.standard_normal(2))],
            [0.2 * rng.standard_normal(), -rng.uniform(0, 2), -rng.uniform(0.5, 3)],
        ]
        for _ in range(3)
    ]
    return net, controllers(tables, 1, edges)


def with_alpha(net: SampledNetwork, alpha: float) -> SampledNetwork:
    return SampledNetwork(net.plant, net.d, alpha, net.period, net.delay)


def alpha_that_breaks(net: SampledNetwork, ones) -> float:
    """The least alpha tried for which some constant slope, or some that switches, makes the disagreement grow."""
    low, high = 1e-3, 1e-3
    while brute_force_radius(with_alpha(net, high), ones) < 1:
        low, high = high, 2 * high
        if high > 1e3:
            return np.inf
    for _ in range(10):
        middle = np.sqrt(low * high)
        breaks = brute_force_radius(with_alpha(net, middle), ones) >= 1
        low, high = (low, middle) if breaks else (middle, high)
    return high
