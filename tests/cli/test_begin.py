"""`lockstep init` and `lockstep explain`: what they print, write and refuse; nothing is told as proved that is not."""

import copy
import json
import math
import re
import tomllib
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from typer.testing import CliRunner

import lockstep
from lockstep.check.expression.text import FUNCTIONS
from lockstep.cli.main import app
from lockstep.codegen.manifest import load_manifest
from lockstep.model.checks.proved.dimensions import check_units
from lockstep.verification.reference import references
from lockstep.workflow.design_file import Design
from lockstep.workflow.explain import Explanation, explain
from lockstep.workflow.init import SCHEMA_NAME, fields

FIELDS = (*fields(), "blank")


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return lambda *words: CliRunner().invoke(app, [str(word) for word in words])


@pytest.mark.parametrize("field", FIELDS)
def test_a_begun_file_is_written_with_its_schema_and_obeys_it(field, run, tmp_path):
    result = run("init", *([] if field == "blank" else [field]), "-o", "mine.toml", "--json")
    assert result.exit_code == 0, result.output
    answer = json.loads(result.stdout)
    assert answer["files"] == ["mine.toml", SCHEMA_NAME]
    text = (tmp_path / "mine.toml").read_text(encoding="utf-8")
    assert text == answer["text"]
    assert text.startswith(f"#:schema ./{SCHEMA_NAME}\n")
    schema = json.loads((tmp_path / SCHEMA_NAME).read_text(encoding="utf-8"))
    jsonschema.Draft7Validator(schema).validate(tomllib.loads(text))
    lockstep.Problem.load("mine.toml").validate()


def test_the_file_to_fill_in_leaves_the_gains_to_the_defaults():
    assert lockstep.Problem.parse(lockstep.workflow.init.init().text).has_defaults


def test_the_lists_of_functions_name_every_function(root):
    page = (root / "docs" / "problem.md").read_text(encoding="utf-8")
    (told,) = re.findall(r"^A formula holds .*?^$", page, re.MULTILINE | re.DOTALL)
    schema = json.loads(
        (root / "model/lockstep/model/problem/schemas/problem.json").read_text(encoding="utf-8")
    )
    shown = schema["$defs"]["AgentTable"]["properties"]["dynamics"]["description"]
    lists = [lockstep.workflow.init.init().text, shown, told]
    assert all(set(FUNCTIONS) <= set(re.findall(r"\w+", text)) for text in lists)


def test_every_parameter_of_a_field_that_has_units_has_its_own_and_they_fit():
    """But for the arms', which are those of the paper: most of their coefficients are numbers."""
    tables = {
        field: lockstep.Problem.parse(lockstep.workflow.init.init(field).text).file.agent for field in FIELDS
    }
    without = {
        field
        for field, agent in tables.items()
        if agent.parameters and not agent.units.keys() >= agent.parameters.keys()
    }
    assert without == {"arms"}
    fit = {field for field, agent in tables.items() if agent.units and check_units(agent).status == "proved"}
    assert fit == set(FIELDS) - {"arms", "chua", "neurons"}, "two are dimensionless, without parameters"


def test_what_is_printed_is_the_file_however_narrow_the_terminal_is(run):
    result = run("init", "microgrid")
    assert max(map(len, result.stdout.splitlines())) > 100, "no line is broken"
    lockstep.Problem.parse(result.stdout)


def test_a_file_that_is_there_is_left_as_it_is(run, tmp_path):
    (tmp_path / "mine.toml").write_text("mine", encoding="utf-8")
    result = run("init", "rooms", "-o", "mine.toml", "--json")
    assert result.exit_code == 2
    assert "there already" in json.loads(result.stdout)["error"]["found"]
    assert [path.name for path in tmp_path.iterdir()] == ["mine.toml"]
    assert (tmp_path / "mine.toml").read_text(encoding="utf-8") == "mine"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("romos",), "did you mean `rooms`?"),
        (("../../secret",), "arms, carts, chua"),
        (("rooms", "-o", "no/such/place.toml"), "make it first"),
        (("rooms", "-o", SCHEMA_NAME), "such as problem.toml"),
    ],
)
def test_what_cannot_be_begun_is_bad_input(words, said, run, tmp_path):
    result = run("init", *words)
    assert result.exit_code == 2
    assert said in result.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.fixture(scope="module")
def arms(root) -> Design:
    return lockstep.load(root / "generated" / "flexible_joint_arms" / "design.json")


def names(part) -> set[str]:
    return {one.name for one in part}


def told(part, name: str) -> str:
    (found,) = [one for one in part if one.name == name]
    return f"{found.value}. {found.meaning}"


def test_what_is_proved_of_the_arms_is_told_with_its_figures(arms):
    found = explain(arms)
    claims = arms.stored.claims
    assert found.ok
    assert names(found.proved) >= {
        "agreement",
        "rho",
        "alpha",
        "lower bound of rho",
        "convergence rate",
        "period",
        "rounding",
    }
    assert f"{math.log(2) / claims.decay:.3g} s" in told(found.proved, "convergence rate")
    # A V of its own falls by the claimed factor at each sample, and |x_cl| by its root.
    rate, factor = (
        float(told(found.proved, "convergence rate, sampled").split()[0]),
        claims.sampled.fastest_decay,
    )
    assert factor < claims.sampled.decay
    assert rate == pytest.approx(-math.log(factor) / (2 * 0.005), rel=1e-3)
    assert rate <= -math.log(factor) / (2 * 0.005), "rounded down"
    assert f"{0.1 * claims.rho:.3g} in root mean square" in told(found.proved, "rho")
    assert "200 times a second" in told(found.proved, "period")
    assert "controllers in open loop" in names(found.proved)
    assert names(found.proved).isdisjoint(names(found.open))
    assert names(found.assumed) >= {"model", "clock", "messages"}


def test_a_floor_is_told_as_a_factor_and_a_radius_is_not_rounded_up(root):
    led = lockstep.load(root / "docs" / "gallery" / "designs" / "carts.json")
    found, claims = explain(led), led.stored.claims
    assert f"{claims.rho / claims.floor:.3g} times" in told(found.proved, "lower bound of rho")
    shown = float(re.match(r"\|x_d\(0\)\| <= ([0-9.e+-]+)\.", told(found.proved, "initial states"))[1])
    assert 0.999 * claims.initial_set.radius < shown <= claims.initial_set.radius


def test_a_controller_without_messages_is_told_to_do_what_its_step_does(root, tmp_path):
    """It was said to hold its last command; a static one is a gain of its own outputs against the row that it keeps."""
    design = lockstep.load(root / "docs" / "gallery" / "designs" / "carts.json")
    lockstep.generate(design, tmp_path / "c")
    follower = references(load_manifest(tmp_path / "c"))["cart2"]
    follower.init()
    zero, moved = np.zeros(follower.outputs, np.float32), np.full(follower.outputs, 0.01, np.float32)
    assert not follower.step(zero, zero[None], 1)[1].any()
    assert follower.step(moved, zero[None], 0)[1].all(), (
        "without a message, and it moves with its own outputs"
    )
    said = told(explain(design).proved, "controllers in open loop")
    assert "goes on with the rows it heard last (a node: the differences) and its own outputs" in said


def test_controllers_that_are_not_proved_stable_are_told_as_open(root):
    found = explain(lockstep.load(root / "tests" / "designs" / "arms_rho_only.json"))
    assert found.ok
    assert "controllers in open loop" in names(found.open), "one of them is unstable"


def changed(design: Design, change) -> Explanation:
    content = copy.deepcopy(json.loads(design.text()))
    change(content)
    return explain(Design.of(content, "changed"))


def test_gains_that_are_not_proved_have_nothing_proved_of_them(arms):
    def moved(content: dict) -> None:
        content["gains"][0]["D"][0][0] += 100.0

    found = changed(arms, moved)
    assert not found.ok
    assert found.proved == found.assumed == ()
    assert "Nothing is proved" in found.open[0].meaning


@pytest.mark.parametrize(
    ("change", "missing"),
    [
        (lambda content: content["claims"]["sampled"].update(rho=3.0), "rho, sampled"),
        (lambda content: content["claims"]["sampled"].update(max_period=1.0), "longest period"),
    ],
)
def test_a_claim_that_is_refused_is_told_as_refused(change, missing, arms):
    found = changed(arms, change)
    assert not found.ok
    assert missing not in names(found.proved)
    assert any(one.value == "refused" for one in found.open)


def test_what_a_file_does_not_claim_is_told_as_open(arms):
    def silent(content: dict) -> None:
        content["claims"].update(decay=None)
        content["proofs"]["decay"] = None

    found = changed(arms, silent)
    assert found.ok
    assert "decay" in names(found.open)
    assert "decay" not in names(found.proved)


def test_the_command_prints_it_and_fails_with_the_design(arms, run, tmp_path):
    arms.save(tmp_path / "design.json")
    good = run("explain", "design.json", "--json")
    answer = json.loads(good.stdout)
    assert good.exit_code == 0
    assert {one["name"] for one in answer["proved"]} == names(explain(arms).proved)
    assert {"Proved", "Assumed", "Not proved"} <= set(run("explain", "design.json").stdout.splitlines())
    text = Path("design.json").read_text(encoding="utf-8")
    Path("worse.json").write_text(re.sub(r'"rho": [0-9.]+', '"rho": 3.0', text), encoding="utf-8")
    assert run("explain", "worse.json").exit_code == 1
    assert run("explain", "none.json").exit_code == 2
