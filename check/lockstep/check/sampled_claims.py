"""The sampled loop of a design file: of all agents, or mode by mode, with its controllers as they are computed."""

from typing import Any

import numpy as np

from lockstep.check.continuous.inequality import Certificate
from lockstep.check.continuous.modes import ModalCertificate
from lockstep.check.design_file.content import DesignFile
from lockstep.check.design_file.problem import ProblemTables
from lockstep.check.sampled.certificate import SampledVerdict, decide_sampled
from lockstep.check.sampled.controller import HeldController, SampledNetwork
from lockstep.check.sampled.discretise import sampled_controllers, sampled_table
from lockstep.check.sampled.inequality import Witness
from lockstep.check.sampled.modes import (
    ModalLoop,
    SampledModalWitness,
    common_controller,
    decide_modal_sampled,
    modal_loop,
)
from lockstep.check.sampled.sector import Sector, common_sector
from lockstep.check.system.disagreement import Disagreement, single_difference
from lockstep.check.system.loop import Plant
from lockstep.check.system.network import ExactNetwork

CheckedFile = DesignFile[ProblemTables]


def decide_held(
    stored: CheckedFile,
    network: ExactNetwork,
    held: tuple[HeldController, ...],
    witness: Witness | SampledModalWitness | None,
    period: float | None = None,
) -> SampledVerdict:
    """Decide the sampled loop of all agents, or, by a modal witness and of many graphs always, mode by mode."""
    period = stored.problem.period if period is None else period
    if isinstance(witness, SampledModalWitness) or network.spectrum is not None:
        mine = witness if isinstance(witness, SampledModalWitness) else None
        return decide_modal_sampled(modal_loop_of(stored, network, held, period), mine)
    at = sampled_network(stored, network, period)
    return decide_sampled(at, held, () if witness is None else (witness,))


def modal_loop_of(
    stored: CheckedFile, network: ExactNetwork, held: tuple[HeldController, ...], period: float
) -> ModalLoop:
    """Return the modes of the sampled loop, of all graphs with the spectrum, or of the one whose modes are certified.

    Raises:
        ProblemError: agents or a graph that do not split into modes once the weights are rounded.
    """
    c, plant = stored.proofs.certificate, network.plant.in_numbers(True)
    at = _sampled(stored, plant, single_difference(plant.A), period)
    ends = None if not isinstance(c, ModalCertificate) else (c.lower, c.ends[-1])
    return modal_loop(at, held, network.spectrum, ends, network.graph)


def held_controllers(stored: CheckedFile, period: float) -> tuple[HeldController, ...]:
    """Return the design's gains sampled with a period and rounded."""
    table, spectrum, gains = stored.problem.controller, stored.problem.spectrum, stored.gains
    if spectrum is not None:
        common = sampled_table(gains, 0, period, table["discretization"], table["real"])
        return (common_controller(common, gains.order, spectrum, table["real"]),)
    edges = stored.problem.graph.edges
    return sampled_controllers(gains, edges, period, table["discretization"], table["real"])


def sampled_network(stored: CheckedFile, network: ExactNetwork, period: float) -> SampledNetwork:
    """Return the agents and the coordinates of the assembled loop, in rationals."""
    loop = network.loop(stored.gains.order, exact_arithmetic=True)
    return _sampled(stored, loop.plant, loop.d, period)


def _sampled(stored: CheckedFile, plant: Plant, d: Disagreement, period: float) -> SampledNetwork:
    return SampledNetwork(plant, d, stored.claims.alpha, period, stored.problem.delay, sector(stored, plant))


def sector(stored: DesignFile[Any], plant: Any) -> Sector | None:
    """Return the sector that takes the place of alpha where the continuous certificate uses entries; plant has G and H."""
    c, claims = stored.proofs.certificate, stored.claims
    if not claims.entries or c is None:
        return None
    asked, sizes = (claims.alpha, claims.entries), (plant.G.shape[1], plant.H.shape[0])
    if isinstance(c, Certificate):
        return common_sector(*asked, c.m, c.m_entries, *sizes)
    return common_sector(*asked, np.array([c.mu]), np.array(c.mu_entries)[:, None], *sizes)
