"""A JSON file and typed access to its parts: each is there, of its kind, finite and of its shape, or is refused by name."""

import json
import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

import numpy as np

from lockstep.check.errors import ProblemError, demand
from lockstep.check.file_limits import check_document
from lockstep.check.files import read_text
from lockstep.check.wording import nearest, shorten

T = TypeVar("T")
Reader = Callable[[Any, str], Any]
"""From a value of JSON and its place to what it says, or a `ProblemError` that names the place."""

A_DESIGN = (
    "a file written by `lockstep design`, which takes the problem file, or a folder by `lockstep build`"
)


def load_json(path: Path) -> Any:
    """Read a JSON file, as `parse_json` does its text.

    Raises:
        ProblemError: not there, no regular file, not readable, or what `parse_json` refuses.
    """
    return parse_json(read_text(path, expected=A_DESIGN), str(path))


def parse_json(text: str, where: str) -> Any:
    """Parse JSON; NaN and infinities, which JSON does not have, are read as NaN and refused later.

    Raises:
        ProblemError: not JSON, a key given twice, or a number of thousands of digits.
    """
    try:
        content = json.loads(text, parse_constant=lambda _name: math.nan, object_pairs_hook=_object)
        check_document(content)
    except ProblemError as error:
        raise error.within(where) from None
    except (ValueError, RecursionError) as error:
        # Python refuses whole numbers of more than 4300 digits with a plain ValueError.
        found = "a problem file" if where.endswith(".toml") else f"it is not JSON ({error})"
        raise ProblemError(found, where=where, expected=A_DESIGN) from None
    return content


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return an object of JSON, each key of which is given once: of two values one would be ignored silently."""
    found = dict(pairs)
    if len(found) < len(pairs):
        twice = next(key for key, count in Counter(key for key, _ in pairs).items() if count > 1)
        raise ProblemError(f"the key `{twice}` is given twice", expected="each key once")
    return found


def only(content: Any, known: Iterable[str], where: str) -> None:
    """Refuse what is no object of JSON, or holds a key that is not known, with the nearest one that is."""
    names = list(known)
    demand(isinstance(content, dict), f"a {type(content).__name__}", where, "an object")
    for key in content:
        if key not in names:
            found, known = f"the key `{shorten(key)}` is unknown", ", ".join(f"`{name}`" for name in names)
            raise ProblemError(found, where=where, expected=known, remedy=nearest(key, names))


def part(content: Mapping[str, Any], key: str, kind: type) -> Any:
    """Return what an object holds under a key, of the kind it has to be."""
    value = content.get(key)
    found = f"`{key}` is {'missing' if value is None else 'a ' + type(value).__name__}"
    demand(isinstance(value, kind), found, "", f"a {kind.__name__}")
    return value


def number(value: Any, where: str) -> float:
    """Return a number as a finite double."""
    plain = isinstance(value, int | float) and not isinstance(value, bool)
    try:
        found = float(value) if plain else value
    except OverflowError:
        found = math.inf
    demand(plain and math.isfinite(found), f"{found!r}", where, "a finite number")
    return float(found)


def whole(low: int, high: int | None = None, of: str = "") -> Callable[[Any, str], int]:
    """Return the reader of a whole number in a range."""
    expected = f"a whole number{of} from {low} {'up' if high is None else f'to {high}'}"

    def read(value: Any, where: str) -> int:
        plain = isinstance(value, int) and not isinstance(value, bool)
        holds = plain and low <= value and (high is None or value <= high)
        demand(holds, shorten(repr(value)), where, expected)
        return int(value)

    return read


def position(value: Any, where: str) -> int:
    """Return a position that is counted from 1, counted from 0."""
    return whole(1)(value, where) - 1


def not_negative(value: Any, where: str) -> float:
    """Return a finite double from 0 up."""
    found = number(value, where)
    demand(found >= 0, f"{found!r}", where, "a number from 0 up")
    return found


def above_zero(value: Any, where: str) -> float:
    """Return a finite double above 0."""
    found = number(value, where)
    demand(found > 0, f"{found!r}", where, "a number above 0")
    return found


def one_of(value: Any, known: tuple[T, ...], where: str) -> T:
    """Return a value that is one of those known."""
    for one in known:
        if value == one and type(value) is type(one):
            return one
    said = shorten(repr(value))
    raise ProblemError(said, where=where, expected=" or ".join(json.dumps(one) for one in known))


def among(*known: Any) -> Reader:
    """Return the reader of a value that is one of those known."""
    return lambda value, where: one_of(value, known, where)


def flag(value: Any, where: str) -> bool:
    """Return true or false."""
    demand(isinstance(value, bool), _kind(value), where, "true or false")
    return bool(value)


def record(value: Any, where: str, readers: Mapping[str, Reader]) -> list[Any]:
    """Return what an object holds under each key, by the reader of the key; it may hold no others."""
    only(value, readers, where)
    return [read(value.get(key), f"{where}, `{key}`") for key, read in readers.items()]


def made(kind: Callable[..., T], readers: Mapping[str, Reader]) -> Callable[[Any, str], T]:
    """Return the reader of an object of JSON that says what `kind` is made of, in its order."""
    return lambda value, where: kind(*record(value, where, readers))


def readers_of(kind: type) -> dict[str, Reader]:
    """Return the reader of each field of a dataclass, which its annotation names: `Annotated[float, not_negative]`."""
    hints = get_type_hints(kind, include_extras=True)
    return {field: hint.__metadata__[0] for field, hint in hints.items()}


def each(value: Any, where: str, read: Reader, name: str = "entry") -> tuple[Any, ...]:
    """Return the entries of a list, each by the reader and named by its place."""
    demand(isinstance(value, list), _kind(value), where, "a list")
    return tuple(read(one, f"{where}, {name} {i}") for i, one in enumerate(value, start=1))


def or_none(read: Reader, otherwise: Any = None) -> Reader:
    """Return the reader of what need not be there."""
    return lambda value, where: otherwise if value is None else read(value, where)


def interval(value: Any, where: str) -> tuple[float, float]:
    """Return a lower and an upper bound, infinite where there is none."""
    demand(isinstance(value, list) and len(value) == 2, f"{value!r}", where, "a lower and an upper bound")
    return or_none(number, -math.inf)(value[0], where), or_none(number, math.inf)(value[1], where)


def _kind(value: Any) -> str:
    return "it is missing" if value is None else f"a {type(value).__name__}"


def matrix(rows: int | None = None, columns: int | None = None, *, symmetric: bool = False) -> Reader:
    """Return the reader of a matrix by rows; without a size, of one with as many as there are.

    symmetric: whether it has to be its own transpose, exactly.
    """

    def read(value: Any, where: str) -> Any:
        given = value if isinstance(value, list) and all(isinstance(row, list) for row in value) else None
        height = rows if rows is not None else len(given or [])
        width = columns if columns is not None else max(map(len, given or []), default=0)
        if given is None or len(given) != height or any(len(row) != width for row in given):
            said = f"{height} rows of {width} numbers"
            raise ProblemError("it is missing or has another shape", where=where, expected=said)
        found = np.array([[number(x, where) for x in row] for row in given], dtype=float).reshape(
            height, width
        )
        demand(not symmetric or np.array_equal(found, found.T), "it is not symmetric", where, "P = P'")
        return found

    return read


def vector(size: int | None = None) -> Reader:
    """Return the reader of a vector; without a size, of one with as many numbers as there are."""

    def read(value: Any, where: str) -> Any:
        said, whole = f"{'' if size is None else size} numbers", isinstance(value, list)
        demand(whole and size in (None, len(value)), "it is missing or has another length", where, said)
        return np.array([number(x, where) for x in value], dtype=float)

    return read
