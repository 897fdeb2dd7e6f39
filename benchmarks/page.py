"""Tables of figures in the pages of docs/: rows as Markdown, and a page with what is between its marks replaced."""

from collections.abc import Iterable, Sequence
from pathlib import Path


def markdown(head: Sequence[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a table in Markdown."""
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)])


def updated(page: str, begin: str, end: str, text: str) -> str:
    """Return the page with what is between its marks replaced."""
    head, rest = page.split(begin)
    return f"{head}{begin}\n\n{text}\n\n{end}{rest.split(end)[1]}"


def write(page: Path, begin: str, end: str, text: str) -> None:
    """Replace what is between the marks of a file."""
    page.write_text(updated(page.read_text(encoding="utf-8"), begin, end, text), encoding="utf-8")
