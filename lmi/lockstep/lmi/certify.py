"""The independent checker: from a design file to a verdict, by symbolic algebra and exact arithmetic alone.

It imports no solver and believes nothing but the problem: the agent's matrices are derived again from its
equations, alpha is proved again in interval arithmetic, the inequality is built again over the rationals, and
an exact decision is made (`lockstep.check.certificate`). What a reader has to trust is `lockstep.check`, this file,
`stored_bound`, `scope`, and the model layer under them.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lockstep.check.asked import shortfalls
from lockstep.check.certificate import decide_certificate, decide_floor, decide_initial_set
from lockstep.check.design_file.claims import SampledClaims
from lockstep.check.errors import BoundNotProved
from lockstep.check.inequality import Certificate, Claim
from lockstep.check.modes import ModalCertificate
from lockstep.lmi.document import Stored
from lockstep.lmi.initial import InitialStates, Unavailable
from lockstep.lmi.scope import Scope, domain_of, initial_states, scope_of
from lockstep.lmi.stored_bound import bound_again
from lockstep.model.assembly import network_of
from lockstep.model.network import Network


@dataclass(frozen=True)
class Verdict:
    """Whether a design is certified, and if not, which claim fails and by how much.

    scope: "global", or "local" where the bound holds on the agent's domain only, and with it all that is proved;
    initial: where it is local, states from which the agents stay in their domain, or why none can be given;
    margin: the smallest eigenvalue of -F scaled to a unit diagonal, in doubles, for information.
    """

    certified: bool
    reason: str
    scope: Scope | None = None
    margin: float = float("nan")
    figures: Mapping[str, Any] = field(default_factory=dict)
    initial: InitialStates | Unavailable | None = None


def certify(stored: Stored) -> Verdict:
    """Decide whether the stored gains have the properties the file claims, from the file's problem alone.

    Raises:
        ProblemError: the problem in the file cannot be posed: no spanning tree, no finite bound, ...
    """
    problem, c, claims = stored.problem, stored.proofs.certificate, stored.claims
    if c is None:
        return Verdict(False, "the file holds gains without a certificate")
    if not claims.certified:
        return Verdict(False, "the file does not claim that its gains are certified")
    problem.validate()
    agent = problem.agent()
    try:
        bound = bound_again(stored)
    except BoundNotProved as error:
        return Verdict(False, str(error), figures=error.figures)
    network = network_of(problem, bound)
    delta = np.tile([claims.fragility[letter] for letter in "ABCD"], (network.N, 1))
    weights = problem.state_weight(agent.n), problem.controller_weight(problem.order)
    claim = Claim(claims.alpha, *weights, delta, claims.entries)
    decided = decide_certificate(network.matrices, stored.gains, claim, c)
    margin = decided.figures.get("margin", float("nan"))
    if not decided.proved:
        return Verdict(False, decided.reason, None, margin, decided.figures)
    short = list(shortfalls(problem.document()["design"], claims, stored.gains))
    if short:
        return Verdict(False, f"the file claims less than its problem asks for: {'; '.join(short)}")
    scope = scope_of(agent, bound)
    initial = initial_states(network, c) if scope == "local" else None
    for broken in (_floor(stored, network, claim), _place(stored, network, c, scope)):
        if broken:
            return Verdict(False, broken)
    return Verdict(True, decided.reason, scope, margin, initial=initial)


def _floor(stored: Stored, network: Network, claim: Claim) -> str | None:
    """Say that the floor is claimed and not proved; None if it is, or none is claimed."""
    witness = stored.proofs.floor
    decided = None if witness is None else decide_floor(network.matrices, claim, witness)
    return None if decided is None or decided.proved else decided.reason


def _place(
    stored: Stored, network: Network, certificate: Certificate | ModalCertificate, scope: Scope
) -> str | None:
    """Say whether the certificate is claimed for more states than it is proved for; None if it is not."""
    claimed = stored.claims.initial_set
    if stored.claims.scope == "global" and scope == "local":
        return f"the file says that the certificate is global, but {scope} is proved"
    if claimed is None:
        return None
    decided = decide_initial_set(network.matrices, certificate, domain_of(network.agent), claimed)
    return None if decided.proved else decided.reason


def broken_claim(stored: Stored, proved: SampledClaims, reason: str) -> str | None:
    """Say which claim of a design file about its sampled controllers is better than what is proved; None if none is.

    Args:
        stored: the design file.
        proved: what was proved of its controllers, sampled and rounded;  reason: why not, where they are not certified.
    """
    claimed = stored.claims.sampled
    if claimed.certified and not proved.certified:
        return reason
    return next(claimed.better_than(proved), None)
