"""The communication graph: who listens to whom, with what weight, and its Laplacian (1)."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from operator import and_
from typing import Annotated, Literal, Self, get_args

import numpy as np

from lockstep.check.errors import ProblemError, demand
from lockstep.check.numbers import Matrix, converter

Topology = Literal["cycle", "path", "ring", "complete", "star", "leader_path"]

MOST_AGENTS = 2_000
"""The adjacency is a full matrix: 32 MB at this size."""


@dataclass(frozen=True, eq=False)
class Digraph:
    """A directed weighted graph of N >= 2 agents, by the functions below, which look at what they are given.

    Args:
        adjacency: a_ij > 0 where agent i listens to agent j, 0 elsewhere and on the diagonal.

    >>> Digraph.from_edges(3, [[1, 2], [2, 3], [3, 1]]).laplacian
    array([[ 1., -1.,  0.],
           [ 0.,  1., -1.],
           [-1.,  0.,  1.]])
    """

    adjacency: Annotated[np.ndarray, "N N"]

    def __post_init__(self) -> None:
        a = np.array(self.adjacency, dtype=float)
        a.flags.writeable = False
        object.__setattr__(self, "adjacency", a)

    @classmethod
    def from_edges(cls, agents: int, edges: Sequence[Sequence[int | float]]) -> Self:
        """Build the graph from [listener, source] or [listener, source, weight]; agents count from 1."""
        check_count(agents)
        a = np.zeros((agents, agents))
        for k, edge in enumerate(edges, start=1):
            i, j, weight = _edge(agents, k, edge)
            found, once = f"edge {k}, {_shown(edge)}, is there twice", "one edge per listener and source"
            demand(not a[i, j], found, "[network] edges", once, "add the weights up")
            a[i, j] = weight
        return cls(a)

    @classmethod
    def from_laplacian(cls, laplacian: Annotated[np.ndarray, "N N"]) -> Self:
        """Build the graph whose Laplacian (1) this is; the off-diagonal entries are taken as they are.

        A row may miss zero by 1e-9 of its absolute sum: decimals such as 0.1 + 0.2 - 0.3 do not add up to 0.
        """
        where = "[network] laplacian"
        demand(not np.iscomplexobj(laplacian), "an entry is complex", where)
        L = np.array(laplacian, dtype=float)
        check_square(L, where)
        demand(np.isfinite(L).all(), "an entry is not a finite number", where)
        off = L - np.diag(np.diag(L))
        for i, j in np.argwhere(off > 0)[:1]:
            raise ProblemError(
                f"the entry of row {i + 1} and column {j + 1} is {L[i, j]}",
                where=where,
                expected="off-diagonal entries -a_ij <= 0, as in (1)",
                remedy="give the Laplacian D - A, not the adjacency matrix",
            )
        for i in np.flatnonzero(np.abs(L.sum(axis=1)) > 1e-9 * np.abs(L).sum(axis=1))[:1]:
            found = f"row {i + 1} adds up to {L[i].sum():.6g}"
            raise ProblemError(found, where=where, expected="rows that add up to 0, as in (1)")
        return cls(np.where(off < 0, -off, 0.0))

    @classmethod
    def topology(cls, name: Topology, agents: int) -> Self:
        """Build a graph by name, every weight 1.

        - `cycle`: i listens to i + 1, the last to the first, as in (39)
        - `ring`: both neighbours on a circle
        - `path`: both neighbours on a line
        - `complete`: everyone
        - `star`: all others listen to agent 1
        - `leader_path`: i listens to i - 1

        >>> Digraph.topology("star", 3).roots
        (1,)
        """
        known = get_args(Topology)
        demand(name in known, f"`{name}` is not a topology", "[network] topology", ", ".join(known))
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
    def agents(self) -> int:
        """N, the number of agents."""
        return int(self.adjacency.shape[0])

    N = agents

    @property
    def laplacian(self) -> Annotated[np.ndarray, "N N"]:
        """L = D - A of (1)."""
        return self.laplacian_in(exact_arithmetic=False)

    def laplacian_in(self, *, exact_arithmetic: bool) -> Matrix:
        """Return L in doubles, its diagonal rounded, or in rationals."""
        adjacency = converter(exact_arithmetic)(self.adjacency)
        return np.asarray(np.diag(adjacency.sum(axis=1)) - adjacency)

    @property
    def edges(self) -> list[tuple[int, int, float]]:
        """(listener, source, weight), numbered from 1."""
        return [
            (int(i) + 1, int(j) + 1, float(self.adjacency[i, j])) for i, j in np.argwhere(self.adjacency > 0)
        ]

    @cached_property
    def roots(self) -> tuple[int, ...]:
        """The agents from which information reaches every other one; empty without a spanning tree."""
        everyone = reduce(and_, self._heard())
        return tuple(i + 1 for i in range(self.N) if everyone >> i & 1)

    def _heard(self) -> list[int]:
        """Return, for each agent, whom it hears from, directly or not, and itself, as bits: Warshall's transitive closure."""
        heard = [
            sum(1 << int(j) for j in np.flatnonzero(row)) | 1 << i for i, row in enumerate(self.adjacency)
        ]
        for k in range(self.N):
            through, bit = heard[k], 1 << k
            heard = [bits | through if bits & bit else bits for bits in heard]
        return heard

    def check_spanning_tree(self) -> None:
        """Refuse a graph over which agreement is impossible: rank L < N - 1.

        Raises:
            ProblemError: no directed spanning tree.
        """
        expected = "at least one agent whose information reaches every other one"
        demand(bool(self.roots), "the graph has no spanning tree", "[network]", expected)


def check_count(agents: int) -> None:
    """Refuse a number of agents that no graph here has.

    Raises:
        ProblemError: not a whole number, or one outside of 2 to `MOST_AGENTS`.
    """
    whole = isinstance(agents, int | np.integer) and not isinstance(agents, bool)
    huge = whole and abs(agents) > 10**20  # Python writes no number of thousands of digits
    found, where = f"`agents` is {'beyond 10^20' if huge else repr(agents)}", "[network] agents"
    demand(whole, found, where, "a whole number")
    few = "agreement needs two agents at least" if agents < 2 else ""
    demand(2 <= agents <= MOST_AGENTS, found, where, f"from 2 to {MOST_AGENTS}", few)


def check_square(a: Annotated[np.ndarray, "..."], where: str) -> None:
    """Refuse what is no square matrix of as many agents as a graph may have."""
    found = f"a matrix of shape {' x '.join(map(str, a.shape))}"
    expected = "a square one, one row and one column per agent"
    demand(a.ndim == 2 and len({*a.shape}) == 1, found, where, expected)
    check_count(a.shape[0])


def _edge(agents: int, k: int, edge: Sequence[int | float]) -> tuple[int, int, float]:
    """Check one edge and return its 0-based listener, 0-based source and weight."""
    where, shown = "[network] edges", f"edge {k}, {_shown(edge)},"
    form = "[listener, source] or [listener, source, weight]"
    demand(len(edge) in (2, 3), f"{shown} has {len(edge)} numbers", where, form)
    whole = all(_is_whole(end) for end in edge[:2])
    demand(whole, f"{shown} does not name two agents", where, "whole numbers")
    i, j = int(edge[0]), int(edge[1])
    remedy = "agents count from 1" if 0 in (i, j) else f"`agents` is {agents}: raise it for more"
    inside = 1 <= i <= agents and 1 <= j <= agents
    demand(inside, f"{shown} is out of range", where, f"agents from 1 to {agents}", remedy)
    demand(i != j, f"{shown} is a self loop", where, "two different agents")
    weight = float(edge[2]) if len(edge) == 3 else 1.0
    positive = np.isfinite(weight) and weight > 0
    demand(positive, f"{shown} has the weight {weight}", where, "a finite weight above 0")
    return i - 1, j - 1, weight


def _is_whole(end: int | float) -> bool:
    whole = isinstance(end, int | np.integer) and not isinstance(end, bool)
    return end.is_integer() if isinstance(end, float) else whole


def _shown(edge: Sequence[int | float]) -> str:
    return f"[{', '.join(f'{x:g}' for x in edge)}]"
