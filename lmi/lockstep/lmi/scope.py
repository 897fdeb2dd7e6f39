"""Where a certificate holds: for every state, or only while all agents stay in the box their bound was proved on."""

from lockstep.check.domain import Scope
from lockstep.model.agent import Agent
from lockstep.model.bound_search import Bound
from lockstep.model.checks.nonlinearity import holds_everywhere

__all__ = ["Scope", "scope_of"]


def scope_of(agent: Agent, bound: Bound) -> Scope:
    """Return "global" where the bound is proved for every state, else "local"."""
    return "global" if holds_everywhere(agent, bound) else "local"
