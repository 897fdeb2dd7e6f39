"""Expressions of a problem file: text in, CasADi SX out, and no Python is ever run.

The text is cut into tokens first, so that nothing but numbers, names and the operators below reaches Python's
parser (`ast`, which builds a tree and evaluates nothing). Then a walker turns the node types it knows into
SX, and refuses the rest. Precedence and associativity are Python's: `-x**2` is `-(x**2)`, `x**y**z` is
`x**(y**z)`.

    numbers  names  t  pi  + - * / **  ( )  sin cos tan asin acos atan atan2 sinh cosh tanh exp log sqrt
    abs fabs min max sign  if_else(a < b, then, otherwise) with < <= > >=
"""

import ast
import math
from collections.abc import Callable, Mapping
from functools import reduce
from typing import NamedTuple

import casadi as ca

from lockstep.check.errors import ProblemError
from lockstep.check.tokens import DEEPEST, Source, check_neighbours, tokens
from lockstep.check.wording import nearest, shorten


class Function(NamedTuple):
    """A function of the language: how many arguments it takes, and what it makes of them."""

    fewest: int
    most: int
    build: Callable[..., ca.SX]


FUNCTIONS: Mapping[str, Function] = {
    **{
        name: Function(1, 1, getattr(ca, name))
        for name in (
            "sin",
            "cos",
            "tan",
            "asin",
            "acos",
            "atan",
            "sinh",
            "cosh",
            "tanh",
            "exp",
            "log",
            "sqrt",
            "sign",
            "fabs",
        )
    },
    "abs": Function(1, 1, ca.fabs),
    "atan2": Function(2, 2, ca.atan2),
    "min": Function(2, 64, lambda *a: reduce(ca.fmin, a)),
    "max": Function(2, 64, lambda *a: reduce(ca.fmax, a)),
    "if_else": Function(3, 3, ca.if_else),
}
CONSTANTS: Mapping[str, float] = {"pi": math.pi}
RESERVED = frozenset(FUNCTIONS) | frozenset(CONSTANTS) | {"t"}
"""Names a state, an input, an output or a parameter cannot have."""

_OPERATORS: Mapping[type[ast.operator], Callable[[ca.SX, ca.SX], ca.SX]] = {
    ast.Add: lambda a, b: a + b,
    ast.Sub: lambda a, b: a - b,
    ast.Mult: lambda a, b: a * b,
    ast.Div: lambda a, b: a / b,
    ast.Pow: lambda a, b: a**b,
}
_COMPARISONS: Mapping[type[ast.cmpop], Callable[[ca.SX, ca.SX], ca.SX]] = {
    ast.Lt: lambda a, b: a < b,
    ast.LtE: lambda a, b: a <= b,
    ast.Gt: lambda a, b: a > b,
    ast.GtE: lambda a, b: a >= b,
}


def parse_expression(text: str, symbols: Mapping[str, ca.SX | float], *, where: str = "") -> ca.SX:
    """Parse `text` into a scalar CasADi expression in `symbols`.

    Args:
        text: the expression, at most `LONGEST` characters on one line.
        symbols: what each name stands for: an SX symbol, or the value of a parameter.
        where: the place in the problem file, for messages.

    Raises:
        ProblemError: whatever is not in the language, with its column; an unknown name, with the nearest
            known one; a constant part that is not a finite number, such as 1/0 or log(0).

    >>> x = ca.SX.sym("x")
    >>> parse_expression("-gravity*sin(x) + if_else(x < 0, 0, x**2)", {"x": x, "gravity": 2.0})
    SX(((-2*sin(x))+((!(x<0))?sq(x):0)))
    >>> parse_expression("2*y", {"x": x})
    Traceback (most recent call last):
    lockstep.check.errors.ProblemError: unknown symbol `y` at column 3 of `2*y`; expected x, t, pi or a
    function ...
    """
    if not isinstance(text, str):
        raise ProblemError(f"{shorten(repr(text))} is no text", where=where, expected="a formula as text")
    source = Source(text.strip(" \t"), where)
    check_neighbours(source, tokens(source))
    tree = _tree(source)
    value = _Walker(source, symbols).expression(tree.body, 0)
    _check_constants(source, value)
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


class _Walker:
    """Turns the nodes of the language into SX, and refuses every other one by name."""

    def __init__(self, source: Source, symbols: Mapping[str, ca.SX | float]) -> None:
        self.source = source
        self.symbols: Mapping[str, ca.SX | float] = {**CONSTANTS, **symbols}

    def expression(self, node: ast.expr, depth: int) -> ca.SX:
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

    def operand(self, node: ast.expr, depth: int) -> ca.SX:
        match node:
            case ast.Constant(value=int() | float() as number):
                return ca.SX(float(number))
            case ast.Name(id=name):
                return self.symbol(name, node)
            case ast.UnaryOp(op=ast.USub(), operand=inner):
                return -self.expression(inner, depth + 1)
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

    def binary(self, node: ast.BinOp, left: ca.SX, right: ca.SX) -> ca.SX:
        operator = _OPERATORS.get(type(node.op))
        if operator is None:
            raise self.error(f"`{self.source.segment(node)}` is not part of an expression", node)
        if isinstance(node.op, ast.Div) and right.is_constant() and float(right) == 0.0:
            raise self.error(f"a division by zero: `{self.source.segment(node.right)}` is 0", node.right)
        return self.finite(operator(left, right), node)

    def symbol(self, name: str, node: ast.expr) -> ca.SX:
        if name in self.symbols:
            return ca.SX(self.symbols[name])
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

    def call(self, name: str, node: ast.expr, arguments: list[ast.expr], depth: int) -> ca.SX:
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
        return self.finite(function.build(first, *rest), node)

    def condition(self, node: ast.expr, depth: int) -> ca.SX:
        match node:
            case ast.Compare(left=left, ops=[operator], comparators=[right]) if (
                type(operator) in _COMPARISONS
            ):
                compare = _COMPARISONS[type(operator)]
                return compare(self.expression(left, depth), self.expression(right, depth))
            case _:
                raise self.error(
                    f"`{self.source.segment(node)}` is not a condition",
                    node,
                    expected="one comparison, such as x < 1, in the first place of if_else",
                    remedy="nest if_else for more than one",
                )

    def finite(self, value: ca.SX, node: ast.expr) -> ca.SX:
        if value.is_constant() and not math.isfinite(float(value)):
            raise self.error(
                f"`{self.source.segment(node)}` is {float(value)}", node, expected="a finite number"
            )
        return value

    def error(self, found: str, node: ast.expr, *, expected: str = "", remedy: str = "") -> ProblemError:
        return self.source.error(found, node.col_offset, expected=expected, remedy=remedy)


def _arity(function: Function) -> str:
    if function.fewest == function.most:
        return f"{function.fewest}"
    return f"{function.fewest} or more" if function.most > 2 else f"{function.fewest} to {function.most}"


def _check_constants(source: Source, value: ca.SX) -> None:
    """Refuse an overflow that CasADi's folding hides inside: (1e308*x)*10 becomes inf*x."""
    graph = ca.Function("expression", ca.symvar(value), [value])
    for k in range(graph.n_instructions()):
        if graph.instruction_id(k) == ca.OP_CONST and not math.isfinite(graph.instruction_constant(k)):
            raise source.whole(
                f"the constants of `{shorten(source.text)}` multiply to {graph.instruction_constant(k)}",
                expected="finite numbers",
            )
