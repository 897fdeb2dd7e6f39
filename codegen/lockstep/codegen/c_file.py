"""One generated file of an agent as text: what is comment in it, what its literals are worth, how it is refused.

A file is refused for anything that two readers, this one and a compiler, might take differently.
"""

import re
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np

from lockstep.check.errors import NotCertified, ProblemError

# Without a point or an exponent it would be an integer, and octal after a leading 0.
LITERAL = re.compile(r"-?[0-9]+(?:\.[0-9]+(?:e[+-]?[0-9]{1,3})?|e[+-]?[0-9]{1,3})f?")
INDEX = "(0|[1-9][0-9]*)"
_COMMENT_OR_STRING = re.compile(r'/\*.*?\*/|"[^"\n]*"|"', re.DOTALL)
_CONTROL = re.compile(r"[\x00-\x09\x0b-\x1f\x7f]")


@dataclass(frozen=True)
class CFile:
    """The header ("h") or the source ("c") of the agent `name`."""

    name: str
    kind: Literal["h", "c"]
    text: str

    @classmethod
    def read(cls, folder: Path, name: str, kind: Literal["h", "c"]) -> "CFile":
        """Read a file of a folder; raises `ProblemError` if it is missing or is no text."""
        path = folder / _path(name, kind)
        try:
            # A line's end may be CR LF; a CR alone ends no line in C, so it is left for `check` to refuse.
            return cls(name, kind, path.read_bytes().decode("utf-8").replace("\r\n", "\n"))
        except FileNotFoundError:
            raise ProblemError(
                "there is no such file", where=str(path), remedy="generate the folder again"
            ) from None
        except (OSError, UnicodeDecodeError) as error:
            raise ProblemError(f"it cannot be read ({error})", where=str(path)) from None

    def check(self) -> None:
        """Refuse text that hides where a comment or a line ends."""
        # A backslash at a line's end or a trigraph may change where a comment ends.
        if "\\" in self.text or "??" in self.text:
            raise self.refusal("it holds a backslash or a trigraph")
        # Python and C do not agree on which of these ends a line.
        if found := _CONTROL.search(self.text):
            raise self.refusal(f"it holds the control character {found[0]!r}")

    def refusal(self, found: str) -> NotCertified:
        """Return the error that says what is not as it is generated."""
        path = _path(self.name, self.kind)
        return NotCertified(
            f"{path} is not the C that is generated, so nothing is proved of it: {found}", file=path
        )

    @cached_property
    def code(self) -> str:
        """The text with a space for each comment, as a compiler has it: what a string holds is none.

        A string that does not end on its line is refused: in code that is skipped compilers take it for anything, and a
        comment that begins in it may then be code.
        """

        def kept(found: re.Match[str]) -> str:
            if found[0] == '"':
                raise self.refusal("a string does not end on its line")
            return " " if found[0].startswith("/*") else found[0]

        return _COMMENT_OR_STRING.sub(kept, self.text)

    def differs_from(self, text: str) -> str:
        """Return the first difference from a text, comments and white space around lines aside; "" if there is none."""
        found, expected = self._lines, CFile(self.name, self.kind, text)._lines
        for theirs, ours in zip(found, expected, strict=False):
            if theirs != ours:
                return f"it has `{theirs}` where `{ours}` is generated"
        if len(found) != len(expected):
            return f"it has {len(found)} lines of code where {len(expected)} are generated"
        return ""

    @property
    def _lines(self) -> list[str]:
        return [line for line in (raw.strip(" ") for raw in self.code.split("\n")) if line]

    def value(self, literal: str, real: str) -> float:
        """Return what a literal is worth in the type; refuses one of another type, or that is not finite."""
        if not LITERAL.fullmatch(literal) or literal.endswith("f") != (real == "float32"):
            raise self.refusal(f"`{literal}` is no {real} literal")
        value = nearest(literal, real)
        if not np.isfinite(value):
            raise self.refusal(f"`{literal}` is not finite in {real}")
        return value

    def row(self, text: str) -> tuple[str, ...]:
        """Return the entries of `{a, b, c}`."""
        if not (text.startswith("{") and text.endswith("}")):
            raise self.refusal(f"`{text}` is no row of a table")
        return tuple(text[1:-1].split(", "))


def _path(name: str, kind: str) -> str:
    return f"include/{name}.h" if kind == "h" else f"src/{name}.c"


def nearest(text: str, real: str) -> float:
    """Return the value of a decimal literal in the type, rounded once, as a C compiler does.

    >>> nearest("0.1f", "float32"), nearest("0.1", "float64")
    (0.10000000149011612, 0.1)
    """
    decimal = text.rstrip("f")
    if real == "float64":
        return float(decimal)
    exact = Fraction(decimal)
    with np.errstate(over="ignore", under="ignore"):
        first = np.float32(float(decimal))
    if not np.isfinite(first):
        return float(first)
    # Rounding to double first may land on the wrong side of a tie: the neighbours are compared exactly.
    near = [np.nextafter(first, np.float32(-np.inf)), first, np.nextafter(first, np.float32(np.inf))]
    near = [value for value in near if np.isfinite(value)]
    return float(min(near, key=lambda v: (abs(Fraction(float(v)) - exact), int(v.view(np.uint32)) & 1)))
