"""`[network.messages]` from the problem file to the claims of a design file, and back through the checker."""

import json
from copy import deepcopy

import numpy as np
import pytest
from scipy.sparse import csr_array

from lockstep.check.certify import certified
from lockstep.check.design_file.content import parse
from lockstep.check.design_file.messages import messages_of
from lockstep.check.design_file.problem import ProblemTables
from lockstep.check.errors import ProblemError
from lockstep.check.sampled.links import Messages
from lockstep.lmi.sampled.messages import largest_faults
from lockstep.lmi.sampled.messages.largest_faults import (
    MOST_BROKEN,
    ConstantSlope,
    _breaking_age,
    _radius,
    bursts,
    constant_slopes,
    delays,
)
from lockstep.model.problem import Problem
from lockstep.workflow.certify import certify
from lockstep.workflow.design import design
from lockstep.workflow.design_file import Design
from lockstep.workflow.generate import generate
from lockstep.workflow.messages import message_limits

TEXT = """
[agent]
states = ["x"]
inputs = ["u"]
dynamics = { x = "u - sin(x)" }
outputs = { y = "x" }
[network]
agents = 2
topology = "complete"
MESSAGES
[design]
method = "given"
gains = [{ D = [[-GAIN]] }, { D = [[-GAIN]] }]
[controller]
period = 0.05
"""


def problem(messages: str, gain: float = 2.0) -> Problem:
    return Problem.parse(TEXT.replace("MESSAGES", messages).replace("GAIN", str(gain)))


@pytest.fixture(scope="module")
def made() -> Design:
    return design(problem("messages = { loss = 0.2, burst = 1, delay = [0, 1], jitter = 0.1 }"))


def verdict(content):
    return certified(parse(content, "the design", ProblemTables.from_document))


def checked(content):
    found = verdict(content).verdicts
    return {name: one.proved for name, one in found.items() if name.startswith("messages")}


def complete(found: Design):
    return json.loads(json.dumps(found.stored.document()))


def test_what_is_asked_for_is_claimed_and_decided(made):
    said = made.document()["messages"]
    assert said["certified"]
    assert said["proof"] == "ball"
    assert (said["loss"], said["burst"], said["delay"], said["jitter"]) == (0.2, 1, [0, 1], 0.1)
    assert said["rho"] >= made.sampled["rho"], "more can happen, so no less is promised"
    assert checked(complete(made)) == {"messages": True, "messages_rho": True}
    assert certify(made).answer["messages"]["certified"]


BETTER = [
    (("messages", "loss"), 0.9),
    (("messages", "burst"), 60),
    (("messages", "delay"), [0, 60]),
    (("messages", "decay"), 0.5),
    (("messages", "rho"), 0.1),
]


@pytest.mark.parametrize(("path", "value"), BETTER, ids=str)
def test_a_claim_that_is_better_than_its_witness_is_refused(made, path, value):
    content = complete(made)
    content["claims"][path[0]][path[1]] = value
    assert False in checked(content).values()
    assert not verdict(content).proved


@pytest.mark.slow
def test_rho_holds_for_the_noise_of_the_outputs_too():
    """x_d' = -2 g (x_d + 3 n) - phi: at rest with slope -1 the gain from n alone is 3 * 8 / 7 for g = 4."""
    text = TEXT.replace("MESSAGES", "messages = { loss = 0.2, delay = [0, 1] }").replace("GAIN", "4.0")
    noisy = text.replace(
        "[controller]", "disturbances = { states = 1.0, outputs = { y = 3.0 } }\n[controller]"
    )
    without, made = (design(Problem.parse(one)) for one in (text, noisy))
    assert without.document()["messages"]["rho"] < 3 * 8 / 7 <= made.document()["messages"]["rho"]
    assert checked(complete(made)) == {"messages": True, "messages_rho": True}
    content = complete(made)
    content["problem"]["design"].pop("disturbances")
    assert checked(content)["messages_rho"]
    content = complete(without)
    content["problem"]["design"]["disturbances"] = complete(made)["problem"]["design"]["disturbances"]
    assert not checked(content).get("messages_rho", False), "a witness for no noise proves nothing of noise"


def test_many_graphs_and_messages_are_refused_by_name():
    text = TEXT.replace("MESSAGES", "messages = { loss = 0.1 }").replace(
        'topology = "complete"', "spectrum = [1.0, 3.0]"
    )
    text = text.replace("agents = 2\n", "").split("[design]")[0] + '[design]\nmethod = "modal"\n'
    with pytest.raises(ProblemError, match="`messages` is given"):
        Problem.parse(text)


def test_less_than_is_asked_for_is_refused(made):
    for change in ({"loss": 0.1}, {"burst": 0}, {"jitter": 0.0}):
        content = complete(made)
        content["claims"]["messages"] |= change
        assert checked(content) == {"messages": False}
    content = complete(made)
    del content["claims"]["messages"]
    assert checked(content) == {"messages": False}


def test_without_a_witness_or_with_a_changed_gain_nothing_is_proved(made):
    for key in ("messages", "messages_rho"):
        content = complete(made)
        content["proofs"][key] = None
        assert False in checked(content).values()
    content = complete(made)
    content["proofs"]["messages"]["X"][0][0] *= -1
    assert checked(content) == {"messages": False}


def test_a_file_that_says_nothing_of_messages_is_as_it_was():
    found = design(problem(""))
    assert "messages" not in complete(found)["claims"]
    assert "messages" not in found.document()
    assert certify(found).ok


@pytest.mark.slow
def test_what_is_not_carried_is_refused_and_says_what_is():
    found = design(problem("messages = { delay = [0, 40] }", gain=4.0))
    said = found.document()["messages"]
    assert not said["certified"]
    assert 0 <= said["certified_up_to"]["delay"][1] < 40
    assert not certify(found).ok


def test_header_and_manifest_assume_the_bounds_on_the_network(made, tmp_path):
    """Of nodes that stamp, and of no others: a step that holds a message itself compares two instants."""
    folder = tmp_path / "c"
    generate(made, folder, exports=["messages"])
    name = next((folder / "include").glob("*1.h")).stem
    for path in (folder / "include" / f"{name}.h", folder / "messages" / f"{name}_node.h"):
        said = " ".join(path.read_text().replace("\n *", " ").split())
        assert (
            "messages: a link loses a message with a probability of at most 0.2, each link its own, which may change,"
            " and besides at most 1 are lost in a row" in said
        )
        assert "where differences are stamped" in said
        assert "Of messages that are late or lost nothing is claimed" not in said
    assert (
        "every message arrives in time (of those that do not, `messages` alone says what is proved)"
        in " ".join((folder / "include" / f"{name}.h").read_text().replace("\n *", " ").split())
    )
    assert certify(folder).ok


def test_losses_by_chance_are_told_apart_from_those_in_a_row():
    assert Messages(0.2).text == "a chance of loss of at most 0.2"
    assert Messages(0.2, 2).text == "a chance of loss of at most 0.2, besides up to 2 lost in a row"
    assert Messages(0.0, 1, (0, 1), 0.1).text == "up to 1 lost in a row, up to 1 period late, a jitter of 0.1"


@pytest.mark.slow
def test_limits_stand_on_both_sides():
    found = message_limits(design(problem("", gain=4.0))).limits
    for one in found.values():
        assert one.breaks is None or one.certified < one.breaks
    assert found["delay"].breaks is not None
    assert found["delay"].certified >= 1


def test_ages_break_a_plain_integrator_where_theory_says():
    """x+ = x - g x(k - D) is stable up to g = 2 sin(pi / (4 D + 2)) (Levin and May 1976): here g = 8 T."""
    from lockstep.codegen.sampled_design import prove_agreement

    text = TEXT.replace("u - sin(x)", "u + 1e-9*sin(x)").replace("MESSAGES", "").replace("GAIN", "4.0")
    network, controllers, _ = prove_agreement(design(Problem.parse(text)).stored)
    cases = [ConstantSlope(network, controllers, slope, said) for slope, said in constant_slopes(network, ())]
    assert _breaking_age(cases, 0, delays)[0] == 4, "g = 0.4: 2 sin(pi / 14) = 0.445, 2 sin(pi / 18) = 0.347"
    assert _breaking_age(cases, 0, bursts)[0] >= 4


def test_an_age_that_breaks_is_found_between_the_ages_that_are_looked_at_first(monkeypatch):
    """What breaks from some age on is told as that age, wherever the first one that is looked at lies."""
    for proved in (0, 1, 8, 63, 94):
        for breaks in range(proved + 1, MOST_BROKEN + 1):
            growth = {age: 1.5 if age >= breaks else 0.5 for age in range(MOST_BROKEN)}
            monkeypatch.setattr(
                largest_faults, "_pattern_growth", lambda _, age, __, of=growth: (of[age], f"at {age}")
            )
            found = (
                (breaks, f"at {breaks}") if breaks < MOST_BROKEN else (None, "nothing tried broke the loop")
            )
            assert _breaking_age([None], proved, lambda age: [(age,)]) == found


def test_of_a_large_loop_one_eigenvalue_is_that_of_all(monkeypatch):
    """The product of three random steps, once by Arnoldi's method and once with all eigenvalues."""
    steps = [csr_array(step) for step in np.random.default_rng(3).normal(size=(3, 30, 30))]
    whole = _radius(steps)
    assert whole == pytest.approx(
        np.abs(np.linalg.eigvals(steps[2] @ steps[1] @ steps[0].toarray())).max() ** (1 / 3)
    )
    monkeypatch.setattr(largest_faults, "LARGE", 0)
    assert _radius(steps) == pytest.approx(whole, rel=1e-6)


BAD = [
    ({"loss": 1.0}, "below 1"),
    ({"loss": -0.1}, "from 0 up"),
    ({"burst": 1.5}, "whole number"),
    ({"delay": [2, 1]}, "least first"),
    ({"delay": 3}, "least and the most"),
    ({"jitter": 1}, "below 1"),
    ({"lost": 0.1}, "unknown"),
]


@pytest.mark.parametrize(("table", "said"), BAD, ids=str)
def test_a_table_that_cannot_be_is_refused_by_name(table, said):
    with pytest.raises(ProblemError, match=said):
        messages_of(table)
    listed = ", ".join(f"{key} = {value}" for key, value in table.items())
    with pytest.raises(ProblemError):
        problem(f"messages = {{ {listed} }}")


def test_absent_keys_say_that_nothing_happens():
    assert messages_of({}) == Messages()
    assert messages_of({"delay": [1, 2], "burst": 3}).age == 5
    assert deepcopy(Messages(0.2)).within(Messages(0.2, 1))
    assert Messages(0.1).within(Messages(0.2, 1)), "a probability of at most 0.2"
    assert not Messages(0.3).within(Messages(0.2, 1))
    assert Messages(delay=(1, 2)).within(Messages(delay=(0, 2)))
    assert not Messages(delay=(0, 2)).within(Messages(delay=(1, 2))), "less is claimed: that none is early"


@pytest.mark.parametrize(
    "table", [{"loss": []}, {"jitter": ""}, {"burst": False}, {"delay": {}}, {"delay": []}]
)
def test_what_is_there_and_false_is_no_absent_key(table):
    with pytest.raises(ProblemError):
        messages_of(table)
