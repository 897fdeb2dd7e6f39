"""Elementary functions of constants: the double nearest to the true value stands for a value that is not rational.

The true value is enclosed by ball arithmetic (python-flint `arb`) of growing precision, until one double is nearer than
both of its neighbours to all of the ball.
"""

from collections.abc import Callable, Sequence
from fractions import Fraction
from math import inf, isinf, nextafter, prod

from flint import arb, ctx, fmpq

from lockstep.check.expression.node import Node, Undefined
from lockstep.check.expression.traversal import order

PRECISIONS = (128, 512, 2048, 8192)
"""Bits; the last ones are for arguments such as sin(1e300)."""

FAR = 1000
"""exp of more than this is above every double, of less than minus this below every double."""


def nearest_double(node: Node) -> float:
    """Return the double nearest to a node without variables; infinite if it is above all doubles.

    Raises `Undefined`, with the value of IEEE arithmetic as its text, where there is no value: log(0), sqrt(-1).

    >>> from lockstep.check.expression.node import constant, intern
    >>> nearest_double(intern("exp", (constant(1),)))
    2.718281828459045
    """
    for bits in PRECISIONS:
        with ctx.workprec(bits):
            value = _value(node)
            middle = float(value.mid()) if value.is_finite() else inf
            if value.is_finite() and _is_nearest(middle, value):
                return middle
    if value.is_finite():
        return middle  # a tie, which only an algebraic function can meet: either neighbour is nearest
    raise Undefined("nan")


def _is_nearest(middle: float, value: arb) -> bool:
    if value.is_exact():
        return True
    if isinf(middle):
        return bool(abs(value) > arb(2) ** 1024)
    below, above = ((arb(middle) + arb(nextafter(middle, to))) / 2 for to in (-inf, inf))
    return bool((below < value) & (value < above))


def _value(node: Node) -> arb:
    values: dict[Node, arb] = {}
    for part in order([node]):
        args = [values[a] for a in part.args]
        values[part] = _RULES[part.op](part, args) if part.op in _RULES else _FUNCTIONS[part.op](*args)
    return values[node]


def _ball(value: Fraction) -> arb:
    return arb(fmpq(value.numerator, value.denominator))


def _linear(node: Node, args: Sequence[arb]) -> arb:
    offset, coefficients = node.data
    return sum((_ball(c) * x for c, x in zip(coefficients, args, strict=True)), _ball(offset))


def _monomial(node: Node, args: Sequence[arb]) -> arb:
    return prod((x**p for x, p in zip(args, node.data, strict=True)), start=arb(1))


def _real_power(node: Node, args: Sequence[arb]) -> arb:
    if args[0] == 0:
        if node.data < 0:
            raise Undefined("inf")
        return arb(0)
    return _exp(_ball(node.data) * args[0].log())


def _exp(x: arb) -> arb:
    if x > FAR:
        return arb(2) ** 1100
    return arb(0) if x < -FAR else x.exp()


def _log(x: arb) -> arb:
    if x == 0:
        raise Undefined("-inf")
    return x.log()


_RULES: dict[str, Callable[[Node, Sequence[arb]], arb]] = {
    "constant": lambda node, _: _ball(node.data),
    "linear": _linear,
    "monomial": _monomial,
    "real_power": _real_power,
}
_OF_FLINT = "sin cos tan asin acos atan atan2 sinh cosh tanh sqrt"
_FUNCTIONS: dict[str, Callable[..., arb]] = {
    "exp": _exp,
    "log": _log,
    "hypot": lambda x, y: (x * x + y * y).sqrt(),
    **{name: getattr(arb, name) for name in _OF_FLINT.split()},
}
