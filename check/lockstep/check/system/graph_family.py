"""Not one graph but all that have their spectrum in an interval: what `[network] spectrum` names."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from lockstep.check.errors import demand
from lockstep.check.json_text import number, or_none, whole
from lockstep.check.system.graph import Digraph

MOST_NEIGHBOURS = 4096
"""Of one agent: each rounding of the sum over them counts."""


@dataclass(frozen=True)
class SpectrumRange:
    """Every connected undirected graph, its nonzero Laplacian eigenvalues in [lower, upper], with so many neighbours at most.

    Raises:
        ProblemError: no interval above 0.
    """

    lower: float
    upper: float
    neighbours: int

    def __post_init__(self) -> None:
        found, where = f"[{self.lower}, {self.upper}]", "[network] spectrum"
        demand(0 < self.lower <= self.upper < math.inf, found, where, "[a, b] with 0 < a <= b")

    @classmethod
    def of(cls, table: Mapping[str, Any]) -> Self:
        """Read `spectrum` and `max_degree` of [network]; by default b, which unit weights cannot exceed.

        An agent with the in-degree d has lambda_N >= d N / (N - 1), the Rayleigh quotient of its unit vector less its mean.
        """
        value, where, expected = table["spectrum"], "[network] spectrum", "two numbers"
        demand(isinstance(value, list | tuple) and len(value) == 2, f"{value!r}", where, expected)
        low, high = (number(one, where) for one in value)
        for key in ("edges", "laplacian", "topology"):
            demand(table.get(key) is None, f"`{key}` is given too", "[network]", "a graph or `spectrum`")
        unit = max(1, min(math.floor(high), MOST_NEIGHBOURS))
        most = or_none(whole(1, MOST_NEIGHBOURS), unit)(table.get("max_degree"), "[network] max_degree")
        return cls(low, high, most)

    @property
    def pair(self) -> Digraph:
        """The two agents with lambda_2 = lower."""
        weight = self.lower / 2
        return Digraph(np.array([[0.0, weight], [weight, 0.0]]))
