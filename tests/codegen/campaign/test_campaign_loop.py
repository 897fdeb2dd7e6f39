"""The compiled loop against the simulation of the model layer: the same run, for every kind of controllers."""

import numpy as np
import pytest
from campaign_cases import (
    HORIZON,
    PERIOD,
    PUBLISHED,
    SAME,
    SAME_MESSAGES,
    STEP,
    WEIGHTS,
    assert_same_run,
    emitted,
    on_disagreement,
    one_run,
    reference,
    sampled_loop,
)

from lockstep.campaign.compiled.engine import Batch, Engine
from lockstep.campaign.compiled.functions import Performance
from lockstep.campaign.compiled.layout import Features
from lockstep.campaign.compiled.source import sampled_source
from lockstep.check.system.loop import Gains
from lockstep.model.agents.agent import Agent
from lockstep.model.graphs.graph import Graph
from lockstep.model.network import Network
from lockstep.model.simulation.perturbation import HeldPerturbation
from lockstep.model.simulation.run import simulate
from lockstep.model.simulation.scenario import Scenario

GIVEN = Features(waves=True, sequences=True)


def flat(E):
    """Errors of [A B; C D], (3, 3, 4), as a row of a batch has them: agent after agent, letter after letter."""
    blocks = (E[:, :2, :2], E[:, :2, 2:], E[:, 2:, :2], E[:, 2:, 2:])
    return np.concatenate([block[i].ravel() for i in range(3) for block in blocks])


def test_continuous_controllers_with_errors_of_their_gains(arms_network, continuous):
    given = one_run(continuous)
    E = np.random.default_rng(5).normal(size=(3, 3, 4)) * 0.1
    place = continuous.layout.places["delta"]
    given.batch.rows[0, place] = np.concatenate([flat(E), np.zeros_like(flat(E))])
    held = HeldPerturbation(E[None])
    expected = simulate(arms_network, PUBLISHED, given.scenario(perturbation=held))
    found = continuous.run(given.batch, HORIZON)
    assert_same_run(found, expected, SAME)
    assert found["effort_peak"][0] == pytest.approx(np.abs(expected.u[:-1]).max(), rel=SAME)
    x_C = np.einsum("kia,ab,kib->k", expected.x_C, WEIGHTS.Q, expected.x_C)
    z = np.trapezoid(on_disagreement(expected.x, WEIGHTS.R) + x_C, expected.t)
    assert found["z_squared"][0] == pytest.approx(z, rel=1e-4), "(omega h)^2 / 12 with omega up to 20 rad/s"
    given.batch.rows[0, place] = 0.0
    assert continuous.run(given.batch, HORIZON).states[0] != pytest.approx(expected.x[-1], rel=1e-4)


def test_a_delta_that_turns(arms_network, continuous):
    # Delta(t) = cos(nu t) E_1 + sin(nu t) E_2 against the same errors as a function of time.
    E = np.random.default_rng(6).normal(size=(2, 3, 3, 4)) * 0.1

    class Turning:
        def at(self, t, since):  # noqa: ARG002
            c, s = np.cos(7.0 * t), np.sin(7.0 * t)
            return c[:, None, None, None] * E[0] + s[:, None, None, None] * E[1]

    given = one_run(continuous)
    given.batch.rows[0, continuous.layout.places["delta"]] = np.concatenate([flat(E[0]), flat(E[1])])
    given.batch.rows[0, continuous.layout.places["nu"]] = 7.0
    expected = simulate(arms_network, PUBLISHED, given.scenario(perturbation=Turning()))
    assert_same_run(continuous.run(given.batch, HORIZON), expected, SAME)


def test_the_c_that_ships(arms_network, sampled):
    given = one_run(sampled)
    expected = simulate(arms_network, reference(emitted(arms_network.graph)), given.scenario())
    found = sampled.run(given.batch, HORIZON)
    assert_same_run(found, expected, SAME_MESSAGES)
    # What the sampled certificate charges: x_C at the sampling instants, held for a period.
    x_C = expected.x_C[:-1:5]
    charged = PERIOD * np.einsum("kia,ab,kib->", x_C, WEIGHTS.Q, x_C)
    z = np.trapezoid(on_disagreement(expected.x, WEIGHTS.R), expected.t) + charged
    assert found["z_squared"][0] == pytest.approx(z, rel=1e-4)
    other = simulate(arms_network, PUBLISHED, given.scenario())
    assert found.states[0] != pytest.approx(other.x[-1], rel=1e-6), "continuous controllers differ"


@pytest.mark.parametrize("options", [{"real": "float64"}, {"optimize": "size"}])
def test_other_kinds_of_emitted_c(arms_network, options):
    files = emitted(arms_network.graph, **options)
    engine = Engine(sampled_loop(arms_network, files, GIVEN))
    given = one_run(engine)
    expected = simulate(arms_network, reference(files), given.scenario())
    tolerance = SAME if "real" in options else SAME_MESSAGES
    assert_same_run(engine.run(given.batch, HORIZON), expected, tolerance)


def test_one_period_late(arms_network):
    files = emitted(arms_network.graph)
    late = Engine(sampled_loop(arms_network, files, GIVEN, delay=1))
    given = one_run(late)
    found = late.run(given.batch, HORIZON)
    expected = simulate(arms_network, reference(files, delay=1), given.scenario())
    assert_same_run(found, expected, SAME_MESSAGES)
    prompt = Engine(sampled_loop(arms_network, files, GIVEN)).run(given.batch, HORIZON)
    assert found.states != pytest.approx(prompt.states, rel=1e-4)


def test_static_controllers_and_a_leader_of_other_agents():
    # Order 0, two inputs, an agent without incoming edges, weights of their own, a domain that is left.
    agent = Agent.from_expressions(
        "cart",
        states=["p", "v"],
        inputs=["f", "g"],
        outputs={"y1": "p", "y2": "v"},
        dynamics={"p": "v + 0.1*g", "v": "f - tanh(p)*exp(-v**2) + if_else(p > 1, 0.5, 0)*cos(t)"},
        domain={"p": (-1.5, 1.5)},
    )
    graph = Graph.from_edges(3, [(2, 1, 0.7), (3, 2, 1.3), (3, 1, 1.0)])
    network = Network(agent, graph)
    D = np.random.default_rng(0).normal(size=(2, 2)) - 2 * np.eye(2)
    gains = Gains(*((np.zeros(shape),) * 3 for shape in ((0, 0), (0, 2), (2, 0))), (D,) * 3)
    files = emitted(graph, gains, real="float64")
    weights = Performance(np.eye(2), np.zeros((0, 0)))
    engine = Engine(sampled_source(network, files, weights, step=STEP, features=Features()))
    start = np.array([[2.0, 0.1], [-0.3, 0.2], [0.4, -0.5]])
    found = engine.run(Batch.at_rest(engine.layout, 1, x=start.ravel()), HORIZON)
    expected = simulate(network, reference(files), Scenario(start, HORIZON, STEP, substeps=1))
    assert found.states[0] == pytest.approx(expected.x[-1], rel=SAME)
    assert found["outside"][0] == np.sum(np.abs(expected.x[:-1, :, 0]).max(axis=1) > 1.5) > 0
    inside = Batch.at_rest(engine.layout, 1, x=start.ravel() / 2)
    assert engine.run(inside, HORIZON)["outside"][0] == 0
