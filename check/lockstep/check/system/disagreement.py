"""Disagreement coordinates x_d = (T (x) I) x, in which consensus is the stability of zero.

T in R^{(N-1) x N} has full row rank and T 1 = 0. The paper's (14) takes N - 1 rows of L; the default here is
an orthonormal basis of the complement of 1, under which no agent is special and rho is the true gain from the
disagreement of the disturbances to the disagreement of the states. An orthonormal T is irrational, so its
rational stand-in T = [I, -1] is used with the metric S = (T T')^-1: for x_d = T x, x_d' S x_d is the squared
length of the projection of x on the complement of 1, exactly as in orthonormal coordinates.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from lockstep.check.numbers import Matrix, converter, eye, inverse, is_exact, zeros
from lockstep.check.system.graph import Digraph

Coordinates = Literal["orthonormal", "laplacian_rows"]


@dataclass(frozen=True)
class Disagreement:
    """The map to disagreement coordinates and what the network becomes in them.

    T: (N-1, N), x_d = (T (x) I) x;  right: (N, N-1) with T right = I and last row 0;
    S: (N-1, N-1), the metric of x_d;  L: (N, N) the Laplacian (1);  L_r: (N, N-1) with L = L_r T, the paper's
    C_r being L_r (x) C.
    """

    T: Matrix
    right: Matrix
    S: Matrix
    L: Matrix
    L_r: Matrix

    @property
    def N(self) -> int:
        """Number of agents."""
        return int(self.T.shape[1])

    def pair_multiplier(self, i: int, j: int) -> Matrix:
        """Return M_ij with x_d' (M_ij (x) X) x_d = (x_i - x_j)' X (x_i - x_j): right' (e_i - e_j)(e_i - e_j)' right."""
        row = self.right[i] - self.right[j]
        return np.outer(row, row)

    def squared_distance(self, n: int) -> Matrix:
        """Return (T T')^-1 (x) I_n: x_d' ((T T')^-1 (x) I) x_d = sum_i |x_i - mean|^2, whatever T is."""
        return np.kron(inverse(self.T @ self.T.T), eye(n, self.T))

    def pairs(self) -> list[tuple[int, int]]:
        """Return all unordered pairs of agents, in the order of the multiplier weights m."""
        return [(i, j) for i in range(self.N) for j in range(i + 1, self.N)]


def disagreement(
    graph: Digraph, coordinates: Coordinates = "orthonormal", *, exact_arithmetic: bool = False
) -> Disagreement:
    """Return the disagreement coordinates of a graph with a spanning tree.

    Any T with T 1 = 0 and full row rank is T = T_1 [I, -1], so T_1^-1 stacked on a zero row is a right
    inverse.
    """
    number = converter(exact_arithmetic)
    L, N = graph.laplacian_in(exact_arithmetic=exact_arithmetic), graph.N
    from_first = number(np.hstack([np.eye(N - 1), -np.ones((N - 1, 1))]))
    T = np.delete(L, _dependent_row(graph), axis=0) if coordinates == "laplacian_rows" else from_first
    zero_row = number(np.zeros((1, N - 1)))
    right = np.vstack([inverse(T[:, : N - 1]), zero_row])
    S = eye(N - 1, T) if coordinates == "laplacian_rows" else inverse(T @ T.T)
    return Disagreement(T=T, right=right, S=S, L=L, L_r=L @ right)


def single_difference(like: Matrix, value: float = 0.0) -> Disagreement:
    """Return the coordinates of one mode, x_d being one difference with metric 1, in which the loop sees value times it."""
    one, number = eye(1, like), converter(is_exact(like))
    across = np.vstack([one, 0 * one])
    return Disagreement(across.T, across, one, zeros(2, 2, like), number(np.array([value]))[0] * across)


def _dependent_row(graph: Digraph) -> int:
    """Return a row of L that depends on the others: a root's (a leader's zero row is one), the last such.

    Removing any other row would lose rank N - 1, which the paper's Section 3 overlooks.
    """
    return max(graph.roots) - 1
