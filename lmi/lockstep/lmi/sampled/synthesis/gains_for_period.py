"""Gains for a period: from gains, any number of them, to those whose sampled controllers have the least rho found.

    AtPeriod     the sampled loop of a problem, for gains that may move, in doubles
    measured     rho of the sampled controllers of given gains: `l2_gain.least_rho` judges, for multipliers at hand
    improved     the best of what `descent` reaches from several starts: every stage of every start is measured

The discrete controllers that ship are what is designed; K are the gains that they are Tustin's rule of, so that K is
limited, written to the design file and sampled again as any other gains are. What comes back is a proposal.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from lockstep.check.continuous.inequality import Performance
from lockstep.check.sampled.controller import PRECISIONS, HeldController, SampledNetwork
from lockstep.check.sampled.sector import Sector
from lockstep.lmi.analysis.gain_limit import limited
from lockstep.lmi.analysis.unit_scaling import Units, plant_in_units
from lockstep.lmi.sampled.l2_gain import MULTIPLES, least_in_scales
from lockstep.lmi.sampled.synthesis.descent import STAGES, Descent, DescentPoint
from lockstep.lmi.sampled.synthesis.power_means import SampledObjective
from lockstep.lmi.sampled.synthesis.tustin import tustin
from lockstep.lmi.sampled.witnesses import in_doubles, plant_in_doubles
from lockstep.lmi.search.stopping import NEVER, Deadline
from lockstep.lmi.shapes import GainBlocks, GainLimit, PairWeights
from lockstep.model.loop_transformation.natural_units import natural_units

RHO_KEPT = (1.5, 5.0)
"""The continuous rho may grow by about so much: what ships is the sampled loop. The second where the first is too little."""

NEARBY = (1.0, 1.05, 1.2, 1.5, 2.0, 4.0)
"""Of the multipliers that a descent ends with: they are the least for its rho, and a power mean is below the peak."""

MOST_HALVINGS, FEWEST_HALVINGS = 6, 2
"""Where a start is not brought back at the asked period, it is taken there from the longest half, quarter, ... of it at
which its linear loop is stable: from a quarter, or a shorter one down to the least of these."""

ROUNDS, SETTLED = 4, 0.99
"""At most so many descents from a start, each from the end of the last, while one lowers rho to less than this part of it."""

ROOM = 1e-6
"""The part of the gain limit that is kept for rounding."""


@dataclass(frozen=True, eq=False)
class SampledCandidate:
    """Gains K (N, n_C + m, n_C + q), weights m of the sampled multiplier, and rho of the sampled loop, unproved."""

    K: GainBlocks
    m: PairWeights
    rho: float


class StartingGains(SampledCandidate):
    """Gains to start from, multiplier weights for them (of the continuous certificate, say), and its rho."""


@dataclass(frozen=True, eq=False)
class AtPeriod:
    """A network whose controllers are sampled with its period, for gains that may move.

    network: agents, coordinates, alpha, period, delay, the matrices exact;  edges: (listener, source, weight), from 1;
    weights: what rho is a gain to and from;  order: n_C;  gain_limit: of each K_i;
    decay: 1/s, that the continuous loop is to keep;  deadline: after which a search takes the best so far.
    """

    network: SampledNetwork
    edges: Sequence[tuple[int, int, float]]
    weights: Performance
    order: int
    gain_limit: GainLimit
    decay: float = 0.0
    deadline: Deadline = NEVER

    def at(self, period: float) -> "AtPeriod":
        """Return the same with another period."""
        return replace(self, network=replace(self.network, period=period))

    def controllers(self, tables: GainBlocks) -> tuple[HeldController, ...]:
        """Return discrete controllers as they are, in float64."""
        return tuple(
            HeldController.row_by_row(
                table,
                self.order,
                tuple(source - 1 for listener, source, _ in self.edges if listener == i),
                np.array([weight for listener, _, weight in self.edges if listener == i], dtype=float),
                PRECISIONS["float64"],
            )
            for i, table in enumerate(tables, start=1)
        )

    def objective(self) -> SampledObjective:
        """Return the loops as functions of the gains."""
        _, m, q, _, _ = self.network.plant.sizes
        zero = np.zeros((self.network.d.N, self.order + m, self.order + q))
        loop = in_doubles(self.network, self.controllers(zero), self.weights.outputs)
        return SampledObjective(loop, self.weights, self.order, self.decay)


def sampled_rho_of(
    at: AtPeriod, K: GainBlocks, m: PairWeights, scales: Sequence[float] = MULTIPLES
) -> SampledCandidate | None:
    """Return the sampled rho of gains with their best scale of m; None where none of them shows one."""
    try:
        controllers = at.controllers(tustin(K, at.order, at.network.period))
        loop = in_doubles(at.network, controllers, at.weights.outputs)
    except np.linalg.LinAlgError:
        return None
    found = least_in_scales(loop, at.weights, positive_weights(m, len(at.network.d.pairs())), scales)
    return None if found is None else SampledCandidate(K, found[1], found[0])


def redesigned(
    at: AtPeriod,
    starts: Sequence[StartingGains],
    *,
    rho_most: float | None = None,
    enough: float = 0.0,
    tell: Callable[[float], None] = lambda _part: None,
) -> SampledCandidate | None:
    """Return the gains with the least sampled rho found, the starts' own included; None where none has any.

    Args:
        at: the loop and its period.
        starts: gains, the likeliest first; each is pursued, until one is good enough.
        rho_most: the largest rho of the continuous loop; by default a multiple of the start's.
        enough: the sampled rho at which no more starts are pursued.
        tell: called with the part that is done.
    """
    best: SampledCandidate | None = None
    for index, start in enumerate(starts):

        def part(done: float, index: int = index) -> None:
            tell((index + done) / len(starts))

        part(0.0)
        found = _settled(at, start, rho_most, part)
        if found is not None and (best is None or found.rho < best.rho):
            best = found
        if at.deadline.over or (best is not None and best.rho <= enough):
            break
    return best


def _settled(
    at: AtPeriod, start: StartingGains, rho_most: float | None, tell: Callable[[float], None]
) -> SampledCandidate | None:
    """Return the best of what descents reach, each from where the one before it ended, the start included."""
    best: SampledCandidate | None = None
    for k in range(ROUNDS):

        def part(done: float, k: int = k) -> None:
            tell((k + done) / ROUNDS)

        here = start if best is None else StartingGains(best.K, best.m, start.rho)
        inside, units = in_search_units(at, here.K)
        here = StartingGains(here.K / units.gains, here.m / units.pair_weight, here.rho / units.rho)
        limits = [kept * here.rho for kept in RHO_KEPT] if rho_most is None else [rho_most / units.rho]
        pursued = next((found for limit in limits if (found := _pursued(inside, here, limit, part))), None)
        at_start = sampled_rho_of(inside, here.K, here.m) if best is None else None
        found = min((one for one in (at_start, pursued) if one), key=lambda one: one.rho, default=None)
        if found is None or (best is not None and units.rho * found.rho >= best.rho):
            return best
        settled = at.deadline.over or (best is not None and units.rho * found.rho > SETTLED * best.rho)
        best = SampledCandidate(units.gains * found.K, units.pair_weight * found.m, units.rho * found.rho)
        if settled:
            return best
    return best


def in_search_units(at: AtPeriod, K: GainBlocks) -> tuple[AtPeriod, Units]:
    """Return the loop in units in which its numbers, and those of gains, are near one, and these units.

    A descent sees the numbers alone. The states of the controllers count in units in which B_C and C_C are of one size.
    """
    network, weights, order = at.network, at.weights, at.order
    plant, _ = plant_in_doubles(network)
    X, S_u, S_y, time, g = natural_units(plant, network.alpha, weights.R)
    into = np.linalg.norm(time * K[:, :order, order:] / S_y, axis=(0, 2))
    out = np.linalg.norm(K[:, order:, :order] / S_u[:, None], axis=(0, 1))
    S_C = 2.0 ** np.round(np.log2(np.where(out > 0, out, 1.0) / np.where(into > 0, into, 1.0)) / 2)
    a = 2.0 ** round(math.log2(network.alpha or 1.0))
    disturbed = time * X * (weights.states if len(weights.states) else 1.0)
    e = 2.0 ** round(float(np.log2(disturbed[disturbed > 0]).mean()))
    R, Q = weights.R / np.outer(X, X), weights.Q / np.outer(S_C, S_C)
    cost = 2.0 ** round(math.log2(max(np.diag(R).max(initial=0.0), np.diag(Q).max(initial=0.0))))
    scaled = plant_in_units(plant, X, time, g, a, S_u, S_y)
    W = np.outer(S_u, S_u) * weights.W / cost if len(weights.W) else weights.W
    noise = S_y * weights.outputs / e if len(weights.outputs) else weights.outputs
    gains = np.outer(np.concatenate([1 / (time * S_C), S_u]), np.concatenate([S_C, S_y]))
    sector = network.sector and Sector(network.sector.Pi_w, network.sector.Pi_z / a**2)
    alpha, period = network.alpha / a, network.period / time
    inside = replace(network, plant=scaled.in_numbers(True), alpha=alpha, period=period, sector=sector)
    performance = Performance(R / cost, Q / cost, W, disturbed / e, noise)
    limit = at.gain_limit / gains
    found = replace(at, network=inside, weights=performance, gain_limit=limit, decay=time * at.decay)
    return found, Units(gains, X, time, (g / a) ** 2, cost, e)


def _pursued(
    at: AtPeriod, start: StartingGains, rho_c: float, tell: Callable[[float], None]
) -> SampledCandidate | None:
    """Return the best of what a descent reaches; through shorter periods where the asked one is out of reach at once."""
    found, _ = _reached(at, start, rho_c, tell)
    if found is not None:
        return found
    each = [at.at(at.network.period / 2**k) for k in range(MOST_HALVINGS + 1)]
    steady = (k for k in range(FEWEST_HALVINGS, MOST_HALVINGS) if each[k].objective().growth(start.K)[0] < 0)
    here = start
    for shorter in each[next(steady, MOST_HALVINGS) :: -1]:
        found, last = _reached(shorter, here, rho_c, tell)
        if last is None:
            return None
        here = StartingGains(last.K, np.exp(last.logs), start.rho)
    return found


def _reached(
    at: AtPeriod, start: StartingGains, rho_c: float, tell: Callable[[float], None]
) -> tuple[SampledCandidate | None, DescentPoint | None]:
    objective, known = at.objective(), positive_weights(start.m, len(at.network.d.pairs()))
    logs = np.log(known) if objective.has_phi else np.zeros(0)
    best, last = None, None
    stages = Descent(objective, at.gain_limit, rho_c).stages(DescentPoint(start.K, logs, logs))
    for number, last in enumerate(stages, start=1):
        tell(number / (len(STAGES) + 1))
        m = np.exp(last.logs) if objective.has_phi else known
        found = sampled_rho_of(at, limited(last.K, (1 - ROOM) * at.gain_limit), m, NEARBY)
        if found is not None and (best is None or found.rho < best.rho):
            best = found
        if at.deadline.over:
            break
    return best, last


def positive_weights(m: Float[np.ndarray, " k"], pairs: int) -> PairWeights:
    """Return weights above 0; ones where there are none to be had, as for linear agents, whose multiplier is idle.

    >>> positive_weights(np.array([0.0, 2.0]), 2).tolist(), positive_weights(np.zeros(0), 2).tolist()
    ([2e-06, 2.0], [1.0, 1.0])
    """
    largest = float(m.max(initial=0.0)) if len(m) == pairs else 0.0
    return np.maximum(m, 1e-6 * largest) if largest > 0 else np.ones(pairs)
