"""Where a certificate holds: for every state, or only while all agents stay in the box their bound was proved on."""

from math import isfinite

from lockstep.check.bound.box import Box
from lockstep.check.continuous.inequality import Certificate
from lockstep.check.continuous.initial_set import Domain
from lockstep.check.continuous.modes import ModalCertificate
from lockstep.check.errors import demand
from lockstep.check.system.domain import Scope
from lockstep.lmi.initial_set import InitialStates, Unavailable, initial_set
from lockstep.model.agents.agent import Agent
from lockstep.model.bound_search import Bound
from lockstep.model.checks.nonlinearity import holds_everywhere
from lockstep.model.network import Network

HALF = 0.5
"""The part of the box left to the leader where nothing else is asked for."""


def scope_of(agent: Agent, bound: Bound) -> Scope:
    """Return "global" where the bound is proved for every state, else "local"."""
    return "global" if holds_everywhere(agent, bound) else "local"


def domain_of(agent: Agent) -> Domain:
    """Return the box of v = H x over the agent's domain."""
    return Domain(agent.lure.H, agent.argument_box)


def inner_box(box: Box, fraction: float) -> Box:
    """Return the box with `fraction` of its size around its middle: what is left to a leader.

    `lockstep.check.continuous.initial_set` says why.

    A side without an opposite one moves towards 0 as if its opposite were -side, and by 1 - fraction if it is 0.

    Raises:
        ProblemError: a fraction outside of [0, 1), which would leave no room between the boxes.

    >>> inner_box(Box((-4.0, -2.0), (8.0, float("inf"))), 0.5)
    Box(lower=(-1.0, -1.0), upper=(5.0, inf))
    """
    found = f"{fraction}"
    demand(0 <= fraction < 1, found, "the part of the domain left to the leader", "from 0 up to, but not, 1")
    sides = [_inner_side(low, high, fraction) for low, high in zip(box.lower, box.upper, strict=True)]
    return Box(tuple(low for low, _ in sides), tuple(high for _, high in sides))


def _inner_side(low: float, high: float, fraction: float) -> tuple[float, float]:
    if isfinite(low) and isfinite(high):
        middle, half = low / 2 + high / 2, high / 2 - low / 2
        return middle - fraction * half, middle + fraction * half
    return (
        low + (1 - fraction) * (abs(low) or 1.0) if isfinite(low) else low,
        high - (1 - fraction) * (abs(high) or 1.0) if isfinite(high) else high,
    )


def initial_states(
    network: Network,
    certificate: Certificate | ModalCertificate,
    *,
    fraction: float = HALF,
    inner: Box | None = None,
) -> InitialStates | Unavailable:
    """Return the largest set of `lockstep.check.continuous.initial_set` for a network.

    Args:
        network: the agents and the graph.
        certificate: decided for the bound that was proved on their domain.
        fraction: the part of the box, around its middle, that the leader is to stay in (`inner_box`).
        inner: the leader's box itself, in place of a fraction.

    Raises:
        ProblemError: a fraction outside of [0, 1).
    """
    domain = domain_of(network.agent)
    inner = inner_box(domain.box, fraction) if inner is None else inner
    return initial_set(network.matrices, certificate, domain, inner, network.agent)
