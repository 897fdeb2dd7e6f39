"""Design for the period: what comes out is better where it ships, and survives periods the start does not."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from sampled_cases import brute_force_radius, controllers, network

from lockstep.lmi.inequality import Certificate
from lockstep.lmi.sampled import Weights, certify_sampled, direct, sampled_rho
from lockstep.lmi.sampled.direct import design_for_period
from lockstep.lmi.sampled.program import Direct, tustin
from lockstep.model.errors import Infeasible

EDGES = [(1, 2, 1.0), (2, 1, 1.0)]
ORDER, GAIN_LIMIT = 1, 20.0
WEIGHTS = Weights(np.eye(2), np.eye(1))
K = np.array([[[-1.0, 0.1, 0.1], [0.0, -4.0, -3.0]]] * 2)
"""Two pendulums that are pulled together: the gains of a fast loop, good at short periods."""


def pendulums(period):
    A, B, H = [[0.0, 1.0], [-2.0, -0.5]], [[0.0], [1.0]], [[1.0, 0.0]]
    return network(A, B, np.eye(2), B, H, EDGES, N=2, alpha=1.0, period=period)


def controllers_of(blocks, period):
    return controllers([np.array(tustin(ca.DM(block), ORDER, period)) for block in blocks], ORDER, EDGES)


def start():
    """Witnesses that are no more than a guess: the program finds its own."""
    return Direct(K, np.ones(1), 3.0, Certificate(3.0, np.eye(4), np.ones(1), np.zeros(0)))


def proved(blocks, m, net):
    ones = controllers_of(blocks, net.period)
    return certify_sampled(net, ones), sampled_rho(net, ones, WEIGHTS, m)


def test_a_design_for_the_period_has_a_smaller_rho_and_is_proved():
    net = pendulums(0.2)
    _, before = proved(K, np.ones(1), net)
    found = design_for_period(net, controllers_of, WEIGHTS, start(), GAIN_LIMIT)
    verdict, after = proved(found.K, found.m, net)
    assert verdict.certified
    assert after.rho < 0.95 * before.rho
    assert after.rho == pytest.approx(found.rho, rel=0.02)
    assert np.linalg.norm(found.K, 2, axis=(1, 2)).max() <= GAIN_LIMIT
    assert found.continuous.rho <= 3 * 3.0 * (1 + 1e-6)


@pytest.mark.slow
def test_a_period_that_the_start_does_not_survive_is_reached():
    net = pendulums(0.5)
    assert brute_force_radius(net, controllers_of(K, 0.5)) > 1
    found = design_for_period(net, controllers_of, WEIGHTS, start(), GAIN_LIMIT)
    verdict, after = proved(found.K, found.m, net)
    assert verdict.certified
    assert after is not None
    assert brute_force_radius(net, controllers_of(found.K, 0.5)) < 1


def test_what_no_gains_survive_is_refused(monkeypatch):
    """Agents that are unstable and drift apart within one period whatever is done at its start, as far as is proved."""
    monkeypatch.setattr(direct, "LEAST_GROWTH", 1.3)
    net = network([[3.0]], [[1.0]], [[1.0]], [[1.0]], [[1.0]], EDGES, N=2, alpha=1.0, period=4.0)
    gains = np.array([[[-4.0]]] * 2)
    weights = Weights(np.eye(1), np.zeros((0, 0)))
    guess = Direct(gains, np.ones(1), 3.0, Certificate(3.0, np.eye(1), np.ones(1), np.zeros(0)))

    def static(blocks, _period):
        return controllers(list(blocks), 0, EDGES)

    assert certify_sampled(net.at(0.05), static(gains, 0.05)).certified
    with pytest.raises(Infeasible) as caught:
        design_for_period(net, static, weights, guess, 10.0)
    assert 0 < caught.value.figures["reachable_period"] < 4.0


def test_tustin_is_the_one_of_the_layer_that_prints():
    from lockstep.codegen.discretize import discretize

    rng = np.random.default_rng(0)
    block = rng.standard_normal((3, 4))
    exact = discretize(block[:2, :2], block[:2, 2:], block[2:, :2], block[2:, 2:], 0.3, "tustin").stacked()
    np.testing.assert_allclose(np.array(tustin(ca.DM(block), 2, 0.3)), exact, rtol=1e-13, atol=1e-15)


@pytest.mark.slow
def test_the_start_is_not_made_worse():
    net = pendulums(0.2)
    once = design_for_period(net, controllers_of, WEIGHTS, start(), GAIN_LIMIT)
    again = design_for_period(net, controllers_of, WEIGHTS, replace(once, rho=3.0), GAIN_LIMIT)
    assert again.rho <= once.rho * (1 + 1e-4)
