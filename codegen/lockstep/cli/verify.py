"""`lockstep verify`: the compiled C against the Python reference."""

from pathlib import Path
from typing import TYPE_CHECKING

from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from lockstep.cli.console import Answer, plain, progress_display, respond

if TYPE_CHECKING:
    from lockstep.codegen.verify import VerifyReport


def run(folder: Path, *, steps: int, as_json: bool) -> None:
    """Verify a generated folder."""
    respond(as_json, lambda: _verify(folder, steps))


def _verify(folder: Path, steps: int) -> Answer:
    report = verified(folder, steps)
    return Answer(plain(report.as_dict()), table_of(report), report.ok)


def verified(folder: Path, steps: int) -> "VerifyReport":
    """Verify a folder with a progress display."""
    from lockstep.codegen.verify import verify_folder

    with progress_display() as tell:
        return verify_folder(
            folder, steps=steps, progress=lambda what, done, total: tell(what, done / max(total, 1))
        )


def table_of(report: "VerifyReport") -> RenderableType:
    """Return the targets as a table; a dash is what was not measured."""
    table = Table(title="The compiled C against its reference", title_justify="left", box=box.SIMPLE_HEAD)
    for heading in ("target", "bitwise", "steps", "instr/step", "code B", "RAM B", "stack B"):
        table.add_column(heading, justify="left" if heading == "target" else "right", overflow="fold")
    for target in report.targets:
        said = (
            "skipped" if target.skipped else "failed" if target.error else "equal" if target.bitwise else "NO"
        )
        cells = (target.instructions_per_step, target.text_bytes, target.ram_bytes, target.stack_bytes)
        name = (
            f"{target.name}: {target.skipped or target.error}"
            if said in ("skipped", "failed")
            else target.name
        )
        table.add_row(
            Text(name), said, str(target.steps), *["-" if cell is None else str(cell) for cell in cells]
        )
    verdict = "every bit is equal" if report.ok else "NOT as claimed: " + "; ".join(report.problems)
    return Group(table, Text(verdict, style="bold"))
