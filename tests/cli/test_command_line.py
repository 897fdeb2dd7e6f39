"""The command as a process: what is wrong with the command line, an output that cannot be, an interrupt."""

import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

from lockstep.cli.interrupts import insistent_interrupts
from lockstep.cli.main import app
from lockstep.lmi.processes.workers import started_without_interrupts

LOCKSTEP = [sys.executable, "-c", "from lockstep.cli.main import main; main()"]


def lockstep(*words: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*LOCKSTEP, *map(str, words)], capture_output=True, text=True, check=False)


def only_object(text: str) -> dict:
    answer, end = json.JSONDecoder().raw_decode(text)
    assert not text[end:].strip(), "one object, and nothing after it"
    return answer


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("check",), "Missing argument"),
        (("check", "p.toml", "--no-such-option"), "--no-such-option"),
        (("check", "p.toml", "q.toml"), "q.toml"),
        (("design", "p.toml", "--jobs", "0"), "--jobs"),
        (("simulate", "d.json", "--seed", str(2**63)), "--seed"),
        (("no-such-command",), "no-such-command"),
        ((), "--json"),
    ],
    ids=lambda part: " ".join(part) if isinstance(part, tuple) else "",
)
def test_a_wrong_command_line_is_answered_with_one_object(words, said):
    done = lockstep(*words, "--json")
    error = only_object(done.stdout)["error"]
    assert done.returncode == 2
    assert error["kind"] == "usage"
    assert said in error["message"]
    assert "Traceback" not in done.stderr


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="no folder that takes no files")
def test_a_folder_that_cannot_be_made_is_refused_before_the_problem_is_read(examples, monkeypatch):
    def read(_path):
        raise AssertionError("the problem was read first")

    monkeypatch.setattr("lockstep.model.problem.Problem.load", read)
    words = ["build", str(examples / "flexible_joint_arms.toml"), "-o", "/proc/x", "--json"]
    done = CliRunner().invoke(app, words)
    error = only_object(done.stdout)["error"]
    assert done.exit_code == 2
    assert error["where"] == "/proc"
    assert "takes no files" in error["found"]
    assert "Traceback" not in done.stderr
    # What stands in for the reading of problems is what a folder that can be made comes to.
    done = CliRunner().invoke(app, [*words[:3], "out", "--json"])
    assert "the problem was read first" in only_object(done.stdout)["error"]["message"]


@pytest.fixture(autouse=True)
def interrupts_arrive():
    """Have interrupts answered, here and in what is started here: a shell's job in the background ignores them."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


ENDING = "ending the search"
"""What is said of the first interrupt of a search."""

HANGS = 600
"""Seconds after which a command is held to hang, on any machine."""


def interrupted(words: list[str], ready, times: int = 1, by=signal.SIGINT) -> tuple[int, str, str]:
    """Run a command in a group of its own, and interrupt the whole group, as a terminal and `timeout` do, once it is ready.

    A second interrupt follows as soon as the command says that it ends its search: after a fixed time a fast machine has
    written its design.
    """
    with tempfile.TemporaryFile(mode="w+") as err:
        started = subprocess.Popen(
            [*LOCKSTEP, *words], stdout=subprocess.PIPE, stderr=err, text=True, start_new_session=True
        )

        def said() -> str:
            return os.pread(err.fileno(), 1 << 20, 0).decode()

        try:
            until = time.monotonic() + HANGS
            while not ready(started.pid) and time.monotonic() < until:
                time.sleep(0.02)
            os.killpg(started.pid, by)
            for _ in range(times - 1):
                # Only one that did not end by the first: it is searching.
                while started.poll() is None and ENDING not in said() and time.monotonic() < until:
                    time.sleep(0.002)
                if started.poll() is None:
                    os.killpg(started.pid, signal.SIGINT)
            out, _ = started.communicate(timeout=HANGS)
        finally:
            if started.poll() is None:
                os.killpg(started.pid, signal.SIGKILL)
        return started.returncode, out, said()


def after(seconds: float):
    """Be ready so long after being asked for the first time."""
    begun: list[float] = []

    def ready(_pid: int) -> bool:
        begun.append(time.monotonic())
        return begun[-1] > begun[0] + seconds

    return ready


def has_workers(group: int) -> bool:
    """Tell whether a process of the group has just started as a worker, and is still importing."""
    for place in Path("/proc").glob("[0-9]*"):
        try:
            ours = os.getpgid(int(place.name)) == group
            if ours and b"popen_loky_posix" in (place / "cmdline").read_bytes():
                return True
        except OSError:
            continue
    return False


ATTEMPT = r"(attempt \d+ of at most \d+( \([^)]*\))?: )?"
LINE = rf"lockstep: ({ATTEMPT}[^:]+, \d+ s(, (about \d.* left|soon))?|ending the search; .*)"
"""What is said on the way: progress, and that a first interrupt ends the search."""


def is_answered(code: int, out: str, err: str) -> None:
    assert code == 130
    assert only_object(out)["error"]["kind"] == "interrupted"
    *progress, last = err.strip().splitlines()
    # A design that is ended before it has anything says so.
    assert re.fullmatch(
        r"lockstep: interrupted(?: before any gains were certified)?; nothing was written", last
    ), last
    assert all(re.fullmatch(LINE, line) for line in progress), err


def test_an_interrupt_is_answered_with_one_object(examples):
    is_answered(*interrupted(["check", str(examples / "flexible_joint_arms.toml"), "--json"], loads_numpy))


def loads_numpy(pid: int) -> bool:
    """Tell whether a process has come to its own work: the command line is read without NumPy."""
    return "numpy" in Path(f"/proc/{pid}/maps").read_text()


@pytest.mark.slow
@pytest.mark.parametrize(
    "ready", [has_workers, after(2.0), after(8.0), after(16.0)], ids=["workers", "2", "8", "16"]
)
def test_an_interrupted_design_is_answered_by_one_process_only(ready, examples, tmp_path):
    problem = tmp_path / "arms.toml"
    text = (examples / "flexible_joint_arms.toml").read_text(encoding="utf-8")
    # On no machine is it done before it is interrupted.
    problem.write_text(text.replace("[design]\n", "[design]\nstarts = 10000\n"), encoding="utf-8")
    words = ["design", str(problem), "-o", str(tmp_path / "d.json"), "--json"]
    is_answered(*interrupted(words, ready, times=2))
    assert list(tmp_path.iterdir()) == [problem]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seconds", "jobs", "by"), [(8.0, 1, signal.SIGINT), (60.0, 1, signal.SIGINT), (20.0, 2, signal.SIGTERM)]
)
def test_one_interrupt_of_a_design_keeps_the_best_so_far_or_nothing(seconds, jobs, by, examples, tmp_path):
    problem = tmp_path / "arms.toml"
    text = (examples / "flexible_joint_arms.toml").read_text(encoding="utf-8")
    problem.write_text(text.replace("[design]\n", "[design]\nstarts = 10000\n"), encoding="utf-8")
    words = ["design", str(problem), "-o", str(tmp_path / "d.json"), "--jobs", str(jobs), "--json"]
    code, out, _ = interrupted(words, after(seconds), by=by)
    answer = only_object(out)
    if code == 130:  # on a slow machine no start has gains by then
        assert answer["error"]["kind"] == "interrupted"
        assert list(tmp_path.iterdir()) == [problem]
    else:
        assert answer["certified"]
        assert answer["figures"]["interrupted"] is True
        assert sorted(tmp_path.iterdir()) == [problem, tmp_path / "d.json"]
        assert lockstep("certify", tmp_path / "d.json").returncode == 0


@pytest.mark.parametrize("where", ["make_context", "invoke"])
@pytest.mark.parametrize("as_json", [True, False])
def test_an_interrupt_while_a_command_is_loaded_is_answered(where, as_json, monkeypatch):
    from typer.core import TyperGroup

    def interrupt(*_given, **_named):
        raise KeyboardInterrupt

    words = ["check", "p.toml", *(["--json"] if as_json else [])]
    monkeypatch.setattr(sys, "argv", ["lockstep", *words])
    monkeypatch.setattr(TyperGroup, where, interrupt)
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 130
    assert result.stderr.strip() == "lockstep: interrupted; nothing was written"
    assert (only_object(result.stdout)["error"]["kind"] == "interrupted") if as_json else not result.stdout


def swallowed_once() -> int:
    """Interrupt ourselves where the first exception is dropped, as CasADi drops it; return how often it came."""
    came = 0
    try:
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(HANGS)
    except KeyboardInterrupt:
        came += 1
    try:
        time.sleep(HANGS)
    except KeyboardInterrupt:
        came += 1
    return came


def test_an_interrupt_that_is_dropped_comes_again():
    before = signal.getsignal(signal.SIGINT)
    with insistent_interrupts():
        assert swallowed_once() == 2
    assert signal.getsignal(signal.SIGINT) is before


def test_an_interrupt_that_is_handled_does_not_come_again():
    with insistent_interrupts():
        try:
            os.kill(os.getpid(), signal.SIGINT)
        except KeyboardInterrupt:
            time.sleep(0.3)  # cleaning up takes longer than the time after which it would come again


def test_an_ignored_interrupt_stays_ignored():
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with insistent_interrupts():
            os.kill(os.getpid(), signal.SIGINT)
            assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_processes_started_under_the_shield_keep_it():
    script = "import signal; print(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, []))"
    with started_without_interrupts():
        shielded = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    bare = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert (shielded.stdout.strip(), bare.stdout.strip()) == ("True", "False")
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])


def interrupted_under_the_shield(done: list[str]) -> None:
    with started_without_interrupts():
        # Taken by another thread, which does not block it, or by the main one once it is unblocked.
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.05)
        done.append("started")


def test_an_interrupt_under_the_shield_comes_after_it():
    done: list[str] = []
    with pytest.raises(KeyboardInterrupt):
        interrupted_under_the_shield(done)
    assert done == ["started"]
