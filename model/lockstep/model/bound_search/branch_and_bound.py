"""Branch and bound: the largest modulus of the objective over a domain, from above and from below.

Boxes are taken in batches, worst first, and examined as the checker examines them (`lockstep.check.bound.cover`). A box
that cannot exceed what was reached elsewhere by more than the tolerance is done. Boxes without a finite enclosure come
first, deepest first, so that a slope without bound or an undefined operation is found at once (Hansen & Walster 2004,
chapters 11 and 12).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from lockstep.check.bound import intervals
from lockstep.check.bound.cover import Cover, Part, Pool
from lockstep.check.bound.decide import BATCH
from lockstep.check.bound.intervals import INF
from lockstep.check.bound.unbounded.charts import Enclosure, to_v
from lockstep.check.bound.unbounded.tails import Pattern
from lockstep.model.bound_search.diagnosis import explain
from lockstep.model.bound_search.incumbent import Incumbent
from lockstep.model.bound_search.point_slopes import PointSlopes

NEARLY = 1.01  # a bound this close to a slope reached, over an unbounded domain, is not searched further
UNFINISHED = "the budget was spent before every part of the domain had a finite enclosure"


@dataclass(frozen=True)
class SearchState:
    """Where a search stands: boxes examined, the slope reached and the bound proved so far, the part of the budget spent."""

    boxes: int
    lower: float
    upper: float
    part: float


@dataclass(frozen=True)
class SearchBudget:
    """When to stop: the relative gap, or a budget.

    boxes: the budget, a count, so that no answer depends on a clock. A batch counts as `BATCH` boxes at least: it takes
    half as long with a few boxes as it does when it is full.
    """

    tolerance: float
    boxes: int
    progress: Callable[[SearchState], None] | None = None
    ceiling: float = INF  # a bound known from elsewhere


@dataclass(frozen=True)
class SlopeRange:
    """The largest slope lies in [lower, upper]; `point` = (v, t) reaches `lower`."""

    lower: float
    upper: float
    point: Float[np.ndarray, " variables"] | None
    boxes: int
    converged: bool
    reason: str


@dataclass
class CoverSearch:
    """One search of a cover; points are drawn from `original`, the domain of v and t before it was reduced."""

    cover: Cover
    limits: SearchBudget
    original: tuple[Float[np.ndarray, " plain"], Float[np.ndarray, " plain"]]
    done: float = 0.0
    boxes: int = 0
    spent: int = 0
    pools: dict[Pattern, Pool] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.reach = Incumbent(PointSlopes(self.cover.objective), *self.original)

    def run(self) -> SlopeRange:
        """Return the enclosure of the largest slope."""
        self.reach.sample(self.cover.cutter.kinks, polish=False)
        self._examine(self.cover.root)
        if self._remaining():
            self.reach.sample(self.cover.cutter.kinks, polish=True)
            self._prune()
        if self.limits.ceiling <= max(self.cutoff, self.reach.slope * NEARLY):
            return self._outcome(None)
        while self._remaining():
            hopeless = self._hopeless()
            if hopeless is not None or self.spent >= self.limits.boxes:
                return self._outcome(hopeless)
            self._step()
            if self.limits.progress is not None:
                part = min(1.0, self.spent / self.limits.boxes)
                self.limits.progress(SearchState(self.boxes, max(self.reach.slope, 0.0), self._upper(), part))
        return self._outcome(None)

    @property
    def cutoff(self) -> float:
        """A box whose bound is no larger is done."""
        return max(self.reach.slope, 0.0) * (1.0 + self.limits.tolerance)

    def _examine(self, part: Part) -> None:
        """Enclose new boxes, shrink them, and keep those that are not done."""
        pattern, lower, _, _ = part
        self.boxes += lower.shape[1]
        self.spent += max(lower.shape[1], BATCH)
        found = self.cover.examine(part, self.cutoff)
        for enclosure in found.enclosures:
            self._try_middles(pattern, enclosure)
        self._account(found.left_out)
        self.pools[pattern] = self.pools[pattern].join(found.pool) if pattern in self.pools else found.pool
        self._prune()

    def _try_middles(self, pattern: Pattern, found: Enclosure) -> None:
        estimate = intervals.mignitude(found.at_middle)
        estimate = np.where(found.defined & np.isfinite(estimate), estimate, -1.0)
        i = int(np.argmax(estimate))
        squared = self.cover.objective.squared
        level = self.reach.slope * self.reach.slope if squared else self.reach.slope
        if estimate[i] > level * (1.0 + 1e-14) or self.reach.slope < 0:
            self.reach.try_point(to_v(found.middle[:, i], pattern))

    def _account(self, bound: float) -> None:
        self.done = max(self.done, bound)

    def _prune(self) -> None:
        cutoff = self.cutoff
        for pattern, pool in self.pools.items():
            # A point that cannot be split is done with what is proved of it.
            over = (pool.bound <= cutoff) | ((pool.split < 0) & (pool.bound < INF))
            if over.any():
                self._account(float(pool.bound[over].max()))
                self.pools[pattern] = pool.take(~over)

    def _remaining(self) -> bool:
        return any(pool.bound.size for pool in self.pools.values())

    def _upper(self) -> float:
        found = max([self.done, *(float(p.bound.max(initial=0.0)) for p in self.pools.values())])
        return min(found, self.limits.ceiling)

    def _hopeless(self) -> tuple[Pattern, Pool] | None:
        """Return a box that is as small as boxes get and still has no enclosure."""
        for pattern, pool in self.pools.items():
            stuck = np.isinf(pool.bound) & self.cover.stuck(pool)
            if stuck.any():
                return pattern, pool.take(np.flatnonzero(stuck)[:1])
        return None

    def _step(self) -> None:
        pattern = max(self.pools, key=lambda p: self._urgency(self.pools[p]))
        pool = self.pools[pattern]
        blind = np.isinf(pool.bound)
        order = np.lexsort((-pool.depth, -pool.bound))[: 16 if blind.any() else BATCH]
        rest = np.ones(pool.bound.size, dtype=bool)
        rest[order] = False
        taken = pool.take(order)
        self.pools[pattern] = pool.take(rest)
        for part in self.cover.cutter.split(pattern, taken):
            self._examine(part)

    def _urgency(self, pool: Pool) -> tuple[float, float]:
        if not pool.bound.size:
            return -1.0, 0.0
        top = float(pool.bound.max())
        return top, float(pool.depth[pool.bound == top].max())

    def _outcome(self, hopeless: tuple[Pattern, Pool] | None) -> SlopeRange:
        lower, upper, reason = max(self.reach.slope, 0.0), self._upper(), ""
        if hopeless is not None and self.limits.ceiling == INF:
            pattern, pool = hopeless
            reason = explain(
                self.cover.chart(pattern), pool.lower, pool.upper, self.cover.objective.variables, lower
            )
            upper = INF
        elif upper == INF:
            reason = UNFINISHED
        # A rounding above the cutoff is what a single point's enclosure costs.
        converged = upper <= self.cutoff * (1.0 + 1e-12)
        return SlopeRange(lower, upper, self.reach.point, self.boxes, converged, reason)
