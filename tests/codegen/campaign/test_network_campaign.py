"""Campaigns of network faults: the nodes that ship on a bad network, against what is proved and what must break."""

import dataclasses
import json
import runpy

import numpy as np
import pytest
from typer.testing import CliRunner

from lockstep.campaign.network_faults.campaign import (
    EveryMessageArrives,
    NetworkCampaign,
    NetworkGuarantee,
    run_network,
)
from lockstep.campaign.network_faults.faults import NetworkFaults
from lockstep.campaign.network_faults.loop import COLUMNS, network_loop
from lockstep.check.continuous.inequality import Performance
from lockstep.check.errors import ProblemError
from lockstep.cli.main import app
from lockstep.codegen.emission.emit import emit
from lockstep.codegen.exports import with_exports
from lockstep.codegen.from_design import specification
from lockstep.lmi.document import parse
from lockstep.model.network import Network
from lockstep.model.simulation import simulate
from lockstep.model.simulation.disturbance import Sines
from lockstep.model.simulation.message_channel import MessageChannel
from lockstep.model.simulation.scenario import Scenario
from lockstep.verification.closed_loop.software_in_the_loop import design_controllers
from lockstep.verification.toolchain import host_compilers

pytestmark = pytest.mark.skipif(not host_compilers(), reason="no C compiler here")

RUNS = 32


@pytest.fixture(scope="module")
def stored(root):
    """The arms designed for rho alone, whose large gains a bad network breaks."""
    path = root / "tests" / "designs" / "arms_rho_only.json"
    return parse(json.loads(path.read_text()), str(path))


@pytest.fixture(scope="module")
def network(stored):
    problem = stored.problem
    return Network(problem.agent(), problem.graph(), problem.agents_B(), problem.design.coordinates)


@pytest.fixture(scope="module")
def loop(stored, network):
    weights = Performance(stored.problem.state_weight(4), stored.problem.controller_weight(2))
    return network_loop(network, with_exports(emit(specification(stored)), ["messages"]), weights)


def runs(loop, faults, starts, *, horizon=20.0, waves=None, count=RUNS):
    rows = np.tile(NetworkFaults.parse(faults).row(), (count, 1))
    table = loop.runs(rows, np.arange(count), np.broadcast_to(starts, (count, 3, 4)), horizon, waves)
    return dict(zip(COLUMNS, table.T, strict=True))


START = np.array([[0.8, 0, 0.8, 0], [-0.5, 0, -0.5, 0], [0.2, 0, 0.2, 0]])
FAULTS = [
    "loss=0.5",
    "loss=0.9,burst=1",
    "delay=0:1",
    "to_bad=0.02,to_good=0.5",
    "jitter=0.1",
    "twice=0.3,corrupt=0.1",
    "loss=0.2,delay=0:1,jitter=0.1,twice=0.2,corrupt=0.05",
    "restarts=0.0003,silence=40",
]


@pytest.mark.parametrize("faults", FAULTS)
def test_the_arms_come_to_agree_on_a_bad_network(loop, faults):
    found = runs(loop, faults, START)
    assert (found["faults"] == 0).all()
    if "restarts" not in faults:
        assert (found["disagreement_final"] < 1e-3 * found["disagreement_initial"]).all()
    assert np.median(found["disagreement_final"]) < 1e-3
    wanted = NetworkFaults.parse(faults)
    if faults == "loss=0.5":
        assert found["lost"].sum() / found["sent"].sum() == pytest.approx(0.5, abs=0.005)
    assert (found["bad_checksum"].sum() > 0) == (wanted.corrupt > 0)
    overtaken = wanted.delay[1] or wanted.twice or wanted.jitter or wanted.restarts
    assert (found["old_number"].sum() > 0) == bool(overtaken)


@pytest.mark.parametrize("faults", ["loss=0.9", "delay=8:8", "loss=1,burst=12"])
def test_beyond_what_they_carry_they_do_not(loop, faults):
    """These gains (gain_limit 50) are unstable in the mean square from a loss of 0.8, and from ages of a few periods."""
    found = runs(loop, faults, START)
    assert (found["disagreement_final"] > found["disagreement_initial"]).all()


def common_sine(amplitude=20.0, omega=5.0):
    """All arms' links are pushed alike."""
    push = np.zeros((3, 4))
    push[:, 3] = amplitude
    return np.concatenate([np.zeros(24), push.ravel(), [omega]])


def test_arms_that_move_alike_at_5_rad_per_s_stay_in_agreement_with_half_of_the_messages_lost(
    loop, network, stored
):
    """Stamped differences are exactly 0; a message held against one's own reading of now is an error of what has moved."""
    alike = np.tile([[0.3, 0, 0.3, 0]], (3, 1))
    found = runs(loop, "loss=0.5,delay=0:5,twice=0.1", alike, waves=np.tile(common_sine(), (RUNS, 1)))
    # |x_d| is a difference of doubles that are equal but for the rounding of their mean: some 1e-16 of states up to 100.
    assert found["disagreement_largest"].max() < 1e-12
    push = np.zeros((3, 4))
    push[:, 3] = 20.0
    scenario = Scenario(
        alike,
        5.0,
        step=5e-4,
        disturbance=Sines(push, np.zeros((3, 4)), 5.0 / (2 * np.pi)),
        channel=MessageChannel(drop=0.5, seed=1),
    )
    x = simulate(network, design_controllers(stored), scenario).x
    assert np.abs(x - x.mean(axis=1, keepdims=True)).max() > 0.01, "as controllers without stamps do"


def test_a_run_is_fixed_by_its_seed_whatever_the_number_of_threads(loop):
    faults = NetworkFaults.parse("loss=0.3,delay=0:2,jitter=0.2")
    one, two = (
        run_network(loop, faults, NetworkGuarantee(), 130, seed=3, horizon=0.5, jobs=jobs) for jobs in (1, 2)
    )
    assert (one.values == two.values).all()
    other = run_network(loop, faults, NetworkGuarantee(), 130, seed=4, horizon=0.5)
    assert not (one.values == other.values).all()


def test_a_bound_below_what_is_reached_is_seen_as_exceeded(loop):
    faults = NetworkFaults(burst=0)
    held = [NetworkGuarantee(rho, EveryMessageArrives()) for rho in (10.0, 0.01)]
    good, bad = (run_network(loop, faults, one, 16, horizon=2.0) for one in held)
    assert good.covered and good.ok
    assert bad.covered and not bad.ok


@pytest.mark.parametrize(
    ("loss", "faults", "covered"),
    [
        (0.1, "loss=0.1", True),
        (0.1, "loss=0.11", False),
        (0.1, "loss=0.09", True),
        (0.1, "", True),
        (0.145, "loss=0.1,corrupt=0.05,twice=1", True),
        (0.1, "loss=0.1,corrupt=0.05", False),
        (0.1, "loss=0.05,corrupt=0.05", True),
        (0.1, "loss=0.1,delay=0:4,jitter=0.2", True),
        (0.1, "loss=0.1,delay=0:5", False),
        (0.1, "loss=0.1,to_bad=0.01", False),
        (0.0, "loss=1,burst=2", True),
        (0.1, "loss=1,burst=2", True),
        (0.1, "loss=1,burst=3", False),
        (0.0, "loss=1,burst=3", False),
        (0.0, "delay=0:4", True),
        (0.0, "delay=0:5", False),
        (0.0, "jitter=0.2", True),
        (0.0, "jitter=0.3", False),
        (0.0, "restarts=0.1", False),
    ],
)
def test_what_is_covered(loss, faults, covered):
    """What is proved is for as much or less; of no chance at all, where ages are bounded, it is of each run."""

    class Proved:
        burst, delay, jitter = 2, (0, 4), 0.2

    Proved.loss = loss
    assert NetworkGuarantee(1.0, Proved()).covers(NetworkFaults.parse(faults)) is covered
    assert not NetworkGuarantee(None, Proved()).covers(NetworkFaults.parse(faults))


@pytest.mark.parametrize(
    "text",
    [
        "lose=1",
        "loss=2",
        "loss=",
        "delay=3:1",
        "delay=a",
        "burst=-1",
        "loss=nan",
        "loss=0.1,loss=0.2",
        "delay=0:99",
    ],
)
def test_faults_that_are_none(text):
    with pytest.raises(ProblemError, match="faults"):
        NetworkFaults.parse(text)


def test_the_command(root, tmp_path):
    arguments = [
        "simulate",
        str(root / "generated" / "flexible_joint_arms"),
        "--campaign",
        "48",
        "--horizon",
        "4",
    ]
    result = CliRunner().invoke(app, [*arguments, "--faults", "", "-o", str(tmp_path / "ideal"), "--json"])
    found = json.loads(result.stdout)
    assert result.exit_code == 0, result.output
    assert found["covered"] and found["gain"] < found["rho"]
    # rho of the committed design also weighs u and noise, which these runs have little of.
    assert found["gain"] > 0.6 * found["rho"], "near what is proved, or it would say little"
    assert len((tmp_path / "ideal" / "runs.csv").read_text().splitlines()) == 49
    for wrong in (["--faults", "loss=2"], ["--faults", "", "--controllers", "continuous"]):
        assert CliRunner().invoke(app, [*arguments, *wrong, "-o", str(tmp_path / "x")]).exit_code == 2
    alone = CliRunner().invoke(
        app, ["simulate", str(root / "generated" / "flexible_joint_arms"), "--faults", "loss=0.1"]
    )
    assert alone.exit_code == 2


@pytest.mark.slow
@pytest.mark.parametrize("name", ["loss", "jitter"])
def test_faulty_runs_of_the_arms_keep_to_what_is_proved_of_each_network(root, name):
    """A small part of benchmarks/faults.py, which runs 100 000: proved anew, covered, none above, none diverged."""
    found = runpy.run_path(str(root / "benchmarks" / "faults.py"))["measured"](name, 128, 7, 1)
    assert found["ok"] and found["covered"]
    assert 0.5 * found["rho"] < found["gain"] <= found["rho"]
    assert found["diverged"] == 0


def test_runs_that_clip_are_not_faults_and_not_held_against_rho(root):
    """The committed arms within 10 V, started where they ask for more."""
    path = root / "generated" / "flexible_joint_arms" / "design.json"
    stored = parse(json.loads(path.read_text()), str(path))
    problem = stored.problem
    network = Network(problem.agent(), problem.graph(), problem.agents_B(), problem.design.coordinates)
    weights = Performance(problem.state_weight(4), problem.controller_weight(2))
    loop = network_loop(network, with_exports(emit(specification(stored)), ["messages"]), weights)
    found = runs(loop, "loss=0.2", 20 * START, horizon=5.0, count=4)
    assert (found["clipped"] > 0).all()
    assert (found["faults"] == 0).all()
    values = np.zeros((4, len(COLUMNS)))
    held = dict(zip(COLUMNS, values.T, strict=True))
    held["z2"][:], held["xi2"][:] = [1.0, 0.0, 100.0, 0.0], 1.0
    held["clipped"][2] = 1
    bounded, chance = (
        NetworkCampaign(faults, NetworkGuarantee(2.0, proved), 0, 1.0, values)
        for faults, proved in (
            (NetworkFaults(burst=0), EveryMessageArrives()),
            (NetworkFaults(loss=0.1), EveryMessageArrives(loss=0.1)),
        )
    )
    assert bounded.covered and bounded.ok and bounded.gain == 1.0
    assert not chance.covered, "a mean over some of the runs is another mean"
    held["clipped"][2], held["outside"][2] = 0, 1
    assert bounded.ok and not chance.covered
    held["outside"][2] = 0
    assert not bounded.ok and chance.covered and not chance.ok


@pytest.mark.parametrize("delay", [0, 1])
def test_without_faults_it_is_our_simulation_u_at_once_or_a_period_late(network, stored, delay):
    """Nodes whose messages all arrive at their own instants step as controllers without them do."""
    weights = Performance(stored.problem.state_weight(4), stored.problem.controller_weight(2))
    files = with_exports(emit(specification(stored)), ["messages"])
    found = runs(network_loop(network, files, weights, delay), "", START, horizon=1.0, count=1)
    controllers = dataclasses.replace(design_controllers(stored), delay=delay)
    scenario = Scenario(START, 1.0, stored.problem.controller.period, substeps=10)
    d = simulate(network, controllers, scenario).disagreement()
    # Steps of the same size; a sum in another order may turn a rounding of y to float32.
    assert found["disagreement_final"] == pytest.approx(d[-1], rel=1e-5)
