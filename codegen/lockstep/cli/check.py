"""`lockstep check`: the symbolic model checks."""

from pathlib import Path
from typing import TYPE_CHECKING

from rich import box
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from lockstep.cli.console import Answer, progress_display
from lockstep.cli.messages import limits_answer

if TYPE_CHECKING:
    from lockstep.model.checks import CheckReport

STYLES = {
    **{"ok": "green", "note": "yellow", "fails": "bold red"},
    **{"proved": "green", "refuted": "cyan", "undecided": "yellow"},
}


def run(path: Path, *, boxes: int | None, every: bool, messages: bool) -> Answer:
    """Check a problem file, or the messages of a design; `boxes` is the budget of the search that proves the bound."""
    from lockstep.workflow.check import check

    if messages:
        return limits_answer(path)
    with progress_display() as tell:
        problem, report = check(path, boxes=boxes, every=every, progress=tell)
    return Answer(report.document(), table_of(report, problem.title), report.ok)


def table_of(report: "CheckReport", title: str, *, every: bool = True) -> RenderableType:
    """Return the checks as a table: what was found, and under it why it matters; and, of every check, what was proved."""
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD)
    table.add_column("check", no_wrap=True)
    table.add_column("verdict", no_wrap=True)
    table.add_column("found, and why it matters", overflow="fold")
    for row in report.rows:
        said = Text(row.figure).append(f"\n{row.reason}", style="dim")
        table.add_row(row.name, Text(row.verdict, style=STYLES[row.verdict]), said)
    for finding in report.findings if every else ():
        table.add_row(finding.name, Text(finding.status, style=STYLES[finding.status]), Text(finding.figure))
    return table
