"""What is refused of a file before any work starts: too many keys, too deep, texts that would write over a terminal."""

import unicodedata
from typing import Any

from lockstep.check.errors import ProblemError, demand
from lockstep.check.wording import shorten

MOST_KEYS = 50_000
"""Keys of one file: 2 000 agents with 20 each, and as many again."""

DEEPEST_KEY = 16
"""Levels of tables and lists. The deepest of ours is [[design.gains]] A, row, column: 5."""

_LEVELS = f"at most {DEEPEST_KEY} levels"

_JOINERS = "\u200c\u200d\u00ad"
"""Of the invisible characters those that scripts need to be read: they join or part letters, and move nothing."""


def check_document(document: Any) -> None:
    """Refuse tables and lists that are too deep, too many keys, and texts that hide or move what is printed.

    Raises:
        ProblemError: the limit and what was found, with the place.
    """
    _check_part(document, (), MOST_KEYS)


def _check_part(value: Any, place: tuple[str | int, ...], left: int) -> int:
    """Check a part and return how many keys may still come; the recursion is as deep as the limit."""
    if isinstance(value, str):
        _check_text(value, place)
    if not isinstance(value, dict | list):
        return left
    if len(place) > DEEPEST_KEY:  # the place is put into words only where it is told: there may be a million
        raise ProblemError("it is nested too deeply", where=_shown(place), expected=_LEVELS)
    if isinstance(value, dict):
        left -= len(value)
        demand(left >= 0, "too many keys", _shown(place), f"at most {MOST_KEYS}")
        for key in value:
            _check_text(str(key), place)
    for key, item in value.items() if isinstance(value, dict) else enumerate(value, start=1):
        if isinstance(item, str | dict | list):
            left = _check_part(item, (*place, key), left)
    return left


def hidden(text: str) -> str:
    r"""Return the first character of a text that moves or hides others where it is printed, or nothing.

    Control characters but for tab and line feed, line separators, directional overrides, lone surrogates.

    >>> hidden("\u4e09 Dr\u00e4i"), hidden("\x1b[2A") == "\x1b", hidden("a\u202eb") == "\u202e"
    ('', True, True)
    """
    for character in text:
        category = unicodedata.category(character)
        if category in ("Cc", "Cf", "Cs", "Zl", "Zp") and character not in "\t\n\r" + _JOINERS:
            return character
    return ""


def _check_text(text: str, place: tuple[str | int, ...]) -> None:
    if text.isascii() and text.isprintable():
        return
    if found := hidden(text):
        raise ProblemError(
            f"the text `{shorten(text)}` holds the character U+{ord(found):04X}",
            where=_shown(place),
            expected="characters that can be seen",
        )


def _shown(place: tuple[str | int, ...]) -> str:
    return shorten(", ".join(map(str, place)))
