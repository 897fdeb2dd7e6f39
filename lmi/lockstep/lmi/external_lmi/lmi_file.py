"""The file format of a linear matrix inequality with a point.

    {
      "format": "lockstep-lmi 1",
      "variables": ["p11", "p12", "p22"],
      "constraints": [
        {"name": "P", "sign": ">", "constant": [["0", "0"], ["0", "0"]],
         "terms": {"p11": [[1, 0], [0, 0]], "p12": [[0, 1], [1, 0]], "p22": [[0, 0], [0, 1]]}}
      ],
      "point": {"p11": "3/2", "p12": "0.5", "p22": "1"}
    }

The claim of a constraint is F(x) = constant + sum x_i terms_i > 0 (positive definite), >= 0 (semidefinite) or = 0 (every
entry; any shape). A number is text or a JSON number, a decimal or a quotient of whole numbers, and it is the number as
written: 0.1 is 1/10, not the double next to it. `constant` may be absent where there are terms: then it is 0. Without
variables, a matrix alone is claimed to be positive.
"""

import json
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from flint import fmpq

from lockstep.check.errors import ProblemError, demand
from lockstep.check.files import read_text
from lockstep.check.json_text import only
from lockstep.check.wording import shorten

FORMAT = "lockstep-lmi 1"
SIGNS = (">", ">=", "=")
Sign = Literal[">", ">=", "="]
Rational = np.ndarray

LONGEST, LARGEST_EXPONENT = 2_000, 1_000
"""Characters of a number, and its decimal exponent: exact arithmetic costs as much as numbers are long."""

MOST_ROWS = 500
"""Of a constraint."""

_DECIMAL = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_QUOTIENT = re.compile(r"[+-]?\d+/\d+")


@dataclass(frozen=True, eq=False)
class Constraint:
    """One claim F(x) > 0, >= 0 or = 0: the matrices over the rationals."""

    name: str
    sign: Sign
    constant: Rational
    terms: Mapping[str, Rational]

    def at(self, point: Mapping[str, Any]) -> Rational:
        """Return F(x), exactly."""
        value = self.constant
        for name, matrix in self.terms.items():
            if point[name]:
                value = value + point[name] * matrix
        return value


@dataclass(frozen=True, eq=False)
class Lmi:
    """Variables, constraints and a point."""

    variables: tuple[str, ...]
    constraints: tuple[Constraint, ...]
    point: Mapping[str, Any]

    @classmethod
    def read(cls, path: Path | str) -> "Lmi":
        """Read a file.

        Raises:
            ProblemError: not there, not JSON, or not of this format, with the place.
        """
        path = Path(path)
        text = read_text(path, expected=f"an LMI file (`{FORMAT}`)")
        try:
            return cls.of(json.loads(text, parse_float=_Number, parse_int=_Number, object_pairs_hook=_once))
        except ProblemError as error:
            raise error.within(str(path)) from None
        except (ValueError, RecursionError) as error:
            raise ProblemError(f"it is not JSON ({error})", where=str(path), expected=f"`{FORMAT}`") from None

    @classmethod
    def of(cls, content: Any) -> "Lmi":
        """Read what a file holds.

        Raises:
            ProblemError: not of this format.
        """
        only(content, ("format", "title", "variables", "constraints", "point"), "the LMI")
        if content.get("format", FORMAT) != FORMAT:
            raise ProblemError(shorten(repr(content["format"])), where="`format`", expected=f"`{FORMAT}`")
        variables = content.get("variables", [])
        if (
            not isinstance(variables, list)
            or not all(isinstance(v, str) for v in variables)
            or len({*variables}) < len(variables)
        ):
            raise ProblemError("no list of different names", where="`variables`", expected='["x1", "x2"]')
        listed = content.get("constraints")
        if not isinstance(listed, list) or not listed:
            raise ProblemError("none", where="`constraints`", expected="one object or more")
        constraints = tuple(_constraint(one, k + 1, variables) for k, one in enumerate(listed))
        point = content.get("point", {})
        if not isinstance(point, dict) or {*point} != {*variables}:
            raise ProblemError(
                f"values of {shorten(str(sorted(point) if isinstance(point, dict) else point))}",
                where="`point`",
                expected="a number for each variable and nothing else",
            )
        return cls(
            tuple(variables),
            constraints,
            {v: number(point[v], f"`point`, `{shorten(v)}`") for v in variables},
        )


class _Number(str):
    """A number of JSON, as written."""

    __slots__ = ()


def number(value: Any, where: str) -> fmpq:
    """Return a number as written, exactly.

    >>> number("0.1", ""), number("-3/4", ""), number("1e-3", "")
    (1/10, -3/4, 1/1000)
    """
    if isinstance(value, int | float) and not isinstance(value, bool):
        value = repr(value)
    demand(isinstance(value, str), shorten(repr(value)), where, 'a number, or text like "0.1" or "-3/4"')
    text = value.strip()
    if len(text) > LONGEST:
        raise ProblemError(f"a number of {len(text)} characters", where=where, expected=f"at most {LONGEST}")
    if _QUOTIENT.fullmatch(text) and text.isascii():
        above, below = map(int, text.split("/"))
        if below:
            return fmpq(above, below)
    elif _DECIMAL.fullmatch(text) and text.isascii():
        mantissa, _, exponent = text.lower().partition("e")
        if len(exponent) > 6 or abs(int(exponent or 0)) > LARGEST_EXPONENT:
            expected = f"at most {LARGEST_EXPONENT}"
            raise ProblemError(f"the exponent {exponent}", where=where, expected=expected)
        whole, _, fraction = mantissa.partition(".")
        shift = int(exponent or 0) - len(fraction)
        return fmpq(int(whole + fraction)) * fmpq(10) ** shift
    raise ProblemError(f"`{shorten(text)}`", where=where, expected='a number, or text like "0.1" or "-3/4"')


def _constraint(content: Any, k: int, variables: list[str]) -> Constraint:
    place = f"constraint {k}"
    only(content, ("name", "sign", "constant", "terms"), place)
    sign, name, terms = content.get("sign", ">"), content.get("name", f"F{k}"), content.get("terms", {})
    if sign not in SIGNS:
        raise ProblemError(shorten(repr(sign)), where=f"{place}, `sign`", expected=" or ".join(SIGNS))
    if not isinstance(terms, dict) or any(v not in variables for v in terms):
        unknown = [v for v in terms if v not in variables] if isinstance(terms, dict) else terms
        raise ProblemError(
            shorten(f"terms of {unknown}"), where=f"{place}, `terms`", expected="the variables alone"
        )
    matrices = {v: _matrix(rows, f"{place}, term `{shorten(v)}`") for v, rows in terms.items()}
    given = _matrix(content["constant"], f"{place}, `constant`") if "constant" in content else None
    shapes = {m.shape for m in (*matrices.values(), *([] if given is None else [given]))}
    if len(shapes) != 1:
        found = " and ".join(f"{r} x {c}" for r, c in sorted(shapes)) or "no matrix"
        raise ProblemError(found, where=place, expected="matrices of one shape")
    (shape,) = shapes
    if sign != "=" and shape[0] != shape[1]:
        raise ProblemError(f"{shape[0]} x {shape[1]}", where=place, expected="square matrices")
    constant = given if given is not None else np.full(shape, fmpq(0), dtype=object)
    return Constraint(str(name), sign, constant, matrices)


def _matrix(rows: Any, where: str) -> Rational:
    if (
        not isinstance(rows, list)
        or not rows
        or not all(isinstance(row, list) and len(row) == len(rows[0]) for row in rows)
    ):
        raise ProblemError("no matrix", where=where, expected="a list of rows of the same length")
    if max(len(rows), len(rows[0])) > MOST_ROWS or not rows[0]:
        raise ProblemError(f"{len(rows)} x {len(rows[0])}", where=where, expected=f"1 to {MOST_ROWS} rows")
    found = np.empty((len(rows), len(rows[0])), dtype=object)
    for (i, j), _ in np.ndenumerate(found):
        found[i, j] = number(rows[i][j], f"{where}, row {i + 1}, column {j + 1}")
    return found


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        twice = next(key for key, count in Counter(key for key, _ in pairs).items() if count > 1)
        raise ProblemError(f"the key `{shorten(twice)}` is given twice", expected="each key once")
    return found
