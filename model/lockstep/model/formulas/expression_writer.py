"""The operations of an expression, one after the other, as one text with as few parentheses as are safe.

Every text here is one that `expression` turns into the very operation it stands for: a left operand of the same
rank needs no parentheses, a right one does, `x**-y` and `2*-x` are as Python reads them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca

from lockstep.check.errors import demand
from lockstep.check.expression.text import LONGEST

FUNCTIONS: Mapping[int, str] = {
    ca.OP_SIN: "sin",
    ca.OP_COS: "cos",
    ca.OP_TAN: "tan",
    ca.OP_ASIN: "asin",
    ca.OP_ACOS: "acos",
    ca.OP_ATAN: "atan",
    ca.OP_ATAN2: "atan2",
    ca.OP_SINH: "sinh",
    ca.OP_COSH: "cosh",
    ca.OP_TANH: "tanh",
    ca.OP_EXP: "exp",
    ca.OP_LOG: "log",
    ca.OP_SQRT: "sqrt",
    ca.OP_SIGN: "sign",
    ca.OP_FABS: "abs",
    ca.OP_FMIN: "min",
    ca.OP_FMAX: "max",
}
COMPARISONS: Mapping[int, str] = {ca.OP_LT: "<", ca.OP_LE: "<="}
ARITY: Mapping[int, int] = {
    **dict.fromkeys(FUNCTIONS, 1),
    **dict.fromkeys((ca.OP_NEG, ca.OP_INV, ca.OP_SQ, ca.OP_TWICE, ca.OP_NOT), 1),
    **dict.fromkeys((ca.OP_ADD, ca.OP_SUB, ca.OP_MUL, ca.OP_DIV, ca.OP_POW, ca.OP_CONSTPOW), 2),
    **dict.fromkeys((ca.OP_ATAN2, ca.OP_FMIN, ca.OP_FMAX, ca.OP_IF_ELSE_ZERO, *COMPARISONS), 2),
}
"""How many operands each operation has that can be written."""

REPEATED = "a part that is used twice is written twice: bring the formula to a form that repeats less"

HIGHEST_POWER = 100
"""CasADi multiplies whole powers out up to this one."""

SUM, PRODUCT, SIGN, POWER, ATOM = range(5)
"""What holds a text together, from loose to tight."""


@dataclass(frozen=True)
class Step:
    """One operation: the earlier steps it works on, or its number or name."""

    op: int
    operands: tuple[int, ...] = ()
    number: float = 0.0
    name: str = ""


class _Text(NamedTuple):
    """The text of a step; of a whole power also the step it is a power of."""

    text: str
    rank: int
    base: int = -1
    exponent: int = 1


def write(steps: Sequence[Step], *, where: str = "") -> str:
    """Return the text of the last step.

    Raises:
        ProblemError: a text beyond the language's longest formula, or a condition that is no comparison.

    >>> x, minus, square = Step(ca.OP_INPUT, name="x"), Step(ca.OP_NEG, (0,)), Step(ca.OP_SQ, (1,))
    >>> write([x, minus, square])
    '(-x)**2'
    """
    writer = _Writer(steps, where)
    for number in range(len(steps)):
        writer.add(number)
    return writer.texts[-1].text


class _Writer:
    """The texts of the steps so far."""

    def __init__(self, steps: Sequence[Step], where: str) -> None:
        self.steps, self.where = steps, where
        self.texts: list[_Text] = []

    def add(self, number: int) -> None:
        """Add the text of the next step; a part that is too long makes the whole too long."""
        written = self._written(number, self.steps[number])
        found = f"as text, it has more than {LONGEST} characters"
        demand(len(written.text) <= LONGEST, found, self.where, f"a formula of at most {LONGEST}", REPEATED)
        self.texts.append(written)

    def _written(self, number: int, step: Step) -> _Text:
        match step.op, step.operands:
            case ca.OP_INPUT, _:
                return _Text(step.name, ATOM)
            case ca.OP_CONST, _:
                return _number(step.number)
            case ((ca.OP_ADD | ca.OP_SUB), (a, b)):
                sign = "+" if step.op == ca.OP_ADD else "-"
                whole = self._two_branches(a, b) if step.op == ca.OP_ADD else None
                return whole or _Text(f"{self._at(a, SUM)} {sign} {self._at(b, PRODUCT)}", SUM)
            case ca.OP_MUL, (a, b) if self._is_square_of(b, a):
                return self._power(a, self.texts[b].exponent + 1)
            case ((ca.OP_MUL | ca.OP_DIV), (a, b)):
                sign = "*" if step.op == ca.OP_MUL else "/"
                return _Text(f"{self._at(a, PRODUCT)}{sign}{self._at(b, SIGN)}", PRODUCT)
            case ca.OP_TWICE, (a,):
                return _Text(f"2*{self._at(a, SIGN)}", PRODUCT)
            case ca.OP_INV, (a,):
                return _Text(f"1/{self._at(a, SIGN)}", PRODUCT)
            case ca.OP_NEG, (a,):
                return self._negative(self.texts[a])
            case ca.OP_SQ, (a,):
                base, exponent = self.texts[a].base, 2 * self.texts[a].exponent
                return (
                    self._power(a, 2) if base < 0 or exponent > HIGHEST_POWER else self._power(base, exponent)
                )
            case ((ca.OP_POW | ca.OP_CONSTPOW), (a, b)):
                return _Text(f"{self._at(a, ATOM)}**{self._exponent(b)}", POWER)
            case ca.OP_IF_ELSE_ZERO, _:
                return self._one_branch(number)
            case op, (a, b) if op in COMPARISONS:
                return _Text(f"{self._at(a, SUM)} {COMPARISONS[op]} {self._at(b, SUM)}", SUM)
            case ca.OP_NOT, _:
                return _Text("", SUM)  # read through by `_branch`
            case op, operands:
                return _Text(f"{FUNCTIONS[op]}({', '.join(self.texts[a].text for a in operands)})", ATOM)

    def _at(self, number: int, rank: int) -> str:
        """Return a step's text for a place that asks for a rank."""
        written = self.texts[number]
        return written.text if written.rank >= rank else f"({written.text})"

    def _negative(self, a: _Text) -> _Text:
        """-a*b is read as (-a)*b, which CasADi builds as -(a*b); with a number in front it would be another one."""
        if a.rank == PRODUCT and not a.text[0].isdigit() and a.text[0] != "-":
            return _Text(f"-{a.text}", PRODUCT)
        return _Text(f"-{a.text}" if a.rank >= POWER else f"-({a.text})", SIGN)

    def _power(self, base: int, exponent: int) -> _Text:
        return _Text(f"{self._at(base, ATOM)}**{exponent}", POWER, base, exponent)

    def _exponent(self, number: int) -> str:
        """A whole one that was not multiplied out keeps its point, which tells x**3.0 from x*x*x."""
        step = self.steps[number]
        whole = step.op == ca.OP_CONST and step.number.is_integer() and abs(step.number) <= HIGHEST_POWER
        return repr(step.number) if whole else self._at(number, SIGN)

    def _is_square_of(self, b: int, a: int) -> bool:
        """Whether b is an even power of a: an odd one is the product of the two."""
        written = self.texts[b]
        return written.base == a and written.exponent % 2 == 0 and written.exponent < HIGHEST_POWER

    def _branch(self, number: int) -> tuple[int, bool, int] | None:
        """Return the comparison, whether it is negated, and the value, of a step that is one branch."""
        step = self.steps[number]
        if step.op != ca.OP_IF_ELSE_ZERO:
            return None
        condition, value = step.operands
        negated = self.steps[condition].op == ca.OP_NOT
        if negated:
            (condition,) = self.steps[condition].operands
        found = f"the condition `{self.texts[condition].text}` is no comparison"
        expected = "<, <=, > or >= between two expressions"
        demand(self.steps[condition].op in COMPARISONS, found, self.where, expected)
        return condition, negated, value

    def _one_branch(self, number: int) -> _Text:
        condition, negated, value = self._branch(number) or (0, False, 0)
        first, second = ("0", self.texts[value].text) if negated else (self.texts[value].text, "0")
        return _Text(f"if_else({self.texts[condition].text}, {first}, {second})", ATOM)

    def _two_branches(self, a: int, b: int) -> _Text | None:
        """Return if_else(condition, then, otherwise) for the sum of its two branches."""
        first, second = self._branch(a), self._branch(b)
        if first is None or second is None or first[0] != second[0] or first[1] == second[1]:
            return None
        then, otherwise = (second, first) if first[1] else (first, second)
        texts = [self.texts[k].text for k in (first[0], then[2], otherwise[2])]
        return _Text(f"if_else({', '.join(texts)})", ATOM)


def _number(value: float) -> _Text:
    """Return the shortest text that is read as this double; 2.0 is 2."""
    text = repr(value).removesuffix(".0")
    return _Text(text, SIGN if text.startswith("-") else ATOM)
