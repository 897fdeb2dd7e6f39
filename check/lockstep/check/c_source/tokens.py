"""One generated C file as tokens: what is comment in it, what its literals are worth, how it is refused.

A file is refused for anything that two readers, this one and a compiler, might take differently.
"""

import re
from fractions import Fraction

import numpy as np

from lockstep.check.errors import NotCertified
from lockstep.check.sampled.discretise import Real

# Without a point or an exponent it would be an integer, and octal after a leading 0.
LITERAL = re.compile(r"(?=.{1,99}$)[0-9]+(?:\.[0-9]+(?:e[+-]?[0-9]{1,3})?|e[+-]?[0-9]{1,3})f?")
# What is open to the end is one match: searched for its end at every start, 300 kB of them took over 40 s.
_COMMENT_OR_STRING = re.compile(r'/\*.*?(?:\*/|\Z)|"[^"\n]*"|"', re.DOTALL)
_CONTROL = re.compile(r"[\x00-\x09\x0b-\x1f\x7f]")
# As long as C takes them (6.4); any other character is a token that is never expected.
_TOKEN = re.compile(
    r'[A-Za-z_]\w*|\.?[0-9](?:[eEpP][+-]|[\w.])*|"[^"]*"|<<=|>>=|->|\+\+|--|&&|\|\||<<|>>|<:|:>|<%|%>|[-+*/%&|^=!<>]=|[^ ]',
    re.ASCII,
)


def tokens_of(code: str) -> list[str]:
    """Return the tokens of C without comments; a directive, whose spaces may matter, is one.

    >>> tokens_of('#define A 1\\nx-= .5e-3f;')
    ['#define A 1', 'x', '-=', '.5e-3f', ';']
    """
    found: list[str] = []
    for line in (raw.strip(" ") for raw in code.split("\n")):
        found += [line] if line.startswith("#") else _TOKEN.findall(line)
    return found


class CText:
    """The tokens of a file from first to last, each one expected or taken.

    Raises:
        NotCertified: in all methods, where the file is not as it is generated.
    """

    def __init__(self, path: str, text: str) -> None:
        self.path, self.at = path, 0
        # A backslash at a line's end or a trigraph may change where a comment ends.
        if "\\" in text or "??" in text:
            raise self.refusal("it holds a backslash or a trigraph")
        # Python and C do not agree on which of these ends a line.
        if found := _CONTROL.search(text):
            raise self.refusal(f"it holds the control character {found[0]!r}")
        self.tokens = [*tokens_of(_COMMENT_OR_STRING.sub(self._kept, text)), ""]

    def _kept(self, found: re.Match[str]) -> str:
        # In code that is skipped compilers take an open string for anything, and a comment in it may then be code.
        if found[0] == '"':
            raise self.refusal("a string does not end on its line")
        if found[0].startswith("/*") and not found[0][2:].endswith("*/"):
            raise self.refusal("a comment does not end")
        return " " if found[0].startswith("/*") else found[0]

    def refusal(self, found: str) -> NotCertified:
        """Return the error that says what is not as it is generated."""
        return NotCertified(
            f"{self.path} is not the C that is generated, so nothing is proved of it: {found}", file=self.path
        )

    def expect(self, code: str) -> None:
        """Pass these tokens."""
        for ours in tokens_of(code):
            if self.tokens[self.at] != ours:
                before = " ".join(self.tokens[max(self.at - 6, 0) : self.at])
                theirs = self.tokens[self.at] or "the end"
                raise self.refusal(f"after `{before}` it has `{theirs}` where `{ours}` is generated")
            self.at += 1

    def sees(self, code: str) -> bool:
        """Tell whether these tokens are next."""
        ours = tokens_of(code)
        return self.tokens[self.at : self.at + len(ours)] == ours

    def take(self) -> str:
        """Take the next token; "" is the end."""
        token = self.tokens[self.at]
        self.at += token != ""
        return token

    def take_to(self, last: str) -> tuple[str, ...]:
        """Take the tokens before the next `last`, and that one."""
        try:
            start, self.at = self.at, self.tokens.index(last, self.at) + 1
        except ValueError:
            raise self.refusal(f"it ends without a `{last}`") from None
        return tuple(self.tokens[start : self.at - 1])

    def value(self, sign: str, literal: str, real: Real) -> float:
        """Return what a literal is worth in the type, `sign` being "" or "-"."""
        if not LITERAL.fullmatch(literal) or literal.endswith("f") != (real == "float32"):
            raise self.refusal(f"`{literal}` is no {real} literal")
        value = nearest(sign + literal, real)
        if not np.isfinite(value):
            raise self.refusal(f"`{literal}` is not finite in {real}")
        return value

    def row(self, count: int, real: Real) -> list[float]:
        """Take `{a, b, c}`."""
        values = []
        for k in range(count):
            self.expect("," if k else "{")
            sign = self.take() if self.sees("-") else ""
            values.append(self.value(sign, self.take(), real))
        self.expect("}")
        return values

    def end(self) -> None:
        """Refuse more tokens."""
        if left := self.take():
            raise self.refusal(f"it goes on with `{left}` where nothing more is generated")


def nearest(text: str, real: Real) -> float:
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
    with np.errstate(over="ignore"):
        near = [np.nextafter(first, np.float32(-np.inf)), first, np.nextafter(first, np.float32(np.inf))]
    near = [value for value in near if np.isfinite(value)]
    return float(min(near, key=lambda v: (abs(Fraction(float(v)) - exact), int(v.view(np.uint32)) & 1)))
