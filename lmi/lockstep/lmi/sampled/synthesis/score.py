"""What a design ships with: rho of the sampled loop, in doubles, for gains that a search comes by. A figure, not a
proof."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from lockstep.check.continuous.inequality import Certificate, Claim
from lockstep.check.sampled.controller import PRECISIONS, HeldController, SampledNetwork
from lockstep.check.sampled.sector import common_sector
from lockstep.check.system.loop import Loop
from lockstep.lmi.analysis.certificate_sdp import split_multipliers
from lockstep.lmi.sampled.l2_gain import KEPT, least_in_scales
from lockstep.lmi.sampled.loop_gain import common_pair_weights
from lockstep.lmi.sampled.synthesis.gains_for_period import positive_weights
from lockstep.lmi.sampled.synthesis.tustin import tustin
from lockstep.lmi.sampled.witnesses import in_doubles
from lockstep.lmi.shapes import GainBlocks
from lockstep.model.network import Network as Agents
from lockstep.model.problem import Problem

RESOLUTION = 1e-3
"""Of the logarithm of rho: 0.2 %, as much as two starts may differ by for no reason."""

SCALES = (1.0, 1.1, 2.0, 10.0, 0.1, 100.0)
"""Of the pair weights, tried in this order: those of the continuous loop are its least, and may hold the sampled one
in another scale only."""


@dataclass(frozen=True)
class SampledScore:
    """rho of the sampled loop for gains in the units of the file.

    loop, claim: in these units too;  network: agents, alpha, period and delay;  heard: whom each agent listens to, and with
    which weights;  discretization: of the controllers.
    """

    loop: Loop
    claim: Claim
    network: SampledNetwork
    heard: tuple[tuple[tuple[int, ...], tuple[float, ...]], ...]
    discretization: str

    @classmethod
    def of(cls, problem: Problem, agents: Agents, claim: Claim) -> "SampledScore":
        """Return the score of a problem at its period."""
        loop, table = agents.loop(problem.order), problem.controller
        adjacency = np.asarray(agents.graph.adjacency, dtype=float)
        heard = tuple(
            (tuple(int(j) for j in np.flatnonzero(row)), tuple(float(a) for a in row[row != 0]))
            for row in adjacency
        )
        network = SampledNetwork(loop.plant, loop.d, claim.alpha, table.period, table.delay)
        return cls(loop, claim, network, heard, table.discretization)

    def __call__(self, K: GainBlocks, weights: Float[np.ndarray, " weights"]) -> float:
        """Return rho of the sampled loop, infinite where there is none.

        Args:
            K: the gains of every agent.
            weights: pair weights of a continuous certificate: m, then m_entries row by row.
        """
        with np.errstate(all="ignore"):
            try:
                found = self._least(K, weights)
            except (np.linalg.LinAlgError, ValueError, OverflowError):
                return np.inf
        return np.inf if found is None else found

    def _least(self, K: GainBlocks, weights: Float[np.ndarray, " weights"]) -> float | None:
        order, period = self.loop.order, self.network.period
        if self.discretization == "tustin":
            tables = tustin(K, order, period)
        else:
            tables = np.stack([held_table(block, order, period, self.discretization) for block in K])
        if not np.isfinite(tables).all():
            return None
        controllers = tuple(
            HeldController.row_by_row(table, order, sources, np.array(own), PRECISIONS["float64"])
            for table, (sources, own) in zip(tables, self.heard, strict=True)
        )
        m, m_entries = split_multipliers(self.loop, self.claim, weights)
        network = self.network
        if self.claim.entries:
            r, v = self.loop.plant.G.shape[1], len(self.loop.plant.H)
            sector = common_sector(self.claim.alpha, self.claim.entries, m, m_entries, r, v)
            if sector is None:
                return None
            none = np.zeros((self.loop.n_x, self.loop.n_x))
            m = common_pair_weights(
                self.claim.entries, Certificate(0.0, none, m, m_entries=m_entries), sector
            )
            network = replace(network, sector=sector)
        loop, of_rho = in_doubles(network, controllers, self.claim.outputs), self.claim.performance
        m = positive_weights(m, len(self.loop.d.pairs()))
        found = least_in_scales(loop, of_rho, m, SCALES, resolution=RESOLUTION, kept=KEPT)
        return None if found is None else found[0]


def held_table(
    K: Float[np.ndarray, "k l"], order: int, period: float, discretization: str
) -> Float[np.ndarray, "k l"]:
    """Return [A B; C D] of one agent's controller sampled by Euler's rule or a zero-order hold, in doubles.

    The equations are those of the code that ships, which computes them exactly and rounds once: here the last bits do
    not count.

    >>> held_table(np.array([[-1.0, 1.0], [1.0, 0.0]]), 1, 0.5, "euler").tolist()
    [[0.5, 0.5], [1.0, 0.0]]
    """
    from scipy.linalg import expm

    A, B, C, D = K[:order, :order], K[:order, order:], K[order:, :order], K[order:, order:]
    if discretization == "euler":
        return np.block([[np.eye(order) + A * period, B * period], [C, D]])
    whole = np.zeros((order + B.shape[1],) * 2)
    whole[:order] = period * np.hstack([A, B])
    return np.block([[expm(whole)[:order]], [C, D]])
