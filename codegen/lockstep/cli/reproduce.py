"""`lockstep reproduce`: the paper's claims, each with its verdict; its figures and table with `--figures`."""

from collections import Counter
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import RenderableType
from rich.markdown import Markdown

from lockstep.check.errors import demand
from lockstep.cli.console import Answer, progress_display, table

if TYPE_CHECKING:
    from amini.claims.claim import ClaimRow

COMMAND = "lockstep reproduce"


def run(names: Sequence[str], output: Path | None, figures: Path | None) -> Answer:
    """Settle the claims, and write the page if asked; or make Section 4's figures and table in a folder."""
    found = "the study of the paper is not installed: it is no part of the wheel"
    expected = "Lockstep's source, which holds it in the folder studies/"
    remedy = "in a checkout, run `pip install -e .`, then `lockstep reproduce`"
    demand(find_spec("amini") is not None, found, COMMAND, expected, remedy)
    found, expected = "`--figures` is given with claims or a page", "`--figures` alone: it settles no claims"
    demand(figures is None or not (names or output), found, COMMAND, expected)
    found = "some claims are named, and a page is to be written"
    demand(not names or output is None, found, COMMAND, "names or `-o`, not both: the page holds all claims")
    return _claims(names, output) if figures is None else _section_4(figures)


def _section_4(folder: Path) -> Answer:
    from amini.section4.folder import section_4

    with progress_display() as tell:
        found = section_4(folder, tell)
    return Answer(found.document(), Markdown(found.table), found.ok)


def _claims(names: Sequence[str], output: Path | None) -> Answer:
    from amini.claims.ledger import page, reproduce

    with progress_display() as tell:
        rows = reproduce(names, tell) if output is None else page(output, tell)
    holds = all(row.verdict is not None for row in rows)
    return Answer({"ok": holds, "claims": [row.document() for row in rows]}, _table(rows), holds)


def _table(rows: Sequence["ClaimRow"]) -> RenderableType:
    counts = Counter(row.verdict or "NOT AS EXPECTED" for row in rows)
    title = ", ".join(f"{count} {verdict}" for verdict, count in counts.items())
    cells = ((row.name, row.where, row.claim, row.verdict or "NOT AS EXPECTED", row.figure) for row in rows)
    return table(("name", "where", "claim", "verdict", "figure"), cells, title, words=5)
