"""The structure of h: G with few columns and H with few rows, h(x, t) = G phi(H x, t) + offset(t).

H has as few rows as the terms allow: sin(theta_l - theta_m) sees one number. G has as few columns: a spring force that
enters two equations is one component of phi. Both are choices that change no agent, and they follow from the terms
alone: `columns` and `arguments` choose, `Arguments.restated` carries the choice out exactly.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

from flint import fmpq, fmpq_mat

from lockstep.check.expression.node import Node, linear, linear_terms, variable
from lockstep.check.expression.traversal import order, rebuild
from lockstep.check.numbers import is_double, is_plain_or_double

Row = tuple[tuple[int, Fraction], ...]
"""A linear form: (index, coefficient) pairs by increasing index, no zeros."""

Terms = Mapping[Node, Fraction]
"""A sum of nodes, each with its coefficient."""

Column = tuple[Row, Terms]
"""A column of G, and the component of phi that it multiplies."""


def columns(rows: Sequence[Terms]) -> list[Column]:
    """Choose the columns of G and the components of phi with G phi = rows, as few as the terms show.

    Rows that share terms form a group. A group with no more distinct terms than rows takes the terms as
    components (each sees fewer states than a row does), and its G holds their coefficients; a group with more
    terms than rows, or a row on its own, takes the rows as components, and its G selects them.

    Args:
        rows: the terms of each h_i that depend on states, in the order of the text.
    """
    found: list[Column] = []
    for group in _groups(_merged(rows)):
        touched = sorted({i for column, _ in group for i, _ in column})
        if len(group) < len(touched) or len(group) == len(touched) > 1:
            found += group
        else:
            found += [(((i, Fraction(1)),), rows[i]) for i in touched]
    return sorted(found, key=lambda column: column[0][0][0])


def _merged(rows: Sequence[Terms]) -> list[Column]:
    """Return (column of coefficients, term) pairs; nodes that always enter in one proportion are one term."""
    leads: dict[Row, tuple[Row, dict[Node, Fraction]]] = {}
    for number, node in enumerate(dict.fromkeys(node for row in rows for node in row)):
        column = tuple((i, row[node]) for i, row in enumerate(rows) if node in row)
        shape = tuple((i, value / column[0][1]) for i, value in column)
        first, parts = leads.get(shape, (column, {}))
        ratio = column[0][1] / first[0][1]
        if not is_double(ratio):
            # As doubles, which a design is made with, a rounded proportion would not be this agent: keep it apart.
            shape, first, parts, ratio = ((-1 - number, ratio),), column, {}, Fraction(1)
        leads[shape] = (first, {**parts, node: ratio})
    return list(leads.values())


def _groups(terms: Sequence[Column]) -> list[list[Column]]:
    """Partition terms so that two of them that enter the same equation are in the same group."""
    groups: list[list[Column]] = []
    for term in terms:
        touched = {i for i, _ in term[0]}
        linked = [g for g in groups if any(touched & {i for i, _ in column} for column, _ in g)]
        groups = [g for g in groups if g not in linked] + [[*(t for g in linked for t in g), term]]
    return groups


def forms_seen(nodes: Iterable[Node], states: int) -> frozenset[Row]:
    """Return the linear forms through which nodes see the states: sin(x - y) sees x - y only.

    Args:
        nodes: over variables of which the first `states` are the states.
        states: their number.
    """
    own: dict[Node, frozenset[Row]] = {}
    nodes = list(nodes)
    for node in order(nodes):
        row, others = _split(node, states)
        parts = (own[a] for a in others)
        own[node] = frozenset({row} if row else ()).union(*parts)
    return frozenset[Row]().union(*(own[node] for node in nodes))


def _split(node: Node, states: int) -> tuple[Row, list[Node]]:
    """Return the part of a node that is linear in the states, and its other arguments."""
    if node.op not in ("linear", "variable"):
        return (), list(node.args)
    terms = linear_terms(node)[1]
    row = tuple(sorted((x.data, c) for c, x in terms if x.op == "variable" and x.data < states))
    return row, [x for x in node.args if x.op != "variable"]


@dataclass(frozen=True)
class Arguments:
    """H and v = H x: the linear forms that phi depends on, each written exactly as a combination of rows of H."""

    rows: tuple[Row, ...]
    combinations: Mapping[Row, Sequence[Fraction] | None]

    @classmethod
    def of(cls, rows: Sequence[Row], needed: Sequence[Row]) -> "Arguments":
        """Return the arguments `rows` for the forms that are needed; the rows are independent."""
        return cls(tuple(rows), {row: solve(rows, row) for row in needed})

    def sound(self) -> bool:
        """Whether each form is a multiple of one row, or a sum of rows that doubles hold."""
        return all(
            c is not None and (sum(map(bool, c)) == 1 or all(map(is_plain_or_double, c)))
            for c in self.combinations.values()
        )

    def restated(self, nodes: Sequence[Node], states: int, time: int) -> list[Node]:
        """Return nodes over (x, u, t) as nodes over (v, t).

        Args:
            nodes: which see the states through the needed forms only, and no input.
            states: the number of states.
            time: the number of the variable t.
        """
        v = [variable(k) for k in range(len(self.rows))]
        done: dict[Node, Node] = {variable(time): variable(len(v))}
        for node in order(nodes):
            row, others = _split(node, states)
            if node.op == "linear":
                offset, terms = linear_terms(node)
                kept = [(c, done[x]) for c, x in terms if x in others or x.data == time]
                done[node] = linear(offset, [*self._combined(row, v), *kept])
            elif row:
                if row in self.combinations:
                    done[node] = linear(0, self._combined(row, v))
            elif node.op != "variable":
                done[node] = rebuild(node, [done[a] for a in node.args])
        return [done[node] for node in nodes]

    def _combined(self, row: Row, v: Sequence[Node]) -> list[tuple[Fraction, Node]]:
        if not row:
            return []
        combination = self.combinations[row]
        assert combination is not None
        return list(zip(combination, v, strict=True))


def arguments(needed: Iterable[Row]) -> Arguments:
    """Choose H: independent forms among the needed ones, or plain states where those are as few."""
    rows = sorted(needed)
    directions = _directions(rows)
    independent: list[Row] = []
    for row in directions:
        if solve(independent, row) is None:
            independent.append(row)
    states: list[Row] = [((j, Fraction(1)),) for j in sorted({j for row in rows for j, _ in row})]
    chosen = Arguments.of(sorted(independent), rows)
    dependent = len(directions) > len(independent)
    if (dependent and len(states) == len(independent)) or not chosen.sound():
        chosen = Arguments.of(states, rows)
    return chosen


def _normalised(row: Row) -> Row:
    """Return the row over the size of its smallest coefficient, if that gives doubles: 2 x - 2 y is x - y."""
    least = min(abs(value) for _, value in row)
    quotients = tuple((j, value / least) for j, value in row)
    if len(row) == 1:
        return ((row[0][0], Fraction(1)),)
    return quotients if all(is_double(value) for _, value in quotients) else row


def _directions(rows: Sequence[Row]) -> list[Row]:
    """Return the different directions among the rows, the simplest first; x - y and 2 y - 2 x are one."""
    found: dict[Row, Row] = {}
    for row in map(_normalised, rows):
        found.setdefault(max(row, tuple((j, -value) for j, value in row)), row)
    return sorted(found.values(), key=_simplicity)


def _simplicity(row: Row) -> tuple[int, Fraction, Row]:
    """Order rows with fewer states first, then those with smaller numbers."""
    return len(row), sum((abs(value) for _, value in row), Fraction(0)), row


def solve(rows: Sequence[Row], target: Row) -> list[Fraction] | None:
    """Return the exact c with sum c_k rows_k = target, or None if there are none; the rows are independent.

    >>> x, y = ((0, Fraction(1)),), ((0, Fraction(1)), (1, Fraction(-1)))
    >>> solve([x, y], ((1, Fraction(2)),))
    [Fraction(2, 1), Fraction(-2, 1)]
    >>> solve([y], x) is None
    True
    """
    if target in rows:
        return [Fraction(row == target) for row in rows]
    states = sorted({j for row in [*rows, target] for j, _ in row})
    columns = [[dict(row).get(j, Fraction(0)) for row in [*rows, target]] for j in states]
    system = fmpq_mat([[fmpq(x.numerator, x.denominator) for x in line] for line in columns])
    reduced, rank = system.rref()
    if rank > len(rows):
        return None
    return [Fraction(int(reduced[k, len(rows)].p), int(reduced[k, len(rows)].q)) for k in range(len(rows))]
