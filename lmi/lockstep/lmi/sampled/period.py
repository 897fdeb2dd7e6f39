"""The largest period that is certified, the controllers being sampled anew at each.

Doubles look for the edge: the period is doubled from the one asked for until the loop fails there, or halved
until it holds, and the last factor of two is bisected. The proof then decides at the edge; where it does not
follow, the period is taken back a little. Periods beyond the first that fails are not looked at, so nothing is
said of them.
"""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from lockstep.check.errors import ProblemError
from lockstep.check.sampled.certificate import SampledVerdict
from lockstep.check.sampled.controller import HeldController, SampledNetwork
from lockstep.lmi.analysis.decimals import round_down
from lockstep.lmi.sampled.loop_gain import best_multiplier
from lockstep.lmi.sampled.witnesses import certify_sampled, first_guess, in_doubles, period_in_doubles
from lockstep.lmi.shapes import PairWeights

ControllersAt = Callable[[float], tuple[HeldController, ...]]
"""The controllers of every agent, sampled with a period in s."""

DOUBLINGS = 12
"""From 5 ms to 20 s, or down to a microsecond."""

RESOLUTION = 1e-3
"""How far apart, relatively, the largest period that holds and one that fails end up."""

BACK_OFF = (0.999, 0.998, 0.995, 0.98, 0.95, 0.85, 0.7, 0.4, 0.2, 0.1, 0.03, 0.01)
"""The edge is where doubles see it: a proof needs some room before it, and far more where its numbers are large."""


def max_period(
    network: SampledNetwork, controllers_at: ControllersAt, guess: PairWeights | None = None
) -> SampledVerdict | None:
    """Return the proved verdict at the largest period found, rounded down to four digits; None if there is none.

    Args:
        network: its period is where the search starts.
        controllers_at: gives the controllers for a period; a `ProblemError` says that there are none.
        guess: pair weights to start from.
    """
    edge = _Edge(network, controllers_at, guess)

    def certified(period: float) -> SampledVerdict:
        return certify_sampled(
            replace(network, period=period), controllers_at(period), edge.guess, thorough=False
        )

    return longest_from(network.period, edge.seems_to_hold, certified)


def longest_from(
    start: float, seems_to_hold: Callable[[float], bool], certify: Callable[[float], SampledVerdict]
) -> SampledVerdict | None:
    """Return the proved verdict at the largest period found from a start, rounded down to four digits; None if there is none.

    Args:
        start: where the search starts, in s.
        seems_to_hold: whether a period holds, in doubles.
        certify: the verdict at a period.
    """
    low, high = _bracket(start, seems_to_hold)
    if low is None:
        return None
    while high is not None and high > low * (1 + RESOLUTION):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if seems_to_hold(middle) else (low, middle)
    for factor in BACK_OFF:
        verdict = certify(round_down(low * factor))
        if verdict.certified:
            return verdict
    return None


def _bracket(start: float, seems_to_hold: Callable[[float], bool]) -> tuple[float | None, float | None]:
    """Return a period that seems to hold and, twice as long, one that does not."""
    if seems_to_hold(start):
        for k in range(1, DOUBLINGS + 1):
            if not seems_to_hold(start * 2**k):
                return start * 2 ** (k - 1), start * 2**k
        return start * 2**DOUBLINGS, None
    for k in range(1, DOUBLINGS + 1):
        if seems_to_hold(start / 2**k):
            return start / 2**k, start / 2 ** (k - 1)
    return None, None


class _Edge:
    """Where the loop stops to hold, in doubles; the multiplier that held last is the first guess for the next period."""

    def __init__(
        self, network: SampledNetwork, controllers_at: ControllersAt, guess: PairWeights | None
    ) -> None:
        self.network, self.controllers_at, self.guess = network, controllers_at, guess

    def seems_to_hold(self, period: float) -> bool:
        """Tell whether some multiplier makes the gain around the nonlinearity less than 1."""
        network = replace(self.network, period=period)
        try:
            loop = in_doubles(network, self.controllers_at(period))
            one = period_in_doubles(loop)
            with np.errstate(all="ignore"):
                if one is None:
                    return False
                m, gain = best_multiplier(loop, one, first_guess(network.d, self.guess), least=0.999)
        except (ProblemError, np.linalg.LinAlgError, ValueError):
            return False
        self.guess = m if gain < 1 else self.guess
        return gain < 1
