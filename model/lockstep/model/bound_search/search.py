"""Branch and bound: the largest modulus of the objective over a domain, from above and from below.

Boxes are taken in batches, worst first. Each is enclosed by interval evaluation met with the mean value
form; where a derivative has one sign the box shrinks to a face (monotonicity); a box that cannot exceed
what was reached elsewhere by more than the tolerance is done. Boxes without a finite enclosure come first,
deepest first, so that a slope without bound or an undefined operation is found at once (Hansen & Walster
2004, chapters 11 and 12).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from lockstep.check.bound import rounding
from lockstep.check.bound.charts import Chart, Enclosure, to_v
from lockstep.check.bound.objective import Objective
from lockstep.check.bound.program import Boxes
from lockstep.check.bound.rounding import INF
from lockstep.check.bound.tails import Pattern
from lockstep.model.bound_search.explain import explain
from lockstep.model.bound_search.pool import Cutter, Pool, splittable
from lockstep.model.bound_search.reach import Reach
from lockstep.model.bound_search.sampling import breakpoints

BATCH = 256
NEARLY = 1.01  # a bound this close to a slope reached, over an unbounded domain, is not searched further
UNFINISHED = "the budget was spent before every part of the domain had a finite enclosure"
HALVINGS = 40  # a box 2^-40 of its domain in every direction without an enclosure has none to be found


@dataclass(frozen=True)
class Progress:
    """Where a search stands: boxes examined, the slope reached and the bound proved so far, the part of the budget spent."""

    boxes: int
    lower: float
    upper: float
    part: float


@dataclass(frozen=True)
class Limits:
    """When to stop: the relative gap, or a bound to decide, or a budget.

    boxes: the budget, a count, so that no answer depends on a clock. A batch counts as `BATCH` boxes at least: it takes
    half as long with a few boxes as it does when it is full.
    """

    tolerance: float
    boxes: int
    asked: float | None = None
    progress: Callable[[Progress], None] | None = None
    ceiling: float = INF  # a bound known from elsewhere


@dataclass(frozen=True)
class Outcome:
    """The largest slope lies in [lower, upper]; `point` = (v, t) reaches `lower`."""

    lower: float
    upper: float
    point: Float[np.ndarray, " variables"] | None
    boxes: int
    converged: bool
    reason: str


@dataclass
class Search:
    """One search over the domain of v, t and angles; points are drawn from `original`, that of v and t."""

    objective: Objective
    lower: Float[np.ndarray, " variables"]
    upper: Float[np.ndarray, " variables"]
    limits: Limits
    original: tuple[Float[np.ndarray, " plain"], Float[np.ndarray, " plain"]]
    done: float = 0.0
    boxes: int = 0
    spent: int = 0
    pools: dict[Pattern, Pool] = field(default_factory=dict)
    charts: dict[Pattern, Chart] = field(default_factory=dict)

    def run(self) -> Outcome:
        """Return the enclosure of the largest slope."""
        self._prepare()
        self._examine(self._root_pattern, self.root_lower[:, None], self.root_upper[:, None], np.zeros(1))
        if self._remaining():
            self.reach.sample(self.cutter.kinks, polish=True)
            self._prune()
        if self.limits.ceiling <= max(self.cutoff, self.reach.slope * NEARLY):
            return self._outcome(None)
        while self._remaining() and not self._decided():
            hopeless = self._hopeless()
            if hopeless is not None or self.spent >= self.limits.boxes:
                return self._outcome(hopeless)
            self._step()
            if self.limits.progress is not None:
                part = min(1.0, self.spent / self.limits.boxes)
                self.limits.progress(Progress(self.boxes, max(self.reach.slope, 0.0), self._upper(), part))
        return self._outcome(None)

    def _prepare(self) -> None:
        o = self.objective
        self.count = len(self.lower)
        lower, upper = self.lower[:, None], self.upper[:, None]
        self.open_conditions = o.conditions.open_on(lower, upper)
        needed = o.value.variables.union(
            *(n.variables for c in self.open_conditions.conditions for n in (c.guard, *c.args))
        )
        self.searched = sorted(needed)
        fixed = [k for k in range(self.count) if k not in needed]
        self.root_lower, self.root_upper = self.lower.copy(), self.upper.copy()
        inside = np.clip(0.0, self.lower, self.upper)
        self.root_lower[fixed] = self.root_upper[fixed] = inside[fixed]
        self._root_pattern: Pattern = (0,) * self.count
        kinks = breakpoints(o.value, self.count)
        largest = max((abs(x) for xs in kinks for x in xs), default=0.0)
        self.cutter = Cutter(kinks, 2.0 ** math.ceil(math.log2(max(1.0, 2.0 * largest))))
        self.reach = Reach(o, *self.original)
        self.reach.sample(kinks, polish=False)

    @property
    def cutoff(self) -> float:
        """A box whose bound is no larger is done."""
        if self.limits.asked is not None:
            return self.limits.asked
        return max(self.reach.slope, 0.0) * (1.0 + self.limits.tolerance)

    def _chart(self, pattern: Pattern) -> Chart:
        if pattern not in self.charts:
            self.charts[pattern] = Chart(self.objective, self.open_conditions, self.searched, pattern)
        return self.charts[pattern]

    def _examine(self, pattern: Pattern, lower: Boxes, upper: Boxes, depth: np.ndarray) -> None:
        """Enclose new boxes, shrink them, and keep those that are not done."""
        chart = self._chart(pattern)
        self.boxes += lower.shape[1]
        self.spent += max(lower.shape[1], BATCH)
        lower, upper = lower.copy(), upper.copy()
        found = chart.enclose(lower, upper)
        self._try_middles(pattern, found)
        shrunk = self._shrink(pattern, lower, upper, found)
        bound = self._bound(found)
        if shrunk.any():
            again = chart.enclose(lower[:, shrunk], upper[:, shrunk])
            self._try_middles(pattern, again)
            bound[shrunk] = np.minimum(bound[shrunk], self._bound(again))
        split = self._directions(pattern, lower, upper, found)
        new = Pool(lower, upper, bound, depth, split)
        old = self.pools.get(pattern, Pool.empty(self.count))
        self.pools[pattern] = old.join(new)
        self._prune()

    def _bound(self, found: Enclosure) -> Float[np.ndarray, " boxes"]:
        with np.errstate(all="ignore"):
            top = rounding.magnitude(found.value)
            if self.objective.squared:
                top = rounding.root((np.zeros_like(top), np.maximum(found.value[1], 0.0)))[1]
        return np.where(found.defined, top, INF)

    def _try_middles(self, pattern: Pattern, found: Enclosure) -> None:
        estimate = rounding.mignitude(found.at_middle)
        estimate = np.where(found.defined & np.isfinite(estimate), estimate, -1.0)
        i = int(np.argmax(estimate))
        level = self.reach.slope * self.reach.slope if self.objective.squared else self.reach.slope
        if estimate[i] > level * (1.0 + 1e-14) or self.reach.slope < 0:
            self.reach.try_point(to_v(found.middle[:, i], pattern))

    def _shrink(self, pattern: Pattern, lower: Boxes, upper: Boxes, found: Enclosure) -> np.ndarray:
        """Move to the face where |f| is largest, in every variable in which f is monotone."""
        level = self.cutoff * self.cutoff if self.objective.squared else self.cutoff
        low, high = found.value
        usable = found.defined & np.isfinite(low) & np.isfinite(high)
        upward, downward = (
            usable & (-low <= level) & (high > level),
            usable & (high <= level) & (-low > level),
        )
        if not self.objective.squared:
            # The side that is left out is no larger than the level, and is accounted for here.
            self._account(np.where(upward, -low, np.where(downward, high, 0.0)))
        shrunk = np.zeros_like(usable)
        for k, slope in zip(self.searched, found.slopes, strict=True):
            rising, falling = slope[0] >= 0, slope[1] <= 0
            flat = rising & falling & usable & (lower[k] < upper[k])
            lower[k], upper[k] = (np.where(flat, found.middle[k], end[k]) for end in (lower, upper))
            to_top = (upward & rising) | (downward & falling)
            to_bottom = (upward & falling) | (downward & rising)
            wide = lower[k] < upper[k]
            to_top &= wide & np.isfinite(upper[k])
            # s = 0 stands for infinity, which is a limit and not a point.
            to_bottom &= wide & np.isfinite(lower[k]) & ~to_top & ((lower[k] > 0) | (pattern[k] == 0))
            lower[k] = np.where(to_top, upper[k], lower[k])
            upper[k] = np.where(to_bottom, lower[k], upper[k])
            shrunk |= to_top | to_bottom | flat
        return shrunk

    def _account(self, bounds: np.ndarray) -> None:
        self.done = max(self.done, float(bounds.max(initial=0.0)))

    def _directions(self, pattern: Pattern, lower: Boxes, upper: Boxes, found: Enclosure) -> np.ndarray:
        """Return the variable to split: the one whose slope times width is largest."""
        scores = np.full((self.count, lower.shape[1]), -1.0)
        root = self._root_width(pattern)
        with np.errstate(all="ignore"):
            for k, slope in zip(self.searched, found.slopes, strict=True):
                width = upper[k] - lower[k]
                relative = np.where(np.isinf(width), 4.0, width / root[k] if root[k] > 0 else 0.0)
                score = rounding.magnitude(slope) * width
                blind = ~np.isfinite(score) | ~found.defined
                kinked = self.cutter.holds_kink(k, lower[k], upper[k]) & (pattern[k] == 0)
                score = np.where(blind, 1e300 * (relative + 8.0 * kinked), score + 1e-12 * relative)
                scores[k] = np.where(splittable(lower[k], upper[k]), score, -1.0)
        best = np.argmax(scores, axis=0)
        return np.where(scores.max(axis=0) < 0, -1, best)

    def _root_width(self, pattern: Pattern) -> np.ndarray:
        width = self.root_upper - self.root_lower
        finite = np.where(np.isfinite(width), width, 2.0 * self.cutter.far)
        return np.where(np.array(pattern) != 0, 1.0 / self.cutter.far, finite)

    def _prune(self) -> None:
        cutoff = self.cutoff
        for pattern, pool in self.pools.items():
            # A point that cannot be split is done with what is proved of it.
            over = (pool.bound <= cutoff) | ((pool.split < 0) & (pool.bound < INF))
            if over.any():
                self._account(pool.bound[over])
                self.pools[pattern] = pool.take(~over)

    def _remaining(self) -> bool:
        return any(pool.bound.size for pool in self.pools.values())

    def _decided(self) -> bool:
        """Tell whether one slope above the bound asked for has settled the question."""
        return self.limits.asked is not None and self.reach.slope > self.limits.asked

    def _upper(self) -> float:
        found = max([self.done, *(float(p.bound.max(initial=0.0)) for p in self.pools.values())])
        return min(found, self.limits.ceiling)

    def _hopeless(self) -> tuple[Pattern, Pool] | None:
        """Return a box that is as small as boxes get and still has no enclosure."""
        limit = HALVINGS * max(1, len(self.searched))
        for pattern, pool in self.pools.items():
            stuck = np.isinf(pool.bound) & ((pool.depth >= limit) | (pool.split < 0))
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
        for new_pattern, lower, upper, depth in self.cutter.split(pattern, taken):
            self._examine(new_pattern, lower, upper, depth)

    def _urgency(self, pool: Pool) -> tuple[float, float]:
        if not pool.bound.size:
            return -1.0, 0.0
        top = float(pool.bound.max())
        return top, float(pool.depth[pool.bound == top].max())

    def _outcome(self, hopeless: tuple[Pattern, Pool] | None) -> Outcome:
        lower, upper, reason = max(self.reach.slope, 0.0), self._upper(), ""
        if hopeless is not None and self.limits.ceiling == INF:
            pattern, pool = hopeless
            reason = explain(self._chart(pattern), pool.lower, pool.upper, self.objective.variables, lower)
            upper = INF
        elif upper == INF:
            reason = UNFINISHED
        # A rounding above the cutoff is what a single point's enclosure costs.
        slack = 1.0 + 1e-12 if self.limits.asked is None else 1.0
        converged = self._decided() or upper <= self.cutoff * slack
        return Outcome(lower, upper, self.reach.point, self.boxes, converged, reason)
