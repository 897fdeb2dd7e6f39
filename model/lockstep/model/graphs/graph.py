"""The communication graph of a problem: the checker's, and what is said of it to people."""

from collections import Counter
from collections.abc import Sequence
from functools import cached_property

import numpy as np
from jaxtyping import Float

from lockstep.check.errors import ProblemError, demand
from lockstep.check.system.graph import Digraph, check_square
from lockstep.check.system.graph import Topology as Topology


class Graph(Digraph):
    """A directed weighted graph of N >= 2 agents; see `lockstep.check.system.graph`.

    Raises:
        ProblemError: not square, fewer than two agents, a weight that is negative or not finite, or a self
            loop.

    >>> Graph.from_edges(3, [[1, 2], [2, 3], [3, 1]]).is_balanced
    True
    """

    def __post_init__(self) -> None:
        where = "adjacency"
        demand(not np.iscomplexobj(self.adjacency), "its weights are complex", where, "weights that are real")
        a = np.array(self.adjacency, dtype=float)
        check_square(a, where)
        for i, j in np.argwhere(~(np.isfinite(a) & (a >= 0)))[:1]:
            found = f"the weight from agent {j + 1} to agent {i + 1} is {a[i, j]}"
            raise ProblemError(found, where=where, expected="a finite weight that is not negative")
        for i in np.flatnonzero(np.diag(a))[:1]:
            raise ProblemError(f"agent {i + 1} listens to itself", where=where, expected="a zero diagonal")
        super().__post_init__()

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

    @cached_property
    def origins(self) -> tuple[tuple[int, ...], ...]:
        """The groups of agents that hear everyone in their group and no one outside of it.

        There is at least one; with exactly one, every agent hears from it, directly or not.
        """
        heard = self._heard()
        # All of a group hear the same agents, the group itself; anyone who hears more hears a group that does not hear back.
        groups = [bits for bits, members in Counter(heard).items() if members == bits.bit_count()]
        return tuple(sorted(tuple(i + 1 for i in range(self.N) if bits >> i & 1) for bits in groups))

    @property
    def has_spanning_tree(self) -> bool:
        """Whether rank L = N - 1: some agent's information reaches every other one."""
        return bool(self.roots)

    def check_spanning_tree(self) -> None:
        """Refuse a graph over which agreement is impossible; say so where its edges are probably written the wrong way round.

        Raises:
            ProblemError: no directed spanning tree.

        >>> Graph.from_edges(3, [[1, 2], [1, 3]]).check_spanning_tree()
        Traceback (most recent call last):
        lockstep.check.errors.ProblemError: [network]: the graph has no spanning tree: ... the edges are probably
        reversed: turned round, they lead from agent 1 to all others; an edge is [listener, source], ...
        """
        if self.has_spanning_tree:
            return
        first, second = (_listing(group) for group in self.origins[:2])
        remedy, turned = f"let {first} listen to {second}, or the other way round", Graph(self.adjacency.T)
        if turned.roots:
            roots = " or ".join(map(str, turned.roots[:4])) + (", ..." if len(turned.roots) > 4 else "")
            remedy = (
                f"the edges are probably reversed: turned round, they lead from agent {roots} to all others; an"
                " edge is [listener, source], and row i of a Laplacian is what agent i listens to"
            )
        raise ProblemError(
            f"the graph has no spanning tree: {first} and {second} hear nothing from each other,"
            " directly or through others",
            where="[network]",
            expected="at least one agent whose information reaches every other one",
            remedy=remedy,
        )


def _listing(group: Sequence[int]) -> str:
    shown = ", ".join(map(str, group[:8])) + (", ..." if len(group) > 8 else "")
    return f"agent {shown}" if len(group) == 1 else f"agents {shown}"
