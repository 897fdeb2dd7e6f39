"""Words for messages: the nearest known name, and texts cut to a readable length."""

import difflib
from collections.abc import Iterable


def nearest(name: str, known: Iterable[str]) -> str:
    """Return "did you mean `b`?" for the known name nearest to `name`, or nothing.

    >>> nearest("theta_1", ["theta_l", "omega_l"])
    'did you mean `theta_l`?'
    >>> nearest("tahn", ["tan", "tanh"])
    'did you mean `tanh`?'
    """
    names = list(known)
    swapped = [k for k in names if sorted(k.lower()) == sorted(name.lower())]
    close = swapped or difflib.get_close_matches(name[:100], names, n=1)
    return f"did you mean `{close[0]}`?" if close else ""


def visible(text: str) -> str:
    r"""Return `text` with an escape for each character that is not printed as itself; line ends stay.

    >>> visible("certified NO\x1b[2A")
    'certified NO\\x1b[2A'
    """
    return "".join(c if c.isprintable() or c == "\n" else ascii(c)[1:-1] for c in text)


def shorten(text: str, width: int = 60) -> str:
    """Return `text` on one line of printable ASCII, cut in the middle when it is longer than `width`."""
    line = text if text.isascii() and text.isprintable() else ascii(text)[1:-1]
    half = (width - 5) // 2
    return line if len(line) <= width else f"{line[:half]} ... {line[-half:]}"
