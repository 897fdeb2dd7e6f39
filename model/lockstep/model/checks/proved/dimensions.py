"""Dimensions of every term of every formula, from [agent.units], by pint: terms that are added have one dimension and unit.

N and kN differ by a factor of 1000, which is carried as one more dimension, a power of ten: added to each other without it
they would be another plant, and so would the sine of degrees. What a number multiplies may have any factor, pi/180 or 3.6,
but for those of `PURE`, by which no unit converts.

d/dt x has the dimension of x over time; sin, exp, tanh and their like take and give pure numbers; a power of a quantity has a
number as its exponent. Angles are pure numbers (BIPM, The International System of Units, 9th ed., 2019, section 5.4.8).
A number in a formula is pure where every parameter has a unit; without parameters, or with one that has no unit, it may stand
for a coefficient of any dimension.
"""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from lockstep.check.errors import ProblemError
from lockstep.check.expression.node import Undefined
from lockstep.check.expression.text import parse
from lockstep.model.checks.proved.finding import CheckFinding
from lockstep.model.problem.tables.schema import AgentTable

REMEDY = "correct the formula, or a unit in [agent.units]; a number has no dimension: make it a parameter that has a unit"

Powers = Mapping[str, float]
"""Exponents of the base dimensions, and of 10 where a unit is no coherent one of the SI: NaN where not known; none is 0."""

NONE, PURE = 1e-9, frozenset({1.0, 2.0, 3.0, 4.0, 0.5, 0.25})
"""An exponent that is 0 but for rounding: units differ by more than one part in 1e8, or are one. And sizes of numbers
by which no unit converts."""

CLOCKS = 1e-9, 1e-6, 1e-3, 1.0, 60.0, 3600.0, 86400.0
"""Units of time, in s, that an agent may be written in: with z in m and v in km/h, z' = v would be in 3.6 s."""

SAME = frozenset({"add", "sub", "fmin", "fmax"})
COMPARED = frozenset({"lt", "le", "atan2"})
KEPT = frozenset({"neg", "fabs"})


@dataclass(frozen=True)
class Quantity:
    """A part of a formula: its dimension, None where it may be any, and its value where it is a number."""

    powers: Powers | None
    value: float | None = None


def check_units(table: AgentTable) -> CheckFinding:
    """Check the formulas of [agent].

    Returns:
        "proved" where every name has a unit, "undecided" where some have none.

    Raises:
        ProblemError: a unit that pint does not know, or a formula whose terms differ in dimension: names the term.
    """
    if not table.units:
        return CheckFinding("units", "undecided", "[agent.units] is empty")
    names = [*table.states, *table.inputs, *table.parameters]
    pure = bool(table.parameters) and all(name in table.units for name in table.parameters)
    known = {name: Quantity(dimension(text, name)) for name, text in table.units.items()}
    symbols = {name: known.get(name, Quantity(None)) for name in names}
    symbols = {name: Quantity(q.powers, table.parameters.get(name)) for name, q in symbols.items()}
    algebra = _Dimensions(pure)
    time = _unit_of_time(table, symbols, algebra)
    symbols["t"] = Quantity(time)
    for state, text in table.dynamics.items():
        own = symbols[state].powers
        rate = None if own is None else product_of(own, time, -1)
        _check(text, symbols, algebra, f"[agent.dynamics] {state}", rate, f"d/dt {state}")
    for output, text in table.outputs:
        asked = known.get(output, Quantity(None)).powers
        _check(text, symbols, algebra, f"[agent.outputs] {output}", asked, output)
    counted = {"unit_of_time": float(10 ** time["10"])} if "10" in time else {}
    clock = f", with time, and the period, in units of {counted['unit_of_time']:g} s" if counted else ""
    missing = [name for name in names if name not in table.units]
    if missing:
        figure = f"no contradiction{clock}; no unit is given for {', '.join(missing)}"
        return CheckFinding("units", "undecided", figure, counted or None, {"without": missing})
    of = "pure" if pure else "coefficients of any dimension"
    return CheckFinding(
        "units",
        "proved",
        f"every term of {len(table.dynamics)} equations agrees{clock}; numbers are {of}",
        {"pure": pure, **counted},
    )


def _unit_of_time(table: AgentTable, symbols: dict[str, Quantity], algebra: _Dimensions) -> Powers:
    """Return that of the first term that has one: an agent may be written in minutes, all of it then."""
    for state, text in table.dynamics.items():
        for term in _terms(text):
            try:
                found = parse(term, symbols | {"t": Quantity(None)}, algebra, where=state).powers
            except ProblemError:
                continue
            time = _known(product_of(symbols[state].powers or {}, found or {}, -1))
            is_clock = min(abs(time.get("10", 0.0) - math.log10(clock)) for clock in CLOCKS) < NONE
            if time.keys() - {"10"} == {"[time]"} and time["[time]"] == 1 and is_clock:
                return time
    return {"[time]": 1.0}


def _check(
    text: str,
    symbols: Mapping[str, Quantity],
    algebra: _Dimensions,
    where: str,
    asked: Powers | None,
    of: str,
) -> None:
    for term in _terms(text):
        try:
            found = parse(term, symbols, algebra, where=where)
        except ProblemError as error:
            raise ProblemError(
                error.found, where=error.where, expected="parts whose dimensions fit", remedy=REMEDY
            ) from None
        if asked is None:
            asked, of = found.powers, f"`{term}`"
        elif found.powers is not None and (off := _known(product_of(found.powers, asked, -1))):
            said = f"the term `{term}` has the dimension {text_of(found.powers)}"
            expected = f"{text_of(asked)}, that of {of}"
            if off.keys() == {"10"}:
                times = f"is {10 ** off['10']:.6g} times that of {of}, and numbers are not converted"
                said, expected = f"the unit of the term `{term}` {times}", "units of one system"
            raise ProblemError(said, where=where, expected=expected, remedy=REMEDY)


def _terms(text: str) -> Iterator[str]:
    """Yield the terms of a sum as they are written."""
    source = text.strip(" \t")
    found: list[ast.expr] = []
    todo: list[ast.expr] = [ast.parse(source, mode="eval").body]
    while todo:
        node = todo.pop()
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub):
            todo += [node.left, node.right]
        else:
            found.append(node)
    found.sort(key=lambda node: node.col_offset)
    for node in found:
        yield ast.get_source_segment(source, node) or source


class _Dimensions:
    """The algebra of dimensions for `text.parse`; `Undefined` says what does not fit."""

    def __init__(self, pure: bool) -> None:
        self.pure = pure

    def number(self, value: float) -> Quantity:
        return Quantity({} if self.pure and value else None, value)

    def size(self, value: Quantity) -> float | None:
        return value.value

    def worst_constant(self, value: Quantity) -> float:  # noqa: ARG002
        return 0.0

    def apply(self, operation: str, *values: Quantity) -> Quantity:
        if operation in KEPT:
            sign = -1.0 if operation == "neg" else 1.0
            return Quantity(values[0].powers, None if values[0].value is None else sign * values[0].value)
        if operation in SAME or operation in COMPARED:
            powers = _same(*values)
            return Quantity(powers if operation in SAME else {})
        if operation == "if_else":
            return Quantity(_same(*values[1:]))
        if operation in ("mul", "div"):
            return _multiplied(*values, sign=1 if operation == "mul" else -1)
        if operation == "sqrt":
            return _power(values[0], Quantity({}, 0.5))
        if operation == "pow":
            return _power(*values)
        if operation == "sign":
            return Quantity({})
        if values[0].powers and _known(values[0].powers):
            raise Undefined(
                f"a function of a quantity of the dimension {text_of(values[0].powers)}, not of a number"
            )
        return Quantity({})


def _same(a: Quantity, b: Quantity) -> Powers | None:
    if a.powers is None or b.powers is None:
        return a.powers if b.powers is None else b.powers
    if off := _known(product_of(a.powers, b.powers, -1)):
        differ = f"of the dimensions {text_of(a.powers)} and {text_of(b.powers)}"
        if off.keys() == {"10"}:
            differ = f"whose units differ by a factor of {10 ** abs(off['10']):.6g}, and none is converted"
        raise Undefined(f"made of parts {differ}")
    return b.powers if math.isnan(a.powers.get("10", 0.0)) else a.powers


def _multiplied(a: Quantity, b: Quantity, *, sign: int) -> Quantity:
    value = None
    if a.value is not None and b.value is not None and (sign > 0 or b.value):
        value = a.value * b.value if sign > 0 else a.value / b.value
    if a.powers is None or b.powers is None:
        return Quantity(None, value)
    factor = any(one.value is not None and not one.powers and abs(one.value) not in PURE for one in (a, b))
    return Quantity({**product_of(a.powers, b.powers, sign), **({"10": math.nan} if factor else {})}, value)


def _power(base: Quantity, exponent: Quantity) -> Quantity:
    if exponent.powers:
        raise Undefined(f"a power whose exponent has the dimension {text_of(exponent.powers)}")
    if base.powers is None or not _known(base.powers):
        return Quantity(base.powers)
    if exponent.value is None:
        raise Undefined(f"a quantity of the dimension {text_of(base.powers)} to a power that varies")
    return Quantity({k: p * exponent.value for k, p in base.powers.items() if exponent.value})


def product_of(a: Powers, b: Powers, sign: int) -> Powers:
    """Return the dimension of a product (1) or a quotient (-1)."""
    total = {k: a.get(k, 0.0) + sign * b.get(k, 0.0) for k in (*a, *b)}
    return {k: p for k, p in total.items() if not abs(p) <= NONE}


def _known(powers: Powers) -> Powers:
    """Return a dimension without a factor that is not known."""
    return {k: p for k, p in powers.items() if not math.isnan(p)}


def text_of(powers: Powers) -> str:
    """Return a dimension as text.

    >>> text_of({"[length]": 1.0, "[time]": -2.0, "10": 3.0}), text_of({})
    ('1000 [length] [time]^-2', 'of a pure number')
    """
    factor = [f"{10**p:.6g}" for k, p in _known(powers).items() if k == "10"]
    parts = factor + [k if p == 1 else f"{k}^{p:.6g}" for k, p in sorted(powers.items()) if k != "10"]
    return " ".join(parts) or "of a pure number"


def dimension(text: str, name: str) -> Powers:
    """Return the dimension of a unit, such as "N m/rad".

    Raises:
        ProblemError: text that pint does not read as a unit.
    """
    from pint.errors import PintError

    try:
        # pint's Nm is the count of a yarn, in km/kg.
        unit = _registry().parse_expression(text.replace("Nm", "N m"))
        powers: dict[str, Any] = dict(getattr(unit, "dimensionality", {}))
        if hasattr(unit, "units"):  # by a difference: degC and K are one
            one, two = (_registry().Quantity(k, unit.units).to_base_units().magnitude for k in (1, 2))
            powers["10"] = math.log10(unit.magnitude * (two - one))
    except (PintError, ArithmeticError, AttributeError, KeyError, SyntaxError, TypeError, ValueError) as err:
        power = re.sub(r"(?<![\w.])([A-Za-z]+)(\d)", r"\1^\2", text)
        raise ProblemError(
            f"`{text}` is no unit: {err}",
            where=f"[agent.units] {name}",
            expected='a unit as pint reads it, such as "rad/s^2" or "N m", or "1" for a pure number',
            remedy=f"a power is written with ^: `{power}`" if power != text else "",
        ) from None
    return {k: float(p) for k, p in powers.items() if abs(p) > NONE}


@lru_cache(maxsize=1)
def _registry() -> Any:
    from pint import UnitRegistry

    return UnitRegistry(cache_folder=None)
