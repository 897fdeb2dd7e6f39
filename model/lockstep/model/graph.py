"""The communication graph of a problem: the checker's, and what is said of it to people."""

import numpy as np

from lockstep.check.graph import Digraph
from lockstep.check.graph import Topology as Topology


class Graph(Digraph):
    """A directed weighted graph of N >= 2 agents; see `lockstep.check.graph`.

    >>> Graph.from_edges(3, [[1, 2], [2, 3], [3, 1]]).is_balanced
    True
    """

    @property
    def is_undirected(self) -> bool:
        """Whether a_ij = a_ji for all pairs."""
        return bool((self.adjacency == self.adjacency.T).all())

    @property
    def is_balanced(self) -> bool:
        """Whether each agent is heard with the weight it listens with, to rounding: 1' L = 0."""
        out = self.adjacency.sum(axis=0)
        return bool(np.allclose(out, self.in_degrees, rtol=1e-12, atol=0.0))
