"""The floor: 1.97 for the arms, closed forms, and that no design is below it."""

import numpy as np
import pytest
from lmi_cases import ALPHA, arms, claim, published

from lockstep.lmi.floor import floor_rho
from lockstep.lmi.solve import least_rho
from lockstep.model.agent import Agent
from lockstep.model.graph import Graph
from lockstep.model.network import Network


def network(dynamics: dict[str, str], outputs: dict[str, str], B: tuple[np.ndarray, ...] = ()) -> Network:
    agent = Agent.from_expressions(
        "a", states=list(dynamics), inputs=["u"], dynamics=dynamics, outputs=outputs
    )
    return Network(agent, Graph.topology("cycle", 3), B)


def test_the_floor_of_the_arms() -> None:
    """1.97, measured apart from this code; the published gains are far above it."""
    floor = floor_rho(arms(), ALPHA, np.eye(4))
    assert floor == pytest.approx(1.97, rel=0.01)
    least = least_rho(arms().loop(2), published().blocks, claim(arms(), 2, ALPHA))
    assert least is not None
    assert floor < least.rho


def test_a_chain_whose_disturbance_no_input_reaches_first() -> None:
    """x'' = u + xi_2, x' = v + xi_1, full state, no phi: unlimited gain on v makes v the input of x' = v + xi_1.

    min over v of integral (x^2 + v^2 - rho^2 xi^2): Riccati 1 - p^2 (1 - 1/rho^2) = 0 has p > 0 for rho > 1 only: 1.
    """
    assert floor_rho(network({"x": "v", "v": "u"}, {"y1": "x", "y2": "v"}), 0.0, np.eye(2)) == pytest.approx(
        1.0, abs=2e-3
    )


@pytest.mark.parametrize("weight", [0.25, 4.0])
def test_the_weight_scales_the_chain(weight: float) -> None:
    """R = w I: the cost is w times larger, so rho is sqrt(w) times."""
    chain = network({"x": "v", "v": "u"}, {"y1": "x", "y2": "v"})
    assert floor_rho(chain, 0.0, weight * np.eye(2)) == pytest.approx(np.sqrt(weight), rel=2e-3)


def test_no_agent_can_be_slower_than_what_no_input_reaches() -> None:
    """z' = -z + sin z / 2 + xi, out of reach of u: the gain 1 / (1 - 1/2) = 2 is the floor, whatever the gains of x."""
    fixed = network({"x": "u", "z": "-z + 0.5*sin(z)"}, {"y1": "x", "y2": "z"})
    assert floor_rho(fixed, 0.5, np.diag([1e-6, 1.0])) == pytest.approx(2.0, rel=5e-3)
    # With alpha well beyond 1 no multiplier helps: nothing can be certified (just beyond it the solver wavers).
    assert floor_rho(fixed, 2.0, np.eye(2)) == np.inf


def test_more_alpha_and_more_weight_raise_the_floor() -> None:
    arms_network = arms()
    floors = [floor_rho(arms_network, alpha, np.eye(4)) for alpha in (0.0, ALPHA, 2 * ALPHA)]
    assert floors[0] < floors[1] < floors[2]


def test_different_inputs_are_pooled() -> None:
    """B_1 and B_2 each reach one state, together both: the floor may use both for every agent."""
    unit = np.eye(2)
    dynamics, outputs = {"x": "x + u", "z": "z"}, {"y1": "x", "y2": "z"}
    pooled = network(dynamics, outputs, (unit[:, :1], unit[:, 1:], unit[:, :1]))
    alone = network(dynamics, outputs)
    assert floor_rho(pooled, 0.0, np.eye(2)) < 0.1
    assert floor_rho(alone, 0.0, np.eye(2)) == np.inf
