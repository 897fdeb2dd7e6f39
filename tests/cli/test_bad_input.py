"""Bad input: one clear message, exit status 2, no traceback, nothing written. One perturbation per test."""

import json
import os
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from lockstep.cli.main import app

BAD = {
    "a missing key": ('inputs = ["u"]', "", "`inputs` is missing"),
    "an unknown key": ("order = 2", "order = 2\ngain_limt = 50.0", "did you mean `gain_limit`?"),
    "an unknown symbol": ("gravity*sin", "gravty*sin", "did you mean `gravity`?"),
    "code": ("gravity*sin(theta_l)", "__import__('os')", "`__import__`"),
    "no spanning tree": ("edges = [[1, 2], [2, 3], [3, 1]]", "edges = [[1, 2]]", "no spanning tree"),
    "an uncontrollable agent": ("+ 21.6*u", "+ 0*u", "not stabilisable"),
    "NaN in a weight": ("order = 2", "order = 2\nweights = { state = nan }", "not a finite number"),
    "a weight of the wrong shape": (
        "order = 2",
        "order = 2\nweights = { state = [1.0, 2.0] }",
        "2 numbers for 4 states",
    ),
    "order -1": ("order = 2", "order = -1", "`order` is -1"),
    "a period of 0": ("period = 0.005", "period = 0", "`period` is 0"),
    "a period of next to nothing": ("period = 0.005", "period = 1e-300", "from 1e-06 to 3600"),
    "a period of ages": ("period = 0.005", "period = 1e300", "from 1e-06 to 3600"),
    "no finite bound": ("gravity*sin(theta_l)", "gravity*theta_l*sqrt(1 + theta_l**2)", "no finite bound"),
    "an input that enters nonlinearly": ("21.6*u", "21.6*u**2", "the input `u` enters"),
    "no TOML": ("[agent]", "[agent", "not TOML"),
    "a table twice": ("[network]", "[agent]\n[network]", "cannot declare [agent] twice"),
    "a key twice": ('inputs = ["u"]', 'inputs = ["u"]\ninputs = ["u"]', "each key is given once"),
    "a wrong type": ('inputs = ["u"]', 'inputs = "u"', '`inputs` is "u"; expected a list of names'),
    "a huge exponent": ("gravity = 3.33", "gravity = 1e400", "too large for a double"),
    "numbers that overflow": ("gravity*sin", "1e200*1e200*sin", "`1e200*1e200` is inf"),
    "a word of C": ('name = "arm"', 'name = "while"', "is a word of C"),
    "a name that is no ASCII": ('name = "arm"', 'name = "bras_\u00e9"', "not a C identifier"),
    "an unknown function": ("sin(theta_l)", "sinus(theta_l)", "did you mean `sin`?"),
    "a function that is spelled out": ("sin(theta_l)", "asinh(theta_l)", "write log(p + sqrt(p**2 + 1))"),
    "a jump": ("gravity*sin(theta_l)", "gravity*sign(theta_l)", "no finite bound"),
    "a topology misspelt": (
        "edges = [[1, 2], [2, 3], [3, 1]]",
        'topology = "leaderpath"',
        "did you mean `leader_path`?",
    ),
    "an input on the domain": (
        "[network]",
        "[agent.domain]\nu = [-1.0, 1.0]\n\n[network]",
        "its limits go into [agent.limits]",
    ),
    "a state that is not listed": (', "omega_l"]   #', "]   #", 'add "omega_l" to `states`'),
    "a self-loop": ("[[1, 2], ", "[[1, 1], [1, 2], ", "is a self loop"),
    "an edge twice": ("[[1, 2], ", "[[1, 2], [1, 2], ", "is there twice"),
    "an edge without weight": ("[[1, 2], ", "[[1, 2, 0.0], ", "has the weight 0.0"),
    "weights that overflow": ("[[1, 2], ", "[[1, 3, 1e308], [1, 2, 1e308], ", "agent 1 listens with add up"),
    "a singular weight": (
        "order = 2",
        "order = 2\nweights = { state = [1.0, 0.0, 1.0, 1.0] }",
        "smallest eigenvalue is 0",
    ),
}

LEGAL = {
    "line ends of Windows": lambda text: text.replace("\n", "\r\n").encode(),
    "a byte order mark": lambda text: text.encode("utf-8-sig"),
    "a title in any letters": lambda text: text.replace("Three", "\u4e09 Dr\u00e4i").encode(),
}

ILLEGAL = {
    "an empty file": (b"", "the key `agent` is missing"),
    "bytes": (bytes(range(256)), "is not UTF-8"),
    "UTF-16": ("[agent]".encode("utf-16"), "is not UTF-8"),
    "a zero byte": (b"[agent]\0", "not TOML"),
}


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    return lambda *words: CliRunner().invoke(app, list(map(str, words)))


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
    # Signs of life, `lockstep: ..., 5 s`, appear where the machine is slow: they are no messages.
    said = [
        line for line in result.stderr.strip().splitlines() if not re.fullmatch(r"lockstep: .*, \d+ s", line)
    ]
    assert len(said) == 1, "one message"
    assert sorted(path.name for path in tmp_path.iterdir()) == [problem], "nothing is written"


@pytest.mark.parametrize("name", LEGAL)
def test_how_a_file_is_stored_does_not_matter(name, examples, tmp_path, run):
    text = (examples / "flexible_joint_arms.toml").read_text()
    (tmp_path / "p.toml").write_bytes(LEGAL[name](text))
    assert run("check", "p.toml").exit_code == 0


@pytest.mark.parametrize("command", ["check", "design", "build"])
@pytest.mark.parametrize("name", ILLEGAL)
def test_what_is_no_problem_file(name, command, tmp_path, run):
    content, expected = ILLEGAL[name]
    (tmp_path / "p.toml").write_bytes(content)
    result = run(command, "p.toml", *([] if command == "check" else ["-o", "out"]))
    assert result.exit_code == 2
    assert expected in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["p.toml"]


@pytest.mark.parametrize(("command", "place"), [("design", "out.json"), ("build", "out")])
def test_what_is_there_of_an_earlier_run_is_kept_and_said_to_be(command, place, examples, tmp_path, run):
    problem = perturbed(examples, tmp_path, "order = 2", "order = -1")
    (tmp_path / place).write_text("of yesterday")
    result = run(command, problem, "-o", place)
    assert result.exit_code == 2
    assert f"{place} was there before, and is as it was" in result.stderr
    assert (tmp_path / place).read_text() == "of yesterday"


@pytest.mark.parametrize("content", [b"", b"{}", b"[1]", b"\xff\xfe", b'{"a": 1, "a": 2}', b"[" * 100_000])
@pytest.mark.parametrize("command", ["certify", "generate", "simulate"])
def test_what_is_no_design_file(command, content, tmp_path, run):
    (tmp_path / "d.json").write_bytes(content)
    result = run(command, "d.json", *([] if command == "certify" else ["-o", "out"]))
    assert result.exit_code == 2
    assert "d.json" in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["d.json"]


@pytest.mark.parametrize("command", ["check", "design", "certify", "simulate", "verify"])
def test_what_is_no_plain_file_is_not_read(command, tmp_path, run):
    os.mkfifo(tmp_path / "pipe")
    result = run(command, "pipe")
    assert result.exit_code == 2, "a read would never end"
    assert "it is no" in result.stderr


@pytest.mark.parametrize("command", ["check", "design", "certify", "simulate", "verify"])
def test_a_name_no_file_can_have(command, run):
    result = run(command, "x" * 300)
    assert result.exit_code == 2
    assert "name too long" in result.stderr.lower()


def test_several_mistakes_are_told_each_with_its_place(tmp_path, run):
    (tmp_path / "p.toml").write_text('titel = "x"\n[agent]\nname = "a"\n[network]\nagentz = 3\n')
    said = run("check", "p.toml").stderr
    # Misspelt keys first; `titel` stands before any table and has no place to name.
    assert "p.toml, [network]: unknown key `agentz`; expected agents, edges" in said
    assert (
        "did you mean `agents`?; also unknown key `titel`; also [agent]: the key `states` is missing" in said
    )
    assert "; and 3 more" in said
    (tmp_path / "p.toml").write_text("")
    said = run("check", "p.toml").stderr
    assert said.strip().endswith("expected the table [agent]; also the key `network` is missing")


def test_the_output_may_not_be_a_device_or_a_pipe(examples, tmp_path, run):
    os.mkfifo(tmp_path / "pipe")
    result = run("design", examples / "flexible_joint_arms.toml", "-o", "pipe")
    assert result.exit_code == 2
    assert "no plain file" in result.stderr
    assert (tmp_path / "pipe").is_fifo(), "it would be replaced"


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
    assert any(
        "the origin is no equilibrium" in note and "incremental bound" in note for note in answer["notes"]
    )


@pytest.mark.parametrize(
    "words",
    [
        ("design", "p.toml", "-o", "p.toml"),
        ("design", "p.toml", "-o", "out.json", "--trade-off", "./out.json"),
        ("design", "p.toml", "--trade-off", "p.toml"),
    ],
)
def test_nothing_that_is_read_or_written_is_overwritten(examples, run, tmp_path, words):
    text = (examples / "carts.toml").read_bytes()
    (tmp_path / "p.toml").write_bytes(text)
    result = run(*words)
    assert result.exit_code == 2
    assert "is named twice" in result.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["p.toml"]
    assert (tmp_path / "p.toml").read_bytes() == text
