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
from lockstep.check.errors import BoundNotProved
from lockstep.check.floor.witness import proves_floor
from lockstep.check.inequality import Claim
from lockstep.check.local import InitialSet, Unavailable, initial_set
from lockstep.check.modes import ModalCertificate, decide_modes
from lockstep.check.psd import Definiteness
from lockstep.lmi.asked import shortfalls
from lockstep.lmi.document import Stored
from lockstep.lmi.scope import Scope, scope_of
from lockstep.lmi.stored_bound import bound_again
from lockstep.model.assembly import network_of


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
    problem, c = stored.problem, stored.certificate
    if c is None:
        return Verdict(False, "the file holds gains without a certificate")
    if c.rho <= 0 or stored.alpha < 0:
        said = f"the file claims rho = {c.rho:g} and alpha = {stored.alpha:g}"
        return Verdict(False, f"{said}: rho must be positive and alpha not negative")
    problem.validate()
    agent = problem.agent()
    try:
        bound = bound_again(stored)
    except BoundNotProved as error:
        return Verdict(False, str(error), figures=error.figures)
    network = network_of(problem, bound)
    delta = np.tile([stored.fragility[letter] for letter in "ABCD"], (network.N, 1))
    weights = problem.state_weight(agent.n), problem.controller_weight(problem.order)
    claim = Claim(stored.alpha, *weights, delta, stored.entries)
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
    if stored.floor is not None and not proves_floor(network, claim.alpha_of_floor, claim.R, stored.floor):
        said = f"the file claims that no controllers certify a rho below {stored.floor.rho:.10g}"
        return Verdict(False, f"{said}, but its floor_witness does not prove it")
    reason = f"P > 0 and F < 0, decided exactly ({answer.method})"
    scope = scope_of(agent, bound)
    initial = initial_set(network, c) if scope == "local" else None
    return Verdict(True, reason, scope, answer.margin, initial=initial)


def _refused(answer: Definiteness) -> Verdict:
    if not answer.decided:
        return Verdict(False, answer.method, None, answer.margin)
    found = f"z' M z = {answer.value:.6g} <= 0 for a vector z of length 1 ({answer.method})"
    vector = None if answer.vector is None else [float(entry) for entry in answer.vector]
    figures = {"margin": answer.margin, "value": answer.value, "vector": vector}
    return Verdict(False, f"the inequality does not hold: {found}", None, answer.margin, figures)
