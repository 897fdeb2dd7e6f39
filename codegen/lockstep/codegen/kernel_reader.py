"""[A B; C D] read from the kernel of a generated source, a table of gains or unrolled statements.

Statements are interpreted one by one, each value a linear form in (x, r) with the number of roundings behind every
coefficient, so the order of operations is the file's.
"""

import re
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from jaxtyping import Float, Int

from lockstep.check.errors import NotCertified
from lockstep.codegen.arithmetic import RealType
from lockstep.codegen.budget import Shape
from lockstep.codegen.c_file import INDEX, LITERAL, CFile

Form = dict[tuple[str, int], tuple[Fraction, int]]
"""A linear form: (letter, index) -> (coefficient, roundings it has passed through)."""


@dataclass(frozen=True, eq=False)
class ReadKernel:
    """[A B; C D], the roundings behind each product if they were counted, and what the templates need to print it."""

    table: Float[np.ndarray, "rows cols"]
    roundings: Int[np.ndarray, "rows cols"] | None
    statements: tuple[str, ...]
    literals: tuple[tuple[str, ...], ...]


def read_kernel(source: CFile, shape: Shape, real: RealType) -> ReadKernel:
    """Read the kernel; raises `NotCertified` if it is neither a table nor statements of the kind that is generated."""
    name, text = source.name, source.text
    rows, columns = shape.order + shape.inputs, shape.order + shape.outputs
    table = re.search(rf"{name}_gain\[{rows}\]\[{columns}\] = \{{\n(.*?)\n\}};", text, re.DOTALL)
    if table:
        literals = tuple(source.row(line.strip().rstrip(",")) for line in table[1].splitlines())
        if len(literals) != rows or any(len(row) != columns for row in literals):
            raise source.refusal(f"its table is not {rows} x {columns}")
        values = np.array([[source.value(literal, real.name) for literal in row] for row in literals])
        return ReadKernel(values, None, (), literals)
    body = re.search(
        rf"^static void {name}_kernel\([^\n]*\)\n\{{\n(.*?)^\}}\n", text, re.DOTALL | re.MULTILINE
    )
    if not body:
        raise source.refusal("there is neither a kernel of statements nor a table of gains")
    lines = tuple(line.strip(" ") for line in body[1].splitlines())
    return _interpreted(source, tuple(line for line in lines if not line.startswith("(void)")), shape, real)


def _interpreted(source: CFile, statements: tuple[str, ...], shape: Shape, real: RealType) -> ReadKernel:
    """Follow the statements and return the table they compute."""
    n = shape.order
    machine = _Machine(source, shape, real)
    for statement in statements:
        machine.run(statement)
    targets = [("x_next", k) for k in range(n)] + [("u_next", k) for k in range(shape.inputs)]
    if missing := [f"{letter}[{k}]" for letter, k in targets if (letter, k) not in machine.written]:
        raise source.refusal(f"`{missing[0]}` is not written")
    columns = [("x", k) for k in range(n)] + [("r", k) for k in range(shape.outputs)]
    table = np.zeros((len(targets), len(columns)))
    roundings = np.zeros(table.shape, dtype=int)
    for row, target in enumerate(targets):
        for column, place in enumerate(columns):
            coefficient, count = machine.written[target].get(place, (Fraction(0), 0))
            table[row, column], roundings[row, column] = float(coefficient), count
    return ReadKernel(table, roundings, statements, ())


class _Machine:
    """Interprets the statements of a kernel: every name is defined once, before it is used."""

    def __init__(self, source: CFile, shape: Shape, real: RealType) -> None:
        self.source, self.real = source, real
        self.limits = {
            "x": shape.order,
            "r": shape.outputs,
            "x_next": shape.order,
            "u_next": shape.inputs,
        }
        self.known: dict[str, Form] = {}
        self.written: dict[tuple[str, int], Form] = {}
        self.definition = re.compile(rf"const {real.c_name} ([a-z]+[0-9]+) = (.+);")
        self.output = re.compile(rf"(x_next|u_next)\[{INDEX}\] = (.+);")

    def run(self, statement: str) -> None:
        if found := self.definition.fullmatch(statement):
            if found[1] in self.known:
                raise self.refused(statement)
            self.known[found[1]] = self.expression(found[2], statement)
        elif found := self.output.fullmatch(statement):
            place = self.place(found[1], found[2], statement)
            if place in self.written:
                raise self.refused(statement)
            self.written[place] = self.expression(found[3], statement, constant=True)
        else:
            raise self.refused(statement)

    def expression(self, text: str, statement: str, *, constant: bool = False) -> Form:
        if found := re.fullmatch(rf"(x|r)\[{INDEX}\]", text):
            return {self.place(found[1], found[2], statement): (Fraction(1), 0)}
        if text in self.known:
            return self.known[text]
        if text.startswith("-") and text[1:] in self.known:
            return {place: (-a, k) for place, (a, k) in self.known[text[1:]].items()}
        if constant and LITERAL.fullmatch(text) and self.source.value(text, self.real.name) == 0:
            return {}
        parts = text.split(" ")
        if len(parts) != 3:
            raise self.refused(statement)
        left, sign, right = parts
        if sign == "*" and right in self.known:
            return self.product(left, self.known[right], statement)
        if sign in "+-" and left in self.known and right in self.known:
            return self.sum(left, right, sign, statement)
        raise self.refused(statement)

    def product(self, literal: str, form: Form, statement: str) -> Form:
        """Multiply an input by a literal: one rounding. The product of two rounded things is no form of ours."""
        if not LITERAL.fullmatch(literal) or len(form) != 1 or any(k for _, k in form.values()):
            raise self.refused(statement)
        ((place, (unit, _)),) = form.items()
        return {place: (unit * Fraction(self.source.value(literal, self.real.name)), 1)}

    def sum(self, left: str, right: str, sign: str, statement: str) -> Form:
        """Add two forms: one rounding more for each coefficient. Doubling an input is exact."""
        a, b = self.known[left], self.known[right]
        if left == right and sign == "+" and not any(k for _, k in a.values()):
            return {place: (2 * value, k) for place, (value, k) in a.items()}
        if a.keys() & b.keys():
            raise self.refused(statement)
        factor = 1 if sign == "+" else -1
        return {place: (value, k + 1) for place, (value, k) in a.items()} | {
            place: (factor * value, k + 1) for place, (value, k) in b.items()
        }

    def place(self, letter: str, index: str, statement: str) -> tuple[str, int]:
        if int(index) >= self.limits[letter]:
            raise self.refused(statement)
        return letter, int(index)

    def refused(self, statement: str) -> NotCertified:
        return self.source.refusal(f"`{statement}` is no statement of a kernel")
