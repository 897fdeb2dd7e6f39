"""`lockstep reproduce`: the paper's claims, each with its verdict."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.table import Table

from lockstep.cli.console import Answer, progress_display, respond, write_text

if TYPE_CHECKING:
    from lockstep.lmi.claims.claim import Row


def run(names: Sequence[str], output: Path | None, *, as_json: bool) -> None:
    """Settle the claims, and write the page if asked."""
    respond(as_json, lambda: _reproduce(names, output))


def _reproduce(names: Sequence[str], output: Path | None) -> Answer:
    from lockstep.cli.files import check_writable
    from lockstep.lmi.claims.ledger import reproduce
    from lockstep.lmi.claims.markdown import to_markdown
    from lockstep.model.errors import ProblemError

    if names and output is not None:
        raise ProblemError(
            "some claims are named, and a page is to be written",
            where="lockstep reproduce",
            expected="names or `-o`, not both: the page holds all claims",
        )
    check_writable(output)
    with progress_display() as tell:
        rows = reproduce(names, tell)
    holds = all(row.verdict is not None for row in rows)
    if output is not None and holds:
        write_text(output, to_markdown(rows))
    return Answer({"ok": holds, "claims": [_document(row) for row in rows]}, _table(rows), holds)


def _document(row: "Row") -> dict[str, str | None]:
    return {
        "name": row.name,
        "where": row.where,
        "claim": row.claim,
        "verdict": row.verdict,
        "expected": row.expected,
        "figure": row.figure,
        "how": row.how,
    }


def _table(rows: Sequence["Row"]) -> Table:
    counts = Counter(row.verdict or "NOT AS EXPECTED" for row in rows)
    table = Table(
        title=", ".join(f"{count} {verdict}" for verdict, count in counts.items()), title_justify="left"
    )
    for heading in ("name", "where", "claim", "verdict", "figure"):
        table.add_column(heading)
    for row in rows:
        table.add_row(row.name, row.where, row.claim, row.verdict or "NOT AS EXPECTED", row.figure)
    return table
