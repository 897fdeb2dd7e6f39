"""Witnesses for the inequality of the sampled loop, in doubles: nothing here is believed, it is proved elsewhere.

P      the largest that a decay and a price of the messages' noise allow: it bounds what that noise can reach
t      prices of the rounding errors, by what each of their directions weighs in P
kappa  the price of the noise: dearer than the least by a factor

The price of the noise against the multiplier, the decay, and the weight of the disagreement are free: they are
scanned, and the witness that passes the least noise on is the first to be proved.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice

import numpy as np
from jaxtyping import Float

from lockstep.check.sampled.inequality import Omega_matrix, Witness, multiplier, step_matrix
from lockstep.check.sampled.lifting import Lifted, copies
from lockstep.check.sampled.loop import SampledLoop
from lockstep.lmi.sampled.step_program import step_program
from lockstep.lmi.sampled.storage import (
    distance_ratio,
    holds_in_doubles,
    in_exact_arithmetic,
    metric_of,
    no_prices,
    rounding_prices,
    storage_problem,
)
from lockstep.lmi.shapes import PairWeights

RATES = (0.1, 0.3, 0.2, 0.4, 0.5, 0.03, 0.01, 0.003, 0.001, 1e-4)
"""How fast V is asked to decay, as parts of how fast the linear loop does; likely ones first."""

PRICES = (2.0, 8.0, 64.0)
"""Prices of the noise tried, in multiples of the least."""

RMS = (0.35, 0.45, 0.6, 0.8, 1.0)
"""The root mean square asked for, as a part of the ultimate bound that goes without any weight."""

ROUNDINGS = (1e6, 1e5, 1e4, 1e8)
"""Prices of rounding, relative to what its directions weigh in P."""

CLAIMED = 0.98
"""The part of the decay that is claimed: the rest is room, so that the inequality is strict."""

REACHES = (0.0, 1e-9, 1e-12, 1e-6)
"""What is added to S in every direction, in multiples of its size. A direction that neither the nonlinearity nor an error
reaches, as in a mode that no input moves, has an X of zero and a P without end; a little reach gives it one."""

FREE_RATES, FREE_RMS, FREE_CLAIMED = (0.1, 0.15, 0.225, 0.3, 0.4, 0.5), (0.75, 0.6, 0.5), 0.97
"""As `RATES`, each as long as it lowers what the noise can reach, `RMS`, of the best of them, and `CLAIMED`, where the pair
weights are free: half of what the noise can reach, or less, comes out. The bound of every instant goes first."""

SOME_STATES, MOST_STATES, MOST_PAIRS = 18, 30, 15
"""Of a loop whose weights are freed for all rates and root mean squares, for one of each, and at all: a program takes a
second with 14 states, 20 s with 28, a minute with 40, and 20 s with 18 and the 45 pairs of ten agents."""

HALVINGS = 9
"""Of 24 decades: the least price to a tenth of a decade."""

FASTEST = (1.0, 0.97, 0.93, 0.88, 0.82, 0.75, 0.67, 0.58, 0.48, 0.38, 0.28, 0.2, 0.15, 0.1)
"""Rates of decay of V tried, as parts of that of the linear loop, of which `CLAIMED` is claimed."""

MU = 1e6
"""What underflow counts relative to the messages' noise: it is some thirty decades smaller."""


def candidates(loop: SampledLoop, one: Lifted, m: PairWeights, *, thorough: bool = True) -> Iterator[Witness]:
    """Yield witnesses with which Omega is positive definite in doubles; the one that passes the least noise on is first.

    Where it is not to be thorough, those with the pair weights given, each as it is found.

    Args:
        loop, one: in doubles.
        m: pair weights.
        thorough: whether all are looked for.
    """
    lifted = copies(one, multiplier(loop.network.d, m))
    radius = float(np.abs(np.linalg.eigvals(step_matrix(loop, lifted)[:, : loop.n_x])).max())
    if radius >= 1:
        return
    found = []
    for rate in RATES:
        for witness in _Search(loop, lifted, m, rate * (1 - radius**2)).witnesses():
            if thorough:
                found.append((_promised(witness), witness))
            else:
                yield witness
    if thorough:
        found += [(_promised(witness), witness) for witness in _with_free_weights(loop, one, radius)]
        yield from (witness for _, witness in sorted(found, key=lambda pair: pair[0]))


def fastest_candidates(
    loop: SampledLoop, one: Lifted, weights: Sequence[PairWeights], asked: float
) -> Iterator[Witness]:
    """Yield witnesses for some pair weights, those that decay the fastest first, whatever noise they pass on.

    Args:
        loop, one: in doubles, of a linear loop that is stable.
        weights: each tried for each decay.
        asked: a factor of V in a period, below 1 if one is asked for: tried as well.
    """
    lifted = [copies(one, multiplier(loop.network.d, m)) for m in weights]
    radius = float(np.abs(np.linalg.eigvals(step_matrix(loop, lifted[0])[:, : loop.n_x])).max())
    spreads = {(1 - asked) / CLAIMED, *(1 - radius ** (2 * part) for part in FASTEST)}
    for spread in sorted((one for one in spreads if 0 < one < 1), reverse=True):
        for m, one_M in zip(weights, lifted, strict=True):
            yield from islice(_Search(loop, one_M, m, spread).witnesses(), 1)


def _promised(witness: Witness) -> float:
    """Return what witnesses are ranked by: the bound of every instant counts twice, that of the mean square once."""
    return witness.ultimate**2 * min(witness.rms, witness.ultimate)


def _with_free_weights(loop: SampledLoop, one: Lifted, radius: float) -> Iterator[Witness]:
    """Yield witnesses of the convex program: the least price of the noise with V >= |x_d|^2, and so with a weight of it."""
    distance, spread = metric_of(loop), 1 - radius**2
    rates, parts = (FREE_RATES, FREE_RMS) if loop.n_x <= SOME_STATES else (FREE_RATES[1:2], FREE_RMS[:1])

    def least(rate: float, weight: float = 0.0) -> Witness | None:
        program = step_program(loop, one, 1 - rate * spread, distance, noise=True, weight=weight)
        if program is None:
            return None
        found = program.least(program.kappa, [program.V >> program.in_units_of_V(distance)], weight)
        return found and found[1]

    best, reached = 0.0, np.inf
    for rate in () if is_large(loop) else rates:
        found = least(rate)
        if best and (found is None or found.kappa / (rate * spread) >= reached):
            break
        if found is not None:
            best, reached = rate, found.kappa / (rate * spread)
            yield from islice(priced_for_rounding(loop, one, found, FREE_CLAIMED), 1)
    for part in parts if best else ():
        found = least(best, 1 / (part**2 * reached))
        if found is None:
            break
        yield from islice(priced_for_rounding(loop, one, found, FREE_CLAIMED), 1)


def is_large(loop: SampledLoop) -> bool:
    """Tell whether a program with free pair weights takes too long."""
    return loop.n_x > MOST_STATES or len(loop.network.d.pairs()) > MOST_PAIRS


def priced_for_rounding(
    loop: SampledLoop,
    one: Lifted,
    found: Witness,
    claimed: float,
    *,
    exact_messages: bool = False,
    running: Float[np.ndarray, "n_z n_z"] | None = None,
) -> Iterator[Witness]:
    """Yield a witness of the convex program with prices of the rounding, for few of them first.

    Args:
        loop, one: in doubles.
        found: without prices of the rounding.
        claimed: the part of its decay that is claimed, and its price of the noise over that part: the rest is room.
        exact_messages: whether the messages have no errors, so that these may cost anything.
        running: a cost of z at each sampling instant.
    """
    lifted, decay = copies(one, multiplier(loop.network.d, found.m)), 1 - claimed * (1 - found.decay)
    N = step_matrix(loop, lifted)
    zeta, mu = (
        float(np.linalg.norm(part.T @ found.P @ part, 2))
        for part in (N[:, loop.messages], N[:, loop.underflows])
    )
    kappa = MU * zeta if exact_messages else found.kappa / claimed
    for dear in ROUNDINGS:
        t = rounding_prices(loop, lifted, found.P, dear)
        witness = priced(loop, found.m, t, kappa, decay=decay, weight=claimed * found.weight, P=found.P)
        witness = replace(witness, kappa_mu=max(witness.kappa_mu, MU * mu))
        if (held := confirmed_witness(loop, lifted, witness, running)) is not None:
            yield held


def priced(
    loop: SampledLoop,
    m: PairWeights,
    t: Float[np.ndarray, " ways"],
    kappa: float,
    *,
    decay: float,
    weight: float = 0.0,
    P: Float[np.ndarray, "n_x n_x"] | None = None,
) -> Witness:
    """Return a witness whose underflow costs `MU` times what the messages' noise does; its prices alone without P."""
    ratio = 0.0 if P is None else distance_ratio(loop, P)
    P = np.zeros((loop.n_x, loop.n_x)) if P is None else P
    return Witness(P, m, t, decay, kappa, weight, ratio, MU * kappa)


def confirmed_witness(
    loop: SampledLoop, lifted: Lifted, witness: Witness, running: Float[np.ndarray, "n_z n_z"] | None = None
) -> Witness | None:
    """Return the witness if Omega is positive definite in doubles; running: a cost of z at each sampling instant."""
    return witness if holds_in_doubles(Omega_matrix(loop, lifted, witness, running)) else None


class _Search:
    """Witnesses whose V decays to 1 - spread of itself in each period."""

    def __init__(self, loop: SampledLoop, lifted: Lifted, m: PairWeights, spread: float) -> None:
        self.loop, self.exact, self.lifted = loop, in_exact_arithmetic(loop), lifted
        self.m, self.spread, self.reach = m, spread, 0.0

    def witnesses(self) -> Iterator[Witness]:
        """Yield one for each price of the noise, if any decays so fast."""
        least = self._least_price()
        for factor in PRICES if least is not None else ():
            kappa = factor * (least or 0.0)
            weight, P = self._weight(kappa)
            trials = (self._witness(kappa, weight, P, dear) for dear in ROUNDINGS) if P is not None else ()
            witness = next((trial for trial in trials if trial is not None), None)
            if witness is not None:
                yield witness

    def _prices(self, kappa: float, weight: float, t: Float[np.ndarray, " ways"]) -> Witness:
        return priced(self.loop, self.m, t, kappa, decay=1 - self.spread, weight=weight)

    def _largest(self, loop: SampledLoop, prices: Witness) -> Float[np.ndarray, "n_x n_x"] | None:
        problem = storage_problem(loop, self.lifted, prices)
        return None if problem is None else problem.reaching(self.reach).largest(1 - self.spread)

    def _unrounded(self, kappa: float, weight: float) -> Float[np.ndarray, "n_x n_x"] | None:
        return self._largest(self.exact, self._prices(kappa, weight, no_prices(self.loop)))

    def _least_price(self) -> float | None:
        """Bisect the least price of the noise at which V may decay so."""
        middle = float(np.log10(np.abs(self.lifted.CC_d).max() or 1.0))
        low, high = middle - 12, middle + 12
        if not self._has_an_end(10**high):
            return None
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            low, high = (middle, high) if self._unrounded(10**middle, 0.0) is None else (low, middle)
        return float(10**high)

    def _has_an_end(self, kappa: float) -> bool:
        """Tell whether there is a largest P at a price of the noise, with the least reach that gives it an end."""
        size = float(np.abs(self.lifted.BB_d).max(initial=0.0)) or 1.0
        for part in REACHES:
            self.reach = part * size
            if self._unrounded(kappa, 0.0) is not None:
                return True
        return False

    def _weight(self, kappa: float) -> tuple[float, Float[np.ndarray, "n_x n_x"] | None]:
        """Return the largest weight of the disagreement tried that a price of the noise carries, and P with it."""
        free = self._unrounded(kappa, 0.0)
        if free is None:
            return 0.0, None
        square = distance_ratio(self.loop, free) * kappa / self.spread
        for part in RMS:
            weight = kappa / (part**2 * square)
            P = self._unrounded(kappa, weight)
            if P is not None:
                return weight, P
        return 0.0, free

    def _witness(
        self, kappa: float, weight: float, P: Float[np.ndarray, "n_x n_x"], dear: float
    ) -> Witness | None:
        """Return the witness that claims a little less than what P was found for."""
        t = rounding_prices(self.loop, self.lifted, P, dear)
        found = self._largest(self.loop, self._prices(kappa, weight, t))
        if found is None:
            return None
        decay, kappa = 1 - CLAIMED * self.spread, kappa / CLAIMED
        witness = priced(self.loop, self.m, t, kappa, decay=decay, weight=weight, P=found)
        return confirmed_witness(self.loop, self.lifted, witness)
