"""The symbolic model: agents, graphs, problem files. Names are imported when they are first used."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lockstep.check.errors import (
        BoundNotProved,
        ClaimError,
        Infeasible,
        NotCertified,
        ProblemError,
    )
    from lockstep.check.system.loop import Gains
    from lockstep.model.agents.agent import Agent
    from lockstep.model.assembly import bound_of, network_of
    from lockstep.model.checks import CheckReport, check_problem
    from lockstep.model.graphs.graph import Graph
    from lockstep.model.loop_transformation.lure import Lure
    from lockstep.model.network import Network
    from lockstep.model.problem import Problem, load_problem, parse_problem

__all__ = [
    "Agent",
    "BoundNotProved",
    "CheckReport",
    "ClaimError",
    "Gains",
    "Graph",
    "Infeasible",
    "Lure",
    "Network",
    "NotCertified",
    "Problem",
    "ProblemError",
    "bound_of",
    "check_problem",
    "load_problem",
    "network_of",
    "parse_problem",
]

_HOMES = {
    "Agent": "lockstep.model.agents.agent",
    "CheckReport": "lockstep.model.checks",
    "Gains": "lockstep.check.system.loop",
    "Graph": "lockstep.model.graphs.graph",
    "Lure": "lockstep.model.loop_transformation.lure",
    "Network": "lockstep.model.network",
    "Problem": "lockstep.model.problem",
    "bound_of": "lockstep.model.assembly",
    "check_problem": "lockstep.model.checks",
    "load_problem": "lockstep.model.problem",
    "network_of": "lockstep.model.assembly",
    "parse_problem": "lockstep.model.problem",
}


def __getattr__(name: str) -> Any:
    """Import CasADi only for those who use it (PEP 562): `lockstep --help` answers at once."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES.get(name, "lockstep.check.errors")), name)
