"""What is proved of identical controllers sampled and rounded, mode by mode: for one undirected graph, or for a spectrum."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from lockstep.check.continuous.modes import ModalCertificate
from lockstep.check.sampled import discretise
from lockstep.check.sampled.certificate import SampledVerdict
from lockstep.check.sampled.controller import HeldController, SampledNetwork
from lockstep.check.sampled.modes import (
    ModalLoop,
    SampledModalWitness,
    common_controller,
    modal_loop,
    proves_modal_rho,
)
from lockstep.check.sampled.sector import Sector
from lockstep.check.system.disagreement import single_difference
from lockstep.check.system.laplacian_spectrum import metric
from lockstep.lmi.document import Stored
from lockstep.lmi.sampled.modal.witnesses import certify_modal, certify_modal_decay, longest_modal, modal_rho
from lockstep.lmi.stored_bound import reproved_bound
from lockstep.model.assembly import network_of

TOLD = 1.001
"""Times the decay that is asked for: what is proved is told with four digits, rounded down, by up to a thousandth."""


def asked_decay(stored: Stored) -> float:
    """Return exp(-2 sigma T), the factor of V in a period at the decay sigma that is asked for; 1 where none is."""
    return math.exp(-2 * TOLD * (stored.problem.design.decay or 0.0) * stored.problem.controller.period)


@dataclass(frozen=True, eq=False)
class ModalRho:
    """A rho of the sampled loop that was proved mode by mode, and its witness."""

    rho: float
    witness: SampledModalWitness


@dataclass(frozen=True)
class ModalProofs:
    """The verdict at the problem's period, the one at the longest, rho, and the verdict by a V that decays faster."""

    verdict: SampledVerdict
    longest: SampledVerdict | None
    rho: ModalRho | None
    fastest: SampledVerdict | None


def splits(stored: Stored) -> bool:
    """Tell whether the sampled loop of a design splits into modes: identical gains, and L symmetric, its spectrum known."""
    if not isinstance(stored.proofs.certificate, ModalCertificate):
        return False
    return stored.problem.spectrum is not None or max(metric(stored.problem.graph())) == 1


def prove_modes_of(stored: Stored, sector: Sector | None) -> ModalProofs:
    """Look for what can be proved of a design's gains sampled and rounded, mode by mode; its own witnesses are tried first.

    Raises:
        BoundNotProved: alpha does not bound the nonlinearity, or an entry does not bound its slope.
        ProblemError: a gain or a weight has no value in the target type.
    """
    c, claims, proofs = stored.proofs.certificate, stored.claims.sampled, stored.proofs
    assert isinstance(c, ModalCertificate)
    weights, period = stored.problem.performance, stored.problem.controller.period
    loop_at = _loops(stored, c, sector)
    loop = loop_at(period)
    known = proofs.sampled if isinstance(proofs.sampled, SampledModalWitness) else None
    verdict = certify_modal(loop, c.ends, weights, known)
    rho = None
    if verdict.certified:
        rho = _stated(stored, loop)
        found = None if rho is not None else modal_rho(loop, c.ends, weights, c.mu or 1.0, c.rho)
        rho = rho if found is None else ModalRho(*found)
    longest = None
    if claims.max_period is not None and isinstance(proofs.max_period, SampledModalWitness):
        longest = certify_modal(loop_at(claims.max_period), c.ends, weights, proofs.max_period)
    if longest is None or not longest.certified:
        longest = longest_modal(loop_at, period, c.ends, weights)
    if verdict.certified and (longest is None or longest.period < verdict.period):
        longest = verdict
    fast, fastest = proofs.sampled_decay, None
    if verdict.certified:
        own = fast if isinstance(fast, SampledModalWitness) else None
        fastest = certify_modal_decay(loop, c.ends, weights, verdict.decay, own, asked_decay(stored))
    return ModalProofs(verdict, longest, rho, fastest)


def _stated(stored: Stored, loop: ModalLoop) -> ModalRho | None:
    rho, witness = stored.claims.sampled.rho, stored.proofs.sampled_rho
    if rho is None or not isinstance(witness, SampledModalWitness):
        return None
    return (
        ModalRho(rho, witness) if proves_modal_rho(loop, stored.problem.performance, rho, witness) else None
    )


def _loops(stored: Stored, c: ModalCertificate, sector: Sector | None) -> Callable[[float], ModalLoop]:
    """Return the modes of the sampled loop by their period, as the checker assembles them."""
    problem, claims = stored.problem, stored.claims
    network = network_of(problem, reproved_bound(stored).or_raise())
    plant, delay = network.plant.in_numbers(True), problem.controller.delay

    def loop_at(period: float) -> ModalLoop:
        at = SampledNetwork(plant, single_difference(plant.A), claims.alpha, period, delay, sector)
        held = sampled_controllers(stored, period)
        return modal_loop(at, held, network.spectrum, (c.lower, c.ends[-1]), network.graph)

    return loop_at


def sampled_controllers(stored: Stored, period: float) -> tuple[HeldController, ...]:
    """Return a design's gains sampled with a period and rounded: one for each agent, or one for all of many graphs.

    Raises:
        ProblemError: a gain has no value in the target type.
    """
    table, spectrum, gains = stored.problem.controller, stored.problem.spectrum, stored.gains
    if spectrum is None:
        edges = stored.problem.graph().edges
        return discretise.sampled_controllers(gains, edges, period, table.discretization, table.real)
    common = discretise.sampled_table(gains, 0, period, table.discretization, table.real)
    return (common_controller(common, gains.order, spectrum, table.real),)
