"""A plugin of pytest for CI: tests that do not begin in the time that is left are named and left out; a failure stays one.

    PYTHONPATH=.ci pytest -p within --until=SECONDS_SINCE_THE_EPOCH --turn=TEXT

Files are taken in a circle that begins where the text, say a commit, points to: what one run does not reach, another does.
"""

import hashlib
import time
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path

import pytest

LEFT_OUT = "there was no time left to begin it"


def pytest_addoption(parser: pytest.Parser) -> None:
    """Take the time and the text."""
    parser.addoption("--until", type=float, required=True)
    parser.addoption("--turn", default="")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Turn the circle of files; in each of pytest's processes alike."""

    def file_of(item: pytest.Item) -> Path:
        return item.path

    files = [list(group) for _, group in groupby(items, file_of)]
    digest = hashlib.sha256(config.getoption("--turn").encode()).digest()
    first = int.from_bytes(digest[:8], "big") % max(len(files), 1)
    items[:] = [item for group in files[first:] + files[:first] for item in group]


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Leave a test out after the time."""
    if time.time() > item.config.getoption("--until"):
        pytest.skip(LEFT_OUT)


@pytest.hookimpl(wrapper=True)
def pytest_terminal_summary(terminalreporter: "pytest.TerminalReporter") -> Iterator[None]:
    """Name what was left out. (pytest 8.2, the lowest, has no public name for a reporter.)"""
    skipped = terminalreporter.stats.get("skipped", [])
    out = [report.nodeid for report in skipped if LEFT_OUT in str(report.longrepr)]
    if out:
        terminalreporter.section(f"{len(out)} tests left out: {LEFT_OUT}")
        terminalreporter.write_line("\n".join(out))
    yield
