"""Which names the generated C may have: the functions and files of a design are prefixed with them."""

import re

from lockstep.check.errors import demand
from lockstep.model.formulas.names import C_WORDS

HEADERS = frozenset(
    """main fortran assert ctype errno fenv float inttypes iso646 limits locale math setjmp signal stdarg stdbool stddef
    stdint stdio stdlib string tgmath time wchar wctype features""".split()  # noqa: SIM905
)
"""Names of C's headers, beside which files of such a name would stand, and what linkers take for the program or Fortran."""

_IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,39}")


def check_identifier(name: str, where: str) -> None:
    """Refuse a name that cannot prefix C identifiers and file names (C99 6.4.2; C++ keywords and C's headers too).

    >>> check_identifier("arm 1", "agent")
    Traceback (most recent call last):
    lockstep.check.errors.ProblemError: agent: `arm 1` is no C identifier; expected a letter, then ...
    """
    found = f"`{name}` is no C identifier"
    expected = "a letter, then at most 39 letters, digits or underscores; no keyword, no name of a C header"
    remedy = "rename it: the name prefixes the generated functions"
    demand(_IDENTIFIER.fullmatch(name) and name not in C_WORDS | HEADERS, found, where, expected, remedy)
