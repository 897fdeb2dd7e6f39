"""Loops that the simulation's tests share: the paper's arms, and linear agents whose motion is known in closed form."""

import numpy as np

from amini.claims.example import TABLE_1, network
from lockstep.check.system.loop import Gains
from lockstep.model.agents.agent import Agent
from lockstep.model.graphs.graph import Graph
from lockstep.model.network import Network

ARMS = network()
COROLLARY_1, THEOREM_1 = TABLE_1["corollary_1"], TABLE_1["theorem_1"]
START = np.array([[0.8, 0.0, 0.8, 0.0], [-0.5, 0.0, -0.5, 0.0], [0.2, 0.0, 0.2, 0.0]])


def carts(N: int = 3) -> Network:
    """Carts with friction: p' = v, v' = -0.2 p - 0.7 v + f, both states measured."""
    agent = Agent.from_expressions(
        "cart",
        states=["p", "v"],
        inputs=["f"],
        dynamics={"p": "v", "v": "-0.2*p - 0.7*v + f"},
        outputs={"y1": "p", "y2": "v"},
    )
    return Network(agent, Graph.topology("cycle", N))


def cart_gains(N: int = 3) -> Gains:
    """Controllers of order 1, different for each agent."""
    return Gains(
        A=tuple(np.array([[-1.0 - 0.2 * i]]) for i in range(N)),
        B=tuple(np.array([[0.3, -0.1 * i]]) for i in range(N)),
        C=tuple(np.array([[0.5]]) for _ in range(N)),
        D=tuple(np.array([[-1.2 + 0.1 * i, -0.8]]) for i in range(N)),
    )


def loop_matrix(one: Network, gains: Gains) -> np.ndarray:
    """A of (x, x_C)' = A (x, x_C) for agents with h = 0, put together from (12) entry by entry."""
    lure, N, n, n_C = one.agent.lure, one.N, one.agent.n, gains.order
    L = one.graph.laplacian
    A = np.zeros((N * (n + n_C),) * 2)
    for i in range(N):
        x_i, c_i = slice(i * n, (i + 1) * n), slice(N * n + i * n_C, N * n + (i + 1) * n_C)
        A[x_i, x_i] += lure.A
        A[x_i, c_i] = one.B[i] @ gains.C[i]
        A[c_i, c_i] = gains.A[i]
        for j in range(N):
            x_j = slice(j * n, (j + 1) * n)
            A[x_i, x_j] += L[i, j] * one.B[i] @ gains.D[i] @ lure.C
            A[c_i, x_j] += L[i, j] * gains.B[i] @ lure.C
    return A
