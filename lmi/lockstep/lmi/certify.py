"""The independent checker: from a design file to a verdict, by symbolic algebra and exact arithmetic alone.

It imports no solver and believes nothing but the problem: the agent's matrices are derived again from its
equations, alpha is proved again in interval arithmetic, the inequality is built again over the rationals, and
an exact decision is made (`lockstep.check.certificate`). What a reader has to trust is `lockstep.check`, this file,
`asked`, `stored_bound`, `scope`, and the model layer under them.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lockstep.check.certificate import decide_certificate, decide_floor
from lockstep.check.errors import BoundNotProved
from lockstep.check.inequality import Claim
from lockstep.check.local import InitialSet, Unavailable
from lockstep.lmi.asked import shortfalls
from lockstep.lmi.document import Stored
from lockstep.lmi.scope import Scope, initial_states, scope_of
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
    decided = decide_certificate(network.matrices, stored.gains, claim, c)
    margin = decided.figures.get("margin", float("nan"))
    if not decided.proved:
        return Verdict(False, decided.reason, None, margin, decided.figures)
    short = list(shortfalls(stored))
    if short:
        return Verdict(False, f"the file claims less than its problem asks for: {'; '.join(short)}")
    floor = stored.floor and decide_floor(network.matrices, claim, stored.floor)
    if floor and not floor.proved:
        return Verdict(False, floor.reason)
    scope = scope_of(agent, bound)
    initial = initial_states(network, c) if scope == "local" else None
    return Verdict(True, decided.reason, scope, margin, initial=initial)
