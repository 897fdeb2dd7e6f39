"""The lines of a problem file on which its keys stand."""

import re
import tomllib

_HEADER = re.compile(r"\[\[?([^\[\]]+)\]\]?\s*(#.*)?$")
_KEY = re.compile(
    r"""((?:[A-Za-z0-9_-]+|"[^"]*"|'[^']*')(?:\s*\.\s*(?:[A-Za-z0-9_-]+|"[^"]*"|'[^']*'))*)\s*="""
)


def lines_of_keys(text: str) -> dict[tuple[str, ...], int]:
    """Return the line, from 1, of each key of a TOML text: a key of an inline table stands where the table does.

    A line counts only where the text up to it is whole: what stands in a value of several lines is no key.

    >>> lines_of_keys('[a]\\nb.c = 1\\nd = { e = 2 }\\n')
    {('a',): 1, ('a', 'b'): 2, ('a', 'b', 'c'): 2, ('a', 'd'): 3, ('a', 'd', 'e'): 3}
    >>> lines_of_keys("a = '''\\nb = 1\\n'''\\nc = 2")
    {('a',): 1, ('c',): 4}
    """
    found: dict[tuple[str, ...], int] = {}
    table: tuple[str, ...] = ()
    lines = text.splitlines()
    begin = 0
    while begin < len(lines):
        line = lines[begin].strip()
        if header := _HEADER.match(line):
            table = _split(header[1])
            _note(found, table, begin + 1)
        elif key := _KEY.match(line):
            keys = (*table, *_split(key[1]))
            end, value = _value(lines, begin)
            _note(found, keys, begin + 1)
            _inside(found, keys, _inner(value, _split(key[1])), begin + 1)
            begin = end
        begin += 1
    return found


def _value(lines: list[str], begin: int) -> tuple[int, object]:
    """Return the last line of the value that begins on a line, and what that and the lines up to it hold."""
    for end in range(begin, len(lines)):
        try:
            return end, tomllib.loads("\n".join(lines[begin : end + 1]))
        except tomllib.TOMLDecodeError:
            continue
    return begin, None


def _inner(value: object, keys: tuple[str, ...]) -> object:
    for key in keys:
        value = value.get(key) if isinstance(value, dict) else None
    return value


def _inside(found: dict[tuple[str, ...], int], keys: tuple[str, ...], value: object, line: int) -> None:
    if isinstance(value, dict):
        for key, inner in value.items():
            found.setdefault((*keys, key), line)
            _inside(found, (*keys, key), inner, line)


def _note(found: dict[tuple[str, ...], int], keys: tuple[str, ...], line: int) -> None:
    for k in range(1, len(keys) + 1):
        found.setdefault(keys[:k], line)


def _split(dotted: str) -> tuple[str, ...]:
    return tuple(part.strip().strip("\"'") for part in dotted.split("."))
