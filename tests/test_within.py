"""The plugin of CI that begins no test after a time: what it leaves out is named, and a failure stays one."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

TESTS = {"test_a.py": "def test_right(): pass\n", "test_b.py": "def test_wrong(): assert False\n"}
NEVER, LONG_AGO = "1e12", "0"


@pytest.fixture
def run(root: Path, tmp_path: Path):
    for name, text in TESTS.items():
        (tmp_path / name).write_text(text)

    def run(until: str, turn: str = "") -> tuple[int, list[str]]:
        command = [sys.executable, "-m", "pytest", "-v", "-p", "within", f"--until={until}", f"--turn={turn}"]
        done = subprocess.run(
            [*command, "-p", "no:cacheprovider", str(tmp_path)],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": str(root / ".ci"), "PYTEST_ADDOPTS": ""},
            capture_output=True,
            text=True,
            check=False,
        )
        return done.returncode, done.stdout.splitlines()

    return run


@pytest.mark.slow
def test_a_failure_before_the_time_is_one(run):
    status, said = run(NEVER)
    assert status == 1
    assert not any("left out" in line for line in said)


@pytest.mark.slow
def test_what_is_left_out_is_named(run):
    status, said = run(LONG_AGO)
    assert status == 0
    assert any("2 tests left out" in line for line in said)
    assert {"test_a.py::test_right", "test_b.py::test_wrong"} <= set(said)


@pytest.mark.slow
def test_another_text_begins_with_another_file(run):
    """By SHA-256 of the texts, whose first eight bytes are odd for "1" and even for "2"."""
    first = [next(line for line in run(LONG_AGO, turn)[1] if "::" in line) for turn in ("1", "2")]
    assert [line.partition("::")[0] for line in first] == ["test_b.py", "test_a.py"]
