"""`lockstep check`: the symbolic model checks."""

from pathlib import Path
from typing import TYPE_CHECKING

from rich.table import Table

from lockstep.cli.console import Answer, progress_display, respond

if TYPE_CHECKING:
    from lockstep.model.checks import CheckReport
    from lockstep.model.problem import Problem


def run(path: Path, *, as_json: bool) -> None:
    """Check a problem file."""
    respond(as_json, lambda: _check(path))


def _check(path: Path) -> Answer:
    from lockstep.model.problem import load_problem

    problem = load_problem(path)
    report = checked(problem)
    return Answer(report.document(), table_of(report, problem.title), report.ok)


def checked(problem: "Problem") -> "CheckReport":
    """Check a problem with a progress display."""
    from lockstep.model.checks import check_problem

    with progress_display() as tell:
        tell("checking the model", 0.0)
        return check_problem(problem)


def table_of(report: "CheckReport", title: str) -> Table:
    """Return the checks as a table."""
    table = Table(title=title, title_justify="left")
    for heading in ("check", "verdict", "figure", "why it matters"):
        table.add_column(heading)
    for row in report.rows:
        table.add_row(row.name, row.verdict, row.figure, row.reason)
    return table
