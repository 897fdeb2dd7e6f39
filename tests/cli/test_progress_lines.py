"""Progress where there is no terminal: lines for a long run, none for a short one; and the time limit of the command."""

import io
import json
import time

from rich.console import Console
from rich.text import Text
from typer.testing import CliRunner

from lockstep.cli import console
from lockstep.cli.main import app
from lockstep.workflow.waiting.progress_lines import ProgressLines


def test_a_short_run_says_nothing() -> None:
    said: list[str] = []
    with ProgressLines(said.append) as lines:
        lines.tell("searching", 0.5)
    assert said == []


def test_a_new_phase_is_a_line_and_the_same_one_is_not() -> None:
    said: list[str] = []
    with ProgressLines(said.append, patience=0.0, interval=60.0, pause=0.0) as lines:
        for what, part in (("searching", 0.0), ("searching", 0.25), ("proving", 0.0)):
            lines.tell(what, part)
    assert [line.rpartition(",")[0] for line in said] == ["lockstep: searching", "lockstep: proving"]


def test_short_phases_are_not_a_line_each() -> None:
    said: list[str] = []
    with ProgressLines(said.append, patience=0.0, interval=60.0, pause=60.0) as lines:
        for agent in range(30):
            lines.tell(f"comparing arm{agent}", 0.0)
    assert [line.rpartition(",")[0] for line in said] == ["lockstep: comparing arm0"]


def test_a_forecast_is_said_at_once_and_once() -> None:
    """It stands in what is told until a first part is done, which may be sooner than a line is due."""
    said: list[str] = []
    with ProgressLines(said.append, patience=60.0, interval=60.0, pause=60.0) as lines:
        for what in (
            "proving",
            "searching, this search likely 5 to 20 s",
            "searching, this search likely 5 to 20 s",
        ):
            lines.tell(what, 0.0)
        lines.tell("searching", 0.1)
    assert [line.rpartition(",")[0] for line in said] == ["lockstep: searching, this search likely 5 to 20 s"]


def test_a_phase_that_says_nothing_is_alive() -> None:
    said: list[str] = []
    with ProgressLines(said.append, patience=0.02, interval=0.05, pause=0.0) as lines:
        lines.tell("searching", 0.25)
        while len(said) < 3:
            time.sleep(0.05)
    assert all(line.startswith("lockstep: searching, 25% done, ") for line in said)
    count = len(said)
    time.sleep(0.2)
    assert len(said) == count, "nothing is said after the end"


def test_a_time_limit_that_is_over_at_once_leaves_one_object_and_status_1(examples, tmp_path) -> None:
    # The least limit; writing down the program of this problem alone takes longer on any machine.
    path = examples / "flexible_joint_arms.toml"
    result = CliRunner().invoke(
        app,
        [
            "design",
            str(path),
            "--time-limit",
            "0.01",
            "--fresh",
            "--jobs",
            "1",
            "-o",
            str(tmp_path / "d.json"),
            "--json",
        ],
    )
    assert result.exit_code == 1
    error = json.loads(result.stdout)["error"]
    assert error["kind"] == "OutOfTime"
    assert error["figures"]["time_limit"] == 0.01
    assert "allow more time" in error["message"]
    assert not (tmp_path / "d.json").exists()


def test_a_narrow_terminal_shows_all_that_is_said_and_the_clock_goes_on(monkeypatch) -> None:
    said = "attempt 2 of at most 4: searching for gains up to 300, this search likely 8 s to 40 s"
    narrow = Console(file=io.StringIO(), force_terminal=True, width=40, soft_wrap=True)
    monkeypatch.setattr(console, "errors", narrow)
    bars = console.Doing()
    monkeypatch.setattr(bars.left, "text", lambda: "about 20 s left")
    monkeypatch.setattr(console, "Doing", lambda: bars)
    with console.progress_display() as tell:
        tell(said, 1.0)
        assert not bars.finished, "rich stops the clock of a task that is done"
        with narrow.capture() as shown:
            narrow.print(bars.get_renderable())
    lines = [Text.from_ansi(line).plain.rstrip() for line in shown.get().splitlines()]
    assert max(map(len, lines)) <= 40
    assert f"{said}, about 20 s left" in " ".join(lines)
    assert any("0:00:0" in line for line in lines)
