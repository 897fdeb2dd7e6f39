"""The symbolic model: agents, graphs, problem files. Names are imported when they are first used."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lockstep.model.agent import Agent
    from lockstep.model.errors import (
        BoundNotProved,
        ClaimError,
        Infeasible,
        Mismatch,
        NotCertified,
        ProblemError,
    )
    from lockstep.model.graph import Graph
    from lockstep.model.lure import Lure
    from lockstep.model.problem import Problem, load_problem, parse_problem

__all__ = [
    "Agent",
    "BoundNotProved",
    "ClaimError",
    "Graph",
    "Infeasible",
    "Lure",
    "Mismatch",
    "NotCertified",
    "Problem",
    "ProblemError",
    "load_problem",
    "parse_problem",
]

_HOMES = {
    "Agent": "agent",
    "Graph": "graph",
    "Lure": "lure",
    "Problem": "problem",
    "load_problem": "problem",
    "parse_problem": "problem",
}


def __getattr__(name: str) -> Any:
    """Import CasADi only for those who use it (PEP 562): `lockstep --help` answers at once."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES.get(name, 'errors')}"), name)
