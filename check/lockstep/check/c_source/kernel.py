"""[A B; C D] from the unrolled statements of a kernel, in the order in which they compute.

Each value is a linear form in (x, r) with the number of roundings behind every coefficient; every name is defined once,
before it is used.
"""

import re
from fractions import Fraction
from typing import Annotated, NamedTuple

import numpy as np

from lockstep.check.c_source.tokens import CText
from lockstep.check.sampled.discretise import Real

Form = dict[int, tuple[Fraction, int]]
"""A linear form: place in (x, r) -> (coefficient, roundings it has passed through)."""

_NAME = re.compile("[xrt](?:0|[1-9][0-9]*)")
_LARGEST = Fraction(np.finfo(float).max)


class Shape(NamedTuple):
    """Dimensions of a controller: nc states, q outputs, m inputs, nn neighbours."""

    order: int
    outputs: int
    inputs: int
    neighbours: int

    @property
    def terms(self) -> int:
        """Products of [A B; C D] times (x, r)."""
        return (self.order + self.inputs) * (self.order + self.outputs)


def read_statements(
    file: CText, shape: Shape, real: Real
) -> tuple[Annotated[np.ndarray, "k l"], Annotated[np.ndarray, "k l"]]:
    """Take the statements of a kernel; return the table they compute and the roundings behind each product."""
    n, q, m, _ = shape
    read = _Statements(file, real, _elements("x", n) + _elements("r", q))
    rows = _elements("x_next", n) + _elements("u_next", m)
    c_type = "float" if real == "float32" else "double"
    written: dict[tuple[str, ...], Form] = {}
    while not (file.sees("(") or file.sees("}")):
        found: Form | None = None
        match statement := file.take_to(";"):
            case ("const", kind, name, "=", *value) if kind == c_type and _NAME.fullmatch(name):
                if (name,) not in read.known and (found := read.form(tuple(value))) is not None:
                    read.known[name,] = found
            case (_, "[", _, "]", "=", *value) if (row := statement[:4]) in rows and row not in written:
                found = {} if len(value) == 1 and read.is_zero(value[0]) else read.form(tuple(value))
                if found is not None:
                    written[row] = found
        if found is None:
            raise file.refusal(f"`{' '.join(statement)};` is no statement of a kernel")
    if missing := ["".join(row) for row in rows if row not in written]:
        raise file.refusal(f"`{missing[0]}` is not written")
    table, roundings = np.zeros((n + m, n + q)), np.zeros((n + m, n + q), dtype=int)
    for i, row in enumerate(rows):
        for j, (coefficient, count) in written[row].items():
            table[i, j], roundings[i, j] = float(coefficient), count
    return table, roundings


def _elements(name: str, size: int) -> list[tuple[str, ...]]:
    return [(name, "[", str(k), "]") for k in range(size)]


class _Statements:
    """The names that are known so far, and what an expression of them is; None if it is none of ours."""

    def __init__(self, file: CText, real: Real, inputs: list[tuple[str, ...]]) -> None:
        self.file, self.real = file, real
        self.known: dict[tuple[str, ...], Form] = {one: {k: (Fraction(1), 0)} for k, one in enumerate(inputs)}

    def form(self, value: tuple[str, ...]) -> Form | None:
        known = self.known
        if value in known:
            return known[value]
        match value:
            case ("-", name) if (name,) in known:
                return {place: (-a, k) for place, (a, k) in known[name,].items()}
            case (*signs, literal, "*", name) if signs in ([], ["-"]) and (name,) in known:
                return self.product("".join(signs), literal, known[name,])
            case (left, "+" | "-" as sign, right) if (left,) in known and (right,) in known:
                return _sum(known[left,], known[right,], 1 if sign == "+" else -1)
        return None

    def is_zero(self, value: str) -> bool:
        """Tell whether the row of an output without terms is written: no name is a literal."""
        return (value,) not in self.known and self.file.value("", value, self.real) == 0

    def product(self, sign: str, literal: str, form: Form) -> Form | None:
        """Multiply an input by a literal: one rounding. The product of two rounded things is no form of ours."""
        value = Fraction(self.file.value(sign, literal, self.real))
        found = {j: (value * a, 1) for j, (a, k) in form.items() if k == 0 and abs(value * a) <= _LARGEST}
        return found if len(found) == len(form) == 1 else None


def _sum(a: Form, b: Form, sign: int) -> Form | None:
    """Add two forms: one rounding more for each coefficient. Doubling an input is exact."""
    if a == b and sign == 1 and list(a.values()) == [(Fraction(1), 0)]:
        return {place: (2 * value, k) for place, (value, k) in a.items()}
    if a.keys() & b.keys():
        return None
    return {j: (value, k + 1) for j, (value, k) in a.items()} | {
        j: (sign * v, k + 1) for j, (v, k) in b.items()
    }
