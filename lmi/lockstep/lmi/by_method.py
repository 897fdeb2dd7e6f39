"""Each method's gains, proved: from a problem as it is posed to a proposal.

certified            found by the certificate itself (`methods.certified`)
given                read from the file
as_printed           recovered as the paper prints it: theorem1, corollary1 (`methods.paper`)
protocol             method "lipschitz" (`methods.lipschitz`)
modal                the same for all agents, mode by mode (`methods.modal`)
"""

import contextlib
from typing import Any

import numpy as np

from lockstep.check.continuous.inequality import Claim
from lockstep.check.errors import Infeasible, NotCertified, demand
from lockstep.check.floor.witness import FloorWitness
from lockstep.check.system.loop import Gains
from lockstep.lmi.analysis.certificate_sdp import eliminates_P
from lockstep.lmi.analysis.margins import largest_fraction
from lockstep.lmi.analysis.rounding import prove, short_gains
from lockstep.lmi.diagnosis.open_loop import rho_alone
from lockstep.lmi.guarantees import abscissa, decay_alone
from lockstep.lmi.proposal import Posed, Proposal, given_gains
from lockstep.lmi.search.stopping import NothingYet
from lockstep.lmi.specification.attempts import Attempt, Progress
from lockstep.lmi.specification.defaults import MUCH, VERY_FAR
from lockstep.model.checks.lost_modes import slowest_lost_mode
from lockstep.model.control.static_response import softest
from lockstep.model.network import Network
from lockstep.model.problem import Problem


def certified(posed: Posed, attempt: Attempt) -> Proposal:
    """Search for gains by the certificate itself."""
    problem, network, _, claim = posed
    from lockstep.lmi.methods.certified import CertifiedGains, search_and_prove
    from lockstep.lmi.sampled.synthesis.score import SampledScore

    jobs, tell, time_limit, stop, explain = attempt
    score = SampledScore.of(problem, network, claim)

    def found_from(*, anew: bool) -> tuple[CertifiedGains, FloorWitness | None]:
        effort = jobs, tell, time_limit, score, stop
        found = search_and_prove(problem, network, claim, *effort, explain=explain and not anew, anew=anew)
        rho = found.certificate.rho
        return found, stop.optional(lambda: _floor(problem, network, found.claim, rho, tell), otherwise=None)

    found, floor = found_from(anew=False)
    far = floor is not None and found.certificate.rho > VERY_FAR * floor.rho and not claim.delta.any()
    may = explain and time_limit is None and not stop.asked
    if far and may and not eliminates_P(network.loop(problem.order)):
        with contextlib.suppress(Infeasible, NotCertified, NothingYet):
            again = found_from(anew=True)
            if again[0].certificate.rho < MUCH * found.certificate.rho:
                found, floor = again[0], again[1] or floor
    alone = stop.optional(lambda: rho_alone(network, found.claim), otherwise=None)
    figures = found.figures | _figures(problem, network, found.gains) | {"rho_alone": alone}
    if alone is not None and not eliminates_P(network.loop(0)):
        fast = stop.optional(lambda: decay_alone(network, found.claim), otherwise=None)
        lost = slowest_lost_mode(network, found.claim.alpha, found.claim.entries)
        figures |= {"decay_alone": fast, "lost_mode": lost.said if lost and lost.holds_back(fast) else None}
    own = posed._replace(claim=found.claim)
    gains, proved = found.gains, found.certificate
    return Proposal(*own, gains, proved, figures, floor, found.others, sampled=found.sampled)


def given(posed: Posed, tell: Progress) -> Proposal:
    """Prove the gains of the file."""
    problem, network, _, claim = posed
    gains = given_gains(problem)
    tell("looking for a certificate of the given gains", 0.0)
    try:
        certificate = prove(network, gains, claim, rho=problem.design.rho)
    except NotCertified as error:
        if problem.design.rho is not None:
            raise
        tell("looking for how much of alpha the gains carry", 0.0)
        raise _not_carried(network, gains, claim, error) from None
    return Proposal(*posed, gains, certificate, _figures(problem, network, gains))


def _not_carried(network: Network, gains: Gains, claim: Claim, error: NotCertified) -> NotCertified:
    """Return what given gains do instead: their linear loop is unstable, or they carry a part of alpha only."""
    abscissa = error.figures.get("abscissa", -np.inf)  # where a proof failed, and not the loop, there is none
    if abscissa >= 0:
        n_C, why = gains.order, "with r = sum a_ij (y_i - y_j) negative feedback is u = -r"
        for i in np.flatnonzero(network.graph.in_degrees == 0) if n_C else ():
            if np.linalg.eigvals(gains.blocks[i, :n_C, :n_C]).real.max() >= 0:
                why = f"agent {i + 1} hears nobody, and its own controller is unstable by itself"
        said = f"the linear loop of the given gains is unstable, Re s = {abscissa:.3g}: {why}"
        return NotCertified(f"{error}: {said}", **error.figures)
    part = largest_fraction(network.loop(gains.order), gains.blocks, claim, 0.0)
    alpha = part * claim.alpha
    said = f"one is computed for slopes up to {alpha:.6g}, {part:.3g} of it: try others, or a smaller [agent.domain]"
    return NotCertified(f"{error}; {said}", **error.figures, fraction=part, reachable_alpha=alpha)


def as_printed(posed: Posed, tell: Progress) -> Proposal:
    """Recover gains as the paper prints it, and prove them if they can be."""
    problem, network, _, claim = posed
    from lockstep.lmi.methods.paper import solve_as_printed

    tell(f"solving {'(34)' if problem.design.method == 'corollary1' else '(19)'} as printed", 0.0)
    delta = None if problem.design.method == "corollary1" else claim.delta[0]
    audit = solve_as_printed(network, problem.order, claim.R, claim.Q, delta)
    figures = _figures(problem, network, audit.gains) | {
        "audit": {
            "objective": audit.objective,
            "rho": audit.rho,
            "alpha": list(audit.alpha),
            "residual": audit.residual,
            "abscissa": audit.abscissa,
        }
    }
    try:
        certificate = prove(network, audit.gains, claim)
    except NotCertified as error:
        raise NotCertified(
            f"as printed, the recovered loop is not certified: (22) misses k_i by {audit.residual:.3g} of its"
            f" size, and the recovered loop has the abscissa {audit.abscissa:.3g}; {error}",
            residual=audit.residual,
            abscissa=audit.abscissa,
            design=Proposal(*posed, audit.gains, None, figures),
        ) from None
    return Proposal(*posed, audit.gains, certificate, figures)


def protocol(posed: Posed, tell: Progress) -> Proposal:
    """Take the static protocol of method "lipschitz"."""
    problem, network, _, claim = posed
    from lockstep.lmi.methods.lipschitz import design_protocol, protocol_gains

    expected = 'order = 0: the protocol of method "lipschitz" is static'
    demand(not problem.order, f"`order` is {problem.order}", "[design]", expected)
    tell("solving step 1 of the protocol", 0.0)
    found = design_protocol(network, claim, problem.gain_limit)
    gains = protocol_gains(network, found)
    gains = Gains.from_blocks(short_gains(gains.blocks, problem.gain_limit), 0)
    certificate = prove(network, gains, claim)
    figures = _figures(problem, network, gains) | {
        "protocol": {
            "tau": found.first.tau,
            "K": found.first.K.tolist(),
            "c": found.c,
            "connectivity": found.connectivity,
            "decay": found.decay,
        }
    }
    floor = _floor(problem, network, claim, certificate.rho, tell)
    return Proposal(*posed, gains, certificate, figures, floor)


def modal(posed: Posed, tell: Progress) -> Proposal:
    """Search for gains that are the same for all agents, mode by mode."""
    problem, network, _, claim = posed
    from lockstep.lmi.methods.certified import rate_of_controllers
    from lockstep.lmi.methods.modal import covered_graphs, design_modes, prove_modes

    table = problem.design
    decaying = network.decaying(max(table.decay or 0.0, table.search_decay or 0.0))
    gains = design_modes(
        decaying,
        claim,
        problem.order,
        problem.gain_limit,
        starts=table.starts,
        seed=table.seed,
        rate=rate_of_controllers(problem),
        tell=lambda part: tell("searching for gains", part),
    )
    tell("proving the certificate", 0.0)
    certificate = prove_modes(network, gains, claim)
    figures = {
        "abscissa": abscissa(network, gains, modal=True),
        "gain_norms": problem.gain_norms(gains.blocks),
        "modal": {
            "spectrum": [certificate.lower, certificate.ends[-1]],
            "segments": len(certificate.segments),
            "covers": covered_graphs(network, certificate),
        },
    }
    # A floor is one of a network with so many agents: of many graphs there is none.
    floor = None if network.spectrum is not None else _floor(problem, network, claim, certificate.rho, tell)
    return Proposal(*posed, gains, certificate, figures, floor)


def _figures(problem: Problem, network: Network, gains: Gains) -> dict[str, Any]:
    agent, scales = problem.agent(), problem.performance.states
    disturbed = scales > 0 if len(scales) else np.ones(agent.n, dtype=bool)
    soft = softest(network.loop(gains.order), gains, agent.outputs, agent.states, disturbed)
    norms = problem.gain_norms(gains.blocks)
    return {"abscissa": abscissa(network, gains, modal=False), "gain_norms": norms, "static_response": soft}


def _floor(
    problem: Problem, network: Network, claim: Claim, rho: float, tell: Progress
) -> FloorWitness | None:
    """Return the largest floor that is proved, in any coordinates and for any method; None where none is."""
    from lockstep.lmi.floor.bisection import largest_floor
    from lockstep.model.assembly import exact_network

    tell("proving a lower bound of rho", 0.0)
    return largest_floor(exact_network(problem, network), claim, certified=rho)
