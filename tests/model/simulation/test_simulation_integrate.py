"""The two integrators, against each other, against the matrix exponential and against python-control."""

import re
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import expm
from simulation_cases import ARMS, COROLLARY_1, START, THEOREM_1, cart_gains, carts, loop_matrix

from lockstep.check.errors import ProblemError
from lockstep.check.system.loop import Gains
from lockstep.model import Agent, Graph, Network
from lockstep.model.simulation import Diverged, Scenario, noise, simulate
from lockstep.model.simulation.disturbance import Samples, Sines, Steps
from lockstep.model.simulation.divergence import check_bounded
from lockstep.model.simulation.equations import closed_loop
from lockstep.model.simulation.perturbation import PaperPerturbation

CARTS, GAINS = carts(), cart_gains()
CART_START = np.array([[1.0, 0.0], [-0.4, 0.3], [0.2, -1.0]])


def exact_carts(step: float, xi: np.ndarray) -> np.ndarray:
    """x at the instants for held xi (K, 3, 2), by Van Loan's augmented exponential."""
    A = loop_matrix(CARTS, GAINS)
    E = np.eye(len(A))[:, : xi[0].size]
    augmented = np.zeros((len(A) + E.shape[1],) * 2)
    augmented[: len(A), : len(A)], augmented[: len(A), len(A) :] = A, E
    ahead = expm(step * augmented)[: len(A)]
    X = [np.concatenate([CART_START.ravel(), np.zeros(3)])]
    for held in xi:
        X.append(ahead @ np.concatenate([X[-1], held.ravel()]))
    return np.array(X)[:, :6].reshape(-1, 3, 2)


@pytest.mark.parametrize(("method", "tolerance"), [("rk4", 1e-9), ("adaptive", 1e-9)])
def test_a_linear_loop_under_held_noise_is_the_matrix_exponential(method, tolerance):
    shaking = noise(3, 2, interval=0.02, horizon=2.0, seed=3, sigma=1.0)
    run = simulate(CARTS, GAINS, Scenario(CART_START, 2.0, 0.01, shaking, method=method))
    exact = exact_carts(0.02, shaking.values)
    # RK4: h = 2.5 ms against poles of some 2 rad/s leaves (h w)^4 / 120 = 5e-12 a step, a thousand times that in all.
    assert np.abs(run.x[::2] - exact).max() < tolerance


def test_a_wrong_gain_is_not_the_matrix_exponential():
    shaking = noise(3, 2, interval=0.02, horizon=2.0, seed=3, sigma=1.0)
    wrong = Gains(GAINS.A, GAINS.B, GAINS.C, tuple(1.001 * D for D in GAINS.D))
    run = simulate(CARTS, wrong, Scenario(CART_START, 2.0, 0.01, shaking))
    assert np.abs(run.x[::2] - exact_carts(0.02, shaking.values)).max() > 1e-5


def test_rk4_is_of_fourth_order():
    """Halving the step divides the error by 16: on the nonlinear arms, under a sine and with moving gains."""
    sines = Sines(np.full((3, 4), 0.5), np.arange(12.0).reshape(3, 4), 0.7)
    base = Scenario(START, 2.0, 0.1, sines, PaperPerturbation(3, 2))
    fine = simulate(ARMS, THEOREM_1, replace(base, method="adaptive", tolerance=1e-12)).x[-1]
    errors = [
        np.abs(simulate(ARMS, THEOREM_1, replace(base, substeps=s)).x[-1] - fine).max() for s in (16, 32, 64)
    ]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    # The next term of the error adds about h times the fastest rate, 30 rad/s: 0.2 at h = 6 ms, and falls with h.
    assert np.abs(orders - 4).max() < 0.2, orders
    assert errors[-1] > 1e-12, "not at rounding yet"


@pytest.mark.parametrize(
    "disturbance",
    [
        None,
        noise(3, 4, interval=0.02, horizon=3.0, seed=0, sigma=2.0),
        Steps(np.arange(12.0).reshape(3, 4) / 10, 0.5, 1.5),
        Sines(np.full((3, 4), 1.0), np.arange(12.0).reshape(3, 4), 1.0, 0.3, 2.0),
    ],
    ids=["none", "noise", "step", "sine"],
)
def test_the_integrators_agree(disturbance):
    base = Scenario(START, 3.0, 0.02, disturbance, substeps=16)
    fixed = simulate(ARMS, COROLLARY_1, base)
    adaptive = simulate(ARMS, COROLLARY_1, replace(base, method="adaptive"))
    # Both step over no jump: were one to, the difference would be of the order of the step, 1e-3.
    for letter in ("x", "x_C", "u"):
        assert np.abs(getattr(fixed, letter) - getattr(adaptive, letter)).max() < 2e-8


def test_the_nonlinear_loop_is_that_of_python_control():
    """input_output_response interpolates its input linearly, so a straight line is the same signal to both."""
    import control

    t = np.linspace(0.0, 3.0, 301)
    direction = np.arange(12.0) / 10 - 0.5

    class Ramp:
        hold = "smooth"

        def at(self, time, since):  # noqa: ARG002
            return (time[:, None] * direction).reshape(-1, 3, 4)

    run = simulate(ARMS, COROLLARY_1, Scenario(START, 3.0, 0.01, Ramp()))
    system = ARMS.to_control(COROLLARY_1)
    x0 = np.concatenate([START.ravel(), np.zeros(6)])
    response = control.input_output_response(
        system,
        t,
        np.outer(direction, t),
        x0,
        solve_ivp_method="DOP853",
        solve_ivp_kwargs={"rtol": 1e-9, "atol": 1e-9},
    )
    found = np.hstack([run.x.reshape(301, -1), run.y.reshape(301, -1), run.u.reshape(301, -1)])
    labels = list(response.output_labels)
    assert labels[:12] == [f"arm{i}_{s}" for i in (1, 2, 3) for s in ARMS.agent.states]
    assert np.abs(found - response.outputs.T).max() < 1e-6


def test_the_right_hand_side_is_the_networks_own():
    """The one with Delta = 0 against `Network.closed_loop`, and the agents alone with the same u."""
    generator = np.random.default_rng(0)
    x, x_C, xi = generator.normal(size=12), generator.normal(size=6), generator.normal(size=12)
    dx, dx_C, u = (np.asarray(part).ravel() for part in ARMS.closed_loop(THEOREM_1)(x, x_C, 0.3, xi))
    p = np.concatenate([xi, np.zeros(36)])
    mine = np.asarray(closed_loop(ARMS, THEOREM_1, perturbed=True)(np.concatenate([x, x_C]), 0.3, p)).ravel()
    assert np.allclose(mine, np.concatenate([dx, dx_C]), rtol=0, atol=1e-12)
    alone = np.asarray(ARMS.agents_alone()(x, 0.3, np.concatenate([u, xi]))).ravel()
    assert np.allclose(alone, dx, rtol=0, atol=1e-12)


def test_gain_errors_are_added_to_the_right_gains():
    generator = np.random.default_rng(1)
    errors = generator.normal(size=(3, 3, 4))
    x, x_C, xi = generator.normal(size=12), generator.normal(size=6), np.zeros(12)
    moved = Gains.from_blocks(THEOREM_1.blocks + errors, 2)
    dx, dx_C, _ = (np.asarray(part).ravel() for part in ARMS.closed_loop(moved)(x, x_C, 0.0, xi))
    p = np.concatenate([xi, errors.ravel()])
    mine = np.asarray(closed_loop(ARMS, THEOREM_1, perturbed=True)(np.concatenate([x, x_C]), 0.0, p)).ravel()
    assert np.allclose(mine, np.concatenate([dx, dx_C]), rtol=0, atol=1e-12)


def test_a_static_controller_is_simulated():
    N = 3
    static = Gains(
        (np.zeros((0, 0)),) * N,
        (np.zeros((0, 2)),) * N,
        (np.zeros((1, 0)),) * N,
        (np.array([[-1.0, -1.0]]),) * N,
    )
    run = simulate(CARTS, static, Scenario(CART_START, 10.0, 0.01))
    assert run.x_C.shape == (1001, 3, 0)
    assert run.disagreement()[-1] < 0.05 * run.disagreement()[0]


def test_a_pinned_mean_stays_where_it_is():
    at = np.tile([0.0, 0.0, np.pi, 0.0], (3, 1))
    shaking = Samples(1e-3 * np.random.default_rng(0).normal(size=(50, 3, 4)), 0.02)
    shaking.values[:] -= shaking.values.mean(axis=1, keepdims=True)
    pinned = simulate(ARMS, COROLLARY_1, Scenario(at, 5.0, 0.02, shaking, pinned=True))
    free = simulate(ARMS, COROLLARY_1, Scenario(at, 5.0, 0.02, shaking))
    mean = np.tile(at[0], (len(pinned.t), 1))
    assert np.abs(pinned.x.mean(axis=1) - mean).max() < 1e-12
    assert np.abs(free.x.mean(axis=1) - mean).max() > 1.0, "motors at 0 and links upright do not rest"


def test_a_pressure_beyond_1e9_has_not_diverged():
    """v' = -1e-6 p - 2 v + u, p' = 1e6 v, in m/s and Pa: (s + 1)^2, so that p = p(0) (1 + t) exp(-t) from rest."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    rhs = ca.vertcat(-1e-6 * x[1] - 2 * x[0] + u, 1e6 * x[0])
    agent = Agent(name="a", x=x, u=u, rhs=rhs, y=x[0], states=("v", "p"))
    none = Gains(*((np.zeros(shape),) * 2 for shape in ((0, 0), (0, 1), (1, 0), (1, 1))))
    start = np.array([[0.0, 0.0], [0.0, 3e10]])
    found = simulate(Network(agent, Graph.topology("path", 2)), none, Scenario(start, 1.0, 1e-3))
    assert found.x[-1, 1, 1] == pytest.approx(3e10 * 2 * np.exp(-1.0), rel=1e-9)


def test_what_diverges_is_said_with_time_and_agent():
    wrong = Gains(COROLLARY_1.A, COROLLARY_1.B, COROLLARY_1.C, tuple(-D for D in COROLLARY_1.D))
    with pytest.raises(Diverged) as caught:
        simulate(ARMS, wrong, Scenario(START, 60.0, 0.01))
    figures = caught.value.figures
    assert 0 < figures["time"] < 60
    assert figures["agent"] in (1, 2, 3)
    assert figures["state"] in ARMS.agent.states


def test_an_agent_that_leaves_its_domain_and_then_diverges_is_said_to_have_left():
    """x' = x^2 from x(0): x(t) = x(0) / (1 - t x(0)), which passes 2 at 1/x(0) - 1/2 and every bound at 1/x(0)."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    agent = Agent(name="a", x=x, u=u, rhs=x**2 + u, y=x, states=("x",), domain={"x": (-2.0, 2.0)})
    none = Gains(*((np.zeros(shape),) * 2 for shape in ((0, 0), (0, 1), (1, 0), (1, 1))))
    alone = Network(agent, Graph.topology("path", 2))
    with pytest.raises(
        Diverged, match=r"beyond 1e\+09.*; a2 left the domain: x = 2\.\d* at (\d\.\d*) s"
    ) as caught:
        simulate(alone, none, Scenario(np.array([[0.1], [1.0]]), 3.0, 1e-3))
    left = re.search(r"at (\S+) s$", str(caught.value))
    assert float(left[1]) == pytest.approx(0.5, abs=2e-3)
    assert caught.value.figures["time"] == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize(("gone", "left"), [(-3e9, "; a2 left the domain: x = -3e+09 at 2 s"), (np.nan, "")])
def test_an_agent_that_leaves_its_domain_and_diverges_between_two_records_left_it(gone: float, left: str):
    """Of random problem 20811 such a run counted as a claim that is false; what is no number left nothing that is known."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    agent = Agent(name="a", x=x, u=u, rhs=x**2 + u, y=x, states=("x",), domain={"x": (-2.0, 2.0)})
    with pytest.raises(Diverged) as caught:
        check_bounded(np.array([0.0, 2.0]), np.array([[[0.0], [1.0]], [[0.0], [gone]]]), agent)
    assert str(caught.value).partition("at t = 2 s")[2] == left


@pytest.mark.parametrize(
    "changes", [{"method": "euler"}, {"substeps": 0}, {"horizon": -1.0}, {"step": np.nan}]
)
def test_a_scenario_that_means_nothing_is_refused(changes):
    with pytest.raises(ProblemError):
        simulate(ARMS, COROLLARY_1, replace(Scenario(START, 1.0), **changes))


def test_a_start_for_other_agents_is_refused():
    with pytest.raises(ProblemError, match="2 x 4"):
        simulate(ARMS, COROLLARY_1, Scenario(START[:2], 1.0))
