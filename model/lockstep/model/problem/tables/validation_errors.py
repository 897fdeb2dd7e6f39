"""What pydantic found wrong with a problem file, in the words of the file's author: one `ProblemError`."""

import re
import types
from collections.abc import Iterator, Sequence
from math import isinf
from typing import Any, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from lockstep.check.errors import ProblemError
from lockstep.check.wording import nearest, shorten
from lockstep.model.formulas.confusables import DECIMAL_POINT
from lockstep.model.problem.tables.schema import ProblemFile

Location = tuple[int | str, ...]
_MOST = 3
"""Errors told in full; a file with more of them is better read again after these."""


def problem_error(error: ValidationError) -> ProblemError:
    """Join the errors of a validation into one; misspelt keys first, for they are why others are missing."""
    details = [d for d in error.errors(include_url=False) if not _is_second_opinion(d["loc"])]
    parts = {d["loc"][:k] for d in details for k in range(len(d["loc"]))}
    # a list is said to be too short of what is wrong in it
    details = [d for d in details if d["loc"] not in parts]
    details.sort(key=lambda d: d["type"] != "extra_forbidden")
    first, *rest = [_one(*_place(d)) for d in details[:_MOST]]
    if not rest:
        return first
    more = len(details) - 1 - len(rest)
    others = [f"also {one.where}: {one.found}" if one.where else f"also {one.found}" for one in rest]
    remedy = "; ".join([first.remedy] * bool(first.remedy) + others + [f"and {more} more"] * bool(more))
    return ProblemError(first.found, where=first.where, expected=first.expected, remedy=remedy)


def toml_path(location: Location) -> str:
    """Write a place as the file does.

    >>> toml_path(("design", "gains", 1, "B", 0, 2))
    '[[design.gains]] 2, B, row 1, column 3'
    >>> toml_path(("agent", "states", 0))
    '[agent] states, entry 1'
    """
    if location[:2] == ("design", "gains") and len(location) > 2:
        return _gains_path(location[2:])
    split = next((k for k, part in enumerate(location) if isinstance(part, int)), len(location))
    names, tail = [shorten(str(part)) for part in location[:split]], location[split:]
    if not names:
        return ""
    if len(names) < 2 and not tail:
        return f"[{names[0]}]" if _description(location[:1]).startswith("the table") else names[0]
    return ", ".join([f"[{'.'.join(names[:-1])}] {names[-1]}", *_tail(tail)])


def _gains_path(location: Location) -> str:
    """Write a place from [[design.gains]] on: in one of these tables, or in whichever of them."""
    first, *rest = location
    which = str(first + 1) if isinstance(first, int) else shorten(first)
    return ", ".join([f"[[design.gains]] {which}", *_tail(rest)])


def _table_path(location: Location) -> str:
    """Write the head of a table as the file does: [design.weights], or nothing for the first lines."""
    if not location or any(isinstance(part, int) for part in location):
        return toml_path(location)
    head = f"[{'.'.join(str(part) for part in location)}]"
    return f"[{head}]" if location == ("design", "gains") else head


def _tail(parts: Sequence[int | str]) -> Iterator[str]:
    numbers = sum(isinstance(part, int) for part in parts)
    words = iter(("row", "column") if numbers == 2 else ("entry",) * numbers)
    for part in parts:
        yield f"{next(words)} {part + 1}" if isinstance(part, int) else shorten(part)


def _place(detail: ErrorDetails) -> tuple[Location, str, Any]:
    """Return where an error is, its kind and what was found; an output's own check says which one it is."""
    location = tuple(detail["loc"])
    if detail["type"] == "output":
        return (*location, detail["ctx"]["name"]), "output", detail["ctx"]["value"]
    return location, detail["type"], detail["input"]


def _one(location: Location, kind: str, value: Any) -> ProblemError:
    if kind == "extra_forbidden":
        return _unknown(location)
    location = _known(location)
    expected = _description(location)
    if kind == "missing":
        table = _table_path(location[:-1])
        return ProblemError(f"the key `{location[-1]}` is missing", where=table, expected=expected)
    if not location:
        return ProblemError(f"the document is {_shown(value)}", expected="a table with [agent] and [network]")
    name = shorten(next((part for part in reversed(location) if isinstance(part, str)), ""))
    subject = f"`{name}` is" if isinstance(location[-1], str) else "found"
    choices = re.findall(r'"(\w+)"', expected) if kind == "literal_error" else []
    split = kind in ("interval", "float_type") and isinstance(value, list) and set(map(type, value)) == {int}
    remedy = nearest(value, choices) if isinstance(value, str) else DECIMAL_POINT * split
    found, where = f"{subject} {_shown(value)}", toml_path(location)
    return ProblemError(found, where=where, expected=expected, remedy=remedy)


def _unknown(location: Location) -> ProblemError:
    *table, key = location
    known = list((_model(tuple(table)) or ProblemFile).model_fields)
    elsewhere = [
        _table_path(place) or "the first lines, before any table"
        for place, other in _tables()
        if key in other.model_fields
    ]
    remedy = nearest(str(key), known)
    if elsewhere:
        there = f"`{key}` belongs in {' or '.join(elsewhere)}"
        remedy = f"{remedy} {there}" if remedy else there
    return ProblemError(
        f"unknown key `{shorten(str(key))}`",
        where=_table_path(tuple(table)),
        expected=", ".join(known),
        remedy=remedy,
    )


def _shown(value: Any) -> str:
    """Write a value as TOML does, in short."""
    match value:
        case bool():
            return str(value).lower()
        case str():
            return f'"{shorten(value)}"'
        case int() if abs(value) >= 2**1024:
            return f"{shorten(hex(value), 20)}, a number too large for a double"
        case float() if isinf(value):
            return f"{value}, or a number too large for a double"
        case int() | float():
            return str(value)
        case dict():
            return "a table"
        case list() | tuple():
            return f"a list, {shorten(str(value), 40)}"
        case None:
            return "nothing"
        case _:
            return shorten(str(value), 40)


def _is_second_opinion(location: Location) -> bool:
    """Tell apart: of `initial`, a list or "random", pydantic reports both as failed; of a number or a table by name, too."""
    if location and str(location[-1]).startswith("dict[") and _is_type(location, len(location) - 1):
        return True  # no table at all: what is wrong with it as a number is told
    return any(str(part).startswith("literal[") and _is_type(location, k) for k, part in enumerate(location))


def _known(location: Location) -> Location:
    """Drop the parts that name a type of a union, not a place in the file."""
    return tuple(part for k, part in enumerate(location) if not _is_type(location, k))


def _is_type(location: Location, k: int) -> bool:
    """Tell whether part k names the type that was tried: it follows a key that may hold several types."""
    model = _model(location[: k - 1]) if k else None
    field = model.model_fields.get(str(location[k - 1])) if model else None
    if field is None or get_origin(field.annotation) not in (Union, types.UnionType):
        return False
    return len([t for t in get_args(field.annotation) if t is not types.NoneType]) > 1


def _description(location: Location) -> str:
    """Return what is expected at a place: the description of the innermost field on the way to it."""
    found = ""
    for k in range(1, len(location) + 1):
        model = _model(location[: k - 1])
        if model is not None and location[k - 1] in model.model_fields:
            found = model.model_fields[str(location[k - 1])].description or found
    return found


def _model(location: Location) -> type[BaseModel] | None:
    """Return the table at a place, or None where there is none."""
    return dict(_tables()).get(tuple(part for part in location if isinstance(part, str)))


def _tables(
    model: type[BaseModel] = ProblemFile, place: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], type[BaseModel]]]:
    yield place, model
    for name, field in model.model_fields.items():
        for inner in _models_in(field.annotation):
            yield from _tables(inner, (*place, name))


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and not get_origin(annotation) and issubclass(annotation, BaseModel):
        yield annotation
    elif get_origin(annotation) in (Union, types.UnionType, tuple) or hasattr(annotation, "__metadata__"):
        for argument in get_args(annotation):
            yield from _models_in(argument)
