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
    from lockstep.model.checks import CheckReport, CheckRow

DESIGN_SAYS = ("loop transformation", "where the bound holds", "h(t, 0) = 0", "units of parameters")
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
    return Answer(report.document(), table_of(report, problem.title, every=every), report.ok)


def is_noted(row: "CheckRow") -> bool:
    """Whether a row asks for something that a design does not say: where it holds it does, and how it was made is its own."""
    return row.verdict != "ok" and row.name not in DESIGN_SAYS


def table_of(
    report: "CheckReport", title: str, *, every: bool = False, brief: bool = False
) -> RenderableType:
    """Return the checks as a table: what was found, and under it, where that is not well or `every` check is asked for, why
    it matters; and, of every check, what was proved; without it, not what is always so by construction. A `brief` one
    leaves out what is well, and why notes matter."""
    rows = [row for row in report.rows if every or (is_noted(row) if brief else row.is_telling)]
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD)
    table.add_column("check", no_wrap=True)
    table.add_column("verdict", no_wrap=True)
    table.add_column("found", overflow="fold")
    for row in rows:
        why = f"\n{row.reason}" if every or row.verdict == "fails" or (not brief and is_noted(row)) else ""
        said = Text(row.figure).append(why, style="dim")
        table.add_row(row.name, Text(row.verdict, style=STYLES[row.verdict]), said)
    for finding in report.findings if every else ():
        table.add_row(finding.name, Text(finding.status, style=STYLES[finding.status]), Text(finding.figure))
    return table
