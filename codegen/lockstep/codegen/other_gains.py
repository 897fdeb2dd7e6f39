"""A design file with other gains: what can be made of it, and what is proved and said of them anew."""

from dataclasses import replace
from typing import Any

import numpy as np

from lockstep.check.continuous.inequality import Certificate, Claim
from lockstep.check.continuous.initial_set import InitialSet
from lockstep.check.design_file.claims import SampledClaims
from lockstep.check.design_file.proofs import Proofs
from lockstep.check.errors import ClaimError, Infeasible
from lockstep.check.system.loop import Gains, build_loop
from lockstep.codegen.sampled_design import sampled_network
from lockstep.lmi.document import Stored
from lockstep.lmi.guarantees import guarantees
from lockstep.lmi.sampled.witnesses import plant_in_doubles
from lockstep.model.network import Network

MOST_STATES = 80
"""Of the sampled loop: a step of the descent grows with the third power of their number, its unknowns with it too."""


def obstacle(stored: Stored) -> str | None:
    """Say why a design cannot be made for its period, or None."""
    problem = stored.problem
    if problem.design.method != "certified":
        remedy = "take another period, smaller gains, or less decay"
        return f'the gains of method "{problem.design.method}" are not designed for a period: {remedy}'
    if problem.design.objective == "initial_set":
        return 'objective is "initial_set", which a descent on rho would spend'
    if not isinstance(stored.proofs.certificate, Certificate):
        return "there is no continuous certificate to start from"
    if any(problem.fragility.values()):
        return "[design.fragility] is about continuous gains"
    if problem.controller.discretization != "tustin":
        return f'discretization is "{problem.controller.discretization}", not "tustin"'
    states = problem.agent().n * (stored.gains.N - 1) + stored.gains.order * stored.gains.N
    return f"the loop has {states} states, more than {MOST_STATES}" if states > MOST_STATES else None


def with_gains(stored: Stored, gains: Gains) -> Stored:
    """Return a design file with other gains, their continuous certificate and guarantees proved, nothing else claimed."""
    from lockstep.lmi.analysis.rounding import prove

    problem, (network, claim) = stored.problem, _posed(stored)
    try:
        c = prove(network, gains, claim, rho=problem.design.rho)
        also = guarantees(problem, network, gains, claim, modal=False)
    except ClaimError as error:
        raise Infeasible(f"gains were found, but not certified in continuous time: {error}") from None
    decay, witness = also.decay or (None, None)
    again: dict[str, Any] = {"controllers_stable": also.stable, "sampled": SampledClaims(), "messages": None}
    claims = replace(stored.claims, rho=c.rho, decay=decay, **again)
    proofs = Proofs(c, witness, stored.proofs.floor, bound=stored.proofs.bound)
    return replace(stored, gains=gains, claims=claims, proofs=proofs)


def with_figures(made: Stored, stored: Stored) -> Stored:
    """Return a design with the figures of its gains, those of what they replace, and the states from which it holds."""
    before = stored.claims.sampled
    loop = build_loop(*plant_in_doubles(sampled_network(made)), made.gains.order)
    figures = {
        **stored.info["figures"],
        "abscissa": float(np.linalg.eigvals(loop.A_cl(made.gains.blocks)).real.max()),
        "gain_norms": made.problem.gain_norms(made.gains.blocks),
        "replaced": {
            "rho": stored.claims.rho,
            "sampled_rho": before.rho,
            "sampled_max_period": before.max_period,
        },
    }
    return _placed(replace(made, info={**stored.info, "figures": figures}))


def _placed(made: Stored) -> Stored:
    """Return a design file with the initial states that its own certificate proves; those of another say nothing."""
    from lockstep.lmi.initial_set_design import largest_initial_states

    certificate = made.proofs.certificate
    if made.claims.scope != "local" or certificate is None:
        return replace(made, claims=replace(made.claims, initial_set=None))
    network, claim = _posed(made)
    initial, own = largest_initial_states(network, made.gains, claim, certificate, made.problem.leader)
    proved = initial if isinstance(initial, InitialSet) else None
    proofs = replace(made.proofs, initial_set=own)
    remarks = {**made.info, "initial_set": initial.remarks()}
    return replace(made, claims=replace(made.claims, initial_set=proved), proofs=proofs, info=remarks)


def _posed(stored: Stored) -> tuple[Network, Claim]:
    """Return the network of a design and what is claimed of it, its bound proved anew."""
    from lockstep.lmi.proposal import claim_of
    from lockstep.lmi.stored_bound import reproved_bound
    from lockstep.model.assembly import network_of

    bound = reproved_bound(stored).or_raise()
    claim = replace(claim_of(stored.problem, bound), alpha=stored.claims.alpha)
    return network_of(stored.problem, bound), claim
