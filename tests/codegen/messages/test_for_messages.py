"""From gains that do not carry what a network does to messages to such as do, or to a word on what is carried."""

import json
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest

from cart import cart
from lockstep.check.certify import certified
from lockstep.check.design_file.content import parse
from lockstep.check.design_file.problem import ProblemTables
from lockstep.check.errors import NotCertified
from lockstep.codegen.period_redesign import as_shipped
from lockstep.lmi.design import design
from lockstep.lmi.document import design_file_of
from lockstep.lmi.document import parse as stored_of
from lockstep.lmi.search.stopping import Stop
from lockstep.model.problem import Problem
from lockstep.workflow.design_file import Design
from lockstep.workflow.explain import explain
from lockstep.workflow.generate import generated_files

CARTS = (
    cart("f")
    + """
[network]
agents = 2
edges = [[1, 2], [2, 1]]
messages = { MESSAGES }
[design]
order = 0
gain_limit = 20.0
starts = 1
[controller]
period = 0.1
"""
)


@pytest.fixture(scope="module")
def searched():
    """The gains for messages that arrive, asked to carry others: what is asked enters the proofs alone."""
    stored = {}

    def made(messages, **design_keys):
        if not stored:
            problem = Problem.parse(CARTS.replace("messages = { MESSAGES }", ""))
            stored["file"] = json.loads(Design(design_file_of(design(problem, jobs=1))).text())
        content = deepcopy(stored["file"])
        content["problem"]["network"]["messages"] = messages
        content["problem"]["design"].update(design_keys)
        return stored_of(content, "the design")

    return made


@pytest.mark.slow
def test_gains_that_carry_nothing_late_are_moved_until_they_do(searched):
    asked, told = {"loss": 0.5, "delay": [0, 1]}, []
    made = as_shipped(searched(asked), lambda what, part: told.append((what, part)))
    assert made.info["sampled"]["designed_for_messages"]
    verdicts = certified(parse(made.document(), "the design", ProblemTables.from_document)).verdicts
    assert verdicts["messages"].proved
    assert verdicts["messages_rho"].proved
    assert made.claims.messages.rho >= made.claims.sampled.rho
    parts = [part for what, part in told if what == "designing for the messages"]
    assert parts == sorted(parts)
    assert 0 <= parts[0] < parts[-1] < 1
    assert told[-1][0] == "proving the gains for the messages"


@pytest.mark.slow
def test_an_interrupt_keeps_the_design_that_there_is(searched):
    stop = Stop()

    def tell(what, _part):
        if what == "designing for the messages":
            stop.take()

    stored = searched({"loss": 0.5, "delay": [0, 1]})
    made = as_shipped(stored, tell, stop=stop)
    assert np.array_equal(made.gains.blocks, stored.gains.blocks)
    assert made.claims.sampled.certified
    assert made.claims.messages is None
    assert made.info["messages"]["not_designed_for_messages"] == "interrupted"
    assert "no certificate was found" in made.info["messages"]["reason"]


@pytest.mark.slow
def test_what_no_gains_were_found_for_says_what_is_carried(searched):
    """Half a minute without a message: none are found, or none that are proved, and the part that is carried is certified."""
    made = as_shipped(searched({"loss": 0.9, "burst": 300}))
    said = made.info["messages"]
    assert made.claims.messages is None, (
        "a pattern of 300 lost in a row is beyond what these carts were seen to carry"
    )
    assert said["not_designed_for_messages"]
    assert 0 <= said["certified_up_to"]["burst"] < 300


@pytest.mark.slow
def test_gains_for_the_period_do_not_take_the_place_of_such_as_carry_the_messages(searched, monkeypatch):
    from lockstep.codegen import period_redesign

    monkeypatch.setattr(period_redesign, "designed_for_period", lambda kept, _effort: without(kept))
    made = as_shipped(searched({"loss": 0.1}, for_period=True))
    assert made.claims.messages is not None
    assert made.info["sampled"]["not_designed_for_period"] == "the gains found do not carry the messages"


def without(stored):
    return replace(stored, claims=replace(stored.claims, messages=None))


@pytest.mark.slow
def test_what_is_asked_of_messages_and_not_proved_is_said_before_any_c(root):
    """The reason, with the part that is carried, is the one that the search left in the file."""
    document = json.loads((root / "generated" / "flexible_joint_arms" / "design.json").read_text())
    document["problem"]["network"]["messages"] = {"loss": 0.95}
    document["info"]["messages"] = {"reason": "with 0.04 there is one"}
    asked = Design.of(document, "design.json")
    with pytest.raises(NotCertified, match=r"asks for more than is proved: with 0\.04 there is one"):
        generated_files(asked)
    told = {one.name: one for one in explain(asked).open}["messages"]
    assert told.value == "not claimed"
    assert told.meaning.endswith("the file does not claim it: with 0.04 there is one.")
