"""What the agents do without any controllers: a design that hardly betters it hardly does anything."""

from dataclasses import replace

import numpy as np

from lockstep.check.continuous.inequality import Claim
from lockstep.lmi.analysis.certificate_sdp import least_rho
from lockstep.lmi.search.unit_scaling import scaled
from lockstep.model.network import Network


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
