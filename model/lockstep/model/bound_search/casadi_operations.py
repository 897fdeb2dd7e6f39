"""What the operations of CasADi mean that no text has: written with those that the checker knows, or left out.

An operation without a rule, such as `erf` or `fmod`, is refused by its name: no design file could hold it.
"""

from collections.abc import Callable, Mapping

import casadi as ca

from lockstep.check.expression import operations
from lockstep.check.expression.node import ONE, ZERO, Node, function, linear, power, scale
from lockstep.check.expression.operations import NoteTaker, numeric
from lockstep.check.expression.switches import both, choose, either, negate, positive


def as_condition(node: Node) -> Node:
    """Return a number as the condition that it is not 0: above, or below."""
    if node.op in operations.BOOLEAN:
        return node
    return either(positive(node), positive(scale(-1, node)))


def _if_else(reader: NoteTaker, condition: Node, value: Node, other: Node) -> Node:
    return operations.RULES["if_else"](reader, as_condition(condition), value, other)


def _copysign(reader: NoteTaker, x: Node, y: Node) -> Node:
    below = positive(scale(-1, y))
    reader.need("decided", "`copysign`", below)
    modulus = function("fabs", x)
    return choose(below, scale(-1, modulus), modulus)


def _log1p(reader: NoteTaker, x: Node) -> Node:
    argument = linear(1, [(1, x)])
    reader.need("positive", "`log1p`", argument)
    return function("log", argument)


RULES: Mapping[str, Callable[..., Node]] = {
    **operations.RULES,
    "assign": lambda _, x: x,
    "printme": lambda _, x, __: x,
    "lift": lambda _, x, __: x,
    "inv": lambda reader, x: operations.RULES["div"](reader, ONE, x),
    "constpow": operations.RULES["pow"],
    "twice": numeric(lambda _, x: scale(2, x)),
    "sq": numeric(lambda _, x: power(x, 2)),
    "hypot": numeric(lambda _, x, y: function("hypot", x, y)),
    "copysign": numeric(_copysign),
    "expm1": numeric(lambda _, x: linear(-1, [(1, function("exp", x))])),
    "log1p": numeric(_log1p),
    "eq": numeric(lambda _, a, b: negate(as_condition(a - b))),
    "ne": numeric(lambda _, a, b: as_condition(a - b)),
    "not": lambda _, x: negate(as_condition(x)),
    "and": lambda _, a, b: both(as_condition(a), as_condition(b)),
    "or": lambda _, a, b: either(as_condition(a), as_condition(b)),
    "if_else": _if_else,
    "if_else_zero": lambda reader, condition, value: _if_else(reader, condition, value, ZERO),
}
"""The meaning of each operation: a node, of `NoteTaker` and the nodes it is applied to."""

INSTEAD: Mapping[int, str] = {
    ca.OP_EXPM1: "write exp(x) - 1",
    ca.OP_LOG1P: "write log(1 + x)",
    ca.OP_HYPOT: "write sqrt(x**2 + y**2)",
    ca.OP_ASINH: "write log(x + sqrt(x**2 + 1))",
    ca.OP_ACOSH: "write log(x + sqrt(x**2 - 1))",
    ca.OP_ATANH: "write log((1 + x)/(1 - x))/2",
    ca.OP_COPYSIGN: "write sign(y)*fabs(x)",
    ca.OP_AND: "nest if_else for more than one condition",
    ca.OP_OR: "nest if_else for more than one condition",
    ca.OP_EQ: "use <, <=, > or >= in if_else",
    ca.OP_NE: "use <, <=, > or >= in if_else",
    ca.OP_CALL: "expand function calls before building the agent",
}
"""What to write for an operation that no formula has."""
