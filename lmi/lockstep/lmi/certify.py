"""The independent checker: from a design file to a verdict, by symbolic algebra and exact arithmetic alone.

It imports no solver and believes nothing but the problem: the agent's matrices are derived again from its
equations, alpha is proved again in interval arithmetic, the inequality is built again over the rationals, and
an exact decision is made. What a reader has to trust is this file, `asked`, `stored_bound`, `scope`, `decide`,
`inequality`, `definite`; `local` where the certificate is local; `modes` and `symmetric` for method `modal`;
`floor.projected` and `floor.witness` for a floor of rho; and the model layer under them.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lockstep.check.decide import decide
from lockstep.check.design_file.claims import SampledClaims
from lockstep.check.errors import BoundNotProved
from lockstep.check.floor.witness import proves_floor
from lockstep.check.inequality import Certificate, Claim
from lockstep.check.local import InitialSet, Unavailable, better_than_proved, initial_set
from lockstep.check.modes import ModalCertificate, decide_modes
from lockstep.check.psd import Definiteness
from lockstep.lmi.asked import shortfalls
from lockstep.lmi.document import Stored
from lockstep.lmi.scope import Scope, scope_of
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
    initial: InitialSet | Unavailable | None = None


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
    if isinstance(c, ModalCertificate):
        answer = decide_modes(network, stored.gains, claim, c)
    else:
        loop = network.loop(problem.order, exact_arithmetic=True)
        answer = decide(loop, stored.gains.blocks, claim, c)
    if not answer.positive:
        return _refused(answer)
    short = list(shortfalls(stored))
    if short:
        return Verdict(False, f"the file claims less than its problem asks for: {'; '.join(short)}")
    scope = scope_of(agent, bound)
    initial = initial_set(network, c) if scope == "local" else None
    for broken in (_floor(stored, network, claim), _place(stored, network, c, scope)):
        if broken:
            return Verdict(False, broken)
    reason = f"P > 0 and F < 0, decided exactly ({answer.method})"
    return Verdict(True, reason, scope, answer.margin, initial=initial)


def _floor(stored: Stored, network: Network, claim: Claim) -> str | None:
    """Say that the floor is claimed and not proved; None if it is, or none is claimed."""
    witness = stored.proofs.floor
    if witness is None or proves_floor(network, claim.alpha_of_floor, claim.R, witness):
        return None
    said = f"the file claims that no controllers certify a rho below {witness.rho:.10g}"
    return f"{said}, but its witness does not prove it"


def _place(
    stored: Stored, network: Network, certificate: Certificate | ModalCertificate, scope: Scope
) -> str | None:
    """Say whether the certificate is claimed for more states than it is proved for; None if it is not."""
    claimed = stored.claims.initial_set
    if stored.claims.scope == "global" and scope == "local":
        return f"the file says that the certificate is global, but {scope} is proved"
    if claimed is None:
        return None
    found = better_than_proved(network, certificate, claimed)
    return f"the file claims other initial states than are proved: {found}" if found else None


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


def _refused(answer: Definiteness) -> Verdict:
    found = f"z' M z = {answer.value:.6g} <= 0 for a vector z of length 1 ({answer.method})"
    vector = None if answer.vector is None else [float(entry) for entry in answer.vector]
    figures = {"margin": answer.margin, "value": answer.value, "vector": vector}
    return Verdict(False, f"the inequality does not hold: {found}", None, answer.margin, figures)
