"""Disagreement coordinates against their definitions, for named and random graphs, in doubles and in rationals."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lockstep.check.numbers import as_floats, exactly
from lockstep.check.system.disagreement import Disagreement, disagreement
from lockstep.model.graphs.graph import Graph
from lockstep.model.graphs.orthonormal import orthonormal_factor

COORDINATES = ("orthonormal", "laplacian_rows")


@st.composite
def graphs(draw: st.DrawFn) -> Graph:
    """Random directed graphs with a spanning tree and weights in quarters, so that doubles add up exactly."""
    N = draw(st.integers(2, 6))
    order = draw(st.permutations(range(N)))
    weights = st.sampled_from([0.0, 0.0, 0.25, 1.0, 2.5])
    a = np.array(draw(st.lists(st.lists(weights, min_size=N, max_size=N), min_size=N, max_size=N)))
    np.fill_diagonal(a, 0.0)
    for k in range(1, N):
        a[order[k], order[draw(st.integers(0, k - 1))]] = draw(st.sampled_from([0.5, 1.0, 3.0]))
    return Graph(a)


@pytest.mark.parametrize("coordinates", COORDINATES)
@pytest.mark.parametrize("exact_arithmetic", [False, True])
@settings(max_examples=40)
@given(graph=graphs())
def test_the_defining_identities(coordinates: str, exact_arithmetic: bool, graph: Graph) -> None:
    d = disagreement(graph, coordinates, exact_arithmetic=exact_arithmetic)
    T, right, L, L_r = (as_floats(part) for part in (d.T, d.right, d.L, d.L_r))
    assert np.linalg.matrix_rank(T) == graph.N - 1
    np.testing.assert_array_equal(L, graph.laplacian)
    if exact_arithmetic:
        assert not (d.T @ exactly(np.ones((graph.N, 1)))).any()
        assert (d.L_r @ d.T == d.L).all()
        assert (d.T @ d.right == exactly(np.eye(graph.N - 1))).all()
    np.testing.assert_allclose(T @ np.ones(graph.N), 0.0, atol=1e-12)
    np.testing.assert_allclose(L_r @ T, L, atol=1e-9)
    np.testing.assert_allclose(T @ right, np.eye(graph.N - 1), atol=1e-9)


@settings(max_examples=40)
@given(graph=graphs(), seed=st.integers(0, 2**32))
def test_S_measures_the_projection_off_the_agreement(graph: Graph, seed: int) -> None:
    """x_d' S x_d = |x - mean(x) 1|^2: by hand, with no matrix of the module."""
    x = np.random.default_rng(seed).standard_normal(graph.N)
    d = disagreement(graph)
    x_d = d.T @ x
    assert x_d @ d.S @ x_d == pytest.approx(((x - x.mean()) ** 2).sum(), rel=1e-9)
    F = orthonormal_factor(d)
    np.testing.assert_allclose(F.T @ F, d.S, atol=1e-12)
    # F T is an orthonormal basis of the complement of 1, up to a rotation.
    np.testing.assert_allclose(F @ d.T @ (F @ d.T).T, np.eye(graph.N - 1), atol=1e-9)


def test_the_metric_of_the_paper_s_rows_is_the_identity_and_not_that_length() -> None:
    d = disagreement(Graph.topology("cycle", 3), "laplacian_rows")
    np.testing.assert_array_equal(d.S, np.eye(2))
    np.testing.assert_array_equal(d.T, [[1, -1, 0], [0, 1, -1]])  # (14) with (39): L without its last row
    x = np.array([1.0, 0.0, 0.0])
    assert (d.T @ x) @ d.S @ (d.T @ x) == 1.0
    assert ((x - x.mean()) ** 2).sum() == pytest.approx(2 / 3)


@pytest.mark.parametrize("coordinates", COORDINATES)
@settings(max_examples=30)
@given(graph=graphs(), seed=st.integers(0, 2**32))
def test_a_pair_multiplier_is_the_square_of_a_difference(coordinates: str, graph: Graph, seed: int) -> None:
    generator = np.random.default_rng(seed)
    d = disagreement(graph, coordinates)
    n = 2
    x, X = generator.standard_normal((graph.N, n)), generator.standard_normal((n, n))
    x_d = (d.T @ x).ravel()
    for i, j in d.pairs():
        gap = x[i] - x[j]
        found = x_d @ np.kron(d.pair_multiplier(i, j), X) @ x_d
        assert found == pytest.approx(gap @ X @ gap, abs=1e-8)


def test_all_pairs_weighted_by_one_over_N_give_S() -> None:
    """sum_ij |x_i - x_j|^2 / N is |x_d|^2 for an orthonormal T: the squared length of the projection."""
    d = disagreement(Graph.topology("ring", 5))
    total = sum(d.pair_multiplier(i, j) for i, j in d.pairs()) / 5
    np.testing.assert_allclose(total, d.S, atol=1e-12)
    assert len(d.pairs()) == 10


@pytest.mark.parametrize(
    ("graph", "removed"),
    [
        (Graph.topology("leader_path", 4), 0),  # agent 1 hears no one: its row of L is 0
        (Graph.topology("star", 4), 0),
        (Graph.from_edges(4, [[1, 2], [2, 3], [3, 4]]), 3),  # agent 4 leads
        (Graph.from_edges(3, [[1, 2], [2, 1], [3, 1]]), 1),  # 1 and 2 lead: the last of them
    ],
)
def test_the_row_removed_is_one_that_depends_on_the_others(graph: Graph, removed: int) -> None:
    d = disagreement(graph, "laplacian_rows", exact_arithmetic=True)
    np.testing.assert_array_equal(as_floats(d.T), np.delete(graph.laplacian, removed, axis=0))


def test_removing_another_row_would_lose_rank() -> None:
    """Section 3 of the paper lets any row go; behind a leader only the leader's can."""
    L = Graph.topology("leader_path", 4).laplacian
    ranks = [np.linalg.matrix_rank(np.delete(L, k, axis=0)) for k in range(4)]
    assert ranks == [3, 2, 2, 2]


def test_exact_and_float_coordinates_are_the_same() -> None:
    """Weights in quarters: every sum is exact in doubles, so the two may not differ at all."""
    graph = Graph.from_edges(4, [[1, 2, 0.25], [2, 3, 2.0], [3, 1, 1.0], [4, 1, 0.5], [1, 4, 1.75]])
    for coordinates in COORDINATES:
        exact, floats = (
            disagreement(graph, coordinates, exact_arithmetic=True),
            disagreement(graph, coordinates),
        )
        for name in ("T", "L"):
            np.testing.assert_array_equal(as_floats(getattr(exact, name)), getattr(floats, name))
        for name in ("right", "S", "L_r"):
            np.testing.assert_allclose(
                as_floats(getattr(exact, name)), getattr(floats, name), rtol=1e-12, atol=1e-14
            )


def test_decimal_weights_add_up_exactly_only_in_rationals() -> None:
    """0.1 + 0.2 is rounded in doubles: the exact Laplacian's rows still add up to 0."""
    graph = Graph.from_edges(3, [[1, 2, 0.1], [1, 3, 0.2], [2, 1], [3, 1]])
    d: Disagreement = disagreement(graph, "laplacian_rows", exact_arithmetic=True)
    assert not (d.L @ exactly(np.ones((3, 1)))).any()
    assert d.L[0, 0] != exactly(np.array([0.1 + 0.2]))[0]
