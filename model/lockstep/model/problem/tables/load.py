"""From a file or its text to a checked table: reading, TOML, and the schema."""

import re
import tomllib
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from lockstep.check.errors import ProblemError, demand
from lockstep.check.file_limits import DEEPEST_KEY, MOST_KEYS, check_document
from lockstep.check.files import read_text
from lockstep.check.wording import shorten
from lockstep.model.formulas.confusables import toml_instead_of
from lockstep.model.problem.tables.schema import ProblemFile
from lockstep.model.problem.tables.validation_errors import problem_error

# Nothing is tried twice: a key part begins where none goes on, and gives nothing back.
_LONG_KEY = re.compile(
    rf"""(?<![A-Za-z0-9_-])(?:(?:[A-Za-z0-9_-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){{{DEEPEST_KEY}}}"""
)
_QUOTED = re.compile(r"""\"[^"\n]*+\"|'[^'\n]*+'""")
_TABLE = re.compile(r"^[ \t]*\[", re.MULTILINE)

MOST_LISTS = 300_000
"""Lists of one file: each of 2 000 agents hears 64 others, as many as a controller in C, and as many again."""

MOST_DIGITS = 10_000
_LONG_NUMBER = re.compile(rf"(?<![0-9_])[0-9_]{{{MOST_DIGITS + 1}}}")


def read_problem(path: Path) -> str:
    """Return the text of a problem file, without a byte order mark.

    Raises:
        ProblemError: missing, no regular file, too large, not readable, or not UTF-8.
    """
    return read_text(path, expected="a problem file in TOML").removeprefix("\ufeff")


def check_toml(text: str) -> None:
    """Refuse a text in TOML whose tables would fill the memory while it is parsed.

    Raises:
        ProblemError: a key of more than `DEEPEST_KEY` parts, more than `MOST_KEYS` keys and tables, more than
            `MOST_LISTS` lists, or a number of more than `MOST_DIGITS` digits.
    """
    count = text.count("=") + sum(1 for _ in _TABLE.finditer(text))
    demand(count <= MOST_KEYS, f"some {count} keys and tables", "", f"at most {MOST_KEYS}")
    demand((lists := text.count("[")) <= MOST_LISTS, f"some {lists} lists", "", f"at most {MOST_LISTS}")
    for form, parts, most in ((_LONG_NUMBER, "digits", MOST_DIGITS), (_LONG_KEY, "parts", DEEPEST_KEY)):
        for found in form.finditer(text):
            line = f"line {text.count(chr(10), 0, found.start()) + 1}"
            demand(False, f"`{shorten(found[0], 40)}` has too many {parts}", line, f"at most {most}")


def parse_toml(text: str) -> dict[str, Any]:
    """Parse TOML.

    Raises:
        ProblemError: not TOML, with the line and column, or more keys than a problem has.
    """
    check_toml(text)
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        message = str(error)
        place = re.search(r"\(at (line \d+, column \d+|end of document)\)", message)
        what = re.sub(r"\('.*?\)", _table_name, message[: place.start()].strip() if place else message)
        raise ProblemError(
            f"this is not TOML: {what[:1].lower()}{what[1:]}",
            where=place.group(1) if place else "",
            remedy=toml_instead_of(text, _bare_line(text, place)),
        ) from None
    except (RecursionError, ValueError) as error:
        deep = isinstance(error, RecursionError)
        what = "it is nested too deeply" if deep else "a number has too many digits"
        raise ProblemError(f"this is not TOML that can be read: {what}") from None


def _bare_line(text: str, place: re.Match[str] | None) -> str:
    """Return the line that TOML stopped in, without its texts and its comment."""
    found = re.search(r"line ([0-9]+)", place.group(1)) if place else None
    line = text.splitlines()[int(found[1]) - 1 : int(found[1])] if found else []
    return _QUOTED.sub("", line[0]).partition("#")[0] if line else ""


def _table_name(found: re.Match[str]) -> str:
    """Write the keys of a table, a tuple in Python's messages, as the file does: [agent.units]."""
    keys = re.findall(r"'([^']*)'", found.group())
    return f"[{'.'.join(keys)}]"


def parse_tables(document: Any) -> ProblemFile:
    """Check a document against the schema.

    Raises:
        ProblemError: too deep, too many keys, a text that hides others; an unknown or missing key, a wrong type, or
            a value out of range, with its place in the file.
    """
    check_document(document)
    try:
        return ProblemFile.model_validate(document)
    except ValidationError as error:
        raise problem_error(error) from None
