"""The communication graph of a problem: the checker's, and what is said of it to people."""

import numpy as np
from jaxtyping import Float

from lockstep.check.errors import ProblemError
from lockstep.check.system.graph import Digraph
from lockstep.check.system.graph import Topology as Topology


class Graph(Digraph):
    """A directed weighted graph of N >= 2 agents; see `lockstep.check.system.graph`.

    >>> Graph.from_edges(3, [[1, 2], [2, 3], [3, 1]]).is_balanced
    True
    """

    @property
    def in_degrees(self) -> Float[np.ndarray, " N"]:
        """deg_i = sum_j a_ij of (1): the total weight agent i listens to."""
        return np.asarray(self.adjacency.sum(axis=1))

    @property
    def is_undirected(self) -> bool:
        """Whether a_ij = a_ji for all pairs."""
        return bool((self.adjacency == self.adjacency.T).all())

    @property
    def is_balanced(self) -> bool:
        """Whether each agent is heard with the weight it listens with, to rounding: 1' L = 0."""
        return bool(np.allclose(self.adjacency.sum(axis=0), self.in_degrees, rtol=1e-12, atol=0.0))

    def check_spanning_tree(self) -> None:
        """Refuse a graph over which agreement is impossible; say so where its edges are probably written the wrong way round.

        Raises:
            ProblemError: no directed spanning tree.

        >>> Graph.from_edges(3, [[1, 2], [1, 3]]).check_spanning_tree()
        Traceback (most recent call last):
        lockstep.check.errors.ProblemError: [network]: the graph has no spanning tree: ... the edges are probably
        reversed: turned round, they lead from agent 1 to all others; an edge is [listener, source], ...
        """
        try:
            super().check_spanning_tree()
        except ProblemError as error:
            turned = Digraph(self.adjacency.T)
            if not turned.has_spanning_tree:
                raise
            few = turned.roots[:4]
            roots = " or ".join(map(str, few)) + (", ..." if len(turned.roots) > len(few) else "")
            raise ProblemError(
                error.found,
                where=error.where,
                expected=error.expected,
                remedy=f"the edges are probably reversed: turned round, they lead from agent {roots} to all others; an"
                " edge is [listener, source], and row i of a Laplacian is what agent i listens to",
            ) from None
