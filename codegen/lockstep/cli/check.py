"""`lockstep check`: the symbolic model checks."""

import math
from pathlib import Path
from typing import TYPE_CHECKING

from rich import box
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from lockstep.cli.console import Answer, of_file, progress_display, respond

if TYPE_CHECKING:
    from lockstep.model.bound_search import Progress
    from lockstep.model.checks import CheckReport
    from lockstep.model.problem import Problem

STYLES = {"ok": "green", "note": "yellow", "fails": "bold red"}


def run(path: Path, *, as_json: bool, boxes: int | None = None) -> None:
    """Check a problem file; `boxes` is the budget of the search that proves the bound."""
    respond(as_json, lambda: _check(path, boxes))


def _check(path: Path, boxes: int | None) -> Answer:
    from lockstep.model.problem import load_problem

    problem = load_problem(path)
    with of_file(path):
        report = checked(problem, boxes)
    return Answer(report.document(), table_of(report, problem.title), report.ok)


def checked(problem: "Problem", boxes: int | None = None) -> "CheckReport":
    """Check a problem with a progress display: the enclosure of the bound so far, and the budget spent."""
    from lockstep.model.bound_search import BOXES
    from lockstep.model.checks import check_problem

    with progress_display() as tell:
        tell("checking the model", 0.0)
        return check_problem(
            problem,
            boxes=BOXES if boxes is None else boxes,
            progress=lambda p: tell(enclosure(p), p.part),
        )


def enclosure(progress: "Progress") -> str:
    """Return where a proof of a bound stands.

    >>> from lockstep.model.bound_search import Progress
    >>> enclosure(Progress(512, 3.0, 4.5, 0.1))
    'bound: between 3 and 4.5 after 512 boxes'
    """
    upper = f"and {progress.upper:.5g}" if math.isfinite(progress.upper) else "and no limit yet"
    return f"bound: between {progress.lower:.5g} {upper} after {progress.boxes} boxes"


def table_of(report: "CheckReport", title: str) -> RenderableType:
    """Return the checks as a table: what was found, and under it why it matters."""
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD)
    table.add_column("check", no_wrap=True)
    table.add_column("verdict", no_wrap=True)
    table.add_column("found, and why it matters", overflow="fold")
    for row in report.rows:
        said = Text(row.figure).append(f"\n{row.reason}", style="dim")
        table.add_row(row.name, Text(row.verdict, style=STYLES[row.verdict]), said)
    return table
