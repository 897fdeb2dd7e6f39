"""The network: the reduced loop is the disagreement of the nonlinear closed loop (12), and what a network refuses."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from amini.claims.example import arm
from lockstep.check.errors import ProblemError
from lockstep.check.system.loop import Gains
from lockstep.model.agents.agent import Agent
from lockstep.model.graphs.graph import Graph
from lockstep.model.network import Network

Reader = Callable[[np.ndarray], np.ndarray]
CYCLE = Graph.topology("cycle", 3)


def two_by_two() -> Agent:
    """Two inputs, two outputs, two components of phi, one of time, and an offset all agents share."""
    return Agent.from_expressions(
        "pair",
        states=["a", "b", "c"],
        inputs=["u", "w"],
        outputs={"y1": "a - b", "y2": "c"},
        dynamics={"a": "b - sin(a)*cos(t) + u", "b": "2*tanh(b - c) + cos(t) + 1", "c": "-c + a + 3*w"},
    )


def random_gains(seed: int, N: int, order: int, m: int, q: int) -> Gains:
    generator = np.random.default_rng(seed)
    shapes = ((order, order), (order, q), (m, order), (m, q))
    return Gains(*(tuple(generator.standard_normal(shape) for _ in range(N)) for shape in shapes))


def nonlinearity(agent: Agent, t: float) -> Reader:
    """Return x -> f(x, 0, t) - A x of one agent, straight from the agent's equations: G phi(H x, t) + offset(t)."""

    def h(x: np.ndarray) -> np.ndarray:
        return np.array(agent.dynamics(x, np.zeros(agent.m), t)).ravel() - agent.lure.A @ x

    return h


@pytest.mark.parametrize("coordinates", ["orthonormal", "laplacian_rows"])
@pytest.mark.parametrize("make", [arm, two_by_two])
@settings(max_examples=10)
@given(seed=st.integers(0, 2**32), order=st.integers(0, 2))
def test_the_reduced_loop_is_the_disagreement_of_the_nonlinear_one(
    coordinates: str, make: Callable[[], Agent], seed: int, order: int
) -> None:
    """x_cl' = A_cl x_cl + [T h; 0] + E T xi with x_cl = (T x, x_C): (15) from (12), the nonlinearity included."""
    agent = make()
    generator = np.random.default_rng(seed)
    graph = Graph.from_edges(4, [[1, 2, 0.7], [2, 3, 1.3], [3, 1, 2.0], [4, 1, 0.5], [1, 4, 1.1]])
    B = [generator.standard_normal((agent.n, agent.m)) for _ in range(4)]
    network = Network(agent, graph, B, coordinates)
    gains = random_gains(seed, 4, order, agent.m, agent.q)
    loop = network.loop(order)
    x, xi = generator.standard_normal((2, 4, agent.n)) * 2
    x_C, t = generator.standard_normal((4, order)), float(generator.uniform(0, 5))
    dx, dx_C, _ = (
        np.array(part).ravel() for part in network.closed_loop(gains)(x.ravel(), x_C.ravel(), t, xi.ravel())
    )
    T = loop.d.T
    x_cl = np.concatenate([(T @ x).ravel(), x_C.ravel()])
    h = np.stack([nonlinearity(agent, t)(row) for row in x])
    expected = loop.A_cl(gains.blocks) @ x_cl + loop.E @ (T @ (h + xi)).ravel()
    found = np.concatenate([(T @ dx.reshape(4, agent.n)).ravel(), dx_C])
    np.testing.assert_allclose(found, expected, atol=1e-9 * max(1.0, np.abs(expected).max()))


@pytest.mark.parametrize("make", [arm, two_by_two])
def test_G_phi_is_the_disagreement_of_h(make: Callable[[], Agent]) -> None:
    """(T (x) I) h = (I (x) G) (T (x) I) phi: the offset cancels, which is how phi_d enters."""
    agent = make()
    network = Network(agent, CYCLE)
    loop = network.loop(1)
    x, t = np.random.default_rng(4).standard_normal((3, agent.n)), 0.7
    h = np.stack([nonlinearity(agent, t)(row) for row in x])
    phi = np.stack([np.array(agent.lure.phi(agent.lure.H @ row, t)).ravel() for row in x])
    np.testing.assert_allclose(
        loop.E @ (loop.d.T @ h).ravel(), loop.E @ ((loop.d.T @ phi) @ loop.plant.G.T).ravel(), atol=1e-12
    )


def test_agents_that_agree_keep_agreeing() -> None:
    """Equal states, controllers at rest, one common disturbance: no input, and all derivatives equal."""
    agent = two_by_two()
    network = Network(agent, CYCLE)
    gains = random_gains(1, 3, 2, agent.m, agent.q)
    x = np.tile(np.array([0.3, -1.0, 2.0]), 3)
    dx, dx_C, u = (
        np.array(part).ravel() for part in network.closed_loop(gains)(x, np.zeros(6), 1.2, np.ones(9))
    )
    np.testing.assert_allclose(u, 0.0, atol=1e-12)
    np.testing.assert_allclose(dx_C, 0.0, atol=1e-12)
    np.testing.assert_allclose(dx.reshape(3, 3), np.tile(dx[:3], (3, 1)), atol=1e-12)
    x[0] += 0.1
    assert np.abs(np.array(network.closed_loop(gains)(x, np.zeros(6), 1.2, np.ones(9))[2])).max() > 1e-3


def test_an_agent_uses_its_own_input_matrix() -> None:
    B = [np.array([[0.0], [k], [0.0], [0.0]]) for k in (1.0, 2.0, 3.0)]
    network = Network(arm(), CYCLE, B)
    gains = Gains(*(tuple(np.ones(s) for _ in range(3)) for s in ((0, 0), (0, 2), (1, 0), (1, 2))))
    x = np.zeros((3, 4))
    x[:, 0] = [1.0, 0.0, 0.0]
    dx, _, u = (
        np.array(part).ravel()
        for part in network.closed_loop(gains)(x.ravel(), np.zeros(0), 0.0, np.zeros(12))
    )
    np.testing.assert_allclose(u, [1.0, 0.0, -1.0])  # L x of (39), first column
    accelerations = dx.reshape(3, 4)[:, 1] - [-48.6, 0.0, 0.0]
    np.testing.assert_allclose(accelerations, [1.0, 0.0, -3.0])


def test_what_a_network_refuses() -> None:
    Network(arm(), CYCLE)
    with pytest.raises(ProblemError, match="no spanning tree"):
        Network(arm(), Graph.from_edges(4, [[1, 2], [3, 4]]))
    with pytest.raises(ProblemError, match="2 input matrices for 3 agents"):
        Network(arm(), CYCLE, [np.zeros((4, 1))] * 2)
    with pytest.raises(ProblemError, match="`B` is 3 x 1"):
        Network(arm(), CYCLE, [np.zeros((4, 1)), np.zeros((3, 1)), np.zeros((4, 1))])


def test_scales_move_between_phi_and_the_matrices() -> None:
    """G D_w and D_v^-1 H: a gain that phi is scaled by is given back."""
    network = Network(arm(), CYCLE, scales=((2.0,), (0.5,)))
    np.testing.assert_array_equal(network.plant.G.ravel(), [0, 0, 0, 2])
    np.testing.assert_array_equal(network.plant.H.ravel(), [0, 0, 2, 0])
    with pytest.raises(ProblemError, match="1 for phi and 1 for its arguments"):
        Network(arm(), CYCLE, scales=((1.0, 1.0), (1.0,)))


def test_scales_that_would_be_rounded_are_refused() -> None:
    agent = Agent.from_expressions(
        "a", states=["x"], inputs=["u"], outputs={"y": "x"}, dynamics={"x": "u + sin(0.1*x - 0.3*t)"}
    )
    scale = 3.0 if agent.lure.H[0, 0] == 1.0 else 1.0
    with pytest.raises(ProblemError, match="no matrix of doubles"):
        Network(agent, CYCLE, scales=((1.0,), (scale,)))


def test_a_loop_is_built_once() -> None:
    network = Network(arm(), CYCLE)
    assert network.loop(2) is network.loop(2)
    assert network.loop(2) is not network.loop(2, exact_arithmetic=True)
    assert network.loop(1).n_x == 8 + 3
