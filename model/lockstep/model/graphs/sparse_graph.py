"""Graphs of many agents, sparse throughout: from files, from networkx, and as lists of edges."""

import io
import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from lockstep.check.errors import ProblemError, demand
from lockstep.check.files import read_bytes
from lockstep.check.wording import shorten

LARGEST_FILE = 200_000_000
"""Bytes: some ten million edges."""

MOST = 10_000_000
"""Agents, or edges one way."""

FORMS = "Matrix Market (.mtx), GraphML (.graphml, .xml) or lines listener,source[,weight] (.csv)"


@dataclass(frozen=True, eq=False)
class SparseGraph:
    """Agent `listeners[k]` listens to `sources[k]` with `weights[k]`; agents count from 0.

    Raises:
        ProblemError: a self loop, a weight that is not above 0, an edge given twice, or an agent that is not there.
    """

    agents: int
    listeners: Int[np.ndarray, " edges"]
    sources: Int[np.ndarray, " edges"]
    weights: Float[np.ndarray, " edges"]
    where: str = "[network] file"

    def __post_init__(self) -> None:
        where = self.where
        demand(2 <= self.agents <= MOST, f"{self.agents} agents", where, f"from 2 to {MOST}")
        demand(len(self.weights) <= MOST, f"{len(self.weights)} edges", where, f"at most {MOST}")
        for ends in (self.listeners, self.sources):
            outside = np.flatnonzero((ends < 0) | (ends >= self.agents))
            for k in outside[:1]:
                found = f"edge {k + 1} names agent {ends[k] + 1}"
                raise ProblemError(found, where=where, expected=f"agents from 1 to {self.agents}")
        for k in np.flatnonzero(self.listeners == self.sources)[:1]:
            found = f"agent {self.listeners[k] + 1} listens to itself"
            raise ProblemError(found, where=where, expected="no self loops", remedy="leave the edge out")
        for k in np.flatnonzero(~(np.isfinite(self.weights) & (self.weights > 0)))[:1]:
            found = f"the weight of edge {k + 1} is {self.weights[k]}"
            raise ProblemError(found, where=where, expected="a finite weight above 0")
        keys = np.sort(self.listeners.astype(np.int64) * self.agents + self.sources)
        for key in keys[:-1][keys[1:] == keys[:-1]][:1]:
            found = f"the edge {key // self.agents + 1}, {key % self.agents + 1} is there twice"
            raise ProblemError(found, where=where, expected="one edge per listener and source")

    @property
    def matrix(self) -> Any:
        """The adjacency, scipy.sparse."""
        from scipy.sparse import csr_matrix

        shape = (self.agents, self.agents)
        return csr_matrix((self.weights, (self.listeners, self.sources)), shape=shape)

    @property
    def laplacian(self) -> Any:
        """L = D - A of (1), scipy.sparse."""
        from scipy.sparse import diags

        A = self.matrix
        return (diags(np.asarray(A.sum(axis=1)).ravel()) - A).tocsr()

    @property
    def degrees(self) -> Float[np.ndarray, " N"]:
        """deg_i, the total weight that agent i listens with."""
        return np.bincount(self.listeners, self.weights, self.agents)

    @property
    def most_neighbours(self) -> int:
        """The most agents that one listens to."""
        return int(np.bincount(self.listeners, minlength=self.agents).max(initial=0))

    @property
    def one_way(self) -> tuple[int, int] | None:
        """An edge, from 1, whose counterpart is missing or has another weight; None where the graph is undirected."""
        A = self.matrix
        rest = abs(A - A.T).tocoo()
        odd = np.flatnonzero(rest.data)
        return (int(rest.row[odd[0]]) + 1, int(rest.col[odd[0]]) + 1) if len(odd) else None

    @property
    def edges(self) -> list[tuple[int, int, float]]:
        """(listener, source, weight), numbered from 1."""
        ends = zip(self.listeners.tolist(), self.sources.tolist(), self.weights.tolist(), strict=True)
        return [(i + 1, j + 1, a) for i, j, a in ends]

    @classmethod
    def from_networkx(cls, graph: Any, where: str = "networkx graph") -> "SparseGraph":
        """Read a networkx graph: an edge of a directed one goes from its source to its listener, undirected ones both ways.

        Agents are numbered in the order of the nodes; the attribute `weight` counts, 1 where there is none.
        """
        demand(hasattr(graph, "edges"), f"a {type(graph).__name__}", where, "a `Graph`, or one of networkx")
        number = {node: i for i, node in enumerate(graph.nodes)}
        demand(not graph.is_multigraph(), "it is a multigraph", where, "one edge per pair of agents")
        rows = [(number[v], number[u], a) for u, v, a in graph.edges.data("weight", default=1.0)]
        if not graph.is_directed():
            rows += [(j, i, a) for i, j, a in rows if i != j]
        return cls._of_rows(len(number), rows, where)

    @classmethod
    def _of_rows(cls, agents: int, rows: Iterable[tuple[int, int, Any]], where: str) -> "SparseGraph":
        table = list(rows)
        try:
            weights = np.array([float(a) for _, _, a in table], dtype=float)
        except (TypeError, ValueError):
            expected = "finite weights above 0"
            raise ProblemError("a weight is no number", where=where, expected=expected) from None
        ends = np.array([(i, j) for i, j, _ in table], dtype=np.int64).reshape(len(table), 2)
        return cls(agents, ends[:, 0], ends[:, 1], weights, where)


def read_graph(path: Path) -> SparseGraph:
    """Read a graph from a file, by its suffix: entry (i, j) of a matrix is a_ij, agent i listening to agent j.

    Raises:
        ProblemError: not there, of no known kind, not readable as it, or no graph.
    """
    where = str(path)
    content = read_bytes(path, expected=f"a graph: {FORMS}", at_most=LARGEST_FILE)
    match path.suffix.lower():
        case ".mtx":
            return _matrix_market(content, where)
        case ".graphml" | ".xml":
            return _graphml(content, where)
        case ".csv":
            return _edge_list(content, where)
    raise ProblemError(f"the suffix `{shorten(path.suffix)}`", where=where, expected=FORMS)


def _matrix_market(content: bytes, where: str) -> SparseGraph:
    from scipy.io import mmread
    from scipy.sparse import issparse

    try:
        A = mmread(io.BytesIO(content))
    except (ValueError, TypeError, OverflowError, MemoryError, UnicodeDecodeError) as error:
        raise ProblemError(f"it is not Matrix Market ({error})", where=where, expected=FORMS) from None
    demand(
        issparse(A), "it holds a full matrix", where, "one in coordinates: %%MatrixMarket matrix coordinate"
    )
    found = f"a matrix of {A.shape[0]} x {A.shape[1]}"
    demand(A.shape[0] == A.shape[1], found, where, "a square one, a_ij in row i and column j")
    A = A.tocoo()
    demand(not np.iscomplexobj(A.data), "its entries are complex", where, "weights above 0")
    return SparseGraph(
        A.shape[0], A.row.astype(np.int64), A.col.astype(np.int64), A.data.astype(float), where
    )


def _graphml(content: bytes, where: str) -> SparseGraph:
    from xml.etree.ElementTree import ParseError

    import networkx as nx

    demand(b"<!ENTITY" not in content, "it defines entities", where, "plain GraphML")
    try:
        graph = nx.read_graphml(io.BytesIO(content))
    except (ParseError, nx.NetworkXException, KeyError, ValueError, TypeError) as error:
        raise ProblemError(f"it is not GraphML ({error})", where=where, expected=FORMS) from None
    return SparseGraph.from_networkx(graph, where)


def _edge_list(content: bytes, where: str) -> SparseGraph:
    lines = content.decode("utf-8", errors="replace").splitlines()
    if lines and lines[0].lower().replace(" ", "").startswith("listener,source"):
        lines[0] = ""
    rows: list[tuple[int, int, Any]] = []
    for number, line in enumerate(lines, start=1):
        parts = line.split("#", 1)[0].split(",")
        if parts == [""] or not line.strip():
            continue
        try:
            listener, source, *rest = parts
            weight = float(rest[0]) if rest else 1.0
            rows.append((int(listener) - 1, int(source) - 1, weight))
            wrong = len(rest) > 1 or not math.isfinite(weight)
        except ValueError:
            wrong = True
        demand(
            not wrong, f"line {number}: `{shorten(line)}`", where, "listener,source[,weight], agents from 1"
        )
    demand(bool(rows), "it names no edge", where, "lines listener,source[,weight]")
    return SparseGraph._of_rows(1 + max(max(i, j) for i, j, _ in rows), rows, where)
