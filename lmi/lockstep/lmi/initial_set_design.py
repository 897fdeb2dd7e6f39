"""The largest initial set that is proved of given gains, and gains with a larger one: objective "initial_set"."""

import numpy as np

from lockstep.check.bound.box import Box
from lockstep.check.continuous.inequality import Certificate, Claim
from lockstep.check.continuous.modes import ModalCertificate
from lockstep.check.errors import NotCertified
from lockstep.check.system.loop import Gains
from lockstep.lmi.analysis.certificate_sdp import least_rho
from lockstep.lmi.analysis.rounding import shortest_that_proves
from lockstep.lmi.initial_set import InitialStates, Unavailable
from lockstep.lmi.scope import domain_of, initial_states
from lockstep.lmi.search.initial_set import SetPoint, SetProgram
from lockstep.lmi.search.random_start import Score
from lockstep.lmi.search.stopping import NEVER, Deadline
from lockstep.lmi.shapes import GainBlocks
from lockstep.model.network import Network
from lockstep.model.problem import Problem

LARGEST_LOOP = 60
"""States of a loop up to which a P of its own is looked for: beyond, the program takes minutes."""

RHO_OF_SET = 10.0
"""Where no rho is given, how many times the least one found it may become for a larger initial set."""

KEPT_OF_RHO = 0.98
"""The part of the largest rho that gains keep to before they are rounded."""


def largest_initial_states(
    network: Network,
    gains: Gains,
    claim: Claim,
    certificate: Certificate | ModalCertificate,
    inner: Box | None = None,
) -> tuple[InitialStates | Unavailable, Certificate | None]:
    """Return the largest set that is proved of given gains, and the certificate of its own that proves it, if one does.

    inner: the leader's box; None for the middle half of the domain.
    """
    if network.spectrum is not None:
        return Unavailable("[network] spectrum names graphs without a leader: no agent moves by itself"), None
    if not claim.performance.covers_xi:
        low = ", ".join(np.array(network.agent.states)[claim.performance.states < 1])
        no_gain = "so that rho is no gain from all of xi: name one for each state, the least of them 1"
        said = f"[design.disturbances] has no scale of 1 or more for {low}, {no_gain}"
        return Unavailable(said), None
    plain = initial_states(network, certificate, inner=inner)
    if isinstance(plain, Unavailable) or isinstance(certificate, ModalCertificate):
        return plain, None
    program = SetProgram.of(network, gains.order, claim, domain_of(network.agent), plain.inner)
    if program.loop.n_x > LARGEST_LOOP:
        return plain, None
    candidate = program.certificate(program.largest(program.at(gains.blocks, certificate)))
    if candidate is None:
        return plain, None
    exact = network.loop(gains.order, exact_arithmetic=True)
    own = shortest_that_proves(program.loop, exact, gains.blocks, claim, candidate)
    found = plain if own is None else initial_states(network, own, inner=inner)
    if isinstance(found, Unavailable) or found.radius <= plain.radius:
        return plain, None
    return found, own


def with_larger_set(
    problem: Problem,
    network: Network,
    gains: Gains,
    claim: Claim,
    certificate: Certificate,
    *,
    rate: float | None = None,
    score: Score | None = None,
    deadline: Deadline = NEVER,
) -> GainBlocks:
    """Return gains with a larger initial set, or those given.

    Args:
        problem: with its gain limit, and the largest rho allowed: `RHO_OF_SET` times that of the certificate if none is.
        network, gains, claim, certificate: where to begin.
        rate: that each controller is to forget with by itself, in 1/s, or None.
        score: of the sampled loop: gains without a finite one are passed over.
        deadline: when to end.

    Raises:
        NotCertified: there is no initial set, and why.
    """
    plain = initial_states(network, certificate, inner=problem.leader)
    if isinstance(plain, Unavailable):
        raise NotCertified(f"[design] objective asks for an initial set, but {plain.text()}")
    rho, limit = problem.design.rho or RHO_OF_SET * certificate.rho, problem.gain_limit
    rate = None if rate is None else rate / 2  # rounding has taken some of it
    domain = domain_of(network.agent)
    program = SetProgram.of(network, gains.order, claim, domain, plain.inner, gain_limit=limit, rate=rate)

    def allowed(point: SetPoint) -> bool:
        near = program.certificate(point)
        c = None if near is None else least_rho(program.loop, point.K, claim, near)
        if c is None or c.rho > KEPT_OF_RHO * rho:
            return False
        return score is None or bool(np.isfinite(score(point.K, c.pair_weights)))

    return program.enlarged(program.at(gains.blocks, certificate), allowed, deadline).K
