"""Sampled controllers in the loop, against the discrete system that a linear loop then is."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm
from simulation_cases import ARMS, COROLLARY_1, START, cart_gains, carts

from lockstep.check.continuous.inequality import Performance
from lockstep.check.errors import ProblemError
from lockstep.model.simulation import RhoWeights, Scenario, energies, noise, simulate
from lockstep.model.simulation.message_channel import MessageChannel
from lockstep.model.simulation.perturbation import PaperPerturbation
from lockstep.model.simulation.run import rates
from stepped import exact_controllers

CARTS, PERIOD = carts(), 0.1
DISCRETE = cart_gains()
"""As gains of x+ = A x + B r: stable enough, |A| = 1.4 at most is not, so they are made smaller."""
DISCRETE = type(DISCRETE)(tuple(0.5 * A for A in DISCRETE.A), DISCRETE.B, DISCRETE.C, DISCRETE.D)
CART_START = np.array([[1.0, 0.0], [-0.4, 0.3], [0.2, -1.0]])


def discrete_loop(periods: int, *, delay: int = 0, message_delay: int = 0, arrives=None) -> np.ndarray:
    """x at the sampling instants: the exact step of the plant, messages kept in a table, agent by agent."""
    lure, L = CARTS.agent.lure, CARTS.graph.laplacian
    step = expm(PERIOD * np.block([[lure.A, lure.B], [np.zeros((1, 3))]]))
    x, x_C, pending = CART_START.copy(), np.zeros((3, 1)), np.zeros((3, 1))
    record, sent, held = [x], [], {}
    for k in range(periods):
        y = x @ lure.C.T
        sent.append(y)
        u = np.zeros((3, 1))
        for i in range(3):
            (j,) = np.flatnonzero(L[i] < 0)
            if k >= message_delay and (arrives is None or arrives[k, i]):
                held[i] = sent[k - message_delay][j]
            r = y[i] - held[i] if i in held else np.zeros(2)
            out = DISCRETE.blocks[i] @ np.concatenate([x_C[i], r])
            x_C[i], u[i] = out[:1], out[1:]
        applied, pending = (pending, u) if delay else (u, u)
        x = np.stack([step[:2, :2] @ x[i] + step[:2, 2:] @ applied[i] for i in range(3)])
        record.append(x)
    return np.array(record)


def run(*, delay=0, channel=None, step=PERIOD):
    controllers = exact_controllers(CARTS.graph, DISCRETE, PERIOD, delay=delay)
    scenario = Scenario(CART_START, 4.0, step, channel=channel or MessageChannel(), substeps=16)
    return simulate(CARTS, controllers, scenario)


@pytest.mark.parametrize("delay", [0, 1])
@pytest.mark.parametrize("message_delay", [0, 1, 3])
def test_a_linear_loop_is_its_discrete_system(delay, message_delay):
    found = run(delay=delay, channel=MessageChannel(delay=message_delay))
    exact = discrete_loop(40, delay=delay, message_delay=message_delay)
    # RK4 with 6 ms steps on poles of 0.5 rad/s: below 1e-10.
    assert np.abs(found.x - exact).max() < 1e-10
    assert found.u_hold == "held"
    # In the first periods there is nothing to hear yet, or nothing has taken effect.
    first = int(np.flatnonzero(found.u.any(axis=(1, 2)))[0])
    assert first == delay + message_delay


def test_the_delay_makes_a_difference():
    assert np.abs(run(delay=1).x - discrete_loop(40)).max() > 1e-3
    assert np.abs(run(channel=MessageChannel(delay=1)).x - discrete_loop(40)).max() > 1e-3


def test_a_lost_message_is_replaced_by_the_last_one():
    channel = MessageChannel(drop=0.4, seed=5)
    arrives = channel.arrivals(40, 3)
    assert 0.3 < 1 - arrives.mean() < 0.5
    assert np.abs(run(channel=channel).x - discrete_loop(40, arrives=arrives)).max() < 1e-10
    assert np.abs(run(channel=channel).x - discrete_loop(40)).max() > 1e-3


def test_agents_that_never_hear_move_by_themselves():
    found = run(channel=MessageChannel(drop=1.0))
    assert not found.u.any()
    alone = np.array([(expm(CARTS.agent.lure.A * 4.0) @ x) for x in CART_START])
    assert np.abs(found.x[-1] - alone).max() < 1e-10


def test_a_finer_record_is_the_same_run():
    coarse, fine = run(), run(step=PERIOD / 4)
    assert np.abs(fine.x[::4] - coarse.x).max() < 1e-10
    assert (fine.u[0:4] == fine.u[0]).all()
    assert (fine.x_C[0:4] == fine.x_C[0]).all()


def test_the_adaptive_integrator_agrees_on_the_arms():
    controllers = exact_controllers(ARMS.graph, zoh_of_corollary_1(), 0.01)
    scenario = Scenario(
        START, 1.0, 0.01, noise(3, 4, interval=0.01, horizon=1.0, seed=0, sigma=1.0), substeps=8
    )
    fixed, adaptive = (
        simulate(ARMS, controllers, replace(scenario, method=method)) for method in ("rk4", "adaptive")
    )
    assert np.abs(fixed.x - adaptive.x).max() < 1e-8


def zoh_of_corollary_1(period=0.01):
    from lockstep.check.sampled.discretise import discretise

    g = COROLLARY_1
    sampled = [discretise(g.A[i], g.B[i], g.C[i], g.D[i], period, "zoh") for i in range(3)]
    return g.from_blocks(np.stack(sampled), g.order)


def test_fast_sampling_approaches_the_continuous_controllers():
    """The difference falls with the period: by about two for half of it (zoh is of first order)."""
    smooth = simulate(ARMS, COROLLARY_1, Scenario(START, 2.0, 0.01))
    errors = []
    for period in (0.01, 0.005, 0.0025):
        controllers = exact_controllers(ARMS.graph, zoh_of_corollary_1(period), period)
        sampled = simulate(ARMS, controllers, Scenario(START, 2.0, period))
        errors.append(np.abs(sampled.x[:: round(0.01 / period)] - smooth.x).max())
    assert np.allclose(np.array(errors[:-1]) / errors[1:], 2, atol=0.3), errors
    assert errors[-1] < 0.02


def test_quantised_outputs_are_what_is_heard():
    """With one bit pattern for everything near 0, agents that are near agreement do nothing."""
    near = 0.01 * CART_START
    controllers = exact_controllers(CARTS.graph, DISCRETE, PERIOD)
    rough = simulate(
        CARTS, controllers, Scenario(near, 1.0, PERIOD, channel=MessageChannel(bits=4, full_scale=8.0))
    )
    exact = simulate(CARTS, controllers, Scenario(near, 1.0, PERIOD))
    assert not rough.u.any()
    assert exact.u.any()


@pytest.mark.parametrize(
    ("controllers", "changes", "where"),
    [
        ("sampled", {"perturbation": PaperPerturbation(3, 2)}, "perturbation"),
        ("continuous", {"channel": MessageChannel(drop=0.1)}, "channel"),
        ("sampled", {"step": 0.003}, "scenario"),
    ],
)
def test_what_these_controllers_cannot_have_is_refused(controllers, changes, where):
    chosen = (
        COROLLARY_1
        if controllers == "continuous"
        else exact_controllers(ARMS.graph, zoh_of_corollary_1(), 0.01)
    )
    simulate(ARMS, chosen, Scenario(START, 0.1, 0.01))
    with pytest.raises(ProblemError) as caught:
        simulate(ARMS, chosen, replace(Scenario(START, 0.1, 0.01), **changes))
    assert caught.value.where == where


def test_energies_with_rates_are_those_of_a_fine_record():
    """The same run recorded once a period and a hundred times: noise and inputs are held for that period, 0.25 s."""
    slow = exact_controllers(CARTS.graph, DISCRETE, 0.25)
    shaking = noise(3, 2, interval=0.25, horizon=10.0, seed=3, sigma=4.0)
    weights = RhoWeights.of(CARTS.graph, Performance(np.diag([1.0, 0.2]), np.eye(1)))

    def recorded(step):
        return simulate(CARTS, slow, Scenario(CART_START, 10.0, step, shaking, substeps=8))

    coarse, fine = recorded(0.25), recorded(0.0025)
    exact = energies(fine, weights).output[::100]
    found = energies(coarse, weights, rates(CARTS, coarse)).output
    # Agents of 0.45 rad/s: (0.11)^4 / 384, and trapezoids of the fine record that are off by 1e-6.
    assert np.allclose(found[1:], exact[1:], rtol=2e-5)
    assert abs(energies(coarse, weights).output[-1] / exact[-1] - 1) > 1e-3
