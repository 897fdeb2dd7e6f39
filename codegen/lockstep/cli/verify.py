"""`lockstep verify`: the compiled C against the Python reference."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Group, RenderableType
from rich.text import Text

from lockstep.cli.console import Answer, progress_display, remark, table
from lockstep.model.plain_json import plain

if TYPE_CHECKING:
    from lockstep.verification.verify import VerifyReport


def run(folder: Path, **options: Any) -> Answer:
    """Verify a generated folder; options: of `lockstep.verify`."""
    import lockstep

    if options["log"] is None:
        remark("verify compiles the C of the folder and runs it on this machine")
    with progress_display() as tell:
        report = lockstep.verify(folder, **options, progress=tell)
    return Answer(plain(report.as_dict()), table_of(report), report.ok)


def table_of(report: "VerifyReport", *, brief: bool = False) -> RenderableType:
    """Return the targets as a table; a dash is what was not measured. How many steps each took stands below it.

    Where all is as claimed and it is to be brief, that alone, and what was skipped.
    """
    from lockstep.verification.verify import most_of

    headings = ("target", "bitwise", "instr/step", "code B", "RAM B", "stack B")
    rows, reasons = list[tuple[str | int | None, ...]](), []
    for target in report.targets:
        equal = "equal" if target.bitwise else "NO"
        said = "skipped" if target.skipped else "failed" if target.error else equal
        cells = (target.instructions_per_step, target.text_bytes, target.ram_bytes, target.stack_bytes)
        if why := target.skipped or target.error:
            why = why.partition(" (")[0] if brief and target.skipped else why
            reasons.append(f"{target.name}: {said}, {why}")
        rows.append((target.name, said, *cells))
        if fixed := target.fixed:
            most = [most_of(fixed, figure) for figure in ("instructions_per_step", "text_bytes", "ram_bytes")]
            equal = "equal" if all(one.bitwise for one in fixed) else "NO"
            rows.append(("  in integers", equal, *most, None))
    shown = [tuple(Text("-" if one is None else str(one)) for one in row) for row in rows]
    verdict = f"every bit is equal: {report.fed.partition(';')[0] if brief else report.fed}"
    verdict = verdict if report.ok else "NOT as claimed: " + "; ".join(report.problems)
    found = table(headings, shown, "The compiled C against its reference")
    return Group(*([] if brief and report.ok else [found]), *map(Text, reasons), Text(verdict, style="bold"))
