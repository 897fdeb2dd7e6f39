"""Small random problems and gains for them: what a floor is held against."""

from dataclasses import replace
from typing import Any

import numpy as np

from lockstep.check.bound.slope_bounds import Entry
from lockstep.check.continuous.inequality import Claim
from lockstep.check.floor.witness import proves_floor
from lockstep.lmi.analysis.certificate_sdp import least_rho
from lockstep.lmi.floor.bisection import largest_floor
from lockstep.model.agents.agent import Agent
from lockstep.model.graphs.graph import Graph
from lockstep.model.network import Network

GRAPHS = {
    2: [[(1, 2)], [(1, 2), (2, 1)], [(1, 2, 0.5), (2, 1, 2.0)]],
    3: [
        [(1, 2), (2, 3), (3, 1)],
        [(1, 2), (2, 1), (2, 3), (3, 2)],
        [(2, 1), (3, 1, 2.0)],
        [(1, 2, 0.25), (2, 1), (3, 1), (1, 3, 3.0)],
    ],
}
"""Cycles, paths, leaders, weights: (listener, source[, weight])."""

DRAWS, KEPT, STEPS = 20, 1, 16
"""Gains drawn of each size, stable ones looked at, steps from the best."""

SCALES = (0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
"""Sizes of random gains; the floor has no limit on them."""


def random_problem(rng: np.random.Generator) -> tuple[Network, Claim, int]:
    """One or two states, two or three agents, order 0 or 1, with a nonlinearity or without, B_i of their own or not.

    Half of them have noise, weighed inputs or scaled disturbances, and half of those with a nonlinearity a bound of its own
    for its one slope. Entries are quarters, so that the problem is what its text says; half of the agents are stable.
    """
    n, N, order = int(rng.choice([1, 2, 2, 2])), int(rng.integers(2, 4)), int(rng.integers(0, 2))
    A = quarters(rng, n, n)
    if rng.random() < 0.5:
        A -= np.eye(n) * (1.0 + np.ceil(max(np.linalg.eigvals(A).real.max(), 0.0)))
    G, H = quarters(rng, n, 1), quarters(rng, 1, n)
    C = np.array([measured(rng, n) for _ in range(int(rng.integers(1, 3)))])
    own = [quarters(rng, n, 1) for _ in range(N)] if rng.random() < 0.3 else [quarters(rng, n, 1)] * N
    states = ["x", "z"][:n]
    dynamics = {
        state: f"{line(A[i], states)} + {own[0][i, 0]}*u + {G[i, 0]}*sin({line(H[0], states)})"
        for i, state in enumerate(states)
    }
    outputs = {f"y{i}": line(row, states) for i, row in enumerate(C, start=1)}
    agent = Agent.from_expressions("a", states=states, inputs=["u"], dynamics=dynamics, outputs=outputs)
    graph = Graph.from_edges(N, GRAPHS[N][int(rng.integers(len(GRAPHS[N])))])
    alpha = float(rng.choice([0.25, 0.5, 1.0, 2.0])) if agent.lure.G.shape[1] else 0.0
    R = np.eye(n) * float(rng.choice([0.25, 1.0, 4.0]))
    parts: dict[str, Any] = {}
    if rng.random() < 0.5:
        parts["W"] = np.array([[float(rng.choice([0.0, 0.25, 4.0]))]])
        parts["outputs"] = rng.choice([0.0, 0.25, 1.0], len(C))
        parts["states"] = (
            rng.choice([0.0, 0.5, 2.0], n, p=[0.2, 0.4, 0.4]) if rng.random() < 0.5 else np.zeros(0)
        )
        if len(parts["states"]) and not parts["states"].any():
            parts["states"] = np.ones(n)
    claim = replace(plain(N, alpha, R), Q=np.eye(order), **parts)
    posed = Network(agent, graph, own)
    if alpha and rng.random() < 0.5:
        arguments = range(len(agent.lure.H))
        bounds = rng.choice([0.25, 0.5, 1.0], len(arguments)) * alpha
        claim = replace(claim, entries=tuple(Entry(0, l, float(bounds[l])) for l in arguments))
    return posed, claim, order


def plain(N: int, alpha: float, R: np.ndarray) -> Claim:
    """Return a claim without entries, noise, weights of inputs or fragility, of order 0."""
    return Claim(alpha, R, np.zeros((0, 0)), np.zeros((N, 4)))


def floor(posed: Network, claim: Claim) -> float:
    """Return the floor, decided apart from the search for it; 0 where there is none."""
    witness = largest_floor(posed.matrices, claim)
    if witness is None:
        return 0.0
    assert proves_floor(posed.matrices, claim, witness)
    return witness.rho


def best_found(network: Network, claim: Claim, order: int, rng: np.random.Generator) -> np.ndarray | None:
    """Return the gains with the least rho met: random ones of all sizes, then steps from the best; or None."""
    loop = network.loop(order)
    shape = (network.N, order + network.agent.m, order + network.agent.q)
    best, least = None, np.inf

    def look_at(K: np.ndarray) -> None:
        nonlocal best, least
        if np.linalg.eigvals(loop.A_cl(K)).real.max() >= 0:
            return
        found = least_rho(loop, K, claim)
        if found is not None and found.rho < least:
            best, least = K, found.rho

    for scale in SCALES:
        for shared in (False, True):
            drawn = [scale * draw(rng, shape, shared) for _ in range(DRAWS)]
            stable = [K for K in drawn if np.linalg.eigvals(loop.A_cl(K)).real.max() < 0]
            for K in stable[:KEPT]:
                look_at(K)
    for step in range(STEPS):
        if best is not None:
            look_at(best * (1 + rng.normal(size=shape) / (2 + step / 4)))
    return best


def draw(rng: np.random.Generator, shape: tuple[int, ...], shared: bool) -> np.ndarray:
    """Return gains of size one; shared: the same for all agents."""
    return np.repeat(rng.normal(size=(1, *shape[1:])), shape[0], axis=0) if shared else rng.normal(size=shape)


def quarters(rng: np.random.Generator, rows: int, columns: int) -> np.ndarray:
    """Entries of -2, -1.75, ..., 2, a third of them 0."""
    return rng.integers(-8, 9, (rows, columns)) / 4.0 * (rng.random((rows, columns)) < 0.67)


def measured(rng: np.random.Generator, n: int) -> np.ndarray:
    """Return a row that is not 0: an output measures something."""
    row = quarters(rng, 1, n)[0]
    return row if row.any() else measured(rng, n)


def line(row: np.ndarray, states: list[str]) -> str:
    return " + ".join(f"{entry}*{state}" for entry, state in zip(row, states, strict=True))
