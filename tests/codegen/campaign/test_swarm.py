"""The compiled swarm against the simulation that records everything, and against NumPy."""

from dataclasses import replace

import numpy as np
import pytest

import lockstep
from lockstep.check.continuous.inequality import Performance
from lockstep.check.errors import ProblemError
from lockstep.check.sampled.discretise import clipped_at
from lockstep.check.system.loop import Gains
from lockstep.model.graphs.graph import Graph
from lockstep.model.network import Network
from lockstep.model.simulation import SampledControllers, Scenario, effort_indices, indices, simulate
from lockstep.model.simulation.disturbance import Samples, Sines, Steps, noise
from lockstep.model.simulation.divergence import Diverged
from lockstep.model.simulation.results.trajectory import RhoWeights, energies
from lockstep.swarm import NeighbourLists, SwarmLoop, simulate_swarm, swarm_of_design
from lockstep.swarm.disturbances import StreamedNoise
from lockstep.verification.reference import Reference
from lockstep.verification.toolchain import host_compilers
from lockstep.workflow.runs import swarm
from stepped import sources_of

needs_compiler = pytest.mark.skipif(not host_compilers(), reason="no C compiler here")
ENGINES = [pytest.param(True, marks=needs_compiler, id="compiled"), pytest.param(False, id="numpy")]
PERIOD, HORIZON, N = 0.02, 0.6, 11
"""Eleven agents: one block of lanes, and three lanes of the next."""


def digraph():
    """Eleven agents, weights of several sizes, information from one to all."""
    random = np.random.default_rng(3)
    a = random.uniform(0.2, 1.5, (N, N)) * (random.random((N, N)) < 0.4)
    np.fill_diagonal(a, 0)
    a[np.arange(1, N), np.arange(N - 1)] = 1.0
    return Graph(a)


def loop_of(problem, *, own_gains, own_inputs, real="float32", delay=0, order=2, limits=()):
    agent, graph = problem.agent(), digraph()
    random = np.random.default_rng(5)
    tables = np.zeros((N if own_gains else 1, order + 1, order + 2))
    tables[:] = 0.5 * np.eye(order + 1, order + 2)
    tables[:, :order, order:] = random.normal(size=(len(tables), order, 2)) * 0.01
    tables[:, order, order:] = [-0.7, -0.8]
    tables[:, order, :order] = random.normal(size=(len(tables), order)) * 0.1
    B = np.repeat(agent.lure.B[None], N if own_inputs else 1, axis=0)
    B *= np.linspace(0.8, 1.2, len(B))[:, None, None] if own_inputs else 1
    R, Q = np.diag([1.0, 0.5, 2.0, 0.0]), 2 * np.eye(order)
    lists = NeighbourLists.from_graph(graph)
    sides = clipped_at(real, np.array(limits).reshape(-1, 2))
    return SwarmLoop(agent, lists, order, tables, B, PERIOD, real, R, Q, delay, sides), graph


def recorded(loop, graph, start, disturbance):
    """The run of `simulate`, with the bit-exact references as steppers."""
    dtype = np.dtype(loop.real)
    heard = sources_of(graph)
    steppers = [
        Reference(
            loop.tables[i if len(loop.tables) > 1 else 0],
            graph.adjacency[i, list(heard[i])].astype(dtype),
            loop.order,
            True,
            loop.limits.astype(dtype) if len(loop.limits) else None,
        )
        for i in range(N)
    ]
    controllers = SampledControllers(steppers, heard, PERIOD, loop.delay, loop.real)
    network = Network(loop.agent, graph, tuple(np.broadcast_to(loop.B, (N, 4, 1))))
    trajectory = simulate(network, controllers, Scenario(start, HORIZON, PERIOD / 2, disturbance))
    return trajectory, energies(trajectory, RhoWeights.of(graph, Performance(loop.R, loop.Q)))


START = np.random.default_rng(0).uniform(-1, 1, (N, 4))
DISTURBANCES = {
    "none": lambda: None,
    "steps": lambda: Steps(np.random.default_rng(1).normal(size=(N, 4)), 0.1, 0.3),
    "sines": lambda: Sines(
        np.full((N, 4), 0.5), np.random.default_rng(2).uniform(0, 6, (N, 4)), 1.5, 0.04, 0.5
    ),
    "samples": lambda: Samples(np.random.default_rng(1).normal(size=(30, N, 4)), PERIOD),
}
LOOPS = {
    "one gain": {"own_gains": False, "own_inputs": False},
    "own gains and inputs": {"own_gains": True, "own_inputs": True},
    "late, in doubles": {"own_gains": True, "own_inputs": False, "real": "float64", "delay": 1},
    "clipped": {"own_gains": False, "own_inputs": False, "limits": [[-0.1, 0.2]]},
    "clipped below, late": {"own_gains": True, "own_inputs": False, "delay": 1, "limits": [[-0.1, np.inf]]},
    "static, late": {"own_gains": False, "own_inputs": True, "delay": 1, "order": 0},
}


@pytest.mark.parametrize("compiled", ENGINES)
@pytest.mark.parametrize(
    ("kind", "disturbance"), [*((k, "sines") for k in LOOPS), *(("one gain", d) for d in DISTURBANCES)]
)
def test_a_swarm_is_the_loop_that_is_simulated(arms_problem, compiled, kind, disturbance):
    """The inputs to the bit at first, all states to rounding: both take the same Runge-Kutta steps."""
    loop, graph = loop_of(arms_problem, **LOOPS[kind])
    given = DISTURBANCES[disturbance]()
    expected, energy = recorded(loop, graph, START, given)
    run = simulate_swarm(loop, START, HORIZON, step=PERIOD / 2, disturbance=given, compiled=compiled)
    found = run.trajectory
    np.testing.assert_array_equal(found.u[0], expected.u[0])
    assert (found.clipped, found.faults) == (expected.clipped, expected.faults)
    assert (found.clipped > 0) == bool(len(loop.limits))
    for name in ("x", "x_C", "u", "y", "xi"):
        np.testing.assert_allclose(
            getattr(found, name), getattr(expected, name), rtol=1e-5, atol=1e-6, err_msg=name
        )
    np.testing.assert_allclose(found.x, expected.x, atol=2e-7 if loop.real == "float32" else 1e-12)
    np.testing.assert_allclose(run.disagreement, expected.disagreement(), rtol=1e-6)
    for ours, theirs in (
        (run.indices(), indices(expected)),
        (run.effort_indices(), effort_indices(expected)),
    ):
        rows = [[list(one.document().values()) for one in side] for side in (ours, theirs)]
        np.testing.assert_allclose(*rows, rtol=1e-5)
    np.testing.assert_allclose(run.largest_input, np.abs(expected.u).max(axis=(0, 2)), rtol=1e-5)
    np.testing.assert_allclose(run.energies.output, energy.output, rtol=1e-6)
    np.testing.assert_allclose(run.energies.input, energy.input, rtol=1e-6, atol=1e-12)


def test_noise_drawn_as_the_run_goes_on_is_the_noise_drawn_at_once():
    whole = noise(5, 3, interval=0.02, horizon=1.0, seed=7, sigma=0.3)
    streamed = StreamedNoise(5, 3, 0.3, 0.02, 7)
    since = np.arange(100) * 0.01
    np.testing.assert_array_equal(streamed.at(since, since), whole.at(since, since))
    with pytest.raises(ProblemError, match="not again"):
        streamed.current(0.0)


@needs_compiler
def test_neither_threads_nor_chunks_change_a_bit(arms_problem):
    loop, _ = loop_of(arms_problem, own_gains=False, own_inputs=False)
    loop = replace(loop, neighbours=NeighbourLists.random_regular(3000, 4))
    start = np.random.default_rng(1).uniform(-1, 1, (3000, 4))
    one, three = (simulate_swarm(loop, start, 0.2, threads=threads) for threads in (1, 3))
    plain = simulate_swarm(loop, start, 0.2, compiled=False)
    np.testing.assert_array_equal(one.final, three.final)
    np.testing.assert_array_equal(one.disagreement, three.disagreement)
    np.testing.assert_allclose(one.final, plain.final, atol=1e-6)
    np.testing.assert_allclose(one.disagreement, plain.disagreement, rtol=1e-6)


@pytest.mark.parametrize("compiled", ENGINES)
def test_a_run_that_diverges_says_whose_state_went(arms_problem, compiled):
    loop, _ = loop_of(arms_problem, own_gains=False, own_inputs=False)
    tables = np.array(loop.tables)
    tables[:, 2, 2:] = [50.0, 50.0]
    with pytest.raises(Diverged, match="the loop diverges") as caught:
        simulate_swarm(replace(loop, tables=tables), START, 20.0, compiled=compiled)
    assert 1 <= caught.value.figures["agent"] <= N


@pytest.mark.parametrize(
    ("edges", "said"),
    [
        ([[1, 2], [2, 4]], "names agent 4"),
        ([[1, 1]], "listens to itself"),
        ([[1, 2], [1, 2]], "there twice"),
        ([[1, 2, 0.0]], "a finite weight above 0"),
        ([[1, 2.5]], "whole numbers"),
        ([[1, 2, 3, 4]], "pairs or triples|inhomogeneous"),
    ],
)
def test_edges_that_make_no_graph_are_refused(edges, said):
    with pytest.raises(ProblemError, match=said):
        NeighbourLists.from_edges(3, edges)


def test_lists_are_those_of_a_matrix():
    graph = digraph()
    lists = NeighbourLists.from_graph(graph)
    np.testing.assert_array_equal(lists.to_scipy().toarray(), graph.adjacency)
    again = NeighbourLists.from_scipy(lists.to_scipy())
    np.testing.assert_array_equal(again.source, lists.source)
    lists.check_spanning_tree()
    with pytest.raises(ProblemError, match="no spanning tree: agents 1 and 3"):
        NeighbourLists.from_edges(4, [[1, 2], [2, 1], [3, 4], [4, 3]]).check_spanning_tree()
    regular = NeighbourLists.random_regular(500, 3, seed=1)
    assert set(regular.degrees.tolist()) == {3}
    assert (regular.to_scipy() != regular.to_scipy().T).nnz == 0
    with pytest.raises(ProblemError, match="even product"):
        NeighbourLists.random_regular(5, 3)


@pytest.fixture(scope="module")
def alike(unclipped):
    """A design file with the same gains for all: the first arm's for each; it is simulated and nothing is claimed of it."""
    design = lockstep.load(unclipped)
    gains = design.stored.gains
    same = Gains(*((getattr(gains, letter)[0],) * 3 for letter in "ABCD"))
    return replace(design, stored=replace(design.stored, gains=same))


@pytest.mark.parametrize("engine", ["compiled", "numpy"])
def test_a_design_runs_on_another_graph(alike, monkeypatch, engine):
    if engine == "numpy":
        monkeypatch.setattr(swarm, "host_compilers", list)
    elif not host_compilers():
        pytest.skip("no C compiler here")
    lists = NeighbourLists.random_regular(1200, 4)
    lists = NeighbourLists(lists.first, lists.source, np.full(len(lists.source), 0.25))
    run = lockstep.simulate(alike, neighbours=lists, horizon=0.1, disturbance="noise")
    said = run.document()
    assert (said["agents"], said["engine"]) == (1200, engine)
    assert (
        said["indices"]["agents"] == 1200
        and said["indices"]["largest"]["ISE"] >= said["indices"]["mean"]["ISE"]
    )
    assert said["l2"]["covered"] is False and "another graph" in said["l2"]["reason"]
    assert run.trajectory.disagreement()[0] == pytest.approx(said["disagreement_initial"])
    assert len(repr(run)) < 300
    assert run.agents == 1200
    assert "below the first 12" in run.rows()["agents"], "what is told state by state is not of all"


def test_own_gains_have_no_other_graph(unclipped):
    with pytest.raises(ProblemError, match="controllers that are not all the same"):
        lockstep.simulate(unclipped, neighbours=NeighbourLists.random_regular(10, 3))
    with pytest.raises(ProblemError, match="continuous controllers on a graph"):
        lockstep.simulate(
            unclipped, neighbours=NeighbourLists.random_regular(10, 3), controllers="continuous"
        )


@needs_compiler
def test_a_large_design_gives_the_answer_of_a_small_one(unclipped, monkeypatch):
    """The same keys and figures, whichever way the run goes."""
    options = {"horizon": 0.3, "disturbance": "noise", "seed": 4}
    small = lockstep.simulate(unclipped, **options).document()
    monkeypatch.setattr(swarm, "LARGE", 2)
    found = lockstep.simulate(unclipped, **options).document()
    assert (found.pop("agents"), found.pop("engine")) == (3, "compiled")
    assert found.keys() == small.keys()
    assert found["l2"]["reason"] == small["l2"]["reason"]
    # Integrals by trapezoids here, by cubics there.
    assert found["l2"]["ratio"] == pytest.approx(small["l2"]["ratio"], rel=1e-3)
    assert found["l2"]["covered"] is True
    for key in ("disagreement_initial", "disagreement_final", "disagreement_max", "largest_input"):
        np.testing.assert_allclose(found[key], small[key], rtol=1e-5)
    np.testing.assert_allclose(found["l2"]["output"], small["l2"]["output"], rtol=1e-3)
    np.testing.assert_allclose(found["l2"]["disturbance"], small["l2"]["disturbance"], rtol=1e-6)
    np.testing.assert_allclose(found["l2"]["disturbance"], small["l2"]["disturbance"], rtol=1e-9)
    for one, two in zip(found["indices"], small["indices"], strict=True):
        assert one == pytest.approx(two, rel=1e-5)


@pytest.mark.slow
@needs_compiler
def test_a_hundred_thousand_agents_need_no_square_matrix(alike):
    """One such matrix would be 80 GB."""
    lists = NeighbourLists.random_regular(100_000, 8)
    loop = swarm_of_design(alike.stored, lists)
    run = simulate_swarm(loop, np.zeros((100_000, 4)), 2 * loop.period, substeps=1)
    assert run.final.shape == (100_000, 4)
    assert run.disagreement.tolist() == [0.0] * len(run.disagreement)
