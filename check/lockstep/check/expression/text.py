"""Expressions of a problem file, read into whatever an `Algebra` builds; no Python is ever run.

Precedence and associativity are Python's: `-x**2` is `-(x**2)`, `x**y**z` is `x**(y**z)`. The grammar, in full:

    expression = operand {("+" | "-" | "*" | "/") operand}          * and / before + and -, from left to right
    operand    = ("+" | "-") operand | atom ["**" operand]
    atom       = number | name | function "(" expression {"," expression} [","] ")" | "(" expression ")"
               | "if_else" "(" expression ("<" | "<=" | ">" | ">=") expression "," expression "," expression [","] ")"

    names  t  pi  sin cos tan asin acos atan atan2 sinh cosh tanh exp log sqrt abs fabs min max sign
"""

import math
import re
from collections.abc import Mapping
from functools import reduce
from typing import Generic, NamedTuple, NoReturn, Protocol, TypeVar

from lockstep.check.errors import ProblemError
from lockstep.check.expression.node import Undefined
from lockstep.check.wording import nearest, shorten


class Function(NamedTuple):
    """A function of the language: how many arguments it takes, and the operation it stands for."""

    fewest: int
    most: int
    operation: str


_UNARY = "sin cos tan asin acos atan sinh cosh tanh exp log sqrt sign fabs"
FUNCTIONS: Mapping[str, Function] = {
    **{name: Function(1, 1, name) for name in _UNARY.split()},
    "abs": Function(1, 1, "fabs"),
    "atan2": Function(2, 2, "atan2"),
    "min": Function(2, 64, "fmin"),
    "max": Function(2, 64, "fmax"),
    "if_else": Function(3, 3, "if_else"),
}
CONSTANTS: Mapping[str, float] = {"pi": math.pi}
RESERVED = frozenset(FUNCTIONS) | frozenset(CONSTANTS) | {"t"}
"""Names a state, an input, an output or a parameter cannot have."""

SPELLED = {"asinh": "write log(p + sqrt(p**2 + 1)) - log(n + sqrt(n**2 + 1)), p = max(x, 0), n = max(-x, 0)"}
"""How to write what is no function here: log(x + sqrt(x^2 + 1)), in one, is not shown to be defined far below 0."""

LONGEST = 10_000
"""Characters in one expression. Longer ones come from programs, which can build an `Agent` in Python."""
MOST_TOKENS = 2_000
"""Numbers, names and operators in one."""
DEEPEST = 100
"""Levels of nesting. Chains such as a + b + c do not nest; Python's own limits stay out of reach."""

_TOKEN = re.compile(
    r"[ \t]*((?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?|[A-Za-z][A-Za-z_0-9]*|\*\*|<=|>=|[-+*/()<>,])[ \t]*"
)
_OPERATORS = {"+": (1, "add"), "-": (1, "sub"), "*": (2, "mul"), "/": (2, "div")}
"""How tightly each binds, and the operation it stands for."""
_COMPARISONS = {"<": ("lt", False), "<=": ("le", False), ">": ("lt", True), ">=": ("le", True)}
"""The operation of each comparison, and whether its sides are swapped."""
_A_FORMULA = "one formula such as -k*(x - y) + 2*sin(x); comparisons stand in the first place of if_else only"

V = TypeVar("V")


class Algebra(Protocol[V]):
    """What the values of expressions are, and how the operations are carried out on them."""

    def number(self, value: float) -> V:
        """Return the value of a decimal number, a parameter or pi."""
        ...

    def apply(self, operation: str, *values: V) -> V:
        """Return the operation (a name of `operations.RULES`) on values; `Undefined` if it has no value."""
        ...

    def size(self, value: V) -> float | None:
        """Return the double nearest to a constant value, infinite or nan if it is none; None if it varies."""
        ...

    def worst_constant(self, value: V) -> float:
        """Return a constant inside the value that is no finite number, or 0 if there is none."""
        ...


def parse(text: str, symbols: Mapping[str, V | float], algebra: Algebra[V], *, where: str = "") -> V:
    """Parse `text` into a value of the algebra.

    Args:
        text: the expression, at most `LONGEST` characters on one line.
        symbols: what each name stands for: a value, or the number of a parameter.
        algebra: builds the values.
        where: the place in the problem file, for messages.

    Raises:
        ProblemError: whatever is not in the language, with its column; an unknown name, with the nearest
            known one; a constant part that is not a finite number, such as 1/0 or log(0).
    """
    if not isinstance(text, str) or len(text) > LONGEST:
        long = f"an expression of {len(text)} characters" if isinstance(text, str) else ""
        found = long or f"{text!r:.60} is no text"
        raise ProblemError(found, where=where, expected=f"a formula as text, of at most {LONGEST} characters")
    reader = _Reader(text, symbols, algebra, where)
    value = reader.expression()
    if reader.next:
        reader.refuse()
    worst = algebra.worst_constant(value)
    if not math.isfinite(worst):
        found = f"the constants of `{shorten(text)}` multiply to {worst}"
        raise ProblemError(found, where=where, expected="finite numbers")
    return value


class _Reader(Generic[V]):
    """Goes through the tokens from left to right, one method for each rule of the grammar."""

    def __init__(self, text: str, symbols: Mapping[str, V | float], algebra: Algebra[V], where: str) -> None:
        self.text, self.where, self.algebra = text, where, algebra
        self.symbols: Mapping[str, V | float] = {**CONSTANTS, **symbols}
        self.tokens: list[tuple[str, int, int]] = []
        """Each with the columns at which it begins and ends; the last one is the end of the text, and empty."""
        self.at, self.depth, place = 0, -1, 0
        while place < len(text.rstrip(" \t")):
            match = _TOKEN.match(text, place)
            if match is None or len(self.tokens) == MOST_TOKENS:
                character = shorten(text[len(text) - len(text[place:].lstrip(" \t")) :][:1])
                found = f"`{character}` is not part of an expression"
                expected = "numbers, names, + - * / ** ( ) , and < <= > >= in if_else"
                if match is not None:
                    found, expected = "it goes on", f"at most {MOST_TOKENS} numbers, names and operators"
                raise self.error(found, place, expected=expected)
            self.tokens.append((match[1], *match.span(1)))
            place = match.end()
        self.tokens.append(("", len(text), len(text)))

    @property
    def next(self) -> str:
        """The next token; empty at the end."""
        return self.tokens[self.at][0]

    @property
    def column(self) -> int:
        """Where the next token begins."""
        return self.tokens[self.at][1]

    def sees(self, token: str) -> bool:
        """Pass a token if it is the next one."""
        found = self.next == token
        self.at += found
        return found

    def expect(self, token: str) -> None:
        """Pass a token that has to be there."""
        if not self.sees(token):
            self.refuse()

    def expression(self, rank: int = 1) -> V:
        """Read operands joined by operators that bind as tightly as `rank`, or tighter."""
        start, value = self.column, self.operand()
        while (found := _OPERATORS.get(self.next)) and found[0] >= rank:
            self.at += 1
            right = self.expression(found[0] + 1)
            if found[1] == "div" and self.algebra.size(right) == 0.0:
                raise self.error(f"`{self.since(start)}` is a division by zero", start)
            value = self.apply(found[1], start, value, right)
        return value

    def operand(self) -> V:
        """Read a power, or an operand with a sign."""
        start, self.depth = self.column, self.depth + 1
        if self.depth > DEEPEST:
            raise self.error(
                "the expression is nested too deeply", start, expected=f"at most {DEEPEST} levels"
            )
        if self.sees("-"):
            value = self.algebra.apply("neg", self.operand())
        elif self.sees("+"):
            value = self.operand()
        else:
            value = self.atom()
            if self.sees("**"):
                value = self.apply("pow", start, value, self.operand())
        self.depth -= 1
        return value

    def atom(self) -> V:
        token, start = self.next, self.column
        if self.sees("("):
            value = self.expression()
            self.expect(")")
            return value
        if token[:1].isdecimal() or token[:1] == ".":
            self.at += 1
            if not math.isfinite(float(token)) or re.fullmatch("0[0-9]+", token):
                expected = "at most 1.79e308 (double precision), without leading zeros"
                raise self.error(
                    f"`{shorten(token, 30)}` is no number that is read", start, expected=expected
                )
            return self.algebra.number(float(token))
        if not token[:1].isalpha():
            self.refuse()
        self.at += 1
        if self.sees("("):
            return self.call(token, start)
        if token not in self.symbols:
            names = ", ".join([*(name for name in self.symbols if name not in ("t", "pi")), "t"])
            raise self.error(
                f"unknown symbol `{shorten(token)}`",
                start,
                expected=f"{shorten(names, 120)}, pi or a function ({', '.join(FUNCTIONS)})",
                remedy=f"write {token}(...)" if token in FUNCTIONS else nearest(token, self.symbols),
            )
        known = self.symbols[token]
        return self.algebra.number(known) if isinstance(known, float | int) else known

    def call(self, name: str, start: int) -> V:
        """Read the arguments of a function, its name and parenthesis being read."""
        function = FUNCTIONS.get(name)
        if function is None:
            found, known = f"unknown function `{shorten(name)}`", ", ".join(FUNCTIONS)
            raise self.error(
                found, start, expected=known, remedy=SPELLED.get(name) or nearest(name, FUNCTIONS)
            )
        values = [self.condition() if name == "if_else" else self.expression()] if self.next != ")" else []
        while self.sees(",") and self.next != ")":
            values.append(self.expression())
        self.expect(")")
        if not function.fewest <= len(values) <= function.most:
            expected = f"{function.fewest}" + " or more" * (function.most > function.fewest)
            raise self.error(f"`{name}` with {len(values)} arguments", start, expected=expected)
        if len(values) > 1 and function.operation in ("fmin", "fmax"):
            return reduce(lambda a, b: self.apply(function.operation, start, a, b), values)
        return self.apply(function.operation, start, *values)

    def condition(self) -> V:
        start, left = self.column, self.expression()
        if (found := _COMPARISONS.get(self.next)) is None:
            expected = "one comparison, such as x < 1, in the first place of if_else"
            raise self.error(f"`{self.since(start)}` is not a condition", start, expected=expected)
        self.at += 1
        sides = left, self.expression()
        return self.apply(found[0], start, *(reversed(sides) if found[1] else sides))

    def apply(self, operation: str, start: int, *values: V) -> V:
        """Apply an operation, and refuse a constant that is no finite number."""
        try:
            value = self.algebra.apply(operation, *values)
        except Undefined as error:
            found = str(error)
        else:
            size = self.algebra.size(value)
            if size is None or math.isfinite(size):
                return value
            found = str(size)
        raise self.error(f"`{self.since(start)}` is {found}", start, expected="a finite number")

    def since(self, start: int) -> str:
        """Return the text from a column to the last token that was read, in short."""
        return shorten(self.text[start : self.tokens[self.at - 1][2]], 40)

    def refuse(self) -> NoReturn:
        """Refuse the next token."""
        raise self.error("the expression cannot be read", self.column, expected=_A_FORMULA)

    def error(self, found: str, column: int, *, expected: str = "", remedy: str = "") -> ProblemError:
        """Return an error about one column, counted from 0."""
        place = f"{found} at column {column + 1} of `{shorten(self.text)}`"
        return ProblemError(place, where=self.where, expected=expected, remedy=remedy)
