"""Where a certificate holds: for every state, or only while all agents stay in the box their bound was proved on."""

from lockstep.check.bound.box import Box
from lockstep.check.domain import Scope, inner_box
from lockstep.check.inequality import Certificate
from lockstep.check.local import Domain, InitialSet, Unavailable, initial_set
from lockstep.check.modes import ModalCertificate
from lockstep.model.agent import Agent
from lockstep.model.arguments import arguments_text
from lockstep.model.bound_search import Bound
from lockstep.model.checks.nonlinearity import holds_everywhere
from lockstep.model.network import Network

__all__ = ["Scope", "scope_of"]

HALF = 0.5
"""The part of the box left to the leader where nothing else is asked for."""


def scope_of(agent: Agent, bound: Bound) -> Scope:
    """Return "global" where the bound is proved for every state, else "local"."""
    return "global" if holds_everywhere(agent, bound) else "local"


def domain_of(agent: Agent, *, fraction: float = HALF, inner: Box | None = None) -> Domain:
    """Return the box of v = H x over the agent's domain, and the leader's in it.

    Args:
        agent: whose domain it is.
        fraction: the part of the box, around its middle, that the leader is to stay in (`model.domain.inner_box`).
        inner: the leader's box itself, in place of a fraction.

    Raises:
        ProblemError: a fraction outside of [0, 1).
    """
    box = agent.argument_box
    inner = inner_box(box, fraction) if inner is None else inner
    return Domain(agent.lure.H, box, inner, arguments_text(agent))


def initial_states(
    network: Network,
    certificate: Certificate | ModalCertificate,
    *,
    fraction: float = HALF,
    inner: Box | None = None,
) -> InitialSet | Unavailable:
    """Return the set of `lockstep.check.local` for a network; see `domain_of` for the other arguments."""
    return initial_set(
        network.matrices, certificate, domain_of(network.agent, fraction=fraction, inner=inner)
    )
