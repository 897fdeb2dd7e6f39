"""Messages and the designs that are committed: what is claimed is decided by the checker alone, what is not is looked for."""

import json
from copy import deepcopy
from pathlib import Path

import pytest

from lockstep.check.certify import certified
from lockstep.check.design_file.content import parse
from lockstep.check.design_file.problem import ProblemTables
from lockstep.check.sampled.links import Messages
from lockstep.codegen.sampled_design import prove_agreement
from lockstep.lmi.sampled.messages.witnesses import certify_messages
from lockstep.workflow.certify import certify
from lockstep.workflow.design_file import Design, load

ROOT = Path(__file__).parents[3]
LOSSY = ROOT / "examples" / "lossy_arms" / "design.json"
ARMS = ROOT / "generated" / "flexible_joint_arms" / "design.json"


def verdict(content, name="messages"):
    return certified(parse(content, "the design", ProblemTables.from_document)).verdicts[name].proved


@pytest.mark.slow
def test_the_arms_carry_losses_bursts_delays_and_jitter_together():
    """Each link loses up to half of its messages, and no more: the checker reads the file, nothing is searched."""
    content = json.loads(LOSSY.read_text(encoding="utf-8"))
    asked = {"loss": 0.5, "burst": 5, "delay": [0, 5], "jitter": 0.1}
    assert content["problem"]["network"]["messages"] == asked
    assert content["problem"]["controller"]["period"] == 0.005
    assert content["claims"]["messages"].items() >= asked.items()
    assert verdict(content)
    assert verdict(content, "messages_rho")
    for key, value in {"loss": 0.9, "burst": 12, "jitter": 0.9}.items():
        more = deepcopy(content)
        more["claims"]["messages"][key] = value
        assert not verdict(more), key
    better = deepcopy(content)
    better["claims"]["messages"]["rho"] = content["claims"]["sampled"]["rho"]
    assert not verdict(better, "messages_rho"), "no witness of a gain proves a tenth of it"
    answer = certify(Design.of(better, "the design")).document()
    assert not answer["ok"]
    assert answer["messages"]["certified"] is False


@pytest.mark.parametrize("claim", ["radius", "limits_gain", "clipped_radius"])
def test_what_is_not_proved_of_limits_is_not_shown(claim):
    content = json.loads(ARMS.read_text(encoding="utf-8"))
    content["claims"]["sampled"][claim] = 50.0
    answer = certify(Design.of(content, "the design")).document()
    assert not answer["ok"]
    assert answer["sampled"]["certified"] is True
    assert answer["sampled"].get(claim) is None
    assert answer["sampled"].get("clipped_radius") is None, "it is not decided after what fails"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["carts", "satellites"])
def test_gains_made_for_messages_that_arrive_carry_some_that_do_not(name):
    found = load(ROOT / "docs" / "gallery" / "designs" / f"{name}.json").stored
    network, controllers, sampled = prove_agreement(found)
    assert certify_messages(network, controllers, Messages(0.1, 1, jitter=0.1), sampled.witness.P)
    assert not certify_messages(network, controllers, Messages(0.1, 900), sampled.witness.P)
