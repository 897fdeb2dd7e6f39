"""A small rho of the sampled loop is looked for here, in doubles, and put to the checker's decision.

What rho means, and what decides it, is in `lockstep.check.sampled.l2_gain`.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lockstep.check.continuous.inequality import Performance
from lockstep.check.numbers import Matrix
from lockstep.check.sampled.controller import HeldController, SampledNetwork
from lockstep.check.sampled.inequality import Witness, multiplier
from lockstep.check.sampled.l2_gain import proves_rho, running_cost, ways
from lockstep.check.sampled.lifting import Lifted, lift
from lockstep.check.sampled.loop import SampledLoop, sampled_loop
from lockstep.lmi.sampled.candidates import ROUNDINGS, confirmed_witness, is_large, priced
from lockstep.lmi.sampled.loop_gain import best_multiplier
from lockstep.lmi.sampled.storage import (
    StorageProblem,
    in_exact_arithmetic,
    no_prices,
    rounding_prices,
    storage_problem,
)
from lockstep.lmi.sampled.witnesses import first_guess, in_doubles, period_in_doubles
from lockstep.lmi.shapes import PairWeights, Vector

SCALES = range(-6, 7)
"""Powers of ten that pair weights are tried with where only their ratios are known."""

MULTIPLES = (1.0, 0.1, 10.0, 100.0, 1e3)
"""Of pair weights in a scale that is another loop's: the least for the continuous loop may hardly hold the sampled one."""

KEPT = 0.98
"""The part of a rho that another multiple of its weights is to be below, to be worth it."""

STEP, TRIALS = 0.5, 240
"""Of the logarithms of weights, the first of a search without slopes, and how many rho it looks at: of four agents in 4 s."""

NONE = 100.0
"""Above every log10 of a rho: what a line search sees where there is none; of an infinity it makes NaN."""

LEAST, MOST, WIDER = 1e-6, 1e6, (0, 3, 6)
RESOLUTION = 5e-5
"""The range in which rho is searched, by how many decades it is widened at either end, since rho has a unit, and how finely
its logarithm is."""

SLACKS = (1e-3, 2e-3, 5e-3, 1e-2, 2e-2, 5e-2, 0.1, 0.2, 0.5)
"""How far above the least rho found the proof is tried: what rounding needs depends on the gains."""

ROOM = 1e-4
"""The part of the running cost, and of the linear loop's decay, that is kept so that the inequality is strict."""

SQUARE = 1e-9
"""How far below zero, relatively, an eigenvalue of a square may come out in doubles."""

PRICE = 1e8
"""What the messages' noise counts in the search, relative to the lifted cost: as good as nothing gets in."""


class SampledRho(NamedTuple):
    """A rho of the sampled loop that was proved in ball arithmetic, and its witness (decay 1, no weight)."""

    rho: float
    witness: Witness


def sampled_rho(
    network: SampledNetwork,
    controllers: tuple[HeldController, ...],
    weights: Performance,
    guess: PairWeights | None = None,
) -> SampledRho | None:
    """Find and prove a small rho; None if none is proved.

    Args:
        network: agents, coordinates, alpha, period, delay, the matrices exact.
        controllers: one per agent, with the coefficients of the code; all their rounding is covered.
        weights: what rho is a gain to and from.
        guess: pair weights, in their own scale: those of the continuous certificate. Where they prove nothing, or
            there are none, those that prove stability are tried in their best scale.
    """
    loop = in_doubles(network, controllers, weights.outputs)
    exact_loop = sampled_loop(network, controllers, weights.outputs)
    for m in _pair_weights(loop, weights, guess):
        found = _proved_with(loop, exact_loop, weights, m)
        if found is not None:
            return found
    return None


def _proved_with(
    loop: SampledLoop, exact_loop: SampledLoop, weights: Performance, m: PairWeights
) -> SampledRho | None:
    least = least_rho(loop, weights, m)
    if least is None:
        return None
    for slack, dear in itertools.product(SLACKS, ROUNDINGS):
        rho = float(f"{least * (1 + slack):.4g}")
        period = period_of(loop, weights, m, rho)
        witness = None if period is None else period.witness(dear)
        if witness is not None and proves_rho(exact_loop, weights, rho, witness):
            return SampledRho(rho, witness)
    return None


def lifted_with_performance(loop: SampledLoop, weights: Performance, M: Matrix, rho: float) -> Lifted:
    """Return one period of x_d in doubles with the disturbance and the weighted state, for a multiplier and a rho."""
    from scipy.linalg import expm

    A, B = (np.kron(np.eye(loop.network.d.N - 1), one) for one in (loop.network.plant.A, loop.into))
    return lift(A, B, *ways(loop, weights, M, rho), loop.network.period, expm)


@dataclass(frozen=True, eq=False)
class _Period:
    """One lifted period for a multiplier and a rho, and the prices of the noise."""

    loop: SampledLoop
    lifted: Lifted
    m: PairWeights
    running: Float[np.ndarray, "n_z n_z"]
    units: Float[np.ndarray, " n_x"]
    """Of costs, which are small or large beside them: R's own of each state, elsewhere its largest eigenvalue."""
    price: float = PRICE

    @property
    def kappa(self) -> float:
        return self.price * float(np.abs(self.lifted.CC_d).max() or 1.0)

    def prices(self, t: Float[np.ndarray, " ways"], P: Float[np.ndarray, "n_x n_x"] | None = None) -> Witness:
        """Return the prices, with P if there is one."""
        return priced(self.loop, self.m, t, self.kappa, decay=1.0, P=P)

    def unrounded(self) -> StorageProblem | None:
        """Return the inequality without rounding."""
        return storage_problem(
            in_exact_arithmetic(self.loop),
            self.lifted,
            self.prices(no_prices(self.loop)),
            self.running + self.rest(0.01 * ROOM),
        )

    def rest(self, share: float) -> Float[np.ndarray, "n_z n_z"]:
        """Return a small cost of every state, without which V may be zero in some direction."""
        cost = np.zeros((self.loop.n_z, self.loop.n_z))
        cost[: self.loop.n_x, : self.loop.n_x] = share * self.loop.network.period * np.diag(self.units)
        return cost

    def witness(self, dear: float) -> Witness | None:
        """Return a witness with a little room in every direction, or None."""
        loop, first = self.loop, self.unrounded()
        P = None if first is None else first.smallest(1.0)
        if first is None or P is None:
            return None
        prices = self.prices(rounding_prices(loop, self.lifted, P, dear))
        problem = storage_problem(loop, self.lifted, prices, self.running + self.rest(ROOM))
        spread = ROOM * (1 - float(np.abs(np.linalg.eigvals(first.A)).max()) ** 2)
        P = None if problem is None or not 0 < spread < 1 else problem.smallest(1 - spread)
        if P is None:
            return None
        return confirmed_witness(loop, self.lifted, self.prices(prices.t, P), self.running)


def period_of(loop: SampledLoop, weights: Performance, m: PairWeights, rho: float) -> _Period | None:
    """Lift a period, or return None where the period alone exceeds rho."""
    try:
        lifted = lifted_with_performance(loop, weights, multiplier(loop.network.d, m), rho)
    except np.linalg.LinAlgError:
        return None
    if not is_lifted(lifted):
        return None
    units, R = np.full(loop.n_x, np.linalg.norm(weights.R, 2)), np.diag(weights.R)
    own = np.tile(np.where(R > 0, R, units[0]), loop.network.d.N - 1)
    units[: len(own)] = own
    if loop.network.delay:
        # The last of x are the inputs, held one period more: by what they weigh, or by how large they are where x is one.
        k = len(loop.computed)
        size = np.maximum((loop.computed[:, : loop.n_x - k] ** 2 / units[:-k]).sum(axis=1), 1e-300)
        W = np.tile(np.diag(weights.W), loop.network.d.N) if len(weights.W) else np.zeros(k)
        units[-k:] = np.where(W > 0, W, 1 / size)
    return _Period(loop, lifted, m, running_cost(loop, weights, rho), units)


def is_lifted(lifted: Lifted) -> bool:
    """Tell whether S and Q are finite squares: past a conjugate point the formulas go on, and mean nothing."""
    if not all(np.isfinite(part).all() for part in (lifted.A_d, lifted.BB_d, lifted.CC_d)):
        return False
    return all(
        np.linalg.eigvalsh(part)[0] >= -SQUARE * np.abs(part).max() for part in (lifted.BB_d, lifted.CC_d)
    )


def least_rho(
    loop: SampledLoop,
    weights: Performance,
    m: PairWeights,
    most: float | None = None,
    *,
    resolution: float = RESOLUTION,
) -> float | None:
    """Bisect the least rho without rounding, in doubles; None if there is none up to `most`, by default 1e12."""

    def holds(exponent: float) -> bool:
        period = period_of(loop, weights, m, 10**exponent)
        problem = None if period is None else period.unrounded()
        return problem is not None and problem.smallest(1.0) is not None

    tops = (math.log10(most),) if most else tuple(math.log10(MOST) + more for more in WIDER)
    high = next((at for at in tops if holds(at)), None)
    if high is None:
        return None
    ends = (min(math.log10(LEAST), high - 1) - less for less in WIDER)
    low = next((at for at in ends if not holds(at)), math.log10(LEAST) - WIDER[-1])
    while high - low > resolution:
        middle = (low + high) / 2
        low, high = (low, middle) if holds(middle) else (middle, high)
    return float(10**high)


def least_in_scales(
    loop: SampledLoop,
    weights: Performance,
    m: PairWeights,
    scales: Sequence[float],
    *,
    resolution: float = RESOLUTION,
    kept: float = 1.0,
) -> tuple[float, PairWeights] | None:
    """Return the least rho over multiples of pair weights, and that multiple; one that keeps more of the rho of those before
    than `kept` is passed over."""
    best: tuple[float, PairWeights] | None = None
    for scale in scales:
        most = None if best is None else kept * best[0]
        rho = least_rho(loop, weights, scale * m, most, resolution=resolution)
        best = best if rho is None else (rho, scale * m)
    return best


def _pair_weights(
    loop: SampledLoop, weights: Performance, guess: PairWeights | None
) -> Iterator[PairWeights]:
    """Yield pair weights to prove rho with: those known, then those that prove stability, then these with a smaller rho.

    The proof of stability does not depend on the scale of its weights, rho does: too small they do not hold the
    nonlinearity, and far too large they let the disturbance through. In a sector for several slopes, which the continuous
    loop holds each by itself, those known are far from the best: there they are lowered before all.
    """
    known = first_guess(loop.network.d, guess)
    lowered = None if loop.network.sector is None else _lowered(loop, weights, known)
    multiple = None if guess is None else least_in_scales(loop, weights, known, MULTIPLES, kept=KEPT)
    yield from (m for m in (lowered, multiple and multiple[1]) if m is not None)
    one = period_in_doubles(loop)
    stable = None if one is None else best_multiplier(loop, one, known)[0]
    for m in (stable, known if lowered is None else None):
        scaled = None if m is None else _lowered(loop, weights, m)
        if scaled is not None:
            yield scaled


def _lowered(loop: SampledLoop, weights: Performance, m: PairWeights) -> PairWeights | None:
    """Return weights with a small rho, from the best power of ten of some on; of a large loop these in one scale."""
    from scipy.optimize import minimize

    def height(logs: Vector, resolution: float = 1e-3) -> float:
        least = least_rho(loop, weights, np.exp(logs), resolution=resolution)
        return NONE if least is None else math.log10(least)

    logs = np.log(np.maximum(m, LEAST * m.max()))
    first = min((logs + math.log(10) * scale for scale in SCALES), key=lambda at: height(at, 0.1))
    ways = np.ones((1, len(m))) if is_large(loop) else np.eye(len(m))
    simplex = np.vstack([0 * ways[:, 0], STEP * np.eye(len(ways))])
    options = {"initial_simplex": simplex, "maxfev": TRIALS}
    found = minimize(
        lambda step: height(first + step @ ways), simplex[0], method="Nelder-Mead", options=options
    )
    return None if found.fun == NONE else np.exp(first + found.x @ ways)
