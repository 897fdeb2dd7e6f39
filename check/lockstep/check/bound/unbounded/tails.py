"""Half-infinite ranges: v = 1/s or v = -1/s with s in (0, e], rewritten so that infinities cancel.

Substitution alone gives inf/inf. Factoring the lowest power of s out of every sum turns a rational function
such as (1 - v^2)/(1 + v^2)^2 into s^2 (s^2 - 1)/(s^2 + 1)^2, which is bounded on s in [0, e] by ordinary
intervals. A power of v against an exponential, v^2 exp(-v^2), is bounded by monotonicity: where its
logarithmic derivative says that it falls towards infinity, its value at the inner end of the tail bounds
it.
"""

from collections.abc import Sequence
from fractions import Fraction
from functools import reduce
from typing import Any

from lockstep.check.expression.derivative import derivative
from lockstep.check.expression.node import (
    ZERO,
    Node,
    add,
    factors,
    function,
    intern,
    linear,
    linear_terms,
    product,
    variable,
)
from lockstep.check.expression.switches import positive
from lockstep.check.expression.traversal import expand, rebuild, rewritten, substitute

Pattern = tuple[int, ...]  # per variable: 0 as it is, +1 the upper tail, -1 the lower one
_DECAYING = frozenset({"exp", "sech2"})


def on_tails(outputs: Sequence[Node], pattern: Pattern) -> list[Node]:
    """Return the outputs in the coordinates of the pattern, infinities cancelled; fit for differentiation."""
    moved = {variable(k): side / variable(k) for k, side in enumerate(pattern) if side}
    return _factor(substitute(outputs, moved), _tails(pattern)) if moved else list(outputs)


def bounded_on_tails(outputs: Sequence[Node], pattern: Pattern) -> list[Node]:
    """Return outputs that are in tail coordinates with decaying products bounded; fit for evaluation only."""
    tails = _tails(pattern)
    return _bound_decay(_factor(outputs, tails), tails) if tails else list(outputs)


def _tails(pattern: Pattern) -> list[Node]:
    return [variable(k) for k, side in enumerate(pattern) if side]


def _factor(outputs: Sequence[Node], tails: Sequence[Node]) -> list[Node]:
    return rewritten(outputs, lambda node, args: reduce(_factor_node, tails, rebuild(node, args)))


def _exponent(node: Node, s: Node) -> int:
    """Return the power of sqrt(s) in the node as a factor."""
    powers = factors(node)[1]
    return 2 * powers.get(s, 0) + powers.get(function("sqrt", s), 0)


def _power(s: Node, halves: int) -> Node:
    """Return sqrt(s)^halves."""
    return s ** (halves // 2) if halves % 2 == 0 else function("sqrt", s) ** halves


def _without(node: Node, s: Node) -> Node:
    """Return the node without its factor in s."""
    coefficient, powers = factors(node)
    return product(coefficient, {x: p for x, p in powers.items() if x not in (s, function("sqrt", s))})


def _factor_node(node: Node, s: Node) -> Node:
    """Pull powers of the positive variable s out of one operation."""
    op = node.op
    if op == "linear":
        return _factor_sum(node, s)
    if op == "monomial":
        return _power(s, _exponent(node, s)) * _without(node, s)
    if op == "sqrt" and node.args[0] is not s:
        p = _exponent(node.args[0], s)
        if p % 2 == 0:
            return _power(s, p // 2) * function("sqrt", _without(node.args[0], s))
    if op in ("fabs", "hypot", "direction"):
        p = min(_exponent(a, s) for a in node.args)
        if p >= 0:
            return node
        inner = function(op, *(_factor_node(_power(s, -p) * a, s) for a in node.args))
        return inner if op == "direction" else _power(s, p) * inner
    if op == "positive" and _exponent(node.args[0], s) < 0:
        return positive(_without(node.args[0], s), weak=bool(node.data))
    return node


def _factor_sum(node: Node, s: Node) -> Node:
    offset, terms = linear_terms(node)
    if len(terms) == 1 and not offset:
        return node
    growing = _fastest([x for _, n in terms for x in factors(n)[1] if _grows(x, s)], s)
    if growing is not None:  # 1 + exp(u) = exp(u) (1 + exp(-u)) where u goes to infinity
        return growing * linear(0, [(offset, growing**-1), *((c, x / growing) for c, x in terms)])
    lowest = min((_exponent(x, s) for _, x in terms if not _decays(x, s)), default=0)
    if lowest >= 0:
        return node
    lift = _power(s, -lowest)
    return _power(s, lowest) * add(offset * lift, *(c * (lift * x) for c, x in terms))


def _grows(node: Node, s: Node) -> bool:
    return node.op == "exp" and _leading(node.args[0], s)[0] < 0 < _leading(node.args[0], s)[1]


def _leading(exponent: Node, s: Node) -> tuple[int, Fraction]:
    """Return (p, c) of c s^p, the term that decides an exponent as s falls to 0; c = 0 if none is seen to."""
    best = (0, Fraction(0))
    for c, part in _laurent_terms(exponent):
        p = _exponent(part, s)
        if p < best[0]:
            pure = set(factors(part)[1]) <= {s}
            best = (p, c if pure else Fraction(0))
        elif p == best[0] and p < 0:
            best = (p, Fraction(0))
    return best


def _laurent_terms(node: Node) -> tuple[tuple[Fraction, Node], ...]:
    """Undo the factoring of a sum in s: s^-2 (1 + s) is s^-2 + s^-1."""
    return linear_terms(expand(node))[1]


def _fastest(candidates: list[Node], s: Node) -> Node | None:
    best: Node | None = None
    for x in candidates:
        if best is None or _grows(x / best, s):
            best = x
    return best


def _decays(node: Node, s: Node) -> bool:
    return any(x.op in _DECAYING and s.data in x.variables for x in factors(node)[1])


def _bound_decay(outputs: Sequence[Node], tails: Sequence[Node]) -> list[Node]:
    return rewritten(
        outputs,
        lambda node, args: _bounded_product(node, tails) if node.op == "monomial" else rebuild(node, args),
    )


def _bounded_product(node: Node, tails: Sequence[Node]) -> Node:
    """Split node = part * rest with part > 0 a power of s against a decaying factor, and bound the part."""
    _, powers = factors(node)
    growing = [s for s in tails if _exponent(node, s) < 0 and _decays(node, s)]
    if not growing:
        return node
    s = growing[0]
    roots = [function("sqrt", x) for x in tails]
    part = {x: p for x, p in powers.items() if x in tails or x in roots or (x.op in _DECAYING and p > 0)}
    rest = {x: p for x, p in powers.items() if x not in part}
    index: Any = s.data
    whole = product(1, part)
    logarithmic = add(*(p * _relative_slope(x, index) for x, p in part.items()))
    slope = _factor([logarithmic], tails)[0]
    end = substitute([whole], {s: intern("inner_end", (), index)})[0]
    others = [x for x in tails if x is not s]
    end = _bound_decay([end], others)[0] if others else end
    bounded = function("decreasing", whole, slope, end)
    return bounded * product(1, rest)


def _relative_slope(x: Node, index: int) -> Node:
    """Return x'/x of a positive factor: a variable or its root, exp or sech^2."""
    if x.op == "sqrt":
        return Fraction(1, 2) * _relative_slope(x.args[0], index)
    if x.op == "variable":
        return 1 / x if x.data == index else ZERO
    inner = derivative([x.args[0]], index)[0]
    return inner if x.op == "exp" else -2 * (function("tanh", x.args[0]) * inner)
