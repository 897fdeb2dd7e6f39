"""What agents do without controllers, and controllers without their states: a design that hardly betters it is idle."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from lockstep.check.continuous.inequality import Claim
from lockstep.check.system.loop import Gains
from lockstep.lmi.analysis.certificate_sdp import least_rho
from lockstep.lmi.analysis.unit_scaling import scaled
from lockstep.model.network import Network

SOFT = "of {of} moves {moves} {times:.3g} times as far apart as u = 0 does (computed); rho is of the worst frequency"


def softer(figures: Mapping[str, Any]) -> str:
    """Say what a constant disturbance moves a tenth or more further apart than u = 0 does; "" where it moves nothing so."""
    soft = figures.get("static_response")
    return SOFT.format(**soft) if soft and soft["times"] > 1.1 else ""


def rho_alone(network: Network, claim: Claim) -> float | None:
    """Return the least rho found, in doubles, for u = 0; None where agents do not come to agree so.

    Args:
        network: the agents and their graph.
        claim: alpha, R and what disturbs; the weight of the controllers' states and the gains' errors mean nothing here.
    """
    m, q = network.plant.B[0].shape[1], len(network.plant.C)
    K, of_agents = np.zeros((network.N, m, q)), replace(claim, Q=np.zeros((0, 0)), delta=0 * claim.delta)
    loop, scaled_claim, units = scaled(network.loop(0), of_agents)
    if np.linalg.eigvals(loop.A_cl(K)).real.max() >= 0:
        return None
    found = least_rho(loop, K, scaled_claim)
    return None if found is None else units.rho * found.rho


def part_of_states(gains: Gains) -> float | None:
    """Return the largest M / (M + |D_C|), entry by entry, of all controllers, M = |C_C (j w - A_C)^-1 B_C|; None for order 0.

    Over w = 0 and around each pole of a controller, in doubles. Where it is small, static gains do the same. Poles are
    moved by 1e-9 of |A_C|: one at 0 integrates, and makes all of u in the end.
    """
    if gains.order == 0:
        return None
    worst, eye = 0.0, np.eye(gains.order)
    for A, B, C, D in zip(gains.A, gains.B, gains.C, gains.D, strict=True):
        try:
            poles = np.abs(np.linalg.eigvals(A))
            # Entries of 1e300 are numbers, too: what is not known to be small is not.
            with np.errstate(all="ignore"):
                for w in (0.0, *poles, *(poles / 10), *(poles * 10)):
                    moved = np.abs(
                        C @ np.linalg.solve((1j * w + 1e-9 * (1 + np.linalg.norm(A))) * eye - A, B)
                    )
                    part = moved / np.maximum(moved + np.abs(D), np.finfo(float).tiny)
                    worst = max(worst, float(np.nan_to_num(part, nan=1.0).max()))
        except np.linalg.LinAlgError:
            return 1.0
    return worst
