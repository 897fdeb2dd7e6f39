"""`lockstep reproduce`: the paper's claims, each with its verdict; its figures and table with `--figures`."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.markdown import Markdown
from rich.table import Table

from lockstep.cli.console import Answer, progress_display, respond, write_text
from lockstep.cli.folders import check_folder, write_files

if TYPE_CHECKING:
    from amini.claims.claim import Row
    from amini.section4.runs import Runs


def run(names: Sequence[str], output: Path | None, figures: Path | None = None, *, as_json: bool) -> None:
    """Settle the claims, and write the page if asked; or make Section 4's figures and table in a folder."""
    respond(as_json, lambda: _answer(names, output, figures))


def _answer(names: Sequence[str], output: Path | None, figures: Path | None) -> Answer:
    if figures is None:
        _check(
            not (names and output is not None),
            "some claims are named, and a page is to be written",
            "names or `-o`, not both: the page holds all claims",
        )
        return _reproduce(names, output)
    _check(
        not names and output is None,
        "`--figures` is given with claims or a page",
        "`--figures` alone: it settles no claims",
    )
    return _section_4(figures)


def _check(agree: bool, found: str, expected: str) -> None:
    """Refuse options that contradict each other."""
    from lockstep.check.errors import ProblemError

    if not agree:
        raise ProblemError(found, where="lockstep reproduce", expected=expected)


def _section_4(folder: Path) -> Answer:
    from amini.section4.figures import figures
    from amini.section4.runs import all_runs
    from amini.section4.table import to_csv, to_markdown

    check_folder(folder)
    with progress_display() as tell:
        runs = list(all_runs(tell))
        tell("figures", 1.0)
        drawn = figures(runs)
    texts = {"table_2.csv": to_csv(runs), "table_2.md": to_markdown(runs)}
    files = {**drawn, **{name: text.encode() for name, text in texts.items()}}
    write_files(folder, files)
    holds = all(one.agrees for one in runs)
    document = {
        "ok": holds,
        "directory": str(folder),
        "files": sorted(files),
        "runs": [_run_document(one) for one in runs],
    }
    return Answer(document, Markdown(texts["table_2.md"]), holds)


def _run_document(one: "Runs") -> dict[str, str | float | bool | None]:
    d = one.quiet.disagreement()
    return {
        "name": one.contestant.key,
        "disagreement_initial": float(d[0]),
        "disagreement_final": float(d[-1]),
        "agrees": one.agrees,
        "gain": one.gain,
        "rho": one.contestant.rho,
    }


def _reproduce(names: Sequence[str], output: Path | None) -> Answer:
    from amini.claims.ledger import reproduce
    from amini.claims.markdown import to_markdown
    from lockstep.cli.files import check_writable

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
