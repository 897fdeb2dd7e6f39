"""`lockstep build`: from a problem file to a folder of proved, compiled and checked C, with a report; `generate`: its C."""

from pathlib import Path
from typing import Any

from rich.console import Group
from rich.text import Text

from lockstep.cli.check import is_noted
from lockstep.cli.check import table_of as check_table
from lockstep.cli.console import Answer, left_from_before, progress_display, remark, two_columns
from lockstep.cli.design import REUSED, summary
from lockstep.cli.interrupts import keeping_the_best
from lockstep.cli.verify import table_of as verify_table
from lockstep.model.checks.linear_part import WAYS


def run(path: Path, output: Path, **options: Any) -> Answer:
    """Check, design, certify, generate, verify, report; write the folder last. Options: of `lockstep.build`."""
    import lockstep

    with left_from_before(output), progress_display() as tell, keeping_the_best(remark) as stop:
        found = lockstep.build(path, output, **options, progress=tell, remark=remark, stop=stop)
    if found.design.reused:
        remark(REUSED)
    document = found.document()
    report = document["report"]
    said = [f"{output / report}: the report" if report else "nothing is written"]
    said += [f"{one.figure}: hold that against the machine" for one in found.checks.rows if one.name == WAYS]
    said += [*(f"note: {one}" for one in found.notes), *found.problems]  # what to change is read last
    noted = any(map(is_noted, found.checks.rows))
    parts = [
        *([check_table(found.checks, "What is to be noted of the model", brief=True)] if noted else []),
        summary(document["design"]),
        verify_table(found.verified, brief=True),
        Text("\n".join(said), style="bold"),
    ]
    return Answer(document, Group(*parts), found.ok)


def generate(path: Path, output: Path, **options: Any) -> Answer:
    """Generate the folder of a certified design; options: of `lockstep.generate`."""
    import lockstep

    made = lockstep.generate(path, output, **options)
    bytes_of = {name: text if isinstance(text, bytes) else text.encode() for name, text in made.files.items()}
    sizes = {name: f"{len(bytes_of[name])} bytes" for name in sorted(bytes_of)}
    return Answer(made.document(), two_columns(f"{made.design.title}: {output}", sizes))
