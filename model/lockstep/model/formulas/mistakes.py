"""The usual mistakes in a formula, each told in its own words before `lockstep.check.expression.text` reads it.

Numbers are ASCII decimals, names are ASCII identifiers that are no words of Python, and the rest is + - * /
** ( ) , and < <= > >=. What is from other languages (^, 1_000, 0x10, strings, attributes, and, or) stops here.
"""

import keyword
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from lockstep.check.errors import ProblemError
from lockstep.check.expression.text import DEEPEST, LONGEST, MOST_TOKENS
from lockstep.check.wording import shorten
from lockstep.model.formulas.confusables import DECIMAL_POINT, advice_to_retype, typed_instead

_TOKEN = re.compile(
    r"(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)|(?P<name>[A-Za-z_][A-Za-z_0-9]*)"
    r"|(?P<operator>\*\*|<=|>=|[-+*/()<>,])|(?P<space>[ \t]+)"
)
_REMEDIES: Mapping[str, str] = {
    "^": "use ** for a power",
    "=": "conditions are written with <, <=, > or >=; a right-hand side has no `=`",
    "'": "an expression is made of numbers, names and operators, without quotes",
    '"': "an expression is made of numbers, names and operators, without quotes",
    "[": "use ( and )",
    "{": "use ( and )",
    ".": "write numbers as 0.5; nothing has attributes here",
    "%": "there is no remainder; use sin, cos or if_else for what repeats",
    "#": "put the comment outside of the quotes of the TOML string",
    "\n": "write the expression on one line",
    "\r": "write the expression on one line",
    "if": "use if_else(a < b, then, otherwise)",
    "else": "use if_else(a < b, then, otherwise)",
    "and": "nest if_else(...) instead",
    "or": "nest if_else(...) instead",
    "not": "swap the two branches of if_else instead",
}


@dataclass(frozen=True)
class Source:
    """An expression's text and where it stands, to point at from a message."""

    text: str
    where: str

    def error(self, found: str, column: int, *, expected: str = "", remedy: str = "") -> ProblemError:
        """Return an error about one column, counted from 0."""
        place = f"{found} at column {column + 1} of `{shorten(self.text)}`"
        return ProblemError(place, where=self.where, expected=expected, remedy=remedy)

    def whole(self, found: str, *, expected: str = "", remedy: str = "") -> ProblemError:
        """Return an error about the expression as a whole."""
        return ProblemError(found, where=self.where, expected=expected, remedy=remedy)


class Token(NamedTuple):
    """A number, a name or an operator, and the column it starts in."""

    kind: str
    text: str
    column: int


def check_text(text: str, where: str) -> None:
    """Refuse a text that cannot be a formula, in words for what it looks like.

    Raises:
        ProblemError: what was found, its column, and what to write instead.
    """
    if isinstance(text, str):
        source = Source(text.strip(" \t"), where)
        check_neighbours(source, tokens(source))


def tokens(source: Source) -> list[Token]:
    """Cut the text into tokens, refusing every character that no token starts with."""
    if len(source.text) > LONGEST:
        raise source.whole(
            f"an expression of {len(source.text)} characters",
            expected=f"at most {LONGEST}",
            remedy="name its parts as parameters, or build the agent in Python",
        )
    found: list[Token] = []
    position = 0
    while position < len(source.text):
        match = _TOKEN.match(source.text, position)
        if match is None or match.lastgroup is None:
            character = source.text[position]
            raise source.error(
                f"`{shorten(character)}` is not part of an expression",
                position,
                expected="numbers, names, + - * / ** ( ) , and < <= > >= in if_else",
                remedy=_remedy(character, source.text),
            )
        if match.lastgroup != "space":
            token = Token(match.lastgroup, match.group(), position)
            _check_word(source, token)
            found.append(token)
        position = match.end()
    if not found:
        raise source.whole(
            "the expression is empty", expected="a formula in the states", remedy='write "0" for none'
        )
    if len(found) > MOST_TOKENS:
        raise source.whole(
            f"an expression of {len(found)} numbers, names and operators",
            expected=f"at most {MOST_TOKENS}",
            remedy="build the agent in Python",
        )
    return found


def _remedy(character: str, text: str) -> str:
    """Say what to write for a character, or for all of the text that only look like another one."""
    same = _REMEDIES.get(character) or _REMEDIES.get(typed_instead(character))
    return same or advice_to_retype("".join(one for one in text if typed_instead(one) not in _REMEDIES))


def check_neighbours(source: Source, line: list[Token]) -> None:
    """Refuse what Python would read in its own way: 007, 2x, 1_000; and unbalanced parentheses."""
    calls = list[bool]()  # of each `(` that is open: whether it is a function's
    for before, token in zip([None, *line], line, strict=False):
        if token.kind == "number":
            _check_number(source, token)
        starts_value = token.kind in ("number", "name") or token.text == "("
        if (
            before is not None
            and starts_value
            and (
                before.kind == "number" or before.text == ")" or (before.kind == "name" and token.text != "(")
            )
        ):
            raise source.error(
                f"an operator is missing between `{before.text}` and `{token.text}`",
                token.column,
                remedy="write * to multiply",
            )
        if token.text == "," and not (calls and calls[-1]):
            raise source.error("a comma outside of a function", token.column, remedy=DECIMAL_POINT)
        if token.text == "(":
            calls.append(before is not None and before.kind == "name")
        if token.text == ")" and not calls:
            raise source.error("a `)` that closes nothing", token.column)
        if token.text == ")":
            calls.pop()
        if len(calls) > DEEPEST:
            raise source.error(
                "the expression is nested too deeply", token.column, expected=f"at most {DEEPEST} levels"
            )
    if calls:
        raise source.whole(
            f"{len(calls)} `(` not closed in `{shorten(source.text)}`", expected="a `)` for each `(`"
        )


def _check_word(source: Source, token: Token) -> None:
    if token.kind == "name" and keyword.iskeyword(token.text):
        raise source.error(
            f"`{token.text}` is not part of an expression",
            token.column,
            remedy=_REMEDIES.get(token.text, "names cannot be words of Python's own language"),
        )
    if token.text.lower() in ("nan", "inf", "infinity"):
        raise source.error(
            f"`{token.text}` is no number that can be computed with", token.column, expected="a finite number"
        )
    if token.text.startswith("_"):
        raise source.error(
            f"`{shorten(token.text)}` is not part of an expression",
            token.column,
            expected="names that start with a letter",
        )


def _check_number(source: Source, token: Token) -> None:
    if not math.isfinite(float(token.text)):
        raise source.error(
            f"`{shorten(token.text, 30)}` is too large for a number",
            token.column,
            expected="at most 1.79e308 (double precision)",
        )
    if re.fullmatch(r"0[0-9]+", token.text):
        raise source.error(
            f"`{shorten(token.text, 30)}` starts with a zero",
            token.column,
            remedy="leave the leading zeros out",
        )
