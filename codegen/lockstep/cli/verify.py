"""`lockstep verify`: the compiled C against the Python reference."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.table import Table

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
        return verify_folder(folder, steps=steps, progress=lambda what, done, total: tell(what, done / max(total, 1)))


def table_of(report: "VerifyReport") -> Table:
    """Return the targets as a table."""
    table = Table(title="compiled C against the reference", title_justify="left")
    for heading in ("target", "bitwise equal", "steps", "largest error", "instructions/step", "code", "RAM", "stack"):
        table.add_column(heading, justify="left" if heading == "target" else "right")
    for target in report.targets:
        said = "skipped: " + target.skipped if target.skipped else target.error or ("yes" if target.bitwise else "NO")
        cells = (target.steps, target.max_abs_error, target.instructions_per_step, target.text_bytes, target.ram_bytes,
                 target.stack_bytes)
        table.add_row(target.name, said, *[_cell(value) for value in cells])
    table.caption = "; ".join(report.problems)
    return table


def _cell(value: Any) -> str:
    return "" if value is None else f"{value:g}" if isinstance(value, float) else str(value)
