"""How well a graph connects, as one number: the generalised algebraic connectivity.

The number a plays the part that lambda_2 has on an undirected graph. With weights r > 0 of the agents and
V = sum_i r_i |x_i - x_bar|^2, a is the largest number with -V'/2 >= a V along x' = -L x:

    strongly connected   r the left null vector of L, x_bar = r'x, R = diag(r):
                         a = min over r'x = 0 of x'(R L + L'R)x / (2 x'R x)
                         (Yu, Chen, Cao and Kurths, IEEE Trans. Syst., Man, Cybern. B 40(3), 2010); on a balanced graph
                         r = 1/N and a is lambda_2 of (L + L')/2, on an undirected one lambda_2 of L
    one leader           x_bar = x_leader, r = p / q with L_ff' p = 1, L_ff q = 1, L_ff the followers' block;
                         diag(q) (R L_ff + L_ff'R) diag(q) is diagonally dominant, so a > 0
                         (Qu, Cooperative Control of Dynamical Systems, 2009)

Other graphs with a spanning tree (several agents that hear each other lead the rest) have neither, and are
refused.
"""

import numpy as np
from jaxtyping import Float

from lockstep.check.errors import ProblemError
from lockstep.model.graphs.graph import Graph


def connectivity(graph: Graph) -> float:
    """Return the generalised algebraic connectivity a > 0.

    Raises:
        ProblemError: the graph is neither strongly connected nor led by one agent.

    >>> connectivity(Graph.topology("cycle", 3))
    1.5
    """
    graph.check_spanning_tree()
    if len(graph.roots) == graph.N:
        return round(_strongly_connected(graph.laplacian), 14)
    if len(graph.roots) == 1:
        followers = [i for i in range(graph.N) if i + 1 != graph.roots[0]]
        return round(_led(graph.laplacian[np.ix_(followers, followers)]), 14)
    raise ProblemError(
        f"agents {', '.join(map(str, graph.roots))} lead the others together",
        where="[network]",
        expected="a graph that is strongly connected or has one leader: the generalised algebraic"
        " connectivity of others is not defined",
        remedy='use method = "certified", which takes any graph with a spanning tree',
    )


def left_null_vector(L: Float[np.ndarray, "N N"]) -> Float[np.ndarray, " N"]:
    """Return r >= 0 with r'L = 0 and r'1 = 1."""
    from scipy.linalg import null_space

    r = null_space(L.T)[:, 0]
    return np.asarray(r / r.sum())


def _strongly_connected(L: Float[np.ndarray, "N N"]) -> float:
    from scipy.linalg import eigh, null_space

    r = left_null_vector(L)
    basis = null_space(r[None, :])
    RL = r[:, None] * L
    return float(eigh(basis.T @ (RL + RL.T) @ basis / 2, basis.T @ np.diag(r) @ basis, eigvals_only=True)[0])


def _led(L_ff: Float[np.ndarray, "F F"]) -> float:
    from scipy.linalg import eigh

    ones = np.ones(len(L_ff))
    r = np.linalg.solve(L_ff.T, ones) / np.linalg.solve(L_ff, ones)
    RL = r[:, None] * L_ff
    return float(eigh((RL + RL.T) / 2, np.diag(r), eigvals_only=True)[0])
