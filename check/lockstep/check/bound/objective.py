"""The slope to be bounded: one block of the scaled Jacobian as a scalar whose modulus is to be maximised.

|J|_2 = max over unit u of |J'u|. A single entry is bounded as it is; a row or a column by the sum of its
squares; a block with k = min(rows, columns) > 1 by the sum of squares of J'u (or J u), where u runs over
half the unit sphere in k - 1 angles that join the search. So every case is the maximum of one smooth
function of a few variables.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from lockstep.check.bound.identities import split_cases, unit_vectors
from lockstep.check.bound.regularity import Conditions
from lockstep.check.expression.node import ONE, ZERO, Node, add, function, multiply, power, variable

HALF_TURN = math.nextafter(math.pi, math.inf)


@dataclass(frozen=True, eq=False)
class Objective:
    """One block of slopes over the variables 0..variables-1 (v, then t) under the conditions of phi."""

    slopes: tuple[tuple[Node, ...], ...]  # rows: outputs of the block; columns: inputs
    conditions: Conditions
    variables: int

    @cached_property
    def narrow(self) -> tuple[tuple[Node, ...], ...]:
        """The slopes with no more rows than columns (transposed if need be: the norm is the same)."""
        rows = self.slopes
        return rows if len(rows) <= len(rows[0]) else tuple(zip(*rows, strict=True))

    @property
    def angles(self) -> list[tuple[float, float]]:
        """The ranges of the angles of u, variables that follow v and t."""
        count = len(self.narrow) - 1
        if count < 1:
            return []
        first = HALF_TURN if count == 1 else HALF_TURN / 2
        return [(0.0, first), *[(0.0, HALF_TURN)] * (count - 2), *[(0.0, 2 * HALF_TURN)] * (count > 1)]

    @cached_property
    def direction(self) -> list[Node]:
        """The unit vector u in spherical angles."""
        result, rest = [], ONE
        for k in range(len(self.narrow) - 1):
            angle = variable(self.variables + k)
            result.append(multiply(rest, function("cos", angle)))
            rest = multiply(rest, function("sin", angle))
        return [*result, rest]

    @cached_property
    def components(self) -> list[Node]:
        """The components of J'u that are not identically 0."""
        sums = [
            add(*(multiply(u, x) for u, x in zip(self.direction, column, strict=True)))
            for column in zip(*self.narrow, strict=True)
        ]
        return [z for z in sums if z is not ZERO]

    @property
    def squared(self) -> bool:
        """Whether `value` is the square of the slope, or the slope with its sign."""
        return len(self.components) > 1

    @cached_property
    def value(self) -> Node:
        """The scalar whose modulus (or its root, if `squared`) is the slope."""
        z = self.components
        if not z:
            return ZERO
        return split_cases(unit_vectors(add(*(power(x, 2) for x in z)))) if self.squared else z[0]

    @cached_property
    def used(self) -> frozenset[int]:
        """The variables among v and t that the slopes depend on."""
        return frozenset[int]().union(*(x.variables for row in self.slopes for x in row))


def blocks(jacobian: Sequence[Sequence[Node]]) -> list[tuple[list[int], list[int]]]:
    """Return the (rows, columns) of the independent blocks: outputs linked by the inputs they share."""
    left = {i for i, row in enumerate(jacobian) if any(x is not ZERO for x in row)}
    found = []
    while left:
        rows, columns, fresh = set[int](), set[int](), {min(left)}
        while fresh:
            rows |= fresh
            columns |= {j for i in fresh for j, x in enumerate(jacobian[i]) if x is not ZERO}
            fresh = {i for i in left - rows if any(jacobian[i][j] is not ZERO for j in columns)}
        left -= rows
        found.append((sorted(rows), sorted(columns)))
    return found
