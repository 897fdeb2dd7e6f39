"""Symbolic derivatives with rules chosen for tight enclosures (sech^2 rather than 1 - tanh^2).

Piecewise operations get a selection: where a box leaves the selection open, its enclosure is the hull of
the branches, which contains Clarke's generalised derivative (Clarke 1990, chapter 2). A selection
differentiated once more has no derivative at its kink: such a node encloses everything unless the box
decides the condition.
"""

from collections.abc import Callable, Sequence
from fractions import Fraction

from lockstep.check.expression.node import ONE, ZERO, Node, add, function, linear, multiply, variable
from lockstep.check.expression.switches import choose, positive
from lockstep.check.expression.traversal import order

_UNARY: dict[str, Callable[[Node], Node]] = {
    "exp": lambda x: function("exp", x),
    "log": lambda x: 1 / x,
    "sqrt": lambda x: Fraction(1, 2) / function("sqrt", x),
    "sin": lambda x: function("cos", x),
    "cos": lambda x: -function("sin", x),
    "tan": lambda x: 1 + function("tan", x) ** 2,
    "asin": lambda x: 1 / function("sqrt", 1 - x**2),
    "acos": lambda x: -1 / function("sqrt", 1 - x**2),
    "atan": lambda x: 1 / (1 + x**2),
    "sinh": lambda x: function("cosh", x),
    "cosh": lambda x: function("sinh", x),
    "tanh": lambda x: function("sech2", x),
    "sech2": lambda x: -2 * (function("tanh", x) * function("sech2", x)),
    "fabs": lambda x: choose(positive(x, weak=True), ONE, -ONE),
}


def _partial(node: Node) -> list[Node]:
    """Return the derivative of a function node with respect to each of its arguments."""
    if node.op in _UNARY:
        return [_UNARY[node.op](node.args[0])]
    if node.op == "real_power":
        exponent = node.data
        return [exponent * function("real_power", node.args[0], data=exponent - 1)]
    x, y = node.args
    if node.op == "hypot":
        return [function("direction", x, y), function("direction", y, x)]
    if node.op == "direction":  # d/dx x/|(x, y)| = y^2/|.|^3
        length = function("hypot", x, y)
        cube, apart = length**-3, positive(length)
        # It jumps at the origin, also where y is exactly 0 and the formula is 0:
        # a box that holds the origin gets everything.
        return [choose(apart, d, d, smooth=True) for d in (y**2 * cube, -multiply(x, y, cube))]
    if node.op == "atan2":  # atan2(x, y): x is the ordinate
        square = x**2 + y**2
        return [y / square, -(x / square)]
    raise AssertionError(f"no derivative rule for {node.op}")


def _node_derivative(node: Node, inner: dict[Node, Node], index: int, of_slopes: bool) -> Node:
    if node.op == "linear":
        return linear(0, [(c, inner[a]) for c, a in zip(node.data[1], node.args, strict=True)])
    if node.op == "monomial":
        return _monomial_derivative(node, inner)
    if node.op == "choose":
        condition, a, b = node.args
        jumps = bool(node.data) or (of_slopes and index in condition.variables)
        return choose(condition, inner[a], inner[b], smooth=jumps)
    if node.op in ("fmin", "fmax"):
        x, y = node.args
        larger = positive(x - y, weak=True)
        a, b = (x, y) if node.op == "fmax" else (y, x)
        return choose(larger, inner[a], inner[b])
    if all(inner[a] is ZERO for a in node.args):
        return ZERO
    return add(*(p * inner[a] for p, a in zip(_partial(node), node.args, strict=True)))


def _monomial_derivative(node: Node, inner: dict[Node, Node]) -> Node:
    pairs = list(zip(node.args, node.data, strict=True))
    terms = []
    for x, p in pairs:
        if inner[x] is not ZERO:
            rest = [y**q for y, q in pairs if y is not x]
            terms.append(p * multiply(x ** (p - 1), inner[x], *rest))
    return add(*terms)


def derivative(outputs: Sequence[Node], index: int, *, of_slopes: bool = False) -> list[Node]:
    """Return d(output)/d(variable `index`) of each output.

    `of_slopes` says that the outputs are slopes themselves: their selections may jump, and where a box
    leaves such a selection open their derivative is everything.
    """
    inner: dict[Node, Node] = {}
    own = variable(index)
    for node in order(outputs):
        if node is own:
            inner[node] = ONE
        elif index not in node.variables or node.op in ("positive", "not", "and"):
            inner[node] = ZERO
        else:
            inner[node] = _node_derivative(node, inner, index, of_slopes)
    return [inner[n] for n in outputs]
