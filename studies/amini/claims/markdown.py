"""The ledger as a Markdown page: docs/claims.md."""

from collections import Counter
from collections.abc import Sequence
from typing import get_args

from amini.claims.claim import ClaimRow, ClaimVerdict

HEAD = """# The paper's claims, one by one

Amini, Azarbahram and Sojoodi, *H-infinity consensus of nonlinear complex multi-agent systems using dynamic output
feedback controller: an LMI approach*. Equation numbers are the paper's. Every figure on this page is computed by
`lockstep reproduce -o docs/claims.md`; the command in the last column computes its row alone.

- **proved**: by exact arithmetic or by algebra that the row states.
- **reproduced**: the figure is met numerically.
- **refuted**: a counterexample is computed, or the opposite is shown.
- **underdetermined**: the paper does not give what a verdict would need.

A refuted claim is a fact about the paper. The command fails only where a verdict does not come out as it stands here.
"""

COLUMNS = "| where | claim | verdict | figure | command |\n|---|---|---|---|---|\n"


def to_markdown(rows: Sequence[ClaimRow]) -> str:
    """Return the page.

    >>> print(to_markdown([ClaimRow("x", "(1)", "It holds.", "proved", "proved", "1 = 1")]).splitlines()[-1])
    | (1) | It holds. | proved | 1 = 1 | `lockstep reproduce x` |
    """
    counts = Counter(row.verdict for row in rows)
    total = ", ".join(f"{counts[verdict]} {verdict}" for verdict in get_args(ClaimVerdict))
    lines = "".join(
        f"| {_cell(row.where)} | {_cell(row.claim)} | {row.verdict or 'NOT AS EXPECTED'} | {_cell(row.figure)} |"
        f" `{row.how}` |\n"
        for row in rows
    )
    return f"{HEAD}\n{len(rows)} claims: {total}.\n\n{COLUMNS}{lines}"


def _cell(text: str) -> str:
    """Escape what Markdown would read as layout."""
    return text.replace("|", "\\|").replace("*", "\\*").replace("_", "\\_")
