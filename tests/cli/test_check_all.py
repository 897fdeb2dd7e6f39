"""`lockstep check --all`: verdicts in the table and in JSON, and units that are refused."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from lockstep.cli.main import app
from lockstep.model.checks import CheckRow

PENDULUM = Path(__file__).parents[1] / "models" / "pendulum.toml"


def run(*words):
    result = CliRunner().invoke(app, ["check", *map(str, words)])
    return result.exit_code, result.stdout


@pytest.fixture(scope="module")
def answer():
    status, said = run(PENDULUM, "--all", "--json")
    assert status == 0
    return json.loads(said)


def test_each_check_has_a_name_a_verdict_a_value_and_a_witness(answer):
    proved = {one["name"]: one for one in answer["checks"] if "value" in one}
    assert {one["verdict"] for one in proved.values()} <= {"proved", "refuted", "undecided"}
    assert all({"name", "verdict", "value", "witness", "figure"} == set(one) for one in proved.values())
    assert proved["equilibria"]["value"]["count"] == 3
    assert proved["contraction"]["witness"]["real_part"] > 0


def test_without_all_it_answers_as_before(answer):
    plain = json.loads(run(PENDULUM, "--json")[1])
    assert plain["checks"] == answer["checks"][: len(plain["checks"])]
    assert not any("value" in one for one in plain["checks"])


def test_the_table_has_them():
    status, said = run(PENDULUM, "--all", "--boxes", "2000")
    assert status == 0
    assert "exactly 3" in said
    assert "refuted" in said
    assert "agreement needs an agent that all" in " ".join(said.split()), "each row says why it matters"


def test_what_is_well_is_said_in_a_line(tmp_path):
    """Why a row matters stands where there is something to decide, and with `--all`."""
    status, said = run(PENDULUM)
    assert status == 0
    assert "spanning tree" in said
    assert "agreement needs an agent that all" not in " ".join(said.split())
    slow = tmp_path / "slow.toml"
    slow.write_text(PENDULUM.read_text(encoding="utf-8") + "\n[controller]\nperiod = 1.0\n", encoding="utf-8")
    status, said = run(slow)
    assert "a controller cannot act on what happens between its samples" in " ".join(said.split())


def test_units_that_contradict_each_other_are_bad_input(tmp_path):
    wrong = tmp_path / "wrong.toml"
    wrong.write_text(PENDULUM.read_text(encoding="utf-8").replace("k/m*omega", "k*omega"), encoding="utf-8")
    for every in ((), ("--all",)):
        status, said = run(wrong, *every, "--json")
        assert status == 2
        assert "the term `k*omega`" in json.dumps(json.loads(said))


def test_the_text_leaves_out_what_is_so_by_construction():
    """Nobody can act on it; it stays in `--json` and in `--all`, and is said where it is not so."""
    quiet, said = ("numbers", "L 1 = 0", "h(t, 0) = 0"), run(PENDULUM)[1]
    assert not any(name in said for name in quiet)
    names = {one["name"]: one["verdict"] for one in json.loads(run(PENDULUM, "--json")[1])["checks"]}
    assert [names[name] for name in quiet] == ["ok", "ok", "ok"]
    every = run(PENDULUM, "--all", "--boxes", "10")[1]
    assert all(name in every for name in quiet)
    lit = CheckRow("h(t, 0) = 0", "note", "|h(t, 0)| = 1", "why")
    assert (lit.is_telling, replace(lit, verdict="ok").is_telling) == (True, False)
