"""The largest disagreement from which no input meets its limit is looked for here, in doubles, and put to the checker.

Without rounding it is `step_program` with P >= k_l' k_l / u_max,l^2 for every input and gamma (T T')^-1 (x) diag(s)^-2 >=
P_d, gamma least: the half-axes are gamma^-1/2 s. The sizes s of the states, all 1 where nothing is said, weigh metres against
metres per second. Of a large loop, and where the solver gives up, P and the pair weights are sums of the smallest P
(`storage`) for some costs and multiples of the weights that are given. The largest energy of a disturbance is that of the
largest P, for which a factor of the pair weights and a decay are searched.
"""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag

from lockstep.check.continuous.inequality import Performance
from lockstep.check.sampled.controller import HeldController, SampledNetwork
from lockstep.check.sampled.inequality import Witness, metric, multiplier
from lockstep.check.sampled.inputs.input_limits import proves_gain, proves_radius
from lockstep.check.sampled.l2_gain import running_cost
from lockstep.check.sampled.lifting import Lifted, copies
from lockstep.check.sampled.loop import SampledLoop, sampled_loop
from lockstep.lmi.sampled.candidates import (
    REACHES,
    ROUNDINGS,
    SOME_STATES,
    confirmed_witness,
    is_large,
    priced,
    priced_for_rounding,
)
from lockstep.lmi.sampled.half_axes import ONE, Sizes, largest_multiple
from lockstep.lmi.sampled.l2_gain import PRICE, is_lifted, lifted_with_performance
from lockstep.lmi.sampled.loop_gain import spectral_radius
from lockstep.lmi.sampled.step_program import StepProgram, step_program
from lockstep.lmi.sampled.storage import (
    StorageProblem,
    in_exact_arithmetic,
    no_prices,
    on_disagreement,
    rounding_prices,
    storage_problem,
)
from lockstep.lmi.sampled.witnesses import in_doubles, period_in_doubles

RATES = (0.005, 0.02, 0.1)
"""How fast V is asked to decay, as parts of how fast the linear loop does."""

KEPT = (0.995, 0.97, 0.9)
"""Parts of the radius found that are claimed: rounding needs some room."""

SCALES, COARSE = (-3.0, 3.0), 13
"""Powers of ten between which pair weights are scaled, from those given, and how many are looked at first."""

FACTORS = tuple(10.0 ** (exponent / 2) for exponent in range(-6, 7))
"""By which given pair weights are multiplied, from where they cost what the inputs do."""

PARTS, MOST_ADDED, HELPS = tuple(10.0 ** (exponent / 2) for exponent in range(-8, 5)), 4, 0.98
"""How much of another P, both of norm 1, is added to the best one; how many are; and what gamma has to fall to."""

DULL = 1e-6
"""Of the largest cost, what a state costs that no input sees: V has to grow with every state."""

DEAR = 1e30
"""The price of messages that have no errors."""

CLAIMED = 0.5
"""The part of the decay that is claimed: the rest is room for rounding."""


_Stored = tuple[Float[np.ndarray, "n_x n_x"], Float[np.ndarray, " pairs"]]
"""P and the pair weights that go with it."""


def largest_radius(
    network: SampledNetwork,
    controllers: tuple[HeldController, ...],
    limits: Float[np.ndarray, " m"],
    guess: Float[np.ndarray, " pairs"],
    sizes: Sizes = ONE,
) -> tuple[float, Witness] | None:
    """Find and prove a large radius over the sizes of the states, in short decimals; None if none is proved.

    Args:
        network: agents, coordinates, alpha, period, delay, the matrices exact.
        controllers: one per agent, with the coefficients of the code.
        limits: (m,) of each agent's inputs.
        guess: pair weights that prove the loop, up to a common factor: those of a large loop.
        sizes: (n,) or one for all; the half-axes are the radius times these.
    """
    loop, exact_loop = in_doubles(network, controllers), sampled_loop(network, controllers)
    one = period_in_doubles(loop)
    if one is None or not np.isfinite(limits).any():
        return None
    spread = 1 - spectral_radius(loop, one) ** 2
    rows = np.array([row / limits[k % len(limits)] for k, row in enumerate(loop.computed[:, : loop.n_x])])

    def least(decay: float) -> tuple[float, Witness] | None:
        found = None if is_large(loop) else least_level(loop, one, rows, decay, sizes=sizes)
        return found or level_of_given_weights(loop, one, rows, decay, guess, sizes)

    rates = () if spread <= 0 else RATES if is_large(loop) or loop.n_x <= SOME_STATES else RATES[1:2]
    found = [least(1 - rate * spread) for rate in rates]
    for _, witness in sorted((each for each in found if each is not None), key=lambda each: each[0]):
        for candidate in priced_for_rounding(loop, one, witness, CLAIMED, exact_messages=True):
            radius, a = largest_multiple(exact_loop, candidate, limits, sizes)
            if proves_radius(exact_loop, candidate, limits, a):
                return radius, candidate
    return None


def inside(loop: SampledLoop, gamma: Any, program: StepProgram, sizes: Sizes) -> tuple[list[Any], float]:
    """Return gamma unit (T T')^-1 (x) diag(s)^-2 >= P_d as conditions, and the unit, with which both sides are near 1.

    In units of s: a solver loses 1e-6 beside 1.
    """
    S = np.resize(sizes, loop.n_d)[:, None] * program.basis[: loop.n_d]
    unit = float(np.linalg.norm(S, 2)) ** 2
    return [gamma * np.asarray(metric(loop)) - (S @ program.V @ S.T) / unit >> 0], unit


def least_level(
    loop: SampledLoop,
    one: Lifted,
    rows: Float[np.ndarray, "k n_x"],
    decay: float,
    noise: float | None = None,
    sizes: Sizes = ONE,
) -> tuple[float, Witness] | None:
    """Return the least gamma with |k_l x_cl| <= 1 where V <= 1 and P_d is `inside`, and its witness, or None.

    noise: the most that the messages' errors may cost, as kappa; where they count for nothing, None, and the witness is
    without prices of errors.
    """
    import cvxpy as cp

    program = step_program(loop, one, decay, rows.T @ rows, noise=noise is not None)
    if program is None:
        return None
    gamma, inverse = cp.Variable(), np.linalg.inv(program.basis)
    conditions, unit = inside(loop, gamma, program, sizes)
    conditions += [program.V - np.outer(inner, inner) >> 0 for inner in rows @ inverse.T if inner.any()]
    if noise is not None and math.isfinite(noise):
        conditions.append(program.kappa <= noise / program.unit)
    found = program.least(gamma, conditions)
    return found and (unit * found[0], found[1])


def level_of_given_weights(
    loop: SampledLoop,
    one: Lifted,
    rows: Float[np.ndarray, "k n_x"],
    decay: float,
    m: Float[np.ndarray, " pairs"],
    sizes: Sizes = ONE,
) -> tuple[float, Witness] | None:
    """Return what `least_level` does, P and the weights being sums of some; or None.

    Each P is the smallest with m times a factor and a cost of each sample: of the inputs, of the disagreement, or of the
    controllers and the inputs held. The inequality is convex in P and the weights together, so that sums satisfy it too: to
    the best one another is added, the one that helps most, as long as it helps.
    """
    n, n_d, s, found = loop.n_x, loop.n_d, np.resize(sizes, loop.n_d), list[_Stored | None]()
    form = np.asarray(metric(loop)) / np.outer(s, s)
    size = float(np.linalg.norm(rows, 2)) ** 2
    alike = size / (float(np.linalg.norm(copies(one, multiplier(loop.network.d, m)).CC_d, 2)) or 1.0)
    others = np.diag(np.arange(n) >= n_d).astype(float)
    for cost in (rows.T @ rows, on_disagreement(loop, size * form / np.linalg.norm(form, 2)), size * others):
        costs = block_diag(cost + DULL * size * np.eye(n), np.zeros((loop.n_z - n,) * 2))
        found += [_smallest(loop, one, alike * factor * m, decay, costs) for factor in FACTORS]
    root = np.linalg.inv(np.linalg.cholesky(form))

    def measured(P: Float[np.ndarray, "n n"]) -> tuple[float, float]:
        reach = float((rows.T * np.linalg.solve(P, rows.T)).sum(axis=0).max())
        return reach * float(np.linalg.eigvalsh(root @ P[:n_d, :n_d] @ root.T)[-1]), reach

    some = [each for each in found if each is not None]
    if not some:
        return None
    least, (P, weights) = min(((measured(each[0])[0], each) for each in some), key=lambda tried: tried[0])
    for _ in range(MOST_ADDED):
        sums = ((P + part * Q, weights + part * w) for Q, w in some for part in PARTS)
        less, better = min(((measured(each[0])[0], each) for each in sums), key=lambda tried: tried[0])
        if less > HELPS * least:
            break
        least, (P, weights) = less, (each / np.linalg.norm(better[0], 2) for each in better)
    gamma, reach = measured(P)
    return gamma, priced(loop, reach * weights, np.zeros(len(loop.ways)), 0.0, decay=decay, P=reach * P)


def _smallest(
    loop: SampledLoop,
    one: Lifted,
    m: Float[np.ndarray, " pairs"],
    decay: float,
    cost: Float[np.ndarray, "n_z n_z"],
) -> _Stored | None:
    """Return the smallest P for pair weights and a cost of each sample, and these, both with |P| = 1; or None."""
    exact, prices = in_exact_arithmetic(loop), priced(loop, m, no_prices(loop), DEAR, decay=decay)
    with np.errstate(all="ignore"):
        problem = storage_problem(exact, copies(one, multiplier(loop.network.d, m)), prices, cost)
        P = None if problem is None else problem.smallest(decay)
    return None if P is None else (P / np.linalg.norm(P, 2), m / np.linalg.norm(P, 2))


def largest_gain(
    network: SampledNetwork,
    controllers: tuple[HeldController, ...],
    limits: Float[np.ndarray, " m"],
    weights: Performance,
    guess: Float[np.ndarray, " pairs"],
) -> tuple[float, Witness] | None:
    """Find and prove a large root of the energy of a disturbance under which no input meets its limit, or return None.

    Args:
        network: agents, coordinates, alpha, period, delay, the matrices exact.
        controllers: one per agent, with the coefficients of the code.
        limits: (m,) of each agent's inputs.
        weights: whose scales of disturbance and noise are meant.
        guess: pair weights that are about right for rho = 1.
    """
    from scipy.optimize import minimize_scalar

    quiet = weights._replace(R=0 * weights.R, Q=0 * weights.Q, W=weights.W[:0, :0])
    loop = in_doubles(network, controllers, weights.outputs)
    exact_loop, one = sampled_loop(network, controllers, weights.outputs), period_in_doubles(loop)
    spread = 0.0 if one is None else 1 - spectral_radius(loop, one) ** 2
    found: list[tuple[float, float, float]] = []
    for rate in RATES if spread > 0 and np.isfinite(limits).any() else ():

        def missing(scale: float, rate: float = rate) -> float:
            return -_Disturbed(loop, quiet, guess * 10**scale, 1 - rate * spread).energy(limits)

        # Most scales may have no witness at all: the search begins at one that has, if any does.
        coarse = {scale: missing(scale) for scale in np.linspace(*SCALES, COARSE)}
        middle, step = min(coarse, key=lambda scale: coarse[scale]), np.ptp(SCALES) / (COARSE - 1)
        if not coarse[middle] < 0:
            continue
        around = middle - step, middle + step
        best = minimize_scalar(missing, bounds=around, method="bounded", options={"xatol": 0.02})
        # The best lies near an edge, where what rounding costs may leave nothing: then another has to do.
        found += [
            (energy, scale, rate) for scale, energy in ((best.x, best.fun), *coarse.items()) if energy < 0
        ]
    for missed, scale, rate in sorted(found):
        energy, problem = -missed, _Disturbed(loop, quiet, guess * 10**scale, 1 - rate * spread)
        for witness in problem.witnesses():
            for part in KEPT:
                gain = float(f"{part * energy**0.5:.4g}")
                if proves_gain(exact_loop, witness, limits, weights, gain):
                    return gain, witness
    return None


class _Disturbed:
    """The loop with a disturbance, rho being 1, for pair weights and a decay."""

    def __init__(
        self, loop: SampledLoop, weights: Performance, m: Float[np.ndarray, " pairs"], decay: float
    ) -> None:
        self.loop, self.m, self.decay, self.lifted = loop, m, decay, None
        self.running = running_cost(loop, weights, 1.0)
        try:
            with np.errstate(all="ignore"):
                lifted = lifted_with_performance(loop, weights, multiplier(loop.network.d, m), 1.0)
        except (np.linalg.LinAlgError, ValueError, OverflowError):
            return
        self.lifted = lifted if is_lifted(lifted) else None

    def _problem(self, loop: SampledLoop, t: Float[np.ndarray, " ways"]) -> StorageProblem | None:
        if self.lifted is None:
            return None
        return storage_problem(loop, self.lifted, self._prices(t), self.running)

    def _prices(self, t: Float[np.ndarray, " ways"], P: Float[np.ndarray, "n n"] | None = None) -> Witness:
        assert self.lifted is not None
        kappa = PRICE * float(np.abs(self.lifted.CC_d).max() or 1.0)
        decay = self.decay if P is None else 1 - CLAIMED * (1 - self.decay)
        return priced(self.loop, self.m, t, kappa, decay=decay, P=P)

    def _largest(self, problem: StorageProblem | None) -> Float[np.ndarray, "n n"] | None:
        if problem is None:
            return None
        size = float(np.abs(problem.S).max(initial=0.0)) or 1.0
        trials = (problem.reaching(part * size).largest(self.decay) for part in REACHES)
        return next((P for P in trials if P is not None), None)

    def energy(self, limits: Float[np.ndarray, " m"]) -> float:
        """Return the largest e^2 without rounding, 0 where there is none."""
        P = self._largest(self._problem(in_exact_arithmetic(self.loop), no_prices(self.loop)))
        if P is None:
            return 0.0
        loop, n, outputs = self.loop, self.loop.n_x, self.loop.outputs
        noise = -self.running[outputs, outputs]
        least = math.inf
        for l, row in enumerate(loop.computed):
            square = row[:n] @ np.linalg.solve(P, row[:n])
            if len(noise):
                square += row[outputs] @ np.linalg.solve(noise, row[outputs])
            least = min(least, limits[l % len(limits)] ** 2 / square if square > 0 else math.inf)
        return least if math.isfinite(least) else 0.0

    def witnesses(self) -> Iterator[Witness]:
        """Yield witnesses with prices of the rounding."""
        first = self._largest(self._problem(in_exact_arithmetic(self.loop), no_prices(self.loop)))
        if first is None or self.lifted is None:
            return
        for dear in ROUNDINGS:
            t = rounding_prices(self.loop, self.lifted, first, dear)
            P = self._largest(self._problem(self.loop, t))
            if P is None:
                continue
            held = confirmed_witness(self.loop, self.lifted, self._prices(t, P), self.running)
            if held is not None:
                yield held
