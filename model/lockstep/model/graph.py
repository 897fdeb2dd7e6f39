"""The communication graph of a problem: the checker's, built by name, and what is said of it to people."""

from typing import Literal, Self, get_args

import numpy as np

from lockstep.check.errors import ProblemError
from lockstep.check.graph import Graph as CheckedGraph
from lockstep.check.graph import check_count

Topology = Literal["cycle", "path", "ring", "complete", "star", "leader_path"]


class Graph(CheckedGraph):
    """A directed weighted graph of N >= 2 agents; see `lockstep.check.graph`.

    >>> Graph.from_edges(3, [[1, 2], [2, 3], [3, 1]]).is_balanced
    True
    """

    @classmethod
    def topology(cls, name: Topology, agents: int) -> Self:
        """Build a graph by name, every weight 1.

        cycle: i listens to i + 1, the last to the first, as in (39). ring: both neighbours on a circle. path:
            both neighbours on a line. complete: everyone. star: all others listen to agent 1. leader_path: i
            listens to i - 1.

        >>> Graph.topology("star", 3).roots
        (1,)
        """
        if name not in get_args(Topology):
            raise ProblemError(
                f"`{name}` is not a topology",
                where="[network] topology",
                expected=", ".join(get_args(Topology)),
            )
        check_count(agents)
        if name == "complete":
            return cls(np.ones((agents, agents)) - np.eye(agents))
        forward = [(i, i + 1) for i in range(1, agents)]
        back = [(j, i) for i, j in forward]
        edges: dict[Topology, list[tuple[int, int]]] = {
            "cycle": [*forward, (agents, 1)],
            "path": forward + back,
            "ring": sorted({*forward, *back, (agents, 1), (1, agents)}),
            "star": [(i, 1) for i in range(2, agents + 1)],
            "leader_path": back,
        }
        return cls.from_edges(agents, edges[name])

    @property
    def is_undirected(self) -> bool:
        """Whether a_ij = a_ji for all pairs."""
        return bool((self.adjacency == self.adjacency.T).all())

    @property
    def is_balanced(self) -> bool:
        """Whether each agent is heard with the weight it listens with, to rounding: 1' L = 0."""
        out = self.adjacency.sum(axis=0)
        return bool(np.allclose(out, self.in_degrees, rtol=1e-12, atol=0.0))
