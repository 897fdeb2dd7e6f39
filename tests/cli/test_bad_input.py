"""Bad input: one clear message, exit status 2, no traceback, nothing written. One perturbation per test."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from lockstep.cli.main import app

BAD = {
    "a missing key": ('inputs = ["u"]', "", "`inputs` is missing"),
    "an unknown key": ("gain_limit = 50.0", "gain_limt = 50.0", "did you mean `gain_limit`?"),
    "an unknown symbol": ("gravity*sin", "gravty*sin", "did you mean `gravity`?"),
    "code": ("gravity*sin(theta_l)", "__import__('os')", "`__import__`"),
    "no spanning tree": ("edges = [[1, 2], [2, 3], [3, 1]]", "edges = [[1, 2]]", "no spanning tree"),
    "an uncontrollable agent": ("+ 21.6*u", "+ 0*u", "not controllable"),
    "NaN in a weight": ("state = 1.0", "state = nan", "not a finite number"),
    "a weight of the wrong shape": ("state = 1.0", "state = [1.0, 2.0]", "2 numbers for 4 states"),
    "order -1": ("order = 2", "order = -1", "`order` is -1"),
    "a period of 0": ("period = 0.005", "period = 0", "`period` is 0"),
    "no finite bound": ("gravity*sin(theta_l)", "theta_l**3", "no finite bound"),
    "an input that enters nonlinearly": ("21.6*u", "21.6*u**2", "the input `u` enters"),
    "no TOML": ("[agent]", "[agent", "not TOML"),
}


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    return lambda *words: CliRunner().invoke(app, list(words))


def perturbed(examples: Path, place: Path, old: str, new: str) -> str:
    text = (examples / "flexible_joint_arms.toml").read_text()
    assert old in text
    (place / "problem.toml").write_text(text.replace(old, new, 1))
    return "problem.toml"


@pytest.mark.parametrize("command", ["check", "design", "build"])
@pytest.mark.parametrize("name", BAD)
def test_bad_problem(name, command, examples, tmp_path, run):
    old, new, expected = BAD[name]
    problem = perturbed(examples, tmp_path, old, new)
    output = {"check": [], "design": ["-o", "out.json"], "build": ["-o", "out"]}[command]
    result = run(command, problem, *output)
    assert result.exit_code == 2
    assert expected in result.stderr
    assert "Traceback" not in result.output
    assert problem in result.stderr, "the message names the file"
    assert len(result.stderr.strip().splitlines()) == 1, "one message"
    assert sorted(path.name for path in tmp_path.iterdir()) == [problem], "nothing is written"


def test_json_answers_bad_input_too(examples, tmp_path, run):
    result = run("check", perturbed(examples, tmp_path, "order = 2", "order = -1"), "--json")
    assert result.exit_code == 2
    error = json.loads(result.stdout)["error"]
    assert error["kind"] == "problem"
    assert error["found"] == "`order` is -1"
    assert error["where"].endswith("[design] order")


@pytest.mark.parametrize(
    "words",
    [
        ("check", "nowhere.toml"),
        ("certify", "nowhere.json"),
        ("generate", "nowhere.json", "-o", "out"),
        ("verify", "nowhere"),
        ("design", "nowhere.toml", "-o", "no/such/folder/out.json"),
        ("check",),
        ("check", "nowhere.toml", "--no-such-option"),
        ("no-such-command",),
    ],
    ids=" ".join,
)
def test_what_is_not_there(words, run, tmp_path):
    result = run(*words)
    assert result.exit_code == 2
    assert result.stderr.strip()
    assert "Traceback" not in result.output
    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_not_ours_is_left_alone(examples, tmp_path, run):
    theirs = tmp_path / "out"
    theirs.mkdir()
    (theirs / "thesis.tex").write_text("years of work")
    result = run("build", str(examples / "flexible_joint_arms.toml"), "-o", "out")
    assert result.exit_code == 2
    assert [path.name for path in theirs.iterdir()] == ["thesis.tex"]


def test_a_common_offset_is_no_error(examples, tmp_path, run):
    result = run(
        "check", perturbed(examples, tmp_path, "gravity*sin(theta_l)", "gravity*sin(theta_l) + 1.5"), "--json"
    )
    assert result.exit_code == 0
    answer = json.loads(result.stdout)
    assert answer["ok"]
    assert answer["bound"]["alpha"] == 3.33
    assert any("(3) fails at the origin" in note and "incremental bound" in note for note in answer["notes"])
