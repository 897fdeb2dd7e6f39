"""Graphs from files, and in which interval their spectrum lies."""

import networkx as nx
import numpy as np
import pytest

from lockstep.check.errors import ProblemError
from lockstep.check.system.graph import Digraph
from lockstep.model.graphs import membership as members
from lockstep.model.graphs.membership import largest_from_degrees, membership, within_interval
from lockstep.model.graphs.sparse_graph import SparseGraph, read_graph
from lockstep.model.problem import Problem

HEAD = "%%MatrixMarket matrix coordinate "
EDGES = ((1, 2, 1.0), (2, 3, 0.5), (3, 4, 2.0), (4, 1, 1.0))
"""A circle of four, undirected."""

FILES = {
    "circle.mtx": HEAD + "real symmetric\n4 4 4\n2 1 1\n3 2 0.5\n4 3 2\n4 1 1\n",
    "circle.csv": "listener,source,weight\n" + "".join(f"{i},{j},{a}\n{j},{i},{a}\n" for i, j, a in EDGES),
    "circle.graphml": "\n".join(
        nx.generate_graphml(
            nx.from_edgelist([(i, j, {"weight": a}) for i, j, a in EDGES]), named_key_ids=True
        )
    ),
}


def of(graph):
    return SparseGraph.from_networkx(graph)


@pytest.mark.parametrize("name", FILES)
def test_the_same_graph_from_each_kind_of_file(tmp_path, name):
    path = tmp_path / name
    path.write_text(FILES[name])
    found = read_graph(path).laplacian.toarray()
    two_ways = [[i, j, a] for i, j, a in EDGES] + [[j, i, a] for i, j, a in EDGES]
    assert np.array_equal(found, Digraph.from_edges(4, two_ways).laplacian)


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("a.mtx", HEAD + "real general\n3 3 1\n2 2 1\n", "agent 2 listens to itself"),
        ("a.mtx", HEAD + "real general\n3 3 1\n2 1 -1\n", "the weight of edge 1 is -1"),
        ("a.mtx", HEAD + "real general\n3 3 1\n4 1 1\n", "Matrix Market"),
        ("a.mtx", HEAD + "real general\n3 2 1\n2 1 1\n", "3 x 2"),
        ("a.mtx", "nonsense", "Matrix Market"),
        ("a.csv", "1,2\n1,2\n", "there twice"),
        ("a.csv", "1,2,x\n", "line 1"),
        ("a.csv", "0,2\n", "names agent 0"),
        ("a.csv", "", "no edge"),
        ("a.graphml", "<graphml>", "GraphML"),
        ("a.graphml", '<!DOCTYPE x [<!ENTITY a "b">]><graphml/>', "entities"),
        ("a.txt", "1,2\n", "suffix"),
    ],
)
def test_what_is_no_graph_is_refused(tmp_path, name, text, says):
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(ProblemError, match=says):
        read_graph(path)


def test_a_file_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(ProblemError, match="no such file"):
        read_graph(tmp_path / "none.mtx")


GRAPHS = {
    "path": nx.path_graph(60),
    "circle": nx.cycle_graph(61),
    "star": nx.star_graph(40),
    "grid": nx.grid_2d_graph(9, 11),
    "tree": nx.balanced_tree(3, 4),
    "regular": nx.random_regular_graph(6, 150, seed=2),
    "geometric": nx.random_geometric_graph(120, 0.25, seed=3),
}


@pytest.mark.parametrize("name", GRAPHS)
def test_the_interval_holds_the_spectrum(name):
    graph = of(GRAPHS[name])
    values = np.linalg.eigvalsh(graph.laplacian.toarray())
    found = membership(graph)
    assert found.graph_proof == "inertia"
    assert 0.99 * values[1] < found.lower < values[1] and values[-1] <= found.upper * (1 + 1e-12)


def test_weights_that_float32_rounds_widen_the_interval():
    plain, odd = nx.cycle_graph(12), nx.cycle_graph(12)
    nx.set_edge_attributes(plain, 0.5, "weight")
    nx.set_edge_attributes(odd, 0.1, "weight")
    first, second = membership(of(plain)), membership(of(odd))
    assert 2.0 <= first.upper < 2.0 + 1e-12
    assert second.upper > 0.4 and second.lower < 0.2 * first.lower


def test_more_than_the_bound_by_inertia_is_not_shown():
    graph = of(nx.path_graph(30))
    order, _, _ = members._banded(graph)
    value = float(np.linalg.eigvalsh(graph.laplacian.toarray())[1])
    below, above = (members._factor(graph, order, part * value) for part in (0.99, 1.01))
    assert (below.negative, above.negative) == (1, 2)
    assert max(below.error, above.error) < 1e-10


@pytest.fixture
def at_random(monkeypatch):
    monkeypatch.setattr(members, "MOST_WORK", 0)


@pytest.mark.parametrize("degree", [4, 8])
@pytest.mark.usefixtures("at_random")
def test_at_random_the_interval_holds_the_spectrum(degree):
    graph = of(nx.random_regular_graph(degree, 600, seed=degree))
    values = np.linalg.eigvalsh(graph.laplacian.toarray())
    found = membership(graph)
    assert found.graph_proof == "lanczos, probability of error at most 1e-09"
    assert 0.7 * values[1] < found.lower < values[1]


def test_at_random_an_eigenvalue_that_is_there_is_found():
    """Two clusters joined by one edge: lambda_2 is small, and no claim above it passes, whatever the vector."""
    one = nx.random_regular_graph(8, 300, seed=1)
    both = nx.disjoint_union(one, one)
    both.add_edge(0, 300)
    graph = of(both)
    values = np.linalg.eigvalsh(graph.laplacian.toarray())
    upper = largest_from_degrees(graph)
    for seed in range(20):
        generator = np.random.default_rng(seed)
        inside = 0.95 * values[2]
        for a in (1.001 * values[1], 0.5 * inside, 0.9 * inside):
            assert not members._none_below(graph, graph.laplacian, a, inside, upper, 120, 1e-9, generator)


def test_directed_and_disconnected_graphs_are_refused():
    with pytest.raises(ProblemError, match="do not listen to each other"):
        membership(of(nx.DiGraph([(0, 1), (1, 2), (2, 0)])))
    with pytest.raises(ProblemError, match="falls into 2 parts"):
        membership(of(nx.disjoint_union(nx.path_graph(3), nx.path_graph(3))))


def test_an_interval_asked_for_has_to_hold_what_is_shown():
    found = membership(of(nx.cycle_graph(12)))
    assert within_interval(found, 0.2, 4.0).lower == 0.2
    for lower, upper in ((0.3, 4.0), (0.2, 3.9)):
        with pytest.raises(ProblemError, match="inertia"):
            within_interval(found, lower, upper)


PROBLEM = """
[agent]
states = ["x"]
inputs = ["u"]
dynamics = {{ x = "u" }}
outputs = {{ y = "x" }}
[network]
{network}
[design]
method = "{method}"
order = 0
"""


def problem(folder, network, method="modal"):
    path = folder / "problem.toml"
    path.write_text(PROBLEM.format(network=network, method=method))
    return Problem.load(path)


def written(folder, graph):
    edges = [f"{max(i, j) + 1} {min(i, j) + 1}\n" for i, j in graph.edges]
    head = f"{HEAD}pattern symmetric\n{len(graph)} {len(graph)} {len(edges)}\n"
    (folder / "graph.mtx").write_text(head + "".join(edges))


def test_a_small_graph_is_written_out_and_a_large_one_goes_by_its_spectrum(tmp_path):
    written(tmp_path, nx.cycle_graph(5))
    small = problem(tmp_path, 'file = "graph.mtx"', "certified")
    assert small.sizes.N == 5 and small.spectrum is None and small.file.network.file is None
    assert np.array_equal(small.graph().laplacian, Digraph.topology("ring", 5).laplacian)
    written(tmp_path, nx.random_regular_graph(8, 500, seed=1))
    large = problem(tmp_path, 'file = "graph.mtx"')
    assert large.spectrum.neighbours == 8 and large.spectrum.upper == 16.0 and large.sizes.N == 1
    again = Problem.from_document(large.document())
    assert again.spectrum == large.spectrum and again.file.network.agents == 500
    with pytest.raises(ProblemError, match="modal"):
        problem(tmp_path, 'file = "graph.mtx"', "certified")


def test_a_graph_outside_of_the_spectrum_asked_for_is_refused(tmp_path):
    written(tmp_path, nx.cycle_graph(12))
    assert problem(tmp_path, 'file = "graph.mtx"\nspectrum = [0.2, 4.0]').membership.graph_proof == "inertia"
    for network, says in (
        ("spectrum = [0.3, 4.0]", "nonzero eigenvalues"),
        ("spectrum = [0.2, 4.0]\nmax_degree = 1", "max_degree"),
        ("spectrum = [0.2, 4.0]\nagents = 11", "agents"),
        ('topology = "ring"\nagents = 12', "one graph"),
    ):
        with pytest.raises(ProblemError, match=says):
            problem(tmp_path, f'file = "graph.mtx"\n{network}')


def test_a_file_needs_a_problem_that_is_loaded_from_one():
    with pytest.raises(ProblemError, match="was not read"):
        Problem.parse(PROBLEM.format(network='file = "graph.mtx"', method="modal"))
