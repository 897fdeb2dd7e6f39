"""A start: random gains that make the loop stable, taken to a certificate, and to a small rho, without a nonlinear
program.

Small gains suit loops that are nearly stable, large ones those that are not, and the same gains for all agents those
whose graph is what makes them hard; so the size is drawn too, and every other start has equal gains. A start that the
smoothed norm does not bring to a certificate of the whole claim is brought to one of a part of it; the nonlinear
program climbs from there.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float

from lockstep.check.continuous.inequality import Certificate, Claim
from lockstep.check.system.loop import Loop
from lockstep.lmi.analysis.certificate_sdp import AffineF, eliminates_P, least_rho
from lockstep.lmi.analysis.gain_limit import limited
from lockstep.lmi.analysis.unit_scaling import Units, claim_at, scaled
from lockstep.lmi.search.barrier import BarrierPoint, InteriorProgram, NewtonLimits
from lockstep.lmi.search.common_gains import ModalSearch
from lockstep.lmi.search.smoothed_norm import (
    NEXT_TO_IT,
    ON_TO_THE_MAXIMUM,
    Descended,
    SmoothedNorm,
    norm_descent,
    refined_to_maximum,
    with_multipliers,
)
from lockstep.lmi.search.stabilise import abscissa as abscissa_of
from lockstep.lmi.search.stabilise import stabilise
from lockstep.lmi.search.stopping import NEVER, Deadline
from lockstep.lmi.shapes import GainBlocks, GainLimit

SIZES = (0.3, 1.0, 3.0)
"""Standard deviations of the gains drawn, in the units of the search."""

DRAWS = 4
"""Draws for one start, until one of them becomes stable."""

STARTS_PER_LOWER = 4
"""One start of so many is of controllers with a state less: with more states more starts end in worse minima."""

COUPLED, MOVED = (0.3, 0.1, 0.03, 0.01), ((13, 60), (33, 60))
"""Standard deviations, in the units of the search, of the gains to and from a state that is added: where they are 0 no slope
tells of it. And the descent from there, as `ON_TO_THE_MAXIMUM`."""

DRAWN, STABLE, INSIDE = 0.5, 0.8, 0.9
"""Parts of the gain limit: gains are drawn within the first and made stable within the second, because from the limit
itself the slope of one side leads nowhere, and what comes out is inside the third."""

FRACTIONS, FEW_FRACTIONS = (0.3, 0.1, 0.03, 0.01, 1e-3), (0.1, 1e-3)
"""Parts of alpha and delta tried, largest first, for a first certificate of gains that are merely stable; the few where
each try takes seconds and the climb from there does not."""

LARGE = 20
"""States and components of phi_d from which on a loop is large: fewer starts are drawn, fewer parts of the claim tried."""

CLIMBS = 6
"""At most so many runs towards the full claim."""

STUCK = 1.2
"""A climb whose fractions do not grow by this factor in one run is given up."""

UNPROVED = 1 - 1e-9
"""The fraction of alpha^2 of gains that the nonlinear program says carry all of it, but no certificate does."""


@dataclass(frozen=True)
class GainSearch:
    """What is searched: loop and claim in the units of the search, the gains in those of the file.

    gain_limit: of each agent's gains;  lag: s, by which sampling makes the inputs late;  rate:
    that each A_Ci is to have by itself, Re lambda < -rate, in 1/s; None to ask nothing of them;  modes: the same
    search for gains that are equal for all agents, with which starts of many agents begin; None where it does not apply;
    lower: the same for controllers with a state less, with which some starts begin, or None.
    """

    loop: Loop
    claim: Claim
    units: Units
    gain_limit: GainLimit
    lag: float = 0.0
    rate: float | None = None
    modes: ModalSearch | None = None
    lower: "GainSearch | None" = None

    @classmethod
    def of(
        cls,
        loop: Loop,
        claim: Claim,
        gain_limit: GainLimit,
        lag: float = 0.0,
        rate: float | None = None,
        modes: ModalSearch | None = None,
        lower: "GainSearch | None" = None,
    ) -> "GainSearch":
        """Return the search for a loop and a claim in the units of the file."""
        return cls(*scaled(loop, claim), gain_limit, lag, rate, modes, lower)

    def __reduce__(self) -> tuple[type["GainSearch"], tuple[Any, ...]]:
        """Leave what is built from these behind: symbolic expressions do not travel to another process."""
        return GainSearch, tuple(getattr(self, one.name) for one in fields(self))

    @property
    def is_large(self) -> bool:
        """Whether the loop is one for `barrier`."""
        return self.loop.n_x + self.loop.plant.sizes[3] * (self.loop.d.N - 1) >= LARGE

    @property
    def is_regular(self) -> bool:
        """Whether all agents hear equally much: the in-degrees, on the diagonal of L, are one but for rounding.

        Then all starts are of equal gains, and else every other one: on three regular graphs of ten arms random gains of
        their own came to nothing less, on a star to a third.
        """
        degrees = np.diag(self.loop.d.L)
        return bool(np.ptp(degrees) <= 1e-12 * degrees.max())

    def abscissa(self, K: GainBlocks) -> float:
        """Return that of the loop, and of controllers that are to have a rate, in the unit of time of the search."""
        return abscissa_of(self.loop, K, rate=self.rate, time=self.units.time)[0]

    @cached_property
    def program(self) -> InteriorProgram:
        """The nonlinear program of the loop."""
        return InteriorProgram(self.loop, self.claim, self.gain_limit, rate=self.rate)

    @cached_property
    def norm(self) -> SmoothedNorm:
        """The smoothed norm of the loop."""
        return self._norm(shared=False)

    @cached_property
    def shared_norm(self) -> SmoothedNorm:
        """The same of gains that are equal for all agents: a tenth of the unknowns for ten agents."""
        return self._norm(shared=True)

    def _norm(self, *, shared: bool) -> SmoothedNorm:
        limit, units = self.gain_limit, self.units.gains
        return SmoothedNorm(self.loop, self.claim, limit, units, shared=shared, rate=self.rate)


Score = Callable[[GainBlocks, Float[np.ndarray, " weights"]], float]
"""rho of the sampled loop for gains and pair weights (of alpha, then of each entry) in the units of the file, in
doubles; infinite where it has none."""


@dataclass(frozen=True)
class StartResult:
    """What one start came to.

    index: which one;  abscissa: of its loop;  at: its gains, with rho in the units of the search where the whole
    claim seems within reach;  sampled: the larger of rho and that of the sampled loop, in the units of the file;
    equal: whether its gains are equal and as far down as equal gains go.
    """

    index: int
    abscissa: float
    at: Descended
    sampled: float = np.inf
    equal: bool = False

    @property
    def rank(self) -> tuple[float, float, float, float, int]:
        """From best to worst: what ships, then rho, then the gain around the nonlinearity, then the abscissa."""
        return self.sampled, self.at.rho, self.at.gain, self.abscissa, self.index


def run_start(
    search: GainSearch, score: Score | None, seed: int, index: int, deadline: Deadline = NEVER
) -> StartResult:
    """Return one start; the same arguments give the same one.

    Args:
        search: what is searched.
        score: of the sampled loop; None to rank by rho alone.
        seed, index: of the random gains.
        deadline: a start that is over it is not begun.
    """
    if deadline.over:
        nowhere = Descended(np.zeros(search.norm.shape), np.ones(0), np.inf, np.inf)
        return StartResult(index, np.inf, nowhere)
    lower = search.lower if index % STARTS_PER_LOWER == STARTS_PER_LOWER - 1 else None
    if lower and (at := _with_a_state_more(search, lower, seed, index // STARTS_PER_LOWER)) is not None:
        return scored(search, score, StartResult(index, search.abscissa(at.K), at))
    equal = search.is_regular or index % 2 == 1
    modes = search.modes if equal and eliminates_P(search.loop) else None
    if modes and (at := _equal(search, modes, seed, index)) is not None:
        return scored(search, score, StartResult(index, search.abscissa(at.K), at, equal=True))
    K, abscissa = stable_gains(search, seed, index)
    if abscissa >= 0:
        return StartResult(index, abscissa, Descended(K, np.ones(len(search.norm.W)), np.inf, np.inf))
    return scored(search, score, StartResult(index, abscissa, norm_descent(search.norm, K)))


def _with_a_state_more(search: GainSearch, lower: GainSearch, seed: int, index: int) -> Descended | None:
    """Return what a start with a state less comes to, with one more state beside it and moved with it, or None."""
    at = resume(lower, None, run_start(lower, None, seed, index)).at
    if not np.isfinite(at.rho):
        return None
    norm, limit, theirs, ours = search.norm, search.gain_limit, lower.units, search.units
    drawn = np.random.default_rng([seed, index]).standard_normal(norm.shape) * ours.gains
    if not np.ptp(at.K, axis=0).any():
        drawn[:] = drawn[0]  # equal gains stay so
    drawn[:, 1:, 1:] = drawn[:, 0, 0] = 0.0
    if not ours.pair_weight:
        return None  # it underflows, of rates of 1e300
    K, w = np.zeros(norm.shape), at.w * (theirs.pair_weight / ours.pair_weight)
    K[:, 1:, 1:], K[:, 0, 0] = at.K, -max(ours.gains[0, 0], 2 * (search.rate or 0.0))
    for size in COUPLED:
        coupled = limited(K + size * drawn, INSIDE * limit)
        x = norm.pack(coupled, w)
        if search.abscissa(coupled) < 0 and np.isfinite(norm.level(x, None, norm.frequencies(x))):
            return refined_to_maximum(norm, replace(at, K=coupled, w=w), MOVED)
    return None


def _equal(search: GainSearch, modes: ModalSearch, seed: int, index: int) -> Descended | None:
    """Return equal gains that the modes came to, with multipliers in the whole loop, or None."""
    K = _stable_in_modes(modes, np.random.default_rng([seed, index]))
    if K is None or not np.isfinite((at := modes.down(K)).rho):
        return None
    gains = np.repeat(at.K[:1], len(search.loop.U), axis=0)
    found = with_multipliers(search.shared_norm, gains)
    if not np.isfinite(found.rho) and search.abscissa(gains) < 0:
        found = norm_descent(search.shared_norm, gains)  # of a graph whose Laplacian is not normal
    return found if np.isfinite(found.rho) else None


def _stable_in_modes(modes: ModalSearch, generator: np.random.Generator) -> Float[np.ndarray, "k l"] | None:
    """Return gains of one agent that make all modes stable, or None.

    A descent of a follower with two gains ends where two real poles meet, three times in ten: a few draws do not do.
    """
    return next((K for _ in range(3 * DRAWS) if (K := modes.stable(generator)) is not None), None)


def resume(
    search: GainSearch, score: Score | None, start: StartResult, deadline: Deadline = NEVER
) -> StartResult:
    """Return a start with its gains taken further, or as it is where that made what ships worse."""
    if deadline.over:
        return start
    stages = NEXT_TO_IT if start.equal else ON_TO_THE_MAXIMUM
    further = replace(start, at=refined_to_maximum(search.norm, start.at, stages))
    return min(start, scored(search, score, further), key=lambda one: one.rank)


def scored(search: GainSearch, score: Score | None, start: StartResult) -> StartResult:
    """Return a start with what ships, for the gains it has."""
    if score is None or not np.isfinite(start.at.rho):
        return replace(start, sampled=search.units.rho * start.at.rho)
    pairs = AffineF(search.loop, start.at.K, search.claim).pairs
    weights = search.units.cost * search.units.multiplier * start.at.w[:pairs]
    return replace(start, sampled=max(search.units.rho * start.at.rho, score(start.at.K, weights)))


def stable_gains(search: GainSearch, seed: int, index: int) -> tuple[GainBlocks, float]:
    """Return gains within the limit whose loop is stable, if a descent from random ones finds such, and its abscissa.

    On a path that all follow, every agent's modes are those of the loop: where the slowest of two are one, their slope says
    nothing, and such descents end. Gains that are equal for all agents are made stable for each eigenvalue of L apart.
    """
    generator, limit = np.random.default_rng([seed, index]), search.gain_limit
    shape, units = search.norm.shape, search.units.gains
    own: dict[str, Any] = {"units": units, "rate": search.rate, "time": search.units.time}
    best = np.zeros(shape), np.inf
    for _ in range(DRAWS):
        drawn = generator.choice(SIZES) * generator.standard_normal(shape)
        if index % 2:
            drawn[:] = drawn[0]
        first = limited(drawn * units, DRAWN * limit)
        K = limited(stabilise(search.loop, first, STABLE * limit, **own)[0], INSIDE * limit)
        abscissa = search.abscissa(K)
        best = min(best, (K, abscissa), key=lambda found: found[1])
        if abscissa < 0:
            return best
    if search.modes and (one := _stable_in_modes(search.modes, generator)) is not None:
        K = np.repeat(one[None], shape[0], axis=0)
        return K, search.abscissa(K)
    return best


def feasible_point(search: GainSearch, K: GainBlocks) -> BarrierPoint | None:
    """Return gains with a certificate for some part of the claim, or None where not even the least part has one."""
    claim = search.claim
    for fraction in FEW_FRACTIONS if search.is_large else FRACTIONS:
        part = claim_at(claim, alpha=fraction * claim.alpha, fraction_of_delta=fraction)
        found = least_rho(search.loop, K, part)
        if found is not None:
            return BarrierPoint(K, found, fraction**2, fraction**2)
    return None


@dataclass(frozen=True)
class Homotopy:
    """How much of a claim gains carry.

    point: with a certificate, for the whole claim where its fractions are 1;  certified: the part of alpha and delta
    with a certificate;  claimed: the part that the nonlinear program says they carry.
    """

    point: BarrierPoint
    certified: float
    claimed: float


def homotopy(search: GainSearch, at: Descended, deadline: Deadline = NEVER) -> Homotopy | None:
    """Find the part of a claim that gains carry, and raise it with the nonlinear program; None where they carry
    none."""
    K = at.K
    known = multipliers_only(search, at) if np.isfinite(at.rho) else None
    found = least_rho(search.loop, K, search.claim, known)
    if found is not None:
        return Homotopy(BarrierPoint(K, found), 1.0, 1.0)
    point, program = feasible_point(search, K), search.program
    if point is None:
        return None
    if eliminates_P(search.loop):
        part = point.alpha_fraction**0.5
        return Homotopy(point, part, part)
    certified, rho_most = point.alpha_fraction**0.5, 10.0 * point.certificate.rho
    for _ in range(CLIMBS):
        if deadline.over:
            break
        trial = program.improve(point, "claim", NewtonLimits(150, rho_most, deadline))
        found = least_rho(search.loop, trial.K, search.claim)
        if found is not None:
            return Homotopy(BarrierPoint(trial.K, found), 1.0, 1.0)
        trial = replace(trial, alpha_fraction=min(trial.alpha_fraction, UNPROVED))
        before, after = (p.alpha_fraction * p.delta_fraction for p in (point, trial))
        if after > before:
            point = trial
        if after < STUCK * before:
            break
    parts = [point.alpha_fraction, *([point.delta_fraction] if program.ways else [])]
    return Homotopy(point, certified, min(parts) ** 0.5)


def multipliers_only(search: GainSearch, at: Descended) -> Certificate:
    """Return the multipliers and rho of gains after a descent, as a certificate without its P."""
    none = np.zeros((search.loop.n_x, search.loop.n_x))
    return AffineF(search.loop, at.K, search.claim).certificate(none, np.append(at.w, at.rho**2))
