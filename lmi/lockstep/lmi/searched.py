"""Method "certified": gains by search, in short decimals, and why there are none where there are none."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lockstep.lmi.inequality import Certificate, Claim
from lockstep.lmi.rounding import prove, short_gains
from lockstep.lmi.search import search
from lockstep.lmi.start import Outcome
from lockstep.model.errors import Infeasible, NotCertified
from lockstep.model.loop import Gains
from lockstep.model.network import Network
from lockstep.model.problem import Problem


@dataclass(frozen=True)
class Found:
    """Gains, the claim they were found for (alpha may have been raised), and its certificate."""

    gains: Gains
    claim: Claim
    certificate: Certificate
    figures: dict[str, Any]


def searched(
    problem: Problem, network: Network, claim: Claim, jobs: int | None, tell: Callable[[str, float], None]
) -> Found:
    """Search, round, prove.

    Raises:
        Infeasible: no start led to gains for the claim; the figures say what is reachable.
        NotCertified: gains were found, and their certificate did not survive the exact check.
    """
    table = problem.design
    rho = table.rho if table.objective == "alpha" else None
    best = search(
        network.loop(problem.order),
        claim,
        table.gain_limit,
        starts=table.starts,
        seed=table.seed,
        rho=rho,
        jobs=jobs,
        tell=lambda part: tell("searching for gains", part),
    )
    if best.K is None or best.certificate is None:
        raise _nothing(problem, claim, best)
    tell("proving the certificate", 0.0)
    if rho is not None:
        # 0.01 % is left to rounding; the proved alpha of the agent itself stays below.
        claim = replace(claim, alpha=max(claim.alpha, float(f"{best.alpha * (1 - 1e-4):.6g}")))
    gains = Gains.from_blocks(short_gains(best.K, table.gain_limit), problem.order)
    figures = {"history": list(best.history)}
    muted = without_idle_parts(gains, network)
    if muted is not gains:
        try:
            return Found(muted, claim, prove(network, muted, claim, rho=rho), figures)
        except NotCertified:
            pass
    return Found(gains, claim, prove(network, gains, claim, rho=rho), figures)


def without_idle_parts(gains: Gains, network: Network) -> Gains:
    """Return the gains with the controllers of agents that hear nobody set to x_C' = -x_C, u = 0.

    Such an agent's r is 0 for ever: whatever the search left in its controller is noise.
    """
    deaf = [i for i, degree in enumerate(network.graph.in_degrees) if degree == 0]
    if not deaf:
        return gains
    blocks = gains.blocks.copy()
    for i in deaf:
        blocks[i] = 0.0
        blocks[i, : gains.order, : gains.order] = -np.eye(gains.order)
    return Gains.from_blocks(blocks, gains.order)


def _nothing(problem: Problem, claim: Claim, best: Outcome) -> Infeasible:
    """Say what stands in the way, and what to relax."""
    table = problem.design
    asked = f"order {problem.order}, gain_limit {table.gain_limit:g}, {table.starts} starts"
    if best.fraction == 0:
        if best.abscissa >= 0:
            return Infeasible(
                f"no stabilising gains were found ({asked}): the slowest mode of the best loop stays at Re s ="
                f" {best.abscissa:.3g}; raise [design] order or gain_limit, or measure more",
                abscissa=best.abscissa,
            )
        return Infeasible(
            f"stable gains were found ({asked}) but none with a certificate, even for a thousandth of alpha ="
            f" {claim.alpha:.6g}; raise [design] order, gain_limit or starts",
            abscissa=best.abscissa,
            alpha=claim.alpha,
        )
    if best.fraction < 1:
        delta = " and delta" if claim.delta.any() else ""
        return Infeasible(
            f"no gains were found ({asked}) that carry alpha = {claim.alpha:.6g}; {best.fraction:.3g} of it{delta} is"
            f" reachable: alpha = {best.fraction * claim.alpha:.6g}; lower alpha (a smaller domain, centred slopes), or"
            " raise order, gain_limit or starts",
            alpha=claim.alpha,
            fraction=best.fraction,
            reachable_alpha=best.fraction * claim.alpha,
            reachable_delta=(best.fraction * claim.delta[0]).tolist(),
        )
    reached = best.history[-1]
    return Infeasible(
        f"rho = {table.rho:g} was not reached ({asked}): {reached:.6g} was; raise rho, order, gain_limit or starts",
        rho=table.rho,
        reachable_rho=reached,
    )
