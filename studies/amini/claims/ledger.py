"""The ledger: every claim, in the order of the paper, and how to settle them all or some."""

from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path

from amini.claims.claim import ClaimRow, PaperClaim, settle
from lockstep.check.errors import ProblemError
from lockstep.check.wording import nearest
from lockstep.workflow.output_files import check_writable, write_text


@cache
def all_claims() -> tuple[PaperClaim, ...]:
    """Return all claims, chapter by chapter."""
    from amini.claims import fragility, graphs, nonlinearity, reduction, table_1, table_2, theorem

    chapters = (graphs, nonlinearity, reduction, theorem, fragility, table_1, table_2)
    return tuple(claim for chapter in chapters for claim in chapter.CLAIMS)


def reproduce(names: Sequence[str] = (), tell: Callable[[str, float], None] | None = None) -> list[ClaimRow]:
    """Settle the named claims, or all of them.

    Raises:
        ProblemError: there is no claim of a name.
    """
    chosen = [_named(name) for name in names] or list(all_claims())
    rows = []
    for done, claim in enumerate(chosen):
        if tell is not None:
            tell(claim.where, done / len(chosen))
        rows.append(settle(claim))
    return rows


def _named(name: str) -> PaperClaim:
    known = {claim.name: claim for claim in all_claims()}
    if name not in known:
        raise ProblemError(
            f"there is no claim `{name}`",
            where="lockstep reproduce",
            expected="a name that ends a claim in docs/claims.md",
            remedy=nearest(name, known),
        )
    return known[name]


def page(output: Path, tell: Callable[[str, float], None] | None = None) -> list[ClaimRow]:
    """Settle all claims, and write the page (Markdown) if every verdict is as it stands.

    Raises:
        ProblemError: an output that cannot be written.
    """
    from amini.claims.markdown import to_markdown

    check_writable(output)
    rows = reproduce((), tell)
    if all(row.verdict is not None for row in rows):
        write_text(output, to_markdown(rows))
    return rows
