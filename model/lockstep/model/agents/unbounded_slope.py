"""The refusal of a nonlinearity without a bound, in the names of the problem file."""

import re

import numpy as np

from lockstep.check.errors import ProblemError
from lockstep.model.agents.agent import Agent
from lockstep.model.agents.arguments import argument_texts
from lockstep.model.bound_search import Bound


def no_bound(bound: Bound, agent: Agent) -> ProblemError:
    """Return the refusal of a phi whose slope has no finite bound on its domain."""
    state = agent.states[int(np.flatnonzero(agent.lure.H.any(axis=0))[0])]
    far = "infinity" in bound.reason
    return ProblemError(
        f"the nonlinearity has no finite bound on its domain: {_in_names(bound.reason, agent)}",
        where=_equation(agent),
        expected="a nonlinearity whose slope is bounded, such as sin or tanh, or a domain where it is",
        remedy=f"give a box in [agent.domain], such as {state} = [-1.0, 1.0]"
        f"{f' (in {agent.units[state]})' if state in agent.units else ''}: the certificate is then local"
        if far
        else "leave that point out with a box in [agent.domain] (the certificate is then local), or write a term "
        "whose slope stays finite there",
    )


def _equation(agent: Agent) -> str:
    """Name the one equation that phi enters, where there is one."""
    rows = np.flatnonzero(agent.lure.G.any(axis=1))
    return f"[agent.dynamics] {agent.states[rows[0]]}" if len(rows) == 1 else "[agent.dynamics]"


def _in_names(reason: str, agent: Agent) -> str:
    """Put the states in place of v1, v2, ..., and in brackets where an argument is a sum."""
    texts = argument_texts(agent)

    def named(match: re.Match[str]) -> str:
        k = int(match.group(1)) - 1
        if k >= len(texts):
            return match.group(0)
        return texts[k] if texts[k] in agent.states else f"({texts[k]})"

    return re.sub(r"\bv(\d+)\b", named, reason)
