"""Characters that look like those of a formula or of TOML, and what to type instead.

They come with text that is copied from a page or a word processor: a typographic minus, a dot or a cross to multiply,
superscripts, curved quotes, full-width forms, spaces that do not break, Greek letters.
"""

import re
import unicodedata

from lockstep.check.wording import shorten

_SAME = {
    "-": "\u2010\u2011\u2012\u2013\u2014\u2015\u2212\u00ad\ufe63",
    "*": "\u00d7\u00b7\u22c5\u2219\u2022\u2217\u2062",
    "/": "\u00f7\u2215\u2044",
    "<=": "\u2264\u2a7d",
    ">=": "\u2265\u2a7e",
    '"': "\u201c\u201d\u201e\u201f\u00ab\u00bb",
    "'": "\u2018\u2019\u201a\u201b\u2032\u00b4",
}
LOOK_ALIKES = {character: plain for plain, characters in _SAME.items() for character in characters}
"""What is on the keyboard for each of them."""

DECIMAL_POINT = "decimal numbers have a point: 0.5, not 0,5"
_DECIMAL_COMMA = re.compile(r"=[ \t]*+[-+]?[0-9]++,[0-9]")
_DESIGN = "it looks like a design: `lockstep explain`, `certify`, `generate` and `simulate` take those"
_PLAIN = "texts need quotes, lists [ ], and each key is given once"

_SUPERSCRIPTS = "\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079"


def typed_instead(character: str) -> str:
    """Return what to type instead of a character that looks like it, or nothing.

    >>> [typed_instead(c) for c in "\u2212\u00d7\u00b2\uff0b\u03b8 \u00e4"]
    ['-', '*', '**2', '+', 'theta', '', '']
    """
    if character.isascii():
        return ""
    if character in LOOK_ALIKES:
        return LOOK_ALIKES[character]
    if character in _SUPERSCRIPTS:
        return f"**{_SUPERSCRIPTS.index(character)}"
    if character == "\u221a":
        return "sqrt(...)"
    name = unicodedata.name(character, "")
    if name.startswith("GREEK SMALL LETTER "):
        return name.removeprefix("GREEK SMALL LETTER ").split(" ")[0].lower().replace("lamda", "lambda_")
    same = unicodedata.normalize("NFKC", character)
    return same if same != character and same.isascii() and same.isprintable() else ""


def advice_to_retype(text: str) -> str:
    r"""Return which characters of a text to type anew, and how; nothing where none looks like another one.

    >>> advice_to_retype("\u2212k*x\u00b2")
    'write `-` for \\u2212 (minus sign) and `**2` for \\xb2 (superscript two)'
    """
    found = {character: typed for character in text if (typed := typed_instead(character))}
    shown = [f"{_typed(typed)} for {shorten(one)} ({_name(one)})" for one, typed in list(found.items())[:3]]
    return f"write {' and '.join(shown)}" if shown else ""


def toml_instead_of(text: str, bare: str) -> str:
    r"""Return what to write where TOML stops.

    Args:
        text: the file.
        bare: the line that TOML stopped in, without its texts and its comment.

    >>> toml_instead_of("period = 0,1", "period = 0,1")
    'decimal numbers have a point: 0.5, not 0,5'
    """
    if typed := advice_to_retype(bare):
        return typed
    if _DECIMAL_COMMA.search(bare):
        return DECIMAL_POINT
    return _DESIGN if text.lstrip().startswith("{") else _PLAIN


def _typed(typed: str) -> str:
    return "a space" if typed == " " else f"`{typed}`"


def _name(character: str) -> str:
    return unicodedata.name(character, "no name").lower()
