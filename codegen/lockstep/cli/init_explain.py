"""`lockstep init` and `lockstep explain`: where a design begins, and what it is worth."""

from pathlib import Path

from rich.console import Group
from rich.text import Text

from lockstep.cli.console import Answer, two_columns


def run_init(field: str, output: Path | None) -> Answer:
    """Print a commented problem file of a field, or write it."""
    from lockstep.workflow.init import init

    begun = init(field, output=output)
    folder = output.with_suffix("") if output and output.suffix else "out"
    said = f"{output}, and its schema for editors beside it. Fill it in, then `lockstep build {output} -o {folder}`"
    return Answer(begun.document(), said if output else begun.text.rstrip())


def run_explain(design: Path) -> Answer:
    """Say what is proved of a design and what is not."""
    from lockstep.workflow.explain import explain

    told = explain(design)
    tables = [
        two_columns(title, {one.name: one.text for one in part}) for title, part in told.parts.items() if part
    ]
    return Answer(told.document(), Group(Text(told.found.design.title), *tables), told.ok)
