"""A problem as it is designed for, and what a method proposes: gains, with what is claimed and proved of them."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from lockstep.check.continuous.inequality import Certificate, Claim
from lockstep.check.continuous.modes import ModalCertificate
from lockstep.check.floor.witness import FloorWitness
from lockstep.check.system.domain import Scope
from lockstep.check.system.loop import Gains
from lockstep.lmi.guarantees import Guarantees
from lockstep.lmi.initial_set import InitialStates, Unavailable
from lockstep.lmi.initial_set_design import largest_initial_states
from lockstep.lmi.processes.threads import one_thread
from lockstep.lmi.sampled.synthesis.gains_for_period import StartingGains
from lockstep.lmi.scope import scope_of
from lockstep.model.assembly import bound_of, claimed_slopes, network_of
from lockstep.model.bound_search import Bound
from lockstep.model.network import Network
from lockstep.model.problem import Problem


class Posed(NamedTuple):
    """A problem, its agents on their graph, the proved bound of their nonlinearity, and what is to be certified."""

    problem: Problem
    network: Network
    bound: Bound
    claim: Claim

    @classmethod
    def of(cls, problem: Problem, bound: Bound) -> "Posed":
        """Return a problem with what follows from it and from the bound."""
        return cls(problem, network_of(problem, bound), bound, claim_of(problem, bound))


@dataclass(frozen=True)
class Proposal:
    """Gains, what is claimed of the loop with them, and the certificate, if one was proved.

    figures: what else is known: abscissa, gain norms, the history of the search, the audit of a
    theorem;  floor: a rho below which no controllers can certify, with its proof, where it was looked for and found;
    others: other gains that the search came to, from which a design for the period may start;  guarantees: the decay, and
    whether controllers are stable by themselves;  sampled: the larger of rho and that of the sampled loop in doubles, where
    the search knows it: infinite if the period spoils it.
    """

    problem: Problem
    network: Network
    bound: Bound
    claim: Claim
    gains: Gains
    certificate: Certificate | ModalCertificate | None
    figures: dict[str, Any] = field(default_factory=dict)
    floor: FloorWitness | None = None
    others: tuple[StartingGains, ...] = ()
    guarantees: Guarantees = field(default_factory=Guarantees)
    sampled: float | None = None

    @property
    def certified(self) -> bool:
        """Whether a certificate was proved exactly."""
        return self.certificate is not None

    @cached_property
    def scope(self) -> Scope | None:
        """Where the certificate holds: "global", or "local" where its bound was proved on [agent.domain] only."""
        return scope_of(self.network.agent, self.bound) if self.certified else None

    @property
    def initial(self) -> InitialStates | Unavailable | None:
        """Where the certificate is local: states from which the agents stay in their domain, or why none can be given."""
        return self.initial_and_proof[0]

    @cached_property
    def initial_and_proof(self) -> tuple[InitialStates | Unavailable | None, Certificate | None]:
        """These, and the certificate of their own that proves them, where that of rho does not."""
        if self.certificate is None or self.scope != "local":
            return None, None
        with one_thread():
            given = self.network, self.gains, self.claim, self.certificate
            return largest_initial_states(*given, self.problem.leader)


def proved_bound(problem: Problem) -> Bound:
    """Prove the smallest bound, or the `alpha` the problem gives.

    Raises:
        BoundNotProved: the given alpha is refuted, with a witness, or undecided.
    """
    return bound_of(problem.agent(), alpha=problem.design.alpha).or_raise()


def claim_of(problem: Problem, bound: Bound) -> Claim:
    """Return what is to be certified: alpha and slopes (`claimed_slopes`), R, Q and delta of the problem."""
    alpha, entries = claimed_slopes(problem, bound)
    fragility = problem.fragility
    delta = np.tile([fragility[letter] for letter in "ABCD"], (problem.graph().N, 1))
    return Claim(float(alpha), delta=delta, entries=entries, **problem.performance._asdict())


def given_gains(problem: Problem) -> Gains:
    """Return the gains of method "given"."""
    given = problem.gains or ()
    return Gains(*(tuple(np.array(getattr(one, letter), dtype=float) for one in given) for letter in "ABCD"))
