"""`lockstep init` and `lockstep explain`: where a design begins, and what it is worth."""

from pathlib import Path

from rich.console import Group
from rich.text import Text

from lockstep.cli.console import Answer, respond, two_columns


def run_init(field: str, output: Path | None, *, as_json: bool) -> None:
    """Print a commented problem file of a field, or write it."""
    respond(as_json, lambda: _init(field, output))


def _init(field: str, output: Path | None) -> Answer:
    from lockstep.workflow.init import init

    begun = init(field, output=output)
    said = f"{output}: now `lockstep check {output}`, then `lockstep build {output} -o out`"
    return Answer(begun.document(), said if output else begun.text.rstrip())


def run_explain(design: Path, *, as_json: bool) -> None:
    """Say what is proved of a design and what is not."""
    respond(as_json, lambda: _explain(design))


def _explain(design: Path) -> Answer:
    from lockstep.workflow.explain import explain

    told = explain(design)
    parts = {"Proved": told.proved, "Assumed": told.assumed, "Not proved": told.open}
    tables = [
        two_columns(title, {f"{one.name}": f"{one.value}. {one.meaning}".lstrip(". ") for one in part})
        for title, part in parts.items()
        if part
    ]
    return Answer(told.document(), Group(Text(told.found.design.title), *tables), told.ok)
