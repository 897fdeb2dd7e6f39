"""What each operation means, by its name, and what it needs to be defined and continuous."""

from collections.abc import Callable
from typing import Protocol, runtime_checkable

from lockstep.check.expression.node import ONE, ZERO, Node, factors, function, linear_terms, multiply, number
from lockstep.check.expression.switches import choose, negate, positive

LARGEST_WHOLE_POWER = 1024


@runtime_checkable
class NoteTaker(Protocol):
    """Whoever takes note of what the operations need."""

    def need(self, kind: str, name: str, *args: Node) -> None:
        """Note that the current operation, called `name`, needs `kind` of its arguments."""
        ...

    def make(self, op: str, x: Node) -> Node:
        """Return the named function of x: by `function`, or as it is written."""
        ...


BOOLEAN = frozenset({"truth", "positive", "not", "and"})


def as_number(notes: NoteTaker, node: Node) -> Node:
    """Return a condition as 1 or 0, which jumps where it changes, and a number as it is."""
    if node.op not in BOOLEAN:
        return node
    notes.need("decided", "a comparison", node)
    return choose(node, ONE, ZERO)


def numeric(rule: Callable[..., Node]) -> Callable[..., Node]:
    """Return a rule with conditions among its arguments taken as 1 or 0."""
    return lambda reader, *args: rule(reader, *(as_number(reader, a) for a in args))


def _plain(op: str, kind: str | None = None) -> Callable[..., Node]:
    """Return the rule of a function with a name of its own, and with what it needs."""

    def rule(reader: NoteTaker, x: Node) -> Node:
        if kind is not None:
            reader.need(kind, f"`{op}`", x)
        return reader.make(op, x)

    return numeric(rule)


def _add(_: NoteTaker, a: Node, b: Node) -> Node:
    """Join the two halves that `if_else` is lowered to; add anything else."""
    if a.op == b.op == "choose" and a.args[0] is b.args[0]:
        (condition, first, other), (_c, second, third) = a.args, b.args
        if other is ZERO and second is ZERO:
            return choose(condition, first, third)
        if first is ZERO and third is ZERO:
            return choose(condition, second, other)
    return a + b


def _divide(reader: NoteTaker, a: Node, b: Node) -> Node:
    if not _is_exponential(b):
        reader.need("nonzero", "the division", b)
    return ZERO if b is ZERO else a / b


def _is_exponential(x: Node) -> bool:
    """Tell whether x is positive although its enclosure may reach 0 at infinity."""
    coefficient, powers = factors(x)
    return coefficient > 0 and bool(powers) and all(y.op in ("exp", "cosh") for y in powers)


def _sqrt(reader: NoteTaker, x: Node) -> Node:
    reader.need("not negative", "`sqrt`", x)
    if x.op == "monomial" and x.data == (2,):
        return function("fabs", x.args[0])
    legs = _legs(x)
    if len(legs) < 2:
        return function("sqrt", x)
    length = legs[0]
    for leg in legs[1:]:
        length = function("hypot", length, leg)
    return length


def _legs(x: Node) -> list[Node]:
    """Return the r_i of a sum of squares r_1^2 + r_2^2 + ..., none if x is not one."""
    offset, terms = linear_terms(x)
    if offset < 0 or any(c < 0 or n.op != "monomial" or any(p % 2 for _, p in _powers(n)) for c, n in terms):
        return []
    legs = [multiply(function("sqrt", c * ONE), *(y ** (p // 2) for y, p in _powers(n))) for c, n in terms]
    # The constant last: the slopes of the others then are a unit vector times one factor.
    return [*legs, *([function("sqrt", offset * ONE)] if offset else [])]


def _powers(node: Node) -> list[tuple[Node, int]]:
    return list(factors(node)[1].items())


def _power(reader: NoteTaker, x: Node, y: Node) -> Node:
    exponent = number(y)
    if exponent is None:
        reader.need("positive", "the power with a varying exponent", x)
        return function("exp", y * function("log", x))
    if exponent.denominator == 1 and abs(exponent) <= LARGEST_WHOLE_POWER:
        if exponent < 0:
            reader.need("nonzero", "the negative power", x)
        return x ** int(exponent)
    reader.need("not negative" if exponent > 0 else "positive", f"the power {float(exponent)}", x)
    if exponent.denominator == 2 and abs(exponent) <= LARGEST_WHOLE_POWER:
        return function("sqrt", x) ** int(2 * exponent)
    return function("real_power", x, data=exponent)


def _sign_of(reader: NoteTaker, x: Node) -> Node:
    condition = positive(x)
    reader.need("decided", "`sign`", condition)
    opposite = positive(-x)
    reader.need("decided", "`sign`", opposite)
    return choose(condition, ONE, choose(opposite, -ONE, ZERO))


def _if_else(reader: NoteTaker, condition: Node, value: Node, other: Node) -> Node:
    reader.need("decided", "`if_else`", condition)
    return choose(condition, as_number(reader, value), as_number(reader, other))


def _atan2(reader: NoteTaker, y: Node, x: Node) -> Node:
    reader.need("off the cut", "`atan2`", y, x)
    return function("atan2", y, x)


RULES: dict[str, Callable[..., Node]] = {
    "number": as_number,
    "add": numeric(_add),
    "sub": numeric(lambda _, a, b: a - b),
    "mul": numeric(lambda _, a, b: a * b),
    "div": numeric(_divide),
    "neg": numeric(lambda _, x: -x),
    "sqrt": numeric(_sqrt),
    "pow": numeric(_power),
    "exp": _plain("exp"),
    "log": _plain("log", "positive"),
    "sin": _plain("sin"),
    "cos": _plain("cos"),
    "tan": _plain("tan", "no pole"),
    "asin": _plain("asin", "within one"),
    "acos": _plain("acos", "within one"),
    "atan": _plain("atan"),
    "atan2": numeric(_atan2),
    "sinh": _plain("sinh"),
    "cosh": _plain("cosh"),
    "tanh": _plain("tanh"),
    "fabs": _plain("fabs"),
    "fmin": numeric(lambda _, a, b: function("fmin", a, b)),
    "fmax": numeric(lambda _, a, b: function("fmax", a, b)),
    "sign": numeric(_sign_of),
    "lt": numeric(lambda _, a, b: positive(b - a)),
    "le": numeric(lambda _, a, b: negate(positive(a - b))),
    "if_else": _if_else,
}
"""The meaning of each operation: a node, of `NoteTaker` and the nodes it is applied to."""
