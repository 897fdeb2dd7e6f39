"""Decisions by stored witnesses, on a loop small enough for paper.

Two integrators x_i' = u_i with u_i = -(x_i - x_j) held for T = 0.25 s: with x_d = x_1 - x_2, and e_i, nu_i, mu_i what is
added to u_i (e_i and mu_i) or to r_i (nu_i),

    x_d+ = x_d / 2 + (e_1 - e_2 - nu_1 + nu_2 + mu_1 - mu_2) / 4.

With P = 1 and all of t, kappa, kappa_mu = 100, Schur's complement of Omega > 0 reads 1 - 1 / (4 decay) - 6 / 1600 > 0 (the
rounding of D adds some 1e-10): decay > 0.25 / (1 - 0.00375) = 0.25094. The squared distance from consensus is x_d^2 / 2.
"""

from dataclasses import replace

import numpy as np
import pytest

from lockstep.check.continuous.inequality import Performance
from lockstep.check.numbers import exactly
from lockstep.check.sampled.certificate import decide_sampled
from lockstep.check.sampled.controller import SampledNetwork
from lockstep.check.sampled.discretise import sampled_controllers
from lockstep.check.sampled.inequality import Witness
from lockstep.check.sampled.l2_gain import proves_rho
from lockstep.check.sampled.loop import sampled_loop
from lockstep.check.system.disagreement import disagreement
from lockstep.check.system.loop import Gains, Plant
from lockstep.model.graphs.graph import Graph

EDGES = [(1, 2, 1.0), (2, 1, 1.0)]
ONE, ZERO = (exactly(np.full((1, 1), value)) for value in (1.0, 0.0))
GAINS = Gains(
    (np.zeros((0, 0)),) * 2, (np.zeros((0, 1)),) * 2, (np.zeros((1, 0)),) * 2, (np.array([[-1.0]]),) * 2
)
WITNESS = Witness(np.ones((1, 1)), np.ones(1), np.full(2, 100.0), 0.252, 100.0, 0.0, 0.51, 100.0)


@pytest.fixture
def network():
    d = disagreement(Graph.from_edges(2, EDGES), "laplacian_rows", exact_arithmetic=True)
    return SampledNetwork(Plant(ZERO, (ONE, ONE), ONE, ZERO, ZERO), d, 0.0, 0.25)


@pytest.fixture
def controllers():
    return sampled_controllers(GAINS, EDGES, 0.25, "tustin", "float32")


def test_a_witness_that_holds_is_enough(network, controllers):
    verdict = decide_sampled(network, controllers, [WITNESS])
    assert verdict.certified
    # sqrt(c kappa / (1 - decay)) of |nu| <= 2 sqrt(2) per unit of message error.
    assert verdict.residual_per_message_error == pytest.approx((0.51 * 100 / 0.748) ** 0.5 * 8**0.5, rel=1e-6)


@pytest.mark.parametrize(
    "changed",
    [
        {"decay": 0.2509},
        {"decay": 1.0},
        {"decay": float("nan")},
        {"ratio": 0.49},
        {"ratio": float("inf")},
        {"P": -np.ones((1, 1))},
        {"P": np.full((1, 1), np.nan)},
        {"P": np.ones((2, 2))},
        {"m": np.zeros(1)},
        {"m": np.full(1, np.nan)},
        {"m": np.ones(3)},
        {"t": np.array([100.0, -1.0])},
        {"t": np.array([100.0, np.nan])},
        {"kappa": -1.0},
        {"kappa": 0.1},
        {"kappa_mu": 0.1},
        {"weight": float("nan")},
        {"weight": 0.01},
    ],
)
def test_a_witness_that_does_not_hold_proves_nothing(network, controllers, changed):
    verdict = decide_sampled(network, controllers, [replace(WITNESS, **changed)])
    assert not verdict.certified
    assert "no candidate survived the proof" in verdict.reason
    assert verdict.witness is None
    assert decide_sampled(network, controllers, [replace(WITNESS, **changed), WITNESS]).certified


def test_nothing_is_searched_for(network, controllers):
    verdict = decide_sampled(network, controllers, [])
    assert not verdict.certified
    assert "there is no witness" in verdict.reason


def test_another_period_is_another_loop(network, controllers):
    """At 1 s the loop is x_d+ = -x_d: on the edge; at 0.3 s it is 0.4 x_d, and the noise of 0.3 fits too."""
    assert not decide_sampled(replace(network, period=1.0), controllers, [WITNESS]).certified
    assert decide_sampled(replace(network, period=0.3), controllers, [WITNESS]).certified


def test_rho_below_the_gain_that_exists_is_never_proved(network, controllers):
    """A constant disturbance w of x_d' = u_d + w ends at x_d = w / 2 at the samples: no rho lies below 1/2."""
    loop, weights = sampled_loop(network, controllers), Performance(np.eye(1), np.zeros((0, 0)))
    rho_witness = replace(
        WITNESS, decay=1.0, kappa=1e4, kappa_mu=1e4, t=np.full(2, 1e4), P=np.full((1, 1), 0.3)
    )
    assert proves_rho(loop, weights, 1.0, rho_witness)
    for rho in (0.49, 0.0, -1.0, float("nan")):
        assert not proves_rho(loop, weights, rho, rho_witness)
    assert not proves_rho(loop, weights, 1.0, replace(rho_witness, decay=0.5))
    assert not proves_rho(loop, weights, 1.0, replace(rho_witness, weight=0.1))
