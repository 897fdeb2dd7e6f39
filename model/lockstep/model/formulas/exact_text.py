"""Exact expressions in words of a problem file, for messages."""

from collections.abc import Sequence
from fractions import Fraction

from lockstep.check.expression.node import Node, linear_terms
from lockstep.check.expression.traversal import order

LONGEST = 400
"""Characters of a part: an expression that uses its parts over and over would fill the memory."""

_NAMES = {"fabs": "abs", "fmin": "min", "fmax": "max", "choose": "if_else"}
_PATTERNS = {"positive": "{} > 0", "not": "not {}", "and": "{} and {}"}


def formula_text(node: Node, names: Sequence[str]) -> str:
    """Return a node as a formula in the variables' names; long parts are cut.

    >>> from lockstep.check.expression.node import add, multiply, scale, variable
    >>> x, y = variable(0), variable(1)
    >>> formula_text(add(scale(2, x), multiply(x, y)), ["x", "y"])
    '((2*x)+(x*y))'
    """
    texts: dict[Node, str] = {}
    for part in order([node]):
        text = _text(part, [texts[a] for a in part.args], names)
        texts[part] = text if len(text) <= LONGEST else f"{text[: LONGEST - 4]} ..."
    return texts[node]


def _text(node: Node, args: Sequence[str], names: Sequence[str]) -> str:
    if node.op == "variable":
        index: int = node.data
        return names[index]
    if node.op == "truth":
        return "true" if node.data else "false"
    if node.op in ("constant", "linear"):
        return _sum(node, args)
    if node.op == "monomial":
        return _product(node, args)
    if node.op == "real_power":
        return f"{args[0]}**{float(node.data):.6g}"
    if node.op in _PATTERNS:
        return _PATTERNS[node.op].format(*args)
    return f"{_NAMES.get(node.op, node.op)}({', '.join(args)})"


def _sum(node: Node, args: Sequence[str]) -> str:
    offset, terms = linear_terms(node)
    coefficients = [c for c, _ in terms]
    parts = [_scaled(c, text) for c, text in zip(coefficients, args, strict=False)]
    if offset or not parts:
        parts.append(_number(offset))
    total = parts[0]
    for part in parts[1:]:
        total = f"({total}{part if part.startswith('-') else f'+{part}'})"
    return total


def _scaled(coefficient: Fraction, text: str) -> str:
    if abs(coefficient) == 1:
        return text if coefficient == 1 else f"(-{text})"
    return f"({_number(coefficient)}*{text})"


def _product(node: Node, args: Sequence[str]) -> str:
    above, below = list[str](), list[str]()
    for text, p in zip(args, node.data, strict=True):
        (above if p > 0 else below).append(text if abs(p) == 1 else f"{text}**{abs(p)}")
    top = "*".join(above) or "1"
    return f"({top}/{'/'.join(below)})" if below else f"({top})" if len(above) > 1 else top


def _number(value: Fraction) -> str:
    try:
        return f"{float(value):.6g}"
    except OverflowError:
        return "inf" if value > 0 else "-inf"
