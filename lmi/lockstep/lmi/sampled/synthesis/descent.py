"""Descent on rho of the sampled loop in the gains and the multipliers, without any storage function.

For a power mean g_p(K, m, rho) that falls in rho, rho_p(K, m) is where it is 0, with the slopes - g_p' / (dg_p / dlog rho):
a smooth function, which tends to rho for large p. (Nonsmooth descent on the norm itself, as in Apkarian and Noll,
Nonsmooth H-infinity synthesis, IEEE Trans. Automat. Control 51, 2006, stalls on its kinks here.) BFGS lowers

    log rho_p + PENALTY max(0, c)^2 + weight (edges - sum_i log det (I - K_i K_i' / limit^2)),

c the power mean of the continuous loop at the largest rho it may have and the edges log tr of both loops' Gramians, with
p rising and the weight falling. A start that the period breaks is brought back first: by its spectral radius, then by
the power mean at a large rho. What comes back is a proposal.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex

from lockstep.lmi.analysis.gain_limit import limit_barrier, limited
from lockstep.lmi.quasi_newton import descend
from lockstep.lmi.sampled.l2_gain import MULTIPLES
from lockstep.lmi.sampled.synthesis.power_means import SampledObjective, ValueAndSlopes
from lockstep.lmi.search.stabilise import abscissa
from lockstep.lmi.shapes import GainBlocks, GainLimit, PairWeights, Vector


class Stage(NamedTuple):
    """One descent: the power of its means, and the weight of edges and gain limit, log rho having the weight 1."""

    p: int
    weight: float


STAGES = (Stage(4, 1e-2), Stage(12, 1e-3), Stage(24, 1e-4), Stage(48, 3e-5), Stage(200, 1e-5))
"""Small powers see the whole response, large ones its peak alone."""

ITERATIONS = 120

CONTINUOUS_POWER = 24

FIRST = 0.95
"""The part of the gain limit from which a descent starts: at the limit itself its barrier is infinite."""

RECOVERIES, FEW = 12, 15
"""At most so many short descents to bring a start back, and the iterations of each."""

LARGE_RHO = 1e3
"""Times the largest rho of the continuous loop: where the response around phi alone counts."""

BACK = -0.1
"""The power mean at which a start counts as brought back."""

NEAR, TRIALS = 3e-4, 25
"""How small g_p is made, the rest being taken off to first order, and after how many evaluations it is given up."""

SETTLED = NEAR**2
"""What a step is to lower log rho_p by: no more than its own error, of second order in g_p, is no gain."""

FARTHEST = 0.7
"""A step of the line search whose log rho_p is higher by more than this is as bad as one without: it is not followed up."""


@dataclass(frozen=True, eq=False)
class DescentPoint:
    """Gains K (N, n_C + m, n_C + q), log m of the sampled multiplier, log m of the continuous one."""

    K: GainBlocks
    logs: PairWeights
    logs_c: PairWeights

    def vector(self) -> Vector:
        """Return all of it in one piece."""
        return np.concatenate([self.K.ravel(), self.logs, self.logs_c])

    def at(self, x: Vector) -> "DescentPoint":
        """Return the point of the same shape with other numbers."""
        K, rest = x[: self.K.size].reshape(self.K.shape), x[self.K.size :]
        return DescentPoint(K, rest[: len(self.logs)], rest[len(self.logs) :])


Value = Callable[[DescentPoint], ValueAndSlopes | None]


class Descent:
    """Descents for one problem.

    objective: its loops;  limit: of the gains;  rho_c: the largest rho of the continuous loop.
    """

    def __init__(self, objective: SampledObjective, limit: GainLimit, rho_c: float) -> None:
        self.objective, self.limit, self.log_rho_c = objective, limit, float(np.log(rho_c))
        self.most = self.log_rho_c + float(np.log(LARGE_RHO))

    def stages(self, point: DescentPoint) -> Iterator[DescentPoint]:
        """Yield the point after each stage; nothing where the start is not brought back."""
        within_limit = limited(point.K, FIRST * self.limit)
        found = self._recovered(DescentPoint(within_limit, point.logs, point.logs_c))
        if found is None:
            return
        for stage in STAGES:
            if _Root(self, found, stage.p).slopes(found) is None:
                found = self._recovered(found, stage)
            if found is None:
                return
            found = self._descended(found, _Root(self, found, stage.p).slopes, stage.weight, ITERATIONS)
            yield found

    def lowered(self, start: DescentPoint, stage: Stage, iterations: int) -> DescentPoint | None:
        """Return where one descent leads from a start that is brought back first; None where it is not."""
        found = self._recovered(start, stage)
        if found is None:
            return None
        return self._descended(found, _Root(self, found, stage.p).slopes, stage.weight, iterations)

    def _recovered(self, start: DescentPoint, first: Stage = STAGES[0]) -> DescentPoint | None:
        """Return a point with a finite rho_p, or None."""
        point = self._steadied(start)
        for _ in range(RECOVERIES):
            if point is None:
                return None
            points = self.objective.angles(point.K)

            def mean(at: DescentPoint, points: Complex[np.ndarray, " s"] = points) -> ValueAndSlopes | None:
                return self.objective.sampled(at.K, at.logs, self.most, points, first.p)

            here = mean(point)
            if here is None or here.value < BACK:
                return None if here is None else point
            scaled = [replace(point, logs=point.logs + scale) for scale in np.log(MULTIPLES)]
            found = [(at.value, k) for k, one in enumerate(scaled) if (at := mean(one)) is not None]
            point = scaled[min(found)[1]]
            point = self._descended(point, mean, first.weight, FEW)
        return None

    def _steadied(self, point: DescentPoint) -> DescentPoint | None:
        """Lower the growth of both linear loops until they decay; None where they do not."""
        shape = point.K.shape

        def growth(K: GainBlocks) -> tuple[float, GainBlocks]:
            rates = (self.objective.growth(K), abscissa(self.objective.continuous, K))
            return max(rates, key=lambda rate: rate[0])

        def value(flat: Vector) -> tuple[float, Vector]:
            K = flat.reshape(shape)
            room = limit_barrier(K, self.limit)
            try:
                worst = growth(K)
            except np.linalg.LinAlgError:
                room = None
            if room is None:
                return np.inf, np.zeros_like(flat)
            weight = STAGES[1].weight
            return worst[0] + weight * room[0], (worst[1] + weight * room[1]).ravel()

        for _ in range(RECOVERIES):
            if growth(point.K)[0] < 0:
                return point
            K = descend(value, point.K.ravel(), FEW).reshape(shape)
            point = DescentPoint(K, point.logs, point.logs_c)
        return None

    def _descended(self, start: DescentPoint, value: Value, weight: float, iterations: int) -> DescentPoint:
        frequencies = self.objective.frequencies(start.K)

        def total(x: Vector) -> tuple[float, Vector]:
            at = start.at(x)
            try:
                found = self._total(at, value, weight, frequencies)
            except (np.linalg.LinAlgError, ValueError):
                found = None
            return (np.inf, np.zeros_like(x)) if found is None else found

        return start.at(descend(total, start.vector(), iterations, SETTLED))

    def _total(
        self, at: DescentPoint, value: Value, weight: float, frequencies: Complex[np.ndarray, " s"]
    ) -> tuple[float, Vector] | None:
        room = limit_barrier(at.K, self.limit)
        if room is None:
            return None
        continuous = self.objective.in_continuous_time(
            at.K, at.logs_c, self.log_rho_c, frequencies, CONTINUOUS_POWER, weight
        )
        goal = None if continuous is None else value(at)
        edge = None if goal is None else self.objective.edge(at.K)
        if continuous is None or goal is None or edge is None:
            return None
        slope_K = goal.K + continuous.K + weight * (edge[1] + room[1])
        slope = np.concatenate([slope_K.ravel(), goal.logs, continuous.logs])
        total = goal.value + continuous.value + weight * (edge[0] + room[0])
        return (total, slope) if np.isfinite(total) and np.isfinite(slope).all() else None


class _Root:
    """rho_p of one descent: its points are fixed, and the last root is the next guess."""

    def __init__(self, descent: Descent, start: DescentPoint, p: int) -> None:
        self.objective, self.p = descent.objective, p
        self.points = self.objective.angles(start.K)
        self.guess, self.ceiling = descent.log_rho_c, descent.most

    def slopes(self, at: DescentPoint) -> ValueAndSlopes | None:
        """Return log rho_p, and its slopes in K and log m; None where there is none."""
        s, low, high = self.guess, -np.inf, np.inf
        for _ in range(TRIALS):
            g = self.objective.sampled(at.K, at.logs, s, self.points, self.p)
            if g is not None and abs(g.value) < NEAR and g.log_rho < 0:
                self.guess = s - g.value / g.log_rho
                self.ceiling = self.guess + FARTHEST
                return ValueAndSlopes(self.guess, -g.K / g.log_rho, -g.logs / g.log_rho, 0.0)
            low, high = (s, high) if g is None or g.value > 0 else (low, s)
            if low > self.ceiling or high - low < 1e-9:
                return None
            step = 0.7 if g is None or not g.log_rho < 0 else float(np.clip(-g.value / g.log_rho, -0.5, 1.0))
            s = s + step if low < s + step < high else (max(low, high - 2) + min(high, low + 2)) / 2
        return None
