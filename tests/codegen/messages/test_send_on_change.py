"""Send on change: what listeners use is off by the threshold at most, messages are saved, and the residual holds."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

import lockstep
from lockstep.check.errors import ProblemError
from lockstep.check.json_text import load_json
from lockstep.cli.main import app
from lockstep.lmi.document import parse
from lockstep.model.network import Network
from lockstep.model.simulation import simulate
from lockstep.model.simulation.message_channel import MessageChannel
from lockstep.model.simulation.sampled_controllers import SampledControllers
from lockstep.model.simulation.scenario import Scenario
from lockstep.verification.closed_loop.software_in_the_loop import design_controllers


@pytest.fixture(scope="module")
def stored(root):
    path = root / "generated" / "flexible_joint_arms" / "design.json"
    return parse(json.loads(path.read_text()), str(path))


@pytest.fixture(scope="module")
def network(stored):
    problem = stored.problem
    return Network(problem.agent(), problem.graph(), problem.agents_B(), problem.design.coordinates)


def run(stored, network, change, horizon=4.0, controllers=None):
    start = np.array([[0.8, 0, 0.8, 0], [-0.5, 0, -0.5, 0], [0.2, 0, 0.2, 0]])
    scenario = Scenario(start, horizon, channel=MessageChannel(change=change))
    return simulate(network, controllers or design_controllers(stored), scenario)


class Watched:
    """A stepper that notes which rows it was given, and which of them arrived."""

    def __init__(self, stepper, notes):
        self.stepper, self.notes = stepper, notes

    @property
    def memory(self):
        return self.stepper.memory

    def init(self):
        self.stepper.init()

    def step(self, y, neighbour_y, received):
        self.notes.append((neighbour_y[0].astype(float), received))
        return self.stepper.step(y, neighbour_y, received)


def test_every_message_used_is_off_by_the_threshold_at_most(stored, network):
    given, notes = design_controllers(stored), [[], [], []]
    steppers = [Watched(one, note) for one, note in zip(given.steppers, notes, strict=True)]
    watched = SampledControllers(steppers, given.sources, given.period, given.delay, given.real)
    found = run(stored, network, 0.05, controllers=watched)
    total = 0
    for note in notes:
        held = None
        for now, received in note:
            held = now if received else held
            assert np.abs(held - now).max() <= 0.05 * (1 + 1e-9)
        total += sum(received for _, received in note)
    assert found.sent == total
    assert found.sent + found.saved == 3 * 800


def test_more_is_saved_the_larger_the_threshold_and_nothing_is_changed_without_one(stored, network):
    plain, none = run(stored, network, None), run(stored, network, 0.0)
    assert (plain.saved, plain.sent) == (0, 3 * 800)
    np.testing.assert_array_equal(none.x, plain.x, err_msg="what is equal need not be sent")
    saved = [run(stored, network, change).saved for change in (0.001, 0.01, 0.1)]
    assert sorted(saved) == saved
    assert saved[0] < saved[-1]


@pytest.mark.slow
def test_the_residual_that_is_proved_is_kept_and_a_threshold_costs_something(stored, network):
    """The agents are disturbed by nothing else, so that what is left in the end is the threshold's."""
    kappa = stored.claims.sampled.residual_per_message_error
    left = []
    for change in (0.01, 0.1):
        found = run(stored, network, change, horizon=60.0)
        d = found.disagreement()[-2000:]
        assert d.max() <= kappa * (change + 2.0**-24 * np.abs(found.y).max())
        left.append(d.max())
    assert left[1] > left[0] > 1e-6


@pytest.mark.slow
def test_the_command_says_what_is_saved(root):
    folder = str(root / "generated" / "flexible_joint_arms")
    result = CliRunner().invoke(app, ["simulate", folder, "--send-on-change", "0.01", "--json"])
    found = json.loads(result.stdout)
    assert result.exit_code == 0, result.output
    said = found["messages"]
    assert said["saved"] > 0.5
    assert said["residual"] == pytest.approx(95.536334 * 0.01, rel=1e-3)
    assert found["disagreement_final"] <= said["residual"]
    assert not found["l2"]["covered"]


@pytest.mark.parametrize(("kind", "words"), [("none", "proved"), ("sine", "provedwithoutdisturbances")])
def test_what_remains_is_said_of_runs_without_disturbances(root, kind, words):
    folder = str(root / "generated" / "flexible_joint_arms")
    more = ["--send-on-change", "0.01", "--horizon", "0.5", "--disturbance", kind]
    said = "".join(CliRunner().invoke(app, ["simulate", folder, *more]).stdout.split())
    assert f"apart,whichis{words}" in said
    assert ("without" in said) is (kind == "sine")


def test_what_remains_is_not_claimed_of_a_run_whose_messages_are_lost(root, tmp_path):
    """A message that is sent on change and lost is not sent again."""
    content = load_json(root / "generated" / "flexible_joint_arms" / "design.json")
    content["problem"]["simulation"]["channel"] = {"drop": 0.5}
    (tmp_path / "d.json").write_text(json.dumps(content))
    run = lockstep.simulate(tmp_path / "d.json", send_on_change=0.01, horizon=0.1, perturbation="none")
    assert "proved without messages that are lost" in run.rows()["send on change"]


@pytest.mark.parametrize(
    "wrong",
    [
        ["--send-on-change", "-1"],
        ["--send-on-change", "nan"],
        ["--send-on-change", "0.1", "--controllers", "continuous"],
        ["--send-on-change", "0.1", "--campaign", "2", "-o", "there"],
    ],
)
def test_what_cannot_be(root, tmp_path, monkeypatch, wrong):
    monkeypatch.chdir(tmp_path)
    folder = str(root / "generated" / "flexible_joint_arms")
    assert CliRunner().invoke(app, ["simulate", folder, *wrong]).exit_code == 2
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("change", [-1.0, np.nan, np.inf])
def test_a_threshold_is_a_number(change):
    with pytest.raises(ProblemError, match="change"):
        MessageChannel(change=change)
