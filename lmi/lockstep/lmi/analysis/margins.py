"""How far given gains carry: the largest alpha, or part of a claim, that still has a certificate; rho against alpha.

Each figure is a bisection over semidefinite programs. It says where a search stands; `rounding.prove` is what
certifies.
"""

from collections.abc import Callable, Sequence

import numpy as np

from lockstep.check.continuous.inequality import Claim
from lockstep.check.system.loop import Loop
from lockstep.lmi.analysis.certificate_sdp import least_rho
from lockstep.lmi.analysis.unit_scaling import claim_at, scaled
from lockstep.lmi.shapes import GainBlocks

DOUBLINGS, HALVINGS = 20, 10
"""At most so many doublings of alpha to bracket the largest one, and halvings of the bracket: to 0.1 %."""


def largest_alpha(
    loop: Loop, K: GainBlocks, claim: Claim, *, rho: float = np.inf, from_alpha: float | None = None
) -> float:
    """Return the largest alpha for which a rho of at most `rho` was found; 0 where there is none.

    Args:
        loop, K: the loop and its gains.
        claim: R, Q and delta; its alpha is where the search starts, unless `from_alpha` says otherwise.
        rho: the largest rho that counts.
        from_alpha: an alpha to start from.
    """

    def carried(alpha: float) -> bool:
        found = least_rho(loop, K, claim_at(claim, alpha=alpha))
        return found is not None and found.rho <= rho

    high = max(from_alpha if from_alpha is not None else claim.alpha, 1e-6)
    low = 0.0
    for _ in range(DOUBLINGS):
        if not carried(high):
            break
        low, high = high, 2 * high
    return bisect(carried, low, high, HALVINGS)


def largest_fraction(loop: Loop, K: GainBlocks, claim: Claim, known: float) -> float:
    """Return the largest part of alpha and delta, both scaled alike, that has a certificate, from a known one up.

    Looked for in the units of the search: in metres and pascals the solver finds none for gains that carry most of it.
    """
    loop, claim, _ = scaled(loop, claim)

    def carried(part: float) -> bool:
        some = claim_at(claim, alpha=part * claim.alpha, fraction_of_delta=part)
        return least_rho(loop, K, some) is not None

    return 1.0 if carried(1.0) else bisect(carried, known, 1.0, HALVINGS - 4)


def trade_off(loop: Loop, K: GainBlocks, claim: Claim, alphas: Sequence[float]) -> list[tuple[float, float]]:
    """Return (alpha, least rho) for each alpha, infinite where there is no certificate: the curve rho(alpha)."""
    found = [least_rho(loop, K, claim_at(claim, alpha=alpha)) for alpha in alphas]
    return [(alpha, np.inf if c is None else c.rho) for alpha, c in zip(alphas, found, strict=True)]


def bisect(holds: Callable[[float], bool], low: float, high: float, steps: int) -> float:
    """Return the upper end of what holds in [low, high], low being known to and high not to."""
    for _ in range(steps):
        middle = (low + high) / 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low
