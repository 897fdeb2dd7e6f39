"""Design for the period: gains whose sampled controllers have the least rho, between the samples too.

From gains with a continuous certificate, strides of `program`, each followed by the true rho of its gains; what does
not improve is not kept. Where the sampled loop does not survive the asked period at the start, the period grows to it
from one that it survives, the gains following.

What comes back is a proposal: gains, and multiplier weights to prove them with.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from lockstep.lmi.sampled.certify import in_doubles
from lockstep.lmi.sampled.controller import HeldController, Network
from lockstep.lmi.sampled.performance import Weights, least_rho
from lockstep.lmi.sampled.program import Direct, DirectProgram
from lockstep.model.errors import Infeasible, ProblemError

ControllersOf = Callable[[Float[np.ndarray, "N k l"], float], tuple[HeldController, ...]]
"""The controllers of every agent, from gain blocks and a period in s."""

ROUNDS, ITERATIONS = 10, 120
"""Strides, and IPOPT's iterations in each: counts, so that the same input gives the same gains."""

ROUNDS_ON_THE_WAY = 3
"""Strides at each period before the asked one."""

TRUST, LEAST_TRUST, MOST_TRUST = 0.2, 5e-3, 1.5
"""Bounds on |log m| and |log rho| of a stride: the lifted period is a first-order model in them. They grow where the
model proves good, as it does where rho is large, and shrink where it does not."""

SLACK = 1.02
"""How far above its least rho a stride starts: inside."""

ENOUGH = 1.0005
"""A stride that gains less ends the search."""

RHO_KEPT = 3.0
"""The continuous rho may grow by so much: what ships is the sampled loop."""

GROWTH, LEAST_GROWTH = 1.5, 1.01
"""Of the period, from one that the loop survives to the one that is asked for."""

SCALES = (1.0, 10.0, 100.0, 1e3)
"""The multiplier's size against the weights of rho, tried where a loop is near its edge."""


def design_for_period(
    network: Network,
    controllers_of: ControllersOf,
    weights: Weights,
    start: Direct,
    gain_limit: float,
    *,
    rho_most: float | None = None,
    tell: Callable[[float], None] = lambda _part: None,
) -> Direct:
    """Return gains whose sampled controllers have a small rho at the network's period.

    Args:
        network: agents, coordinates, alpha, delay and the period asked for, the matrices exact.
        controllers_of: samples gains, by Tustin's rule, and rounds them as the code does.
        weights: R and Q.
        start: gains with a continuous certificate, whose m is also the first guess for the sampled one.
        gain_limit: the largest spectral norm of [A B; C D] of each agent.
        rho_most: the largest continuous rho allowed; by default a multiple of the start's.
        tell: called with the part that is done.

    Raises:
        Infeasible: no gains were found that survive the period; the figures say which one they reach.
    """
    rho_c = RHO_KEPT * start.continuous.rho if rho_most is None else rho_most
    search = _Search(controllers_of, weights, gain_limit, rho_c)
    at, growth, asked = _survived(search, network, start), GROWTH, network.period
    if at is None:
        raise Infeasible(
            f"the sampled loop with the continuous design's gains is not stable at any period down to"
            f" {asked / GROWTH**20:.3g} s",
            period=asked,
        )
    (period, best), rounds = at, 0
    while period < asked:
        best = search.improved(network.at(period), best, ROUNDS_ON_THE_WAY)
        rounds += 1
        tell(1 - 0.9 ** (rounds + 1))
        ahead = None
        while ahead is None and growth > LEAST_GROWTH:
            longer = min(asked, period * growth)
            ahead = search.measured(network.at(longer), best)
            growth = growth if ahead is not None else float(np.sqrt(growth))
        if ahead is None:
            raise Infeasible(
                f"no gains were found whose sampled loop is certified at {asked:g} s; at {period:.4g} s some are",
                period=asked,
                reachable_period=period,
            )
        period, best = longer, ahead
    return search.improved(network, best, ROUNDS, tell)


def _survived(search: "_Search", network: Network, start: Direct) -> tuple[float, Direct] | None:
    """Return the longest period tried that the start survives, and what it does there."""
    for k in range(21):
        period = network.period / GROWTH**k
        found = search.measured(network.at(period), start)
        if found is not None:
            return period, found
    return None


class _Search:
    """Strides and true rhos for one set of weights and limits."""

    def __init__(
        self, controllers_of: ControllersOf, weights: Weights, gain_limit: float, rho_c: float
    ) -> None:
        self.controllers_of, self.weights = controllers_of, weights
        self.gain_limit, self.rho_c = gain_limit, rho_c

    def measured(self, network: Network, start: Direct, below: float | None = None) -> Direct | None:
        """Return gains with their true rho and m scaled to go with it; None if there is none, or none below a bound."""
        try:
            loop = in_doubles(network, self.controllers_of(start.K, network.period))
        except ProblemError:
            return None
        found = []
        for scale in SCALES if below is None else (1.0,):
            m = scale * start.m
            rho = least_rho(loop, self.weights, m, None if below is None else (0.3 * below, below))
            if rho is not None:
                found.append(replace(start, m=m, rho=rho))
        return min(found, key=lambda one: one.rho, default=None)

    def improved(
        self,
        network: Network,
        best: Direct,
        rounds: int,
        tell: Callable[[float], None] = lambda _part: None,
    ) -> Direct:
        """Stride until strides gain nothing; each result is kept only if its true rho is smaller."""
        zero = tuple(
            replace(one, table=np.zeros_like(one.table))
            for one in self.controllers_of(best.K, network.period)
        )
        order, trust = zero[0].order, TRUST
        program = DirectProgram(in_doubles(network, zero), self.weights, order, self.gain_limit, self.rho_c)
        for k in range(rounds):
            tell(k / rounds)
            found = program.step(replace(best, rho=SLACK * best.rho), trust, ITERATIONS)
            true = self.measured(network, replace(found, K=self._limited(found.K)), best.rho)
            if true is None:
                trust *= 0.3
                if trust < LEAST_TRUST:
                    break
                continue
            promised, gained, best = best.rho / found.rho, best.rho / true.rho, true
            if gained < ENOUGH:
                break
            trust = min(2 * trust, MOST_TRUST) if gained**2 > promised else trust
        return best

    def _limited(self, K: Float[np.ndarray, "N k l"]) -> Float[np.ndarray, "N k l"]:
        norms = np.linalg.norm(K, 2, axis=(1, 2))
        factors = np.minimum(1.0, (1 - 1e-6) * self.gain_limit / np.maximum(norms, 1e-300))
        return np.asarray(K * factors[:, None, None])
