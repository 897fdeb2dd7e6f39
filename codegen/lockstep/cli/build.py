"""`lockstep build`: from a problem file to a folder of proved, compiled and checked C, with a report."""

from pathlib import Path

from rich.console import Group
from rich.text import Text

from lockstep.cli.check import table_of as check_table
from lockstep.cli.console import Answer, progress_display, respond
from lockstep.cli.design import summary
from lockstep.cli.verify import table_of as verify_table


def run(path: Path, output: Path, *, jobs: int | None, time_limit: float | None, as_json: bool) -> None:
    """Check, design, certify, generate, verify, report; write the folder last."""
    respond(as_json, lambda: _build(path, output, jobs, time_limit))


def _build(path: Path, output: Path, jobs: int | None, time_limit: float | None) -> Answer:
    import lockstep

    with progress_display() as tell:
        found = lockstep.build(path, output, jobs=jobs, time_limit=time_limit, progress=tell)
    document = found.document()
    report = document["report"]
    said = [f"{output / report}: the report" if report else "nothing is written", *found.problems]
    parts = [
        check_table(found.checks, found.design.title, every=False),
        summary(document["design"]),
        verify_table(found.verified),
        Text("\n".join(said), style="bold"),
    ]
    return Answer(document, Group(*parts), found.ok)
