"""Exact expressions as CasADi SX: each rational coefficient is rounded once, to the double nearest to it."""

from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from functools import reduce

import casadi as ca

from lockstep.check.errors import ProblemError
from lockstep.check.expression.node import MINUS_ONE, ONE, ZERO, Node, factors, scale
from lockstep.check.expression.operations import BOOLEAN
from lockstep.check.expression.switches import choose, positive
from lockstep.check.expression.traversal import order
from lockstep.check.numbers import is_double, is_plain_or_double


def symbolic(nodes: Sequence[Node], symbols: Mapping[int, ca.SX]) -> list[ca.SX]:
    """Return nodes as scalar expressions; reading them back gives the same nodes where nothing is rounded.

    Args:
        nodes: expressions over numbered variables.
        symbols: what stands for each variable.

    Raises:
        ProblemError: a coefficient above all doubles.

    >>> from lockstep.check.expression.node import function, linear, variable
    >>> x = ca.SX.sym("x")
    >>> symbolic([linear(1, [(Fraction(1, 3), function("sin", variable(0)))])], {0: x})
    [SX(((sin(x)/3)+1))]
    """
    done: dict[Node, ca.SX] = {}
    for node in order(nodes):
        if node.op == "variable":
            done[node] = symbols[node.data]
        elif (x := _signed(node)) is not None:
            done[node] = ca.sign(done[x])
        elif (base := _power_of_constant(node)) is not None:
            coefficient, powers = factors(node.args[0])
            parts = [done[y] ** p for y, p in powers.items() if y is not base]
            done[node] = done[base.args[0]] ** _scaled(
                reduce(lambda a, b: a * b, parts, ca.SX(1)), coefficient
            )
        else:
            done[node] = (_BUILD.get(node.op) or _named)(node, [done[a] for a in node.args])
    return [ca.if_else(done[n], 1, 0) if n.op in BOOLEAN else done[n] for n in nodes]


def rounds_a_coefficient(node: Node) -> bool:
    """Whether `symbolic` rounds a coefficient or a constant: 1/3 it does not, a sum of two doubles it may."""
    for part in order([node]):
        if part.op == "linear":
            offset, coefficients = part.data
            if not (is_double(offset) and all(map(is_plain_or_double, coefficients))):
                return True
        if isinstance(part.data, Fraction) and not is_double(part.data):
            return True
    return False


def to_double(number: Fraction) -> float:
    """Round a rational to the nearest double; one too large is bad input."""
    try:
        return float(number)
    except OverflowError:
        raise ProblemError(
            "a coefficient of an expression is larger than 1.79e308",
            expected="numbers that fit in double precision",
            remedy="change the units",
        ) from None


def _scaled(value: ca.SX, coefficient: Fraction) -> ca.SX:
    """Return coefficient * value, rounded once; a plain fraction no double holds, such as 1/3, divides."""
    if not is_double(coefficient) and is_plain_or_double(coefficient):
        return (float(coefficient.numerator) * value) / float(coefficient.denominator)
    return to_double(coefficient) * value


def _signed(node: Node) -> Node | None:
    """Return x if the node is sign(x), which messages about a jump call by its name."""
    if node.op != "choose" or node.args[0].op != "positive":
        return None
    x = node.args[0].args[0]
    below = choose(positive(scale(-1, x)), MINUS_ONE, ZERO)
    return x if node is choose(positive(x), ONE, below) else None


def _power_of_constant(node: Node) -> Node | None:
    """Return log(c) if the node is c**y = exp(y log(c)) for a constant c, whose logarithm is not to be rounded."""
    if node.op != "exp":
        return None
    powers = factors(node.args[0])[1]
    return next((y for y, p in powers.items() if y.op == "log" and not y.variables and p == 1), None)


def _linear(node: Node, args: Sequence[ca.SX]) -> ca.SX:
    offset, coefficients = node.data
    terms = [_scaled(x, c) for c, x in zip(coefficients, args, strict=True)]
    return reduce(lambda a, b: a + b, [*terms, ca.SX(to_double(offset))] if offset else terms)


def _monomial(node: Node, args: Sequence[ca.SX]) -> ca.SX:
    # CasADi makes sqrt(x)**3 a product of x and sqrt(x): x**1.5 is read back as it is.
    powers = [
        (x.dep(0) ** (abs(p) / 2) if base.op == "sqrt" and abs(p) > 1 else x ** abs(p), p)
        for base, x, p in zip(node.args, args, node.data, strict=True)
    ]
    above, below = ([x for x, p in powers if (p > 0) is side] for side in (True, False))
    top = reduce(lambda a, b: a * b, above, ca.SX(1))
    return top / reduce(lambda a, b: a * b, below) if below else top


def _named(node: Node, args: Sequence[ca.SX]) -> ca.SX:
    value: ca.SX = getattr(ca, node.op)(*args)
    return value


_BUILD: Mapping[str, Callable[[Node, Sequence[ca.SX]], ca.SX]] = {
    "constant": lambda node, _: ca.SX(to_double(node.data)),
    "linear": _linear,
    "monomial": _monomial,
    "real_power": lambda node, args: args[0] ** to_double(node.data),
    "truth": lambda node, _: ca.SX(bool(node.data)),
    "positive": lambda _, args: args[0] > 0,
    "not": lambda _, args: ca.logic_not(args[0]),
    "and": lambda _, args: ca.logic_and(args[0], args[1]),
    "choose": lambda _, args: ca.if_else(args[0], args[1], args[2]),
}
