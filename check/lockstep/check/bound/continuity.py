"""Which switches of a piecewise function are continuous, decided exactly.

A switch `d > 0` or `d == 0` with d linear in the variables changes on a plane. The function is continuous
across the plane if its formulas before, on and after it agree there: one variable is eliminated from d = 0
and the differences must be the constant 0 in exact arithmetic, with every operation defined on the plane.
Other switches stay as they are, so the identity holds whichever way they stand, and planes that meet need
no argument of their own. A continuous, piecewise smooth function is Lipschitz, and its slope almost
everywhere decides the constant: on a box where d >= 0 the switch then counts as closed ("weak").
"""

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction

from lockstep.check.bound.enclosure import Boxes
from lockstep.check.bound.phi import ExactPhi
from lockstep.check.bound.regularity import Conditions
from lockstep.check.expression.node import ZERO, Node, Undefined, intern, linear, linear_terms
from lockstep.check.expression.switches import FALSE, TRUE
from lockstep.check.expression.traversal import expand, order, substitute


def settle(graph: ExactPhi, lower: Boxes, upper: Boxes) -> ExactPhi:
    """Return the graph with its continuous switches marked weak and their conditions dropped."""
    switches = [n for n in order(_roots(graph)) if n.op == "positive" and not n.data]
    proved: set[Node] = set()
    for plane in {_plane(s): None for s in switches}:
        own = [s for s in switches if _plane(s) is plane]
        if _is_continuous(graph, plane, own, lower, upper):
            proved.update(own)
    weak = {s: intern(s.op, s.args, True) for s in proved}
    needed = tuple(c for c in graph.conditions if c.kind != "decided" or not _switches(c.args) <= proved)
    return replace(graph, outputs=tuple(substitute(graph.outputs, weak)), conditions=needed)


def _roots(graph: ExactPhi) -> list[Node]:
    return [*graph.outputs, *(a for c in graph.conditions for a in c.args)]


def _switches(nodes: Sequence[Node]) -> set[Node]:
    return {n for n in order(nodes) if n.op == "positive" and not n.data}


def _plane(switch: Node) -> Node:
    """Return the switching function up to a factor: d and -d are one plane."""
    return (1 / _lead(switch)) * switch.args[0]


def _lead(switch: Node) -> Fraction:
    """Return the first coefficient of d; it has one, as `positive` makes no switch of a constant."""
    return linear_terms(switch.args[0])[1][0][0]


def _is_continuous(graph: ExactPhi, plane: Node, own: list[Node], lower: Boxes, upper: Boxes) -> bool:
    offset, terms = linear_terms(plane)
    if any(x.op != "variable" for _, x in terms):
        return False
    # Eliminate a component of v where there is one, else nothing jumps in v.
    candidates = [(c, x) for c, x in terms if x.data != graph.inputs]
    if not candidates:
        return False
    coefficient, eliminated = candidates[0]
    solution = linear(-offset / coefficient, [(-c / coefficient, x) for c, x in terms if x is not eliminated])
    try:
        before, on, after = (
            _on_plane(graph, own, side, eliminated, solution, lower, upper) for side in (-1, 0, 1)
        )
    except Undefined:
        return False
    return all(expand(a - b) is ZERO for x in (before, after) for a, b in zip(x, on, strict=True))


def _on_plane(
    graph: ExactPhi, own: list[Node], side: int, eliminated: Node, solution: Node, lower: Boxes, upper: Boxes
) -> list[Node]:
    """Return the outputs on the plane by one side's formula; raises `Undefined` where it has no value."""
    truths = {s: _truth(s, side) for s in own}

    def on_plane(nodes: Sequence[Node]) -> list[Node]:
        return substitute(substitute(nodes, truths), {eliminated: solution})

    needs = Conditions([c for c in graph.conditions if not c.jumps]).changed(on_plane)
    if needs.open_on(lower, upper).conditions:
        raise Undefined("an operation on the plane")
    return on_plane(graph.outputs)


def _truth(switch: Node, side: int) -> Node:
    return TRUE if side * _lead(switch) > 0 else FALSE
