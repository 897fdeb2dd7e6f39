"""Rewritings of a sum of squared slopes that intervals cannot see: correlated branches and unit vectors."""

from contextlib import suppress

from lockstep.check.expression.node import Node, Undefined, factors, intern, linear, linear_terms, product
from lockstep.check.expression.switches import FALSE, TRUE, choose
from lockstep.check.expression.traversal import order, substitute

MOST_CASES = 4


def split_cases(value: Node) -> Node:
    """Return the value as a choice between its cases, for conditions that several of its terms share.

    At almost every point one case holds for all terms alike, so a box that leaves the condition open needs
    the larger of the two values, not a mixture of the largest terms. max(v1, v2) has slopes (1, 0) and (0,
    1): norm 1, not sqrt(2).
    """
    uses: dict[Node, int] = {}
    for node in order([value]):
        for condition in {a for a in node.args if a.op == "positive"}:
            uses[condition] = uses.get(condition, 0) + 1
    shared = [c for c, count in uses.items() if count > 1]
    for condition in shared if len(shared) <= MOST_CASES else []:
        with suppress(
            Undefined
        ):  # a case without a value, such as 1/0 where it never holds, is not split off
            yes, no = (substitute([value], {condition: truth})[0] for truth in (TRUE, FALSE))
            value = choose(condition, yes, no)
    return value


def unit_vectors(value: Node) -> Node:
    """Return the sum with direction(x, y)^2 + direction(y, x)^2 = 1 carried out, at the origin as a limit."""
    while (shorter := _one_pair_less(value)) is not None:
        value = shorter
    return value


def _one_pair_less(value: Node) -> Node | None:
    offset, terms = linear_terms(value)
    left = {node: c for c, node in terms}
    for node, c in left.items():
        for rest, partner in _partners(node):
            if partner is not node and left.get(partner) == c:
                kept = [(k, n) for n, k in left.items() if n not in (node, partner)]
                return linear(offset, [*kept, (c, rest)])
    return None


def _partners(node: Node) -> list[tuple[Node, Node]]:
    """Return (rest, rest * direction(y, x)^2) for each factor direction(x, y)^2 of the node."""
    coefficient, powers = factors(node)
    found = []
    for x, p in powers.items():
        if x.op == "direction" and p == 2:
            rest = {y: q for y, q in powers.items() if y is not x}
            turned = intern("direction", (x.args[1], x.args[0]))
            found.append((product(coefficient, rest), product(coefficient, {**rest, turned: 2})))
    return found
