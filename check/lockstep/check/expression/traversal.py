"""Walking through expressions: evaluation order, substitution, expansion."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from lockstep.check.expression.node import ONE, Node, add, constant, function, linear, linear_terms, multiply
from lockstep.check.expression.switches import both, choose, negate, positive

MOST_TERMS = 2_000
"""Of a product that is multiplied out."""


def order(outputs: Sequence[Node]) -> list[Node]:
    """Return every node the outputs need, arguments before their users."""
    seen, result = set[int](), list[Node]()
    stack = [(n, False) for n in reversed(outputs)]
    while stack:
        node, ready = stack.pop()
        if ready:
            result.append(node)
        elif node.serial not in seen:
            seen.add(node.serial)
            stack.append((node, True))
            stack.extend((a, False) for a in reversed(node.args))
    return result


def rebuild(node: Node, args: Sequence[Node]) -> Node:
    """Return the node's operation applied to new arguments, normalised anew."""
    if not node.args:
        return node
    if node.op == "linear":
        offset, coefficients = node.data
        return linear(offset, zip(coefficients, args, strict=True))
    if node.op == "monomial":
        return multiply(*(a**p for a, p in zip(args, node.data, strict=True)))
    if node.op == "positive":
        return positive(args[0], weak=bool(node.data))
    if node.op == "not":
        return negate(args[0])
    if node.op == "and":
        return both(args[0], args[1])
    if node.op == "choose":
        return choose(args[0], args[1], args[2], smooth=bool(node.data))
    return function(node.op, *args, data=node.data)


def rewritten(outputs: Sequence[Node], rule: Callable[[Node, list[Node]], Node]) -> list[Node]:
    """Return the outputs with every node made anew, from the arguments up: `rule` is given it and its new arguments."""
    done: dict[Node, Node] = {}
    for node in order(outputs):
        done[node] = rule(node, [done[a] for a in node.args])
    return [done[n] for n in outputs]


def substitute(outputs: Sequence[Node], replacement: Mapping[Node, Node]) -> list[Node]:
    """Return the outputs with nodes replaced, every user normalised anew."""
    return rewritten(outputs, lambda n, args: replacement[n] if n in replacement else rebuild(n, args))


def expand(node: Node) -> Node:
    """Return the node with products of sums multiplied out (positive powers), for the test `is ZERO`."""
    made = {"monomial": _expand_monomial}
    return rewritten([node], lambda n, args: made.get(n.op, rebuild)(n, args))[0]


def _expand_monomial(node: Node, args: Sequence[Node]) -> Node:
    result = ONE
    for arg, exponent in zip(args, node.data, strict=True):
        repeated = [arg] * exponent if 0 < exponent <= 8 else [arg**exponent]
        for part in repeated:
            left, right = linear_terms(result), linear_terms(part)
            if (len(left[1]) + 1) * (len(right[1]) + 1) > MOST_TERMS:
                return rebuild(node, args)
            result = add(
                *(
                    multiply(constant(c), x, constant(d), y)
                    for c, x in [(left[0], ONE), *left[1]]
                    for d, y in [(right[0], ONE), *right[1]]
                )
            )
    return result
