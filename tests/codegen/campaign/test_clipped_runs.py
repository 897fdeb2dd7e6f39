"""Runs that clip, against what is proved of them: simulation, campaign, and the arms whose inputs are limited."""

import dataclasses

import numpy as np
import pytest
from test_clipping_c import bench, check_bench

from lockstep.campaign.campaign import summary
from lockstep.campaign.compiled.engine import Batch, Engine
from lockstep.campaign.compiled.layout import Features
from lockstep.campaign.compiled.source import sampled_source
from lockstep.campaign.compute import RunTable, columns_of, compute, excused
from lockstep.campaign.draw import FAMILIES
from lockstep.campaign.plan import plan_of
from lockstep.check.continuous.inequality import Performance
from lockstep.check.errors import ProblemError
from lockstep.check.numbers import as_floats
from lockstep.cli.campaign import _not_covered
from lockstep.codegen.emission.emit import emit
from lockstep.codegen.from_design import specification
from lockstep.codegen.period_redesign import as_shipped
from lockstep.lmi.design import design
from lockstep.lmi.design_verdict import certify
from lockstep.lmi.document import Stored, answer_document, design_file_of
from lockstep.model.network import Network
from lockstep.model.problem import Problem
from lockstep.model.simulation import simulate
from lockstep.model.simulation.scenario import Scenario
from lockstep.verification.closed_loop.measured_gain import measured, network_of_design, promise
from lockstep.verification.closed_loop.software_in_the_loop import design_controllers

PENDULUMS = """
[agent]
name = "pendulum"
states = ["q", "v"]
inputs = ["u"]
dynamics = { q = "v", v = "-0.5*v + slope*sin(q) + u" }
outputs = { y1 = "q", y2 = "v" }
parameters = { slope = 0.3 }
limits = { u = [-3.0, 2.0] }
[network]
agents = 3
edges = [[1, 2], [2, 3], [3, 1]]
[design]
method = "given"
gains = [GAINS, GAINS, GAINS]
[controller]
period = 0.02
""".replace("GAINS", "{ A = [[-3.0]], B = [[1.0, 0.5]], C = [[-1.0]], D = [[-2.5, -1.5]] }")


@pytest.fixture(scope="module")
def pendulums() -> Stored:
    """Pendulums with weak springs: by themselves they move apart from one angle, and settle at others."""
    return as_shipped(design_file_of(design(Problem.parse(PENDULUMS))))


def starts(stored: Stored, radius: float, count: int, seed: int = 0) -> np.ndarray:
    """Starts at a disagreement of a radius, uniform in direction."""
    x = np.random.default_rng(seed).normal(size=(count, stored.gains.N, stored.problem.agent().n))
    x -= x.mean(axis=1, keepdims=True)
    return x * radius / np.linalg.norm(x.reshape(count, -1), axis=1)[:, None, None]


def engine_of(stored: Stored) -> Engine:
    problem = stored.problem
    network = Network(problem.agent(), problem.graph(), problem.agents_B(), problem.design.coordinates)
    weights = Performance(
        problem.state_weight(network.agent.n), problem.controller_weight(stored.gains.order)
    )
    return Engine(
        sampled_source(network, emit(specification(stored)), weights, step=1e-3, features=Features())
    )


def run_from(engine: Engine, x: np.ndarray, horizon: float):
    return engine.run(Batch.at_rest(engine.layout, len(x), x=x.reshape(len(x), -1)), horizon)


def test_what_is_claimed_is_answered_and_decided(pendulums):
    limits = answer_document(pendulums)["limits"]
    assert {"radius", "gain", "clipped_radius"} <= set(limits)
    assert limits["clipped_radius"] > limits["radius"]
    assert certify(pendulums).ok
    for name in ("radius", "limits_gain", "clipped_radius"):
        for factor, ok in ((0.9, True), (1.3, False)):
            claims = pendulums.claims
            better = {name: factor * getattr(claims.sampled, name)}
            changed = dataclasses.replace(claims, sampled=dataclasses.replace(claims.sampled, **better))
            assert certify(dataclasses.replace(pendulums, claims=changed)).ok == ok, name
    more = dataclasses.replace(claims.sampled, radius=1.02 * claims.sampled.radius)
    refused = certify(dataclasses.replace(pendulums, claims=dataclasses.replace(claims, sampled=more)))
    assert refused.reason.endswith("its witness does not prove it; of 0.9 times as much it does")
    for name in ("half_axes", "clipped_half_axes"):
        alike = [
            getattr(pendulums.claims.sampled, name.replace("half_axes", "radius"))
        ] * pendulums.problem.agent().n
        for factor, ok in ((0.9, True), (1.3, False)):
            better = {name: tuple(factor * one for one in alike)}
            changed = dataclasses.replace(claims, sampled=dataclasses.replace(claims.sampled, **better))
            assert certify(dataclasses.replace(pendulums, claims=changed)).ok == ok, name
    without = dataclasses.replace(pendulums, proofs=dataclasses.replace(pendulums.proofs, clipped=None))
    assert not certify(without).ok


def test_from_the_radius_nothing_clips_and_from_the_clipped_one_all_converge(pendulums):
    engine, claims = engine_of(pendulums), pendulums.claims.sampled
    within = run_from(engine, starts(pendulums, claims.radius, 64), 10.0)
    assert within["clipped"].sum() == 0
    edge = run_from(engine, starts(pendulums, claims.clipped_radius, 256), 40.0)
    assert (edge["clipped"] > 0).any()
    assert not edge.diverged.any()
    assert edge["disagreement_final"].max() < 1e-2


@pytest.mark.slow
def test_from_an_ellipsoid_in_the_units_of_the_states_nothing_clips_and_all_converge(pendulums):
    """The rate in 1/1000, and weighed so: what is claimed in each state's unit is the same, and a ball would not be."""
    text = PENDULUMS.replace('q = "v"', 'q = "v/1000"').replace(
        '"-0.5*v + slope*sin(q) + u"', '"-0.5*v + 1000*(slope*sin(q) + u)"'
    )
    text = text.replace("0.5]]", "5e-4]]").replace("-1.5]]", "-1.5e-3]]")
    text = text.replace("[controller]", "weights = { state = [1.0, 1e-6] }\n[controller]")
    stored = as_shipped(design_file_of(design(Problem.parse(text))))
    engine, claims, known = engine_of(stored), stored.claims.sampled, pendulums.claims.sampled
    assert certify(stored).ok
    # Less the solver's gap; a ball in these units may be larger, the rate being a thousandth in it.
    assert claims.radius >= 0.98 * known.radius
    assert claims.clipped_radius >= 0.98 * known.clipped_radius
    for radius, half_axes, clips in (
        (claims.radius, claims.half_axes, False),
        (claims.clipped_radius, claims.clipped_half_axes, True),
    ):
        assert half_axes[1] > 500 * radius
        runs = run_from(engine, starts(stored, 1.0, 128) * np.array(half_axes), 40.0)
        assert (runs["clipped"] > 0).any() == clips
        assert not runs.diverged.any()
        assert runs["disagreement_final"].max() < 10.0, "of 1000 in a unit of the rate"


def simulated(stored: Stored, radius: float):
    controllers = design_controllers(stored)
    scenario = Scenario(starts(stored, radius, 1)[0], 2.0, controllers.period, substeps=4)
    network = network_of_design(stored)
    trajectory = simulate(network, controllers, scenario)
    return trajectory, measured(trajectory, scenario, stored, network, promise(stored, "sampled"))


def test_a_simulated_run_that_clips_is_not_covered(pendulums):
    claims = pendulums.claims.sampled
    trajectory, found = simulated(pendulums, claims.radius)
    assert (trajectory.clipped, found.covered, found.holds) == (0, True, True)
    trajectory, found = simulated(pendulums, 2 * claims.clipped_radius)
    assert trajectory.clipped > 0
    assert trajectory.faults == 0
    assert trajectory.u.max() == 2.0 or trajectory.u.min() == -3.0
    assert not found.covered
    assert "clipped" in found.reason


def test_a_campaign_counts_what_clipped_and_covers_none_of_it(pendulums):
    plan = plan_of(pendulums, emit(specification(pendulums)), horizon=2.0, seed=3)
    assert plan.clipped_radius == pendulums.claims.sampled.clipped_radius
    table = RunTable(columns_of(plan), compute(plan, 0, 256))
    clipped = table["clipped"] > 0
    assert clipped.any()
    assert not (clipped & table.covered).any()
    inside = clipped & ~excused(plan, table)
    assert inside.any()
    assert (table["family"][inside] == FAMILIES.index("start")).all()
    assert (table["disagreement_initial"][inside] <= plan.clipped_radius).all()
    assert (table["diverged"][inside] == 0).all()
    beyond = dataclasses.replace(plan, clipped_radius=None)
    assert excused(beyond, table)[clipped].all()
    assert beyond.identity != plan.identity


def test_limits_are_part_of_the_problem():
    with pytest.raises(ProblemError, match="a range around 0"):
        Problem.parse(PENDULUMS.replace("[-3.0, 2.0]", "[0.0, 2.0]"))


@pytest.mark.slow
def test_the_arms_within_six_volts(examples):
    """Certified from further away than where nothing clips; hundreds of clipped runs stay in the level set; and the bench."""
    text = (examples / "flexible_joint_arms.toml").read_text()
    assert "u = [-10.0, 10.0]" in text
    text = text.replace("u = [-10.0, 10.0]", "u = [-6.0, 6.0]")
    stored = as_shipped(design_file_of(design(Problem.parse(text))))
    claims = stored.claims.sampled
    assert certify(stored).ok
    assert claims.radius is not None
    assert claims.clipped_radius is not None
    assert claims.clipped_radius > 1.5 * claims.radius
    assert stored.claims.controllers_stable
    engine, x = engine_of(stored), starts(stored, claims.clipped_radius, 512)
    runs = run_from(engine, x, 20.0)
    assert (runs["clipped"] > 0).sum() > 50
    assert not runs.diverged.any()
    assert runs["disagreement_final"].max() < 1e-4
    for start in x[:40]:
        V = levels(stored, engine, start, 20.0)
        assert (V[0] * (1 + 1e-9) >= V).all()
    check_bench(bench(emit(specification(stored)), stored.problem.controller.period), 1.0)


def levels(stored: Stored, engine: Engine, start: np.ndarray, horizon: float) -> np.ndarray:
    """V at the samples of one run: the controllers' states of a row are those after its step."""
    P, network = stored.proofs.clipped.storage.P, network_of_design(stored)
    T = as_floats(network.loop(stored.gains.order).d.T)
    trace = engine.trace(Batch.at_rest(engine.layout, 1, x=start.reshape(1, -1)), horizon)
    x, x_C = (trace[name][:: engine.layout.substeps] for name in ("x", "x_C"))
    before = np.concatenate([np.zeros_like(x_C[:1]), x_C[:-1]])
    x_d = np.einsum("ij,rjk->rik", T, x).reshape(len(x), -1)
    xi = np.hstack([x_d, before.reshape(len(x), -1)])
    return np.einsum("ri,ij,rj->r", xi, P, xi)


def test_a_run_that_left_its_domain_is_no_run_that_is_proved_to_converge(pendulums):
    """With inputs clipped agreement is proved while every agent stays in its domain."""
    plan = plan_of(pendulums, emit(specification(pendulums)), horizon=1.0)
    columns = columns_of(plan)
    row = dict.fromkeys(columns, 0.0) | {"family": FAMILIES.index("start"), "clipped": 3.0}
    table = RunTable(
        columns, np.array([[(row | {"outside": left})[name] for name in columns] for left in (0.0, 5.0)])
    )
    assert excused(plan, table).tolist() == [False, True]
    said = summary(plan, table)
    assert (said["runs_outside"], said["clipped_runs"]) == (1, 2)
    assert "2 runs, of which nothing is claimed; 1 left the domain" in _not_covered(said)
