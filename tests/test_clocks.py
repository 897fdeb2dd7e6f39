"""No verdict depends on a clock: budgets are counts, and what reads a clock is listed here."""

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
FOLDERS = [
    folder
    for root in ("check", "model", "lmi", "codegen")
    for folder in sorted((ROOT / root / "lockstep").iterdir())
    if folder.is_dir()
]

CLOCKS = {
    # a time limit that the user sets: it stops the search, and the design says so
    *(f"lmi/{name}.py" for name in ("search/stopping", "specification/attempts")),
    # how long a search is likely to take, and figures for people
    "lmi/search/search_time.py",
    *(f"workflow/waiting/{name}.py" for name in ("progress_lines", "time_left")),
    "campaign/campaign.py",
}


def imported(source: str) -> Iterator[str]:
    """Every module that a text imports, within functions too."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module or "."


def reads_a_clock(source: str) -> bool:
    return bool({"time", "timeit", "datetime"} & set(imported(source)))


def test_no_verdict_depends_on_a_clock():
    """What reads a clock is listed, and is neither the proof of a bound nor the checker."""
    assert {"check", "model", "lmi", "codegen", "cli"} <= {folder.name for folder in FOLDERS}
    found = {
        path.relative_to(folder.parent).as_posix()
        for folder in FOLDERS
        for path in folder.rglob("*.py")
        if reads_a_clock(path.read_text(encoding="utf-8"))
    }
    assert found <= CLOCKS
    assert reads_a_clock("def f():\n    import time as clock\n")
    assert not reads_a_clock("def f(time):\n    return time\n")
