"""Trim points and linearisations: closed forms, finite differences, and a small motion beside the linear one."""

import control
import numpy as np
import pytest

from lockstep.check.errors import ProblemError
from lockstep.check.system.loop import Gains
from lockstep.model import Agent, Graph, Network
from lockstep.model.control.operating_points import linearised_along, linearised_loop
from lockstep.model.simulation import Scenario, simulate


def pendulum(**changes) -> Agent:
    given = dict(
        name="arm",
        states=["a", "w"],
        inputs=["u"],
        outputs={"y": "a"},
        dynamics={"a": "w", "w": "u - 9.81*sin(a) - 0.2*w*abs(w)"},
    )
    return Agent.from_expressions(**{**given, **changes})


def test_the_torque_that_holds_a_pendulum_and_the_angle_that_a_torque_holds():
    agent = pendulum()
    found = agent.trim(states={"a": 0.5})
    np.testing.assert_allclose([*found.x, *found.u], [0.5, 0.0, 9.81 * np.sin(0.5)], atol=1e-9)
    given = agent.trim(inputs={"u": 3.0}, start=[0.2, 0.0])
    np.testing.assert_allclose(given.x, [np.arcsin(3 / 9.81), 0.0], atol=1e-9)
    upright = agent.trim(start=[3.0, 0.1])
    np.testing.assert_allclose(upright.x, [np.pi, 0.0], atol=1e-8)
    system = agent.linearise(upright.x, upright.u)
    np.testing.assert_allclose(np.sort(system.poles().real), [-np.sqrt(9.81), np.sqrt(9.81)], rtol=1e-8)
    assert (system.state_labels, system.input_labels, system.output_labels) == (["a", "w"], ["u"], ["y"])


def test_no_equilibrium_is_said():
    with pytest.raises(ProblemError, match="at best"):
        pendulum().trim(inputs={"u": 12.0})
    with pytest.raises(ProblemError, match="some of"):
        pendulum().trim(states={"b": 1.0})
    with pytest.raises(ProblemError, match="expected 2 and 1"):
        pendulum().linearise([1.0], [0.0])
    root = pendulum(dynamics={"a": "w", "w": "u - sqrt(a)"})
    with pytest.raises(ProblemError, match="not finite"):
        root.linearise([0.0, 0.0], [0.0])


def test_the_slopes_are_those_of_finite_differences_at_a_moving_point():
    agent = pendulum()
    ours = agent.linearise([0.7, -1.3], [0.4], 2.0)
    theirs = control.linearize(agent.to_control(), [0.7, -1.3], [0.4], t=2.0)
    np.testing.assert_allclose(ours.A, theirs.A, atol=1e-5)
    np.testing.assert_allclose(ours.B, theirs.B, atol=1e-5)


def loop() -> tuple[Network, Gains]:
    one = np.array([[-1.0, 0.5]])
    gains = Gains(
        A=(np.array([[-2.0]]),) * 3,
        B=(np.array([[0.5]]),) * 3,
        C=(one[:, 1:],) * 3,
        D=(np.array([[-6.0]]),) * 3,
    )
    return Network(pendulum(), Graph.topology("cycle", 3)), gains


def test_along_a_trajectory_a_nearby_run_moves_as_the_linear_time_varying_system():
    network, gains = loop()
    start = np.array([[0.9, 0.0], [0.3, 0.5], [-0.4, 0.2]])
    nudge = 1e-5 * np.arange(1, 7).reshape(3, 2)
    first = simulate(network, gains, Scenario(start, 1.0, step=0.002))
    second = simulate(network, gains, Scenario(start + nudge, 1.0, step=0.002))
    t, systems = linearised_along(network, gains, first)
    d = np.concatenate([nudge.ravel(), np.zeros(3)])
    for k in range(len(t) - 1):
        h = t[k + 1] - t[k]
        middle = (systems[k].A + systems[k + 1].A) / 2
        d = d + h * middle @ (d + h / 2 * systems[k].A @ d)
    np.testing.assert_allclose(
        (second.x[-1] - first.x[-1]).ravel() / 1e-5, d[:6] / 1e-5, rtol=2e-3, atol=2e-3
    )
    assert len(linearised_along(network, gains, first, every=100)[1]) == 6


def test_the_loop_at_rest_is_the_linear_one_with_the_slope_at_zero():
    network, gains = loop()
    found = linearised_loop(network, gains, np.zeros((3, 2)))
    theirs = control.linearize(network.to_control(gains), np.zeros(9), np.zeros(6))
    np.testing.assert_allclose(found.A, theirs.A, atol=1e-5)
    np.testing.assert_allclose(found.C, theirs.C, atol=1e-5)
    assert found.input_labels == network.to_control(gains).input_labels
    with pytest.raises(ProblemError, match="expected 6 and 3"):
        linearised_loop(network, gains, np.zeros((2, 2)))
