"""The documentation site: it builds without a warning, its commands print what is shown."""

import os
import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from lockstep.model.problem import Problem
from lockstep.workflow.init import BLANK, fields, init

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"


@pytest.mark.slow
@pytest.mark.skipif(find_spec("furo") is None, reason="the extra `docs` is not installed")
def test_the_site_builds_without_a_warning(tmp_path):
    command = [
        sys.executable,
        "-m",
        "sphinx",
        "-W",
        "--keep-going",
        "-q",
        "-b",
        "html",
        str(DOCS),
        str(tmp_path / "site"),
    ]
    built = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
    assert built.returncode == 0, built.stderr
    found = (path for kind in ("*.md", "*.ipynb") for path in DOCS.rglob(kind))
    pages = {path.stem for path in found if path.parent.name != "paper"}  # which is for a journal
    assert pages <= {path.stem for path in (tmp_path / "site").rglob("*.html")}, "every page is in the site"


def test_there_are_ten_fields_and_more_each_with_its_source():
    assert len(fields()) >= 10
    for field in fields():
        assert "# Source: " in init(field).text


def test_every_field_and_the_blank_file_can_be_posed_and_starts_within_its_domain():
    for field in (*fields(), BLANK):
        problem = Problem.parse(init(field).text)
        problem.validate()
        box = problem.agent().box
        starts = problem.initial_states()
        assert problem.simulation.initial != "random"
        assert ((starts >= box[:, 0]) & (starts <= box[:, 1])).all(), field


def test_the_arms_to_begin_from_are_those_of_the_example(examples):
    begun, example = Problem.parse(init("arms").text), Problem.load(examples / "flexible_joint_arms.toml")
    assert begun.file.agent == example.file.agent
    assert begun.file.network == example.file.network


def blocks(page: str) -> list[tuple[str, str]]:
    return re.findall(r"^```(\w+)\n(.*?)^```", page, re.MULTILINE | re.DOTALL)


def commands(block: str) -> list[tuple[str, str]]:
    """(command, what it prints) of a console block."""
    return [
        (found[1], found[2]) for found in re.finditer(r"^\$ (.*)\n((?:(?!\$ ).*\n)*)", block, re.MULTILINE)
    ]


@pytest.fixture
def shell(tmp_path):
    """Runs a command of a page in a folder of its own, where `lockstep` is the one under test."""
    bin_folder = tmp_path / "bin"
    bin_folder.mkdir()
    script = bin_folder / "lockstep"
    script.write_text(
        f'#!/bin/sh\nexec {sys.executable} -c "from lockstep.cli.main import main; main()" "$@"\n'
    )
    script.chmod(0o755)
    place = tmp_path / "place"
    place.mkdir()
    environment = {**os.environ, "PATH": f"{bin_folder}:{os.environ['PATH']}", "COLUMNS": "80"}

    def run(command: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            ["sh", "-c", command], cwd=place, env=environment, capture_output=True, text=True, check=False
        )

    run.place = place  # type: ignore[attr-defined]
    return run


def prints(expected: str, found: str) -> bool:
    """Whether a text is what is shown of it: `...` stands for anything, and how lines are broken does not count."""
    pieces = [" ".join(piece.split()) for piece in expected.split("...")]
    pattern = ".*?".join(map(re.escape, pieces))
    return re.fullmatch(pattern, " ".join(found.split())) is not None


def test_what_is_left_out_is_all_that_may_differ():
    assert prints("one ...\nthree", "one two three")
    assert prints("rho 0.1...", "rho   0.1023\n")
    assert not prints("one ...\nfour", "one two three")
    assert not prints("one", "one two")


def shown(block: str, shell) -> None:
    for command, expected in commands(block):
        done = shell(command)
        assert done.returncode == 0, f"{command}: {done.stderr}"
        assert prints(expected, done.stdout), f"{command}:\n{done.stdout}"


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("cc") is None, reason="the tutorial compiles its C")
def test_the_tutorial_does_what_it_says(shell):
    for kind, text in blocks((DOCS / "tutorial.md").read_text(encoding="utf-8")):
        if kind in ("toml", "c"):
            (shell.place / {"toml": "belts.toml", "c": "main.c"}[kind]).write_text(text, encoding="utf-8")
        else:
            assert kind in ("console", "text"), "every block is run, but for an equation"
            if kind == "console":
                shown(text, shell)


def test_the_page_on_the_wait_shows_what_explain_prints(shell):
    shutil.copytree(ROOT / "generated", shell.place / "generated")
    for kind, text in blocks((DOCS / "wait.md").read_text(encoding="utf-8")):
        assert kind == "console"
        shown(text, shell)


def test_a_page_that_shows_something_else_is_told(shell):
    with pytest.raises(AssertionError, match="echo"):
        shown("$ echo one\ntwo\n", shell)
    with pytest.raises(AssertionError, match="false"):
        shown("$ false\n", shell)


def test_the_agent_of_the_tutorial_is_in_no_example(examples):
    (toml,) = (
        text for kind, text in blocks((DOCS / "tutorial.md").read_text(encoding="utf-8")) if kind == "toml"
    )
    own = Problem.parse(toml).file.agent.dynamics
    others = [Problem.load(path) for path in examples.rglob("*.toml")] + [
        Problem.parse(init(one).text) for one in fields()
    ]
    assert own not in [other.file.agent.dynamics for other in others]
