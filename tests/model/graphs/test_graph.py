"""Graphs: the Laplacian (39), roots, and what is refused."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lockstep.check.errors import ProblemError
from lockstep.check.numbers import as_floats, exactly
from lockstep.model.graphs.graph import Graph

CYCLE = [[1, -1, 0], [0, 1, -1], [-1, 0, 1]]


def test_the_paper_s_laplacian() -> None:
    """(39)."""
    for graph in (
        Graph.from_edges(3, [[1, 2], [2, 3], [3, 1]]),
        Graph.topology("cycle", 3),
        Graph.from_laplacian(np.array(CYCLE, dtype=float)),
    ):
        np.testing.assert_array_equal(graph.laplacian, CYCLE)
        assert graph.N == graph.agents == 3
        assert graph.roots == (1, 2, 3)
        assert graph.is_balanced
        assert not graph.is_undirected


@pytest.mark.parametrize(
    ("name", "edges", "roots"),
    [
        ("cycle", [(1, 2), (2, 3), (3, 4), (4, 1)], (1, 2, 3, 4)),
        ("path", [(1, 2), (2, 1), (2, 3), (3, 2), (3, 4), (4, 3)], (1, 2, 3, 4)),
        ("ring", [(1, 2), (1, 4), (2, 1), (2, 3), (3, 2), (3, 4), (4, 1), (4, 3)], (1, 2, 3, 4)),
        ("star", [(2, 1), (3, 1), (4, 1)], (1,)),
        ("leader_path", [(2, 1), (3, 2), (4, 3)], (1,)),
    ],
)
def test_topologies(name: str, edges: list, roots: tuple) -> None:
    graph = Graph.topology(name, 4)
    assert [(i, j) for i, j, _ in graph.edges] == edges
    assert graph.roots == roots
    assert graph.is_undirected == (name in ("path", "ring"))


def test_complete_and_two_agents() -> None:
    assert len(Graph.topology("complete", 4).edges) == 12
    for name in ("cycle", "ring", "path", "complete"):
        np.testing.assert_array_equal(Graph.topology(name, 2).laplacian, [[1, -1], [-1, 1]])


def test_weights_and_degrees() -> None:
    graph = Graph.from_edges(3, [[1, 2, 0.5], [1, 3, 2], [2, 1]])
    np.testing.assert_array_equal(graph.in_degrees, [2.5, 1, 0])
    assert graph.roots == (3,)
    assert not graph.is_balanced


def test_a_laplacian_in_decimals_is_read_by_its_off_diagonal() -> None:
    L = np.array([[0.3, -0.1, -0.2], [-1, 1, 0], [0, -1, 1]])
    assert L[0].sum() != 0
    assert Graph.from_laplacian(L).adjacency[0, 2] == 0.2


def test_no_spanning_tree_names_who_does_not_hear() -> None:
    graph = Graph.from_edges(4, [[2, 1], [3, 4], [4, 3]])
    assert not graph.has_spanning_tree
    assert graph.roots == ()
    assert graph.origins == ((1,), (3, 4))
    with pytest.raises(ProblemError, match=r"agent 1 and agents 3, 4 hear nothing from each other"):
        graph.check_spanning_tree()
    Graph.from_edges(4, [[2, 1], [3, 4], [4, 3], [3, 2]]).check_spanning_tree()


@given(
    st.integers(2, 6).flatmap(
        lambda n: st.tuples(st.just(n), st.lists(st.booleans(), min_size=n * n, max_size=n * n))
    )
)
def test_a_spanning_tree_is_a_laplacian_of_rank_n_minus_1(case: tuple) -> None:
    n, bits = case
    a = np.array(bits, dtype=float).reshape(n, n) * (1 - np.eye(n))
    graph = Graph(a)
    assert graph.has_spanning_tree == (np.linalg.matrix_rank(graph.laplacian) == n - 1)
    reach = np.linalg.matrix_power(np.eye(n) + a.T, n) > 0
    assert graph.roots == tuple(i + 1 for i in range(n) if reach[i].all())


@pytest.mark.parametrize(
    ("agents", "edges", "says"),
    [
        (3, [[1, 4]], "edge 1, .* out of range"),
        (3, [[0, 1]], "out of range"),
        (3, [[-1, 1]], "out of range"),
        (3, [[1, 2], [2, 2]], "edge 2, .* self loop"),
        (3, [[1, 2], [1, 2]], "there twice"),
        (3, [[1, 2], [1, 2, 2.0]], "there twice"),
        (3, [[1, 2, 0]], "weight 0"),
        (3, [[1, 2, -1]], "weight -1"),
        (3, [[1, 2, float("nan")]], "weight nan"),
        (3, [[1, 2, float("inf")]], "weight inf"),
        (3, [[1]], "1 numbers"),
        (3, [[1, 2, 3, 4]], "4 numbers"),
        (3, [[1.5, 2]], "whole numbers"),
        (3, [[float("nan"), 2]], "whole numbers"),
        (3, [[True, 2]], "whole numbers"),
        (1, [], "from 2 to"),
        (0, [], "from 2 to"),
        (-3, [], "from 2 to"),
        (10**9, [], "from 2 to"),
        (2.0, [], "whole number"),
        (True, [], "whole number"),
    ],
)
def test_bad_edges_are_refused(agents: int, edges: list, says: str) -> None:
    with pytest.raises(ProblemError, match=says):
        Graph.from_edges(agents, edges)


@pytest.mark.parametrize(
    ("laplacian", "says"),
    [
        ([[1, -1], [0, 0], [0, 0]], "3 x 2"),
        ([1, -1], "shape 2"),
        ([[1, -1], [-1, 1.001]], "row 2 adds up to 0.001"),
        ([[-1, 1], [1, -1]], "adjacency"),
        ([[1, float("nan")], [-1, 1]], "not a finite number"),
        ([[0]], "from 2 to"),
    ],
)
def test_bad_laplacians_are_refused(laplacian: list, says: str) -> None:
    with pytest.raises(ProblemError, match=says):
        Graph.from_laplacian(np.array(laplacian, dtype=float))


@pytest.mark.parametrize(
    ("adjacency", "says"),
    [
        ([[0, 1]], "1 x 2"),
        ([[0, -1], [1, 0]], "from agent 2 to agent 1 is -1"),
        ([[1, 1], [1, 0]], "agent 1 listens to itself"),
        ([[0, float("inf")], [1, 0]], "is inf"),
    ],
)
def test_bad_adjacencies_are_refused(adjacency: list, says: str) -> None:
    with pytest.raises(ProblemError, match=says):
        Graph(np.array(adjacency, dtype=float))


def test_an_unknown_topology_is_refused() -> None:
    with pytest.raises(ProblemError, match="`torus` is not a topology"):
        Graph.topology("torus", 4)


def test_the_adjacency_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="read-only"):
        Graph.topology("cycle", 3).adjacency[0, 0] = 1


@given(
    st.integers(2, 7).flatmap(
        lambda n: st.tuples(st.just(n), st.lists(st.integers(0, 3), min_size=n * n, max_size=n * n))
    )
)
def test_the_origins_are_those_of_the_condensation(case: tuple) -> None:
    """A slow obvious twin: two agents are in one group if they hear each other, an origin has no edges from outside."""
    n, draws = case
    a = (np.array(draws).reshape(n, n) == 1) * (1 - np.eye(n))
    heard = np.linalg.matrix_power(np.eye(n) + a, n) > 0
    groups = {tuple(j + 1 for j in range(n) if heard[i, j] and heard[j, i]) for i in range(n)}
    origins = {group for group in groups if set(np.flatnonzero(heard[group[0] - 1]) + 1) <= set(group)}
    assert Graph(a).origins == tuple(sorted(origins))


def test_two_thousand_agents_in_a_row_have_one_root() -> None:
    assert Graph.topology("leader_path", 2000).roots == (1,)


def test_the_exact_laplacian_is_that_of_the_doubles_as_they_are() -> None:
    graph = Graph.from_edges(3, [[1, 2, 0.1], [1, 3, 0.2], [2, 1], [3, 2]])
    exact = graph.laplacian_in(exact_arithmetic=True)
    assert all(sum(row[1:], start=row[0]) == 0 for row in exact)
    assert as_floats(exact).tolist() == graph.laplacian.tolist()
    assert exact[0, 0] != exactly(graph.laplacian)[0, 0], "0.1 + 0.2 is no double"
