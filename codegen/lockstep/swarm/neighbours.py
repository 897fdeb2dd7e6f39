"""Whom each of many agents hears, as compressed sparse rows: memory grows with the edges, never with N^2."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from jaxtyping import Float, Int

from lockstep.check.errors import ProblemError, demand

MOST = 2**31 - 1
"""Agents are counted in 32 bits."""

_WHERE = "neighbour lists"


class EdgeList(Protocol):
    """A graph: how many agents, and (listener, source, weight) of each edge, agents from 1."""

    @property
    def agents(self) -> int:
        """N."""
        ...

    @property
    def edges(self) -> list[tuple[int, int, float]]:
        """Of each edge."""
        ...


@dataclass(frozen=True, eq=False)
class NeighbourLists:
    """Agent i hears source[first[i]], ..., source[first[i + 1] - 1], in ascending order, with the weights beside them.

    Args:
        first: (N + 1,), from 0, never decreasing.
        source: (edges,), agents from 0.
        weight: (edges,), a_ij > 0.

    Raises:
        ProblemError: arrays that do not fit, an agent that hears itself or another one twice, or a weight that is no finite
            number above 0.

    >>> NeighbourLists.from_edges(3, [[1, 2], [1, 3, 0.5], [2, 1]]).degrees.tolist()
    [2, 1, 0]
    """

    first: Int[np.ndarray, " N+1"]
    source: Int[np.ndarray, " E"]
    weight: Float[np.ndarray, " E"]

    def __post_init__(self) -> None:
        first = np.ascontiguousarray(self.first, dtype=np.int64)
        source = np.ascontiguousarray(self.source, dtype=np.int32)
        weight = np.ascontiguousarray(self.weight, dtype=float)
        edges = len(source)
        if first.ndim != 1 or not 3 <= len(first) <= MOST or first[0] != 0 or first[-1] != edges:
            raise ProblemError(
                f"`first` of {len(first)} numbers for {edges} edges",
                where=_WHERE,
                expected="N + 1 numbers for two agents or more, from 0 to the number of edges",
            )
        if (np.diff(first) < 0).any() or weight.shape != (edges,):
            raise ProblemError("`first` decreases, or the weights are not one per edge", where=_WHERE)
        _check_weights(weight)
        listener = np.repeat(np.arange(len(first) - 1), np.diff(first))
        if edges and not 0 <= source.min() <= source.max() < len(first) - 1:
            raise ProblemError("a source is no agent", where=_WHERE, expected=f"0 to {len(first) - 2}")
        if (alone := np.flatnonzero(source == listener)).size:
            raise ProblemError(f"agent {listener[alone[0]] + 1} listens to itself", where=_WHERE)
        order = np.lexsort((source, listener))
        source, weight = source[order], weight[order]
        twice = np.flatnonzero((np.diff(source) == 0) & (np.diff(listener) == 0))
        if twice.size:
            i, j = int(listener[twice[0]]) + 1, int(source[twice[0]]) + 1
            found = f"the edge [{i}, {j}] is there twice"
            raise ProblemError(found, where=_WHERE, remedy="add the weights up")
        for name, value in (("first", first), ("source", source), ("weight", weight)):
            value.flags.writeable = False
            object.__setattr__(self, name, value)

    @classmethod
    def from_edges(
        cls, agents: int, edges: Sequence[Sequence[float]] | Float[np.ndarray, "E k"]
    ) -> "NeighbourLists":
        """Return the lists of [listener, source] or [listener, source, weight]; agents count from 1, as in [network].

        Raises:
            ProblemError: rows of other lengths, numbers that name no agents, or what the class refuses.
        """
        rows = _rows(edges)
        ends = rows[:, :2]
        if not (np.isfinite(ends).all() and (ends == np.floor(ends)).all()):
            raise ProblemError("an edge does not name two agents", where=_WHERE, expected="whole numbers")
        if len(ends) and not (ends.min() >= 1 and ends.max() <= agents):
            raise ProblemError(
                f"an edge names agent {ends.min() if ends.min() < 1 else ends.max():g}",
                where=_WHERE,
                expected=f"agents from 1 to {agents}",
            )
        listener, source = (ends.astype(np.int64) - 1).T
        weight = rows[:, 2] if rows.shape[1] == 3 else np.ones(len(rows))
        return cls._sorted(agents, listener, source, weight)

    @classmethod
    def from_graph(cls, graph: EdgeList) -> "NeighbourLists":
        """Return the lists of a graph in any form that knows its agents and edges."""
        return cls.from_edges(graph.agents, np.array(graph.edges, dtype=float).reshape(-1, 3))

    @classmethod
    def from_scipy(cls, adjacency: Any) -> "NeighbourLists":
        """Return the lists of a sparse adjacency matrix (N, N) of SciPy: a_ij > 0 where agent i hears agent j."""
        matrix = adjacency.tocoo()
        found = f"a matrix of {matrix.shape[0]} x {matrix.shape[1]}"
        demand(matrix.shape[0] == matrix.shape[1], found, _WHERE, "a square one")
        return cls._sorted(matrix.shape[0], matrix.row, matrix.col, matrix.data)

    @classmethod
    def random_regular(cls, agents: int, degree: int, seed: int = 0) -> "NeighbourLists":
        """Return an undirected random graph, `degree` neighbours each: pairings (Bollobas 1980), clashes paired anew.

        Raises:
            ProblemError: no such graph, or none was found in a few hundred rounds.

        >>> set(NeighbourLists.random_regular(100, 4).degrees.tolist())
        {4}
        """
        if not 0 < degree < agents or agents * degree % 2:
            raise ProblemError(
                f"{degree} neighbours of {agents} agents",
                where="random regular graph",
                expected="fewer neighbours than agents, and an even product",
            )
        return cls._sorted(agents, *_paired(agents, degree, np.random.default_rng(seed)))

    @classmethod
    def _sorted(cls, agents: int, listener: Any, source: Any, weight: Any) -> "NeighbourLists":
        order = np.lexsort((source, listener))
        counts = np.bincount(np.asarray(listener), minlength=agents)
        first = np.concatenate([[0], np.cumsum(counts)])
        return cls(first, np.asarray(source)[order], np.asarray(weight, dtype=float)[order])

    @property
    def N(self) -> int:
        """Number of agents."""
        return len(self.first) - 1

    @property
    def degrees(self) -> Int[np.ndarray, " N"]:
        """How many each agent hears."""
        return np.diff(self.first)

    @property
    def listener(self) -> Int[np.ndarray, " E"]:
        """Who hears along each edge, from 0."""
        return np.repeat(np.arange(self.N), self.degrees)

    def to_scipy(self) -> Any:
        """Return the adjacency matrix as `scipy.sparse.csr_array`."""
        from scipy.sparse import csr_array

        return csr_array((self.weight, self.source, self.first), shape=(self.N, self.N))

    def check_spanning_tree(self) -> None:
        """Refuse a graph over which agreement is impossible: one with two groups that hear nothing from outside.

        Raises:
            ProblemError: no directed spanning tree.
        """
        from scipy.sparse.csgraph import connected_components

        count, group = connected_components(self.to_scipy(), directed=True, connection="strong")
        hears_others = np.zeros(count, dtype=bool)
        across = group[self.listener] != group[self.source]
        hears_others[group[self.listener[across]]] = True
        origins = np.flatnonzero(~hears_others)
        if len(origins) > 1:
            some = [int(np.flatnonzero(group == one)[0]) + 1 for one in origins[:2]]
            raise ProblemError(
                f"the graph has no spanning tree: agents {some[0]} and {some[1]} hear nothing from each other,"
                f" directly or through others, and {len(origins)} groups hear nothing from outside",
                where=_WHERE,
                expected="at least one agent whose information reaches every other one",
            )


def _rows(edges: Any) -> Float[np.ndarray, "E k"]:
    if isinstance(edges, Iterable) and not isinstance(edges, np.ndarray):
        edges = [tuple(edge) if len(edge) == 3 else (*edge, 1.0) for edge in edges]
    rows = np.asarray(edges, dtype=float)
    found = "the edges are no list of pairs or triples"
    expected = "[listener, source] or [listener, source, weight]"
    demand(rows.ndim == 2 and rows.shape[1] in (2, 3), found, _WHERE, expected)
    return rows


def _check_weights(weight: Float[np.ndarray, " E"]) -> None:
    wrong = ~(np.isfinite(weight) & (weight > 0))
    if wrong.any():
        raise ProblemError(
            f"an edge has the weight {weight[np.flatnonzero(wrong)[0]]}",
            where=_WHERE,
            expected="a finite weight above 0",
        )


def _paired(agents: int, degree: int, random: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Return listener, source and weight of both directions of each pair."""
    ends = random.permutation(np.repeat(np.arange(agents), degree))
    a, b = ends[0::2].copy(), ends[1::2].copy()
    for _ in range(500):
        key = np.minimum(a, b) * agents + np.maximum(a, b)
        _, first = np.unique(key, return_index=True)
        clash = a == b
        clash[np.setdiff1d(np.arange(len(a)), first)] = True
        bad = np.flatnonzero(clash)
        if not bad.size:
            return np.concatenate([a, b]), np.concatenate([b, a]), np.ones(2 * len(a))
        # The ends of what clashes are exchanged with those of pairs drawn at random.
        with_ = random.choice(len(a), len(bad), replace=False)
        b[bad], b[with_] = b[with_], b[bad]
    raise ProblemError(f"no graph of {agents} agents with {degree} neighbours each was found", where=_WHERE)
