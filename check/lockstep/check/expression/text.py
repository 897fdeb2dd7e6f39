"""Expressions of a problem file, read into whatever an `Algebra` builds; no Python is ever run.

The text is cut into tokens first, so that nothing but numbers, names and the operators below reaches Python's
parser (`ast`, which builds a tree and evaluates nothing). Then a walker hands the node types it knows to the
algebra, and refuses the rest. Precedence and associativity are Python's: `-x**2` is `-(x**2)`, `x**y**z` is
`x**(y**z)`.

    numbers  names  t  pi  + - * / **  ( )  sin cos tan asin acos atan atan2 sinh cosh tanh exp log sqrt
    abs fabs min max sign  if_else(a < b, then, otherwise) with < <= > >=
"""

import ast
import math
from collections.abc import Mapping
from functools import reduce
from typing import Generic, NamedTuple, Protocol, TypeVar

from lockstep.check.errors import ProblemError
from lockstep.check.expression.node import Undefined
from lockstep.check.tokens import DEEPEST, Source, check_neighbours, tokens
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

_OPERATORS: Mapping[type[ast.operator], str] = {
    ast.Add: "add",
    ast.Sub: "sub",
    ast.Mult: "mul",
    ast.Div: "div",
    ast.Pow: "pow",
}
_COMPARISONS: Mapping[type[ast.cmpop], tuple[str, bool]] = {
    ast.Lt: ("lt", False),
    ast.LtE: ("le", False),
    ast.Gt: ("lt", True),
    ast.GtE: ("le", True),
}
"""The operation of each comparison, and whether its sides are swapped."""

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
        """Return a constant inside of the value that is no finite double, 0 if there is none."""
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
    if not isinstance(text, str):
        raise ProblemError(f"{shorten(repr(text))} is no text", where=where, expected="a formula as text")
    source = Source(text.strip(" \t"), where)
    check_neighbours(source, tokens(source))
    value = _Walker(source, symbols, algebra).expression(_tree(source).body, 0)
    worst = algebra.worst_constant(value)
    if not math.isfinite(worst):
        raise source.whole(
            f"the constants of `{shorten(source.text)}` multiply to {worst}", expected="finite numbers"
        )
    return value


def _tree(source: Source) -> ast.Expression:
    """Build the tree. The tokens are ours by now, so what fails here is their order."""
    try:
        return ast.parse(source.text, mode="eval")
    except (RecursionError, MemoryError):
        raise source.whole(
            "the expression is too long or nested too deeply for Python's parser",
            remedy="name its parts as parameters, or build the agent in Python",
        ) from None
    except SyntaxError as error:
        column = min(max((error.offset or 1) - 1, 0), len(source.text) - 1)
        raise source.error(
            "the expression cannot be read", column, expected="one formula such as -k*(x - y) + 2*sin(x)"
        ) from None


class _Walker(Generic[V]):
    """Hands the nodes of the language to the algebra, and refuses every other one by name."""

    def __init__(self, source: Source, symbols: Mapping[str, V | float], algebra: Algebra[V]) -> None:
        self.source = source
        self.symbols: Mapping[str, V | float] = {**CONSTANTS, **symbols}
        self.algebra = algebra

    def expression(self, node: ast.expr, depth: int) -> V:
        """Walk down a chain of operators in a loop, so that only nesting costs depth."""
        if depth > DEEPEST:
            raise self.error(
                "the expression is nested too deeply", node, expected=f"at most {DEEPEST} levels"
            )
        chain: list[ast.BinOp] = []
        while isinstance(node, ast.BinOp):
            chain.append(node)
            node = node.left
        value = self.operand(node, depth)
        for link in reversed(chain):
            value = self.binary(link, value, self.expression(link.right, depth + 1))
        return value

    def operand(self, node: ast.expr, depth: int) -> V:
        match node:
            case ast.Constant(value=int() | float() as number):
                return self.algebra.number(float(number))
            case ast.Name(id=name):
                return self.symbol(name, node)
            case ast.UnaryOp(op=ast.USub(), operand=inner):
                return self.algebra.apply("neg", self.expression(inner, depth + 1))
            case ast.UnaryOp(op=ast.UAdd(), operand=inner):
                return self.expression(inner, depth + 1)
            case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]):
                return self.call(name, node, arguments, depth)
            case ast.Compare():
                raise self.error(
                    f"a comparison, `{self.source.segment(node)}`,",
                    node,
                    expected="a number here: comparisons stand in the first place of if_else",
                )
            case ast.Tuple():
                raise self.error(
                    "a list of values", node, expected="one formula", remedy="write decimals with a point"
                )
            case _:
                raise self.error(f"`{self.source.segment(node)}` is not part of an expression", node)

    def binary(self, node: ast.BinOp, left: V, right: V) -> V:
        operator = _OPERATORS.get(type(node.op))
        if operator is None:
            raise self.error(f"`{self.source.segment(node)}` is not part of an expression", node)
        if isinstance(node.op, ast.Div) and self.algebra.size(right) == 0.0:
            raise self.error(f"a division by zero: `{self.source.segment(node.right)}` is 0", node.right)
        return self.applied(operator, node, left, right)

    def symbol(self, name: str, node: ast.expr) -> V:
        if name in self.symbols:
            value = self.symbols[name]
            return self.algebra.number(value) if isinstance(value, float | int) else value
        if name in FUNCTIONS:
            raise self.error(
                f"the function `{name}` without its arguments", node, remedy=f"write {name}(...)"
            )
        if name.lower() in ("nan", "inf", "infinity"):
            raise self.error(
                f"`{name}` is no number that can be computed with", node, expected="a finite number"
            )
        known = [*self.symbols, *FUNCTIONS]
        raise self.error(
            f"unknown symbol `{shorten(name)}`",
            node,
            expected=self.known_names(),
            remedy=nearest(name, known) or "declare it as a state, an input or a parameter",
        )

    def known_names(self) -> str:
        names = [name for name in self.symbols if name not in ("t", "pi")]
        return f"{shorten(', '.join([*names, 't']), 120)}, pi or a function ({', '.join(FUNCTIONS)})"

    def call(self, name: str, node: ast.expr, arguments: list[ast.expr], depth: int) -> V:
        function = FUNCTIONS.get(name)
        if function is None and name in self.symbols:
            raise self.error(
                f"`{name}` is a symbol, not a function", node, remedy=f"write `{name}` alone, or {name}*(...)"
            )
        if function is None:
            raise self.error(
                f"unknown function `{shorten(name)}`",
                node,
                expected=", ".join(FUNCTIONS),
                remedy=nearest(name, FUNCTIONS),
            )
        if not function.fewest <= len(arguments) <= function.most:
            raise self.error(f"`{name}` with {len(arguments)} arguments", node, expected=_arity(function))
        if name == "if_else":
            first = self.condition(arguments[0], depth + 1)
        else:
            first = self.expression(arguments[0], depth + 1)
        rest = [self.expression(argument, depth + 1) for argument in arguments[1:]]
        if function.operation in ("fmin", "fmax"):
            return reduce(lambda a, b: self.applied(function.operation, node, a, b), rest, first)
        return self.applied(function.operation, node, first, *rest)

    def condition(self, node: ast.expr, depth: int) -> V:
        match node:
            case ast.Compare(left=left, ops=[operator], comparators=[right]) if (
                type(operator) in _COMPARISONS
            ):
                name, swapped = _COMPARISONS[type(operator)]
                sides = self.expression(left, depth), self.expression(right, depth)
                return self.applied(name, node, *(reversed(sides) if swapped else sides))
            case _:
                raise self.error(
                    f"`{self.source.segment(node)}` is not a condition",
                    node,
                    expected="one comparison, such as x < 1, in the first place of if_else",
                    remedy="nest if_else for more than one",
                )

    def applied(self, operation: str, node: ast.expr, *values: V) -> V:
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
        raise self.error(f"`{self.source.segment(node)}` is {found}", node, expected="a finite number")

    def error(self, found: str, node: ast.expr, *, expected: str = "", remedy: str = "") -> ProblemError:
        return self.source.error(found, node.col_offset, expected=expected, remedy=remedy)


def _arity(function: Function) -> str:
    if function.fewest == function.most:
        return f"{function.fewest}"
    return f"{function.fewest} or more" if function.most > 2 else f"{function.fewest} to {function.most}"
