"""Where a single leader stays, which a local certificate takes for granted: `[network] leader`."""

from math import inf

from lockstep.check.bound.box import Box
from lockstep.check.errors import ProblemError, demand
from lockstep.check.system.domain import argument_box
from lockstep.model.agents.agent import Agent
from lockstep.model.problem.tables.schema import ProblemFile


def leader_box(file: ProblemFile, agent: Agent) -> Box | None:
    """Return the box of v = H x for the leader; None where nothing is said of it.

    Raises:
        ProblemError: a name without a domain, a state of [agent.domain] without an interval, or one that is not inside its
            own, away from its ends.
    """
    given, domain = file.network.leader, file.agent.domain
    if given is None:
        return None
    states = dict.fromkeys(agent.states, (-inf, inf))
    for name in (*given, *domain):
        expected = f"an interval for each state of [agent.domain]: {', '.join(domain) or 'there is none'}"
        demand(name in domain, f"`{name}` has no domain", "[network] leader", expected)
        low, high = given.get(name, (None, None))
        lowest, highest = domain.get(name, (None, None))
        a, b = (-inf if low is None else low), (inf if high is None else high)
        away = (lowest is None or a > lowest) and (highest is None or b < highest) and a <= b
        if not away or name not in given:
            raise ProblemError(
                f"[{low}, {high}]" if name in given else "it is missing",
                where=f"[network] leader, `{name}`",
                expected=f"for each state of [agent.domain] an interval inside its own, [{lowest}, {highest}]",
            )
        states[name] = (a, b)
    return argument_box(agent.lure.H, list(states.values()))
