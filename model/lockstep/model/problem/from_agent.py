"""The tables [agent] and [network] of an agent and a graph that were built in Python."""

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np
from jaxtyping import Float

from lockstep.check.errors import demand
from lockstep.check.expression.node import ZERO, variable
from lockstep.check.expression.text import RESERVED
from lockstep.check.expression.traversal import substitute
from lockstep.model.agents.agent import Agent
from lockstep.model.formulas.expression_text import expression_text
from lockstep.model.graphs.graph import Graph
from lockstep.model.real_numbers import reals

Entries = Mapping[tuple[int, int], str]
"""The entries (row, column) of B that are not the same for all agents, and the parameter that stands for each."""


def tables_of(agent: Agent, graph: Graph, B: Sequence[Float[np.ndarray, "n m"]] = ()) -> dict[str, Any]:
    """Return the tables [agent] and [network], as plain lists, texts and numbers.

    Args:
        agent: its expressions are written as formulas (`expression_text`).
        graph: written as its edges.
        B: the input matrix of each agent, where they differ; each entry that does becomes a parameter, B_2_1 for
            row 2, column 1, with the agent's own value where [network] parameters give no other.

    Raises:
        ProblemError: what the language of problem files cannot say, with the equation it is in; a B of the wrong
            shape; an equation whose inputs cannot be taken out without rounding.

    >>> x, u = ca.SX.sym("x"), ca.SX.sym("u")
    >>> tables_of(Agent(name="tank", x=x, u=u, rhs=u - x**3, y=x), Graph.topology("path", 2))["agent"]["dynamics"]
    {'x': 'u - x**3'}
    """
    matrices = _matrices(agent, graph, B)
    entries = _entries(agent, matrices)
    table = {
        "name": agent.name,
        "states": list(agent.states),
        "inputs": list(agent.inputs),
        "parameters": {name: float(agent.lure.B[i, j]) for (i, j), name in entries.items()},
        "dynamics": _dynamics(agent, entries),
        "outputs": _outputs(agent),
        "domain": {state: [float(low), float(high)] for state, (low, high) in agent.domain.items()},
        "units": dict(agent.units),
        "split": agent.split,
        "centre": agent.centre,
    }
    return {"agent": table, "network": _network(agent, graph, matrices, entries)}


def plain(value: Any) -> Any:
    """Return arrays and numbers of NumPy, tuples and other mappings as a TOML parser would give them."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return {key: plain(inner) for key, inner in value.items()}
    return [plain(inner) for inner in value] if isinstance(value, list | tuple) else value


def _network(
    agent: Agent, graph: Graph, matrices: Sequence[Float[np.ndarray, "n m"]], entries: Entries
) -> dict[str, Any]:
    edges = [[i, j] if weight == 1 else [i, j, weight] for i, j, weight in graph.edges]
    table: dict[str, Any] = {"agents": graph.N, "edges": edges}
    if entries:
        own = agent.lure.B
        table["parameters"] = [
            {name: float(B[place]) for place, name in entries.items() if B[place] != own[place]}
            for B in matrices
        ]
    return table


def _matrices(
    agent: Agent, graph: Graph, B: Sequence[Float[np.ndarray, "n m"]]
) -> list[Float[np.ndarray, "n m"]]:
    matrices = [reals(b, "B", f"agent {k}") for k, b in enumerate(B, start=1)] or [agent.lure.B] * graph.N
    expected = "one B per agent"
    demand(len(matrices) == graph.N, f"{len(matrices)} input matrices for {graph.N} agents", "B", expected)
    for k, b in enumerate(matrices, start=1):
        found = f"`B` is {' x '.join(map(str, b.shape))}"
        demand(b.shape == agent.lure.B.shape, found, f"agent {k}", " x ".join(map(str, agent.lure.B.shape)))
    return matrices


def _entries(agent: Agent, matrices: Sequence[Float[np.ndarray, "n m"]]) -> dict[tuple[int, int], str]:
    taken = {*RESERVED, *agent.states, *agent.inputs}
    names = {}
    for i, j in np.argwhere(np.any([b != agent.lure.B for b in matrices], axis=0)).tolist():
        name = f"B_{i + 1}_{j + 1}"
        while name in taken:
            name += "_"
        names[i, j] = name
    return names


def _symbols(agent: Agent) -> dict[str, ca.SX]:
    columns = [*ca.vertsplit(agent.x), *ca.vertsplit(agent.u), agent.t]
    return dict(zip((*agent.states, *agent.inputs, "t"), columns, strict=True))


def _outputs(agent: Agent) -> list[list[str]]:
    """The pairs (name, formula); their order is the order of y."""
    symbols = _symbols(agent)
    return [
        [name, expression_text(formula, symbols, where=f"[agent.outputs] {name}")]
        for name, formula in zip(agent.outputs, ca.vertsplit(agent.y), strict=True)
    ]


def _dynamics(agent: Agent, entries: Entries) -> dict[str, str]:
    parameters = {place: ca.SX.sym(name) for place, name in entries.items()}
    symbols = {**_symbols(agent), **{name: parameters[place] for place, name in entries.items()}}
    formulas = {}
    for i, state in enumerate(agent.states):
        varied = any(row == i for row, _ in entries)
        rhs = _with_parameters(agent, i, parameters) if varied else agent.rhs[i]
        formulas[state] = expression_text(rhs, symbols, where=f"[agent.dynamics] {state}")
    return formulas


def _with_parameters(agent: Agent, i: int, parameters: Mapping[tuple[int, int], ca.SX]) -> ca.SX:
    """Return row i of the dynamics as f(x, 0, t) + sum over j of B_ij u_j, with a parameter where B_ij varies."""
    value = _without_inputs(agent, i)
    for j, u in enumerate(ca.vertsplit(agent.u)):
        value = value + parameters.get((i, j), float(agent.lure.B[i, j])) * u
    return value


def _without_inputs(agent: Agent, i: int) -> ca.SX:
    """Return f_i(x, 0, t), where CasADi does not round what is left: 0.1*(0.3*x + u) becomes (0.1*0.3)*x."""
    rest = ca.substitute([agent.rhs[i]], [agent.u], [ca.SX.zeros(agent.m)])[0]
    where = f"[agent.dynamics] {agent.states[i]}"
    inputs = {variable(agent.n + j): ZERO for j in range(agent.m)}
    exactly = substitute([agent.value(agent.rhs[i], where=where).node], inputs)
    found = "the inputs are among constants that would be rounded without them"
    expected = "for agents with a B of their own, an equation f(x, t) + b*u"
    demand(substitute([agent.value(rest, where=where).node], inputs) == exactly, found, where, expected)
    return rest
