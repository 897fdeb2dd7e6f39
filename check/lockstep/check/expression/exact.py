"""Expressions of a problem file as exact nodes, with the conditions under which they have a value.

A decimal number is the IEEE double nearest to it, taken exactly; arithmetic on constants is exact from there on, and an
elementary function of a constant is the double nearest to its true value (`constants`), so that every coefficient is
rational.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from math import isinf

from lockstep.check.expression.condition import HOLDS, Condition
from lockstep.check.expression.constants import nearest_double
from lockstep.check.expression.node import (
    ZERO,
    Node,
    Undefined,
    constant,
    factors,
    function,
    intern,
    linear_terms,
    number,
)
from lockstep.check.expression.operations import BOOLEAN, LARGEST_WHOLE_POWER, RULES
from lockstep.check.expression.switches import FALSE, TRUE, negate
from lockstep.check.expression.traversal import order
from lockstep.check.numbers import as_float

LONGEST_CONSTANT = 1 << 16
"""Bits of a numerator or denominator, so that no short text makes numbers that take minutes to add."""

MOST_FACTORS = 12
"""Of a product: its second derivatives have the third power of as many parts, 79 of them took 19 s to enclose once."""


@dataclass(frozen=True)
class Value:
    """A node and what must hold for it to have a value and not to jump."""

    node: Node
    conditions: tuple[Condition, ...] = ()


class Exact:
    """The algebra of exact nodes for `text.parse`.

    Args:
        time: the number of the variable that is the time: what jumps in t alone is no condition.
        rules: what each operation means.

    >>> from lockstep.check.expression.node import variable
    >>> from lockstep.check.expression.text import parse
    >>> value = parse("(x + x)/4 - sqrt(9)", {"x": Value(variable(0))}, Exact(1))
    >>> value.node.data
    (Fraction(-3, 1), (Fraction(1, 2),))
    """

    def __init__(self, time: int, rules: Mapping[str, Callable[..., Node]] = RULES) -> None:
        self.time, self.rules = time, rules
        self.seen: dict[Node, int] = {}
        """Every node that was a term of a value, by its first place: the order of the text."""

    def number(self, value: float) -> Value:
        """Return the rational that a double is."""
        return Value(constant(Fraction(value)))

    def apply(self, operation: str, *values: Value) -> Value:
        """Return the operation on values; `Undefined`, with the IEEE value as its text, if it has none."""
        notes = Notes(self.time)
        nodes = [value.node for value in values]
        if operation == "div" and nodes[-1] is ZERO:
            raise Undefined("a division by zero")
        if operation == "pow":
            _check_power(*nodes)
        try:
            node = self.rules[operation](notes, *nodes)
        except Undefined:
            raise Undefined("inf") from None
        if not node.variables and node.op not in BOOLEAN and number(node) is None:
            node = _rounded(node)
        _check_length(node)
        for _, term in linear_terms(node)[1]:
            self.seen.setdefault(term, len(self.seen))
        branches = _branches(operation, values)
        found = {c.under(gate): None for value, gate in branches for c in value.conditions}
        return Value(node, tuple(c for c in {**found, **notes.found} if c.guard is not FALSE))

    def size(self, value: Value) -> float | None:
        """Return the double nearest to a constant, infinite above all doubles."""
        known = number(value.node)
        return None if known is None else as_float(known)

    def worst_constant(self, value: Value) -> float:
        """Return a coefficient that is above all doubles as plus or minus infinity, 0 if there is none."""
        for node in order([value.node]):
            offset, terms = linear_terms(node)
            for size in map(as_float, (offset, *(c for c, _ in terms))):
                if isinf(size):
                    return size
        return 0.0


class Notes:
    """What one operation needs; it keeps functions as they are written: sin(y - x) sees y - x."""

    def __init__(self, time: int) -> None:
        self.time = time
        self.found: dict[Condition, None] = {}

    def need(self, kind: str, name: str, *args: Node) -> None:
        """Note what the operation needs; a jump in t alone leaves h(., t) continuous for every t."""
        if kind == "decided" and all(a.variables <= {self.time} for a in args):
            return
        values = [number(a) for a in args]
        # A constant jumps nowhere, and no rational number is a pole of tan.
        if None not in values and (kind not in HOLDS or HOLDS[kind]((values[0], values[0]))):
            return
        self.found[Condition(kind, args, name)] = None

    def make(self, op: str, x: Node) -> Node:
        """Return the function, simplified for a constant only."""
        return function(op, x) if number(x) is not None else intern(op, (x,))


def _branches(operation: str, values: tuple[Value, ...]) -> list[tuple[Value, Node]]:
    """Return the values with the conditions under which each of them is used."""
    if operation == "if_else":
        condition, first, other = values
        return [(condition, TRUE), (first, condition.node), (other, negate(condition.node))]
    zeros = [value for value in values if operation == "mul" and value.node is ZERO]
    return [(value, TRUE) for value in zeros or values]  # a parameter that is 0 turns its term off


def _rounded(node: Node) -> Node:
    size = nearest_double(node)
    if isinf(size):
        raise Undefined(str(size))
    return constant(Fraction(size))


def _bits(value: Fraction) -> int:
    return max(value.numerator.bit_length(), value.denominator.bit_length())


def _check_power(base: Node, exponent: Node) -> None:
    """Refuse a power whose coefficient is too long before it is computed."""
    p = number(exponent)
    if (
        p is not None
        and abs(p) <= LARGEST_WHOLE_POWER
        and _bits(factors(base)[0]) * abs(p) > LONGEST_CONSTANT
    ):
        raise Undefined(f"a constant of more than {LONGEST_CONSTANT} binary digits")


def _check_length(node: Node) -> None:
    offset, terms = linear_terms(node)
    if any(_bits(c) > LONGEST_CONSTANT for c in (offset, *(c for c, _ in terms))):
        raise Undefined(f"a constant of more than {LONGEST_CONSTANT} binary digits")
    if any(one.op == "monomial" and len(one.args) > MOST_FACTORS for _, one in terms):
        raise Undefined(f"a product of more than {MOST_FACTORS} different factors")
