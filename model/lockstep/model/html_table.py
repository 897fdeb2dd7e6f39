"""A table for a notebook, its texts escaped."""

from collections.abc import Iterable, Sequence
from html import escape


def html_table(rows: Iterable[Sequence[str]], *, title: str = "", heads: Sequence[str] = ()) -> str:
    """Return rows as HTML: with heads above the columns, or the first cell of each row as its head.

    >>> html_table([("rho", "< 2")])
    '<table><tr><th>rho</th><td>&lt; 2</td></tr></table>'
    """
    caption = f"<caption>{escape(title)}</caption>" if title else ""
    top = "".join(f"<th>{escape(head)}</th>" for head in heads)
    lines = [f"<tr>{top}</tr>" if top else ""]
    for row in rows:
        kinds = ["td" if heads or k else "th" for k in range(len(row))]
        cells = (f"<{kind}>{escape(cell)}</{kind}>" for kind, cell in zip(kinds, row, strict=True))
        lines.append(f"<tr>{''.join(cells)}</tr>")
    return f"<table>{caption}{''.join(lines)}</table>"
