"""The agent, its variants and the graph that a problem file describes."""

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from lockstep.check.errors import ProblemError, demand
from lockstep.check.system.graph_family import SpectrumRange
from lockstep.check.wording import nearest, shorten
from lockstep.model.agents.agent import Agent
from lockstep.model.agents.variants import check_same_but_B
from lockstep.model.graphs.graph import Graph
from lockstep.model.problem.tables.schema import AgentTable, NetworkTable, ProblemFile


def build_agent(table: AgentTable, parameters: Mapping[str, float] | None = None) -> Agent:
    """Build the agent of [agent], with some of its parameters changed."""
    domain = {
        state: (-np.inf if low is None else low, np.inf if high is None else high)
        for state, (low, high) in table.domain.items()
    }
    return Agent.from_expressions(
        table.name,
        states=table.states,
        inputs=table.inputs,
        dynamics=table.dynamics,
        outputs=_without_repeats(table.outputs),
        parameters={**table.parameters, **(parameters or {})},
        domain=domain,
        units={name: unit for name, unit in table.units.items() if name not in table.parameters},
        split=table.split,
        centre=table.centre,
    )


def build_variants(common: Agent, file: ProblemFile, agents: int) -> tuple[Agent, ...]:
    """Build one agent per node: the common one, or one with the node's own parameters.

    Raises:
        ProblemError: not one table per node, an unknown parameter, or one that changes more than B.
    """
    given = file.network.parameters
    if given is None:
        return (common,) * agents
    expected = "one table per agent, {} for one without changes"
    demand(len(given) == agents, f"{len(given)} tables for {agents} agents", "[network] parameters", expected)
    return tuple(_variant(common, file.agent, k, parameters) for k, parameters in enumerate(given, start=1))


def _variant(common: Agent, table: AgentTable, k: int, parameters: Mapping[str, float]) -> Agent:
    where = f"[network] parameters, entry {k}"
    expected = shorten(", ".join(table.parameters), 120) or "names from [agent] parameters"
    for name in parameters:
        if name not in table.parameters:
            found, remedy = f"`{shorten(name)}` is no parameter of the agent", nearest(name, table.parameters)
            raise ProblemError(found, where=where, expected=expected, remedy=remedy)
    if not parameters:
        return common
    try:
        variant = build_agent(table, parameters)
    except ProblemError as error:
        raise error.within(where) from None
    check_same_but_B(common.exact, variant.exact, where=where)
    return variant


def build_graph(table: NetworkTable) -> Graph:
    """Build the graph of [network] from its edges, its Laplacian or the name of its topology.

    Raises:
        ProblemError: none of them or more than one, or a number of agents that is missing or does not fit.
    """
    given = [key for key in ("edges", "laplacian", "topology") if getattr(table, key) is not None]
    if table.spectrum is not None:
        return Graph(SpectrumRange.of(table.model_dump(exclude_none=True)).pair.adjacency)
    if table.file is not None and not given:
        found = f"the graph is in `{shorten(table.file)}`, which was not read"
        expected = "a problem that is loaded from its file, which the name of the graph's file is relative to"
        raise ProblemError(found, where="[network] file", expected=expected)
    if len(given) != 1:
        found = f"{' and '.join(f'`{key}`' for key in given)} are given" if given else "there is no graph"
        expected = "exactly one of `edges`, `laplacian`, `topology` and `file`, or `spectrum`"
        raise ProblemError(found, where="[network]", expected=expected)
    if table.laplacian is not None:
        return _from_laplacian(table.laplacian, table.agents)
    if table.agents is None:
        expected = "a whole number of agents, 2 or more"
        raise ProblemError("the key `agents` is missing", where="[network]", expected=expected)
    if table.topology is not None:
        return Graph.topology(table.topology, table.agents)
    return _from_edges(table.agents, table.edges or ())


def _from_edges(agents: int, edges: Sequence[Sequence[float]]) -> Graph:
    graph = Graph.from_edges(agents, edges)
    with np.errstate(over="ignore"):
        finite = np.isfinite(graph.adjacency.sum(axis=1))
    found = f"the weights that agent {int(np.argmin(finite)) + 1} listens with add up to inf"
    expected = "weights whose sum is a double: it stands on the diagonal of (1)"
    demand(finite.all(), found, "[network] edges", expected)
    return graph


def _from_laplacian(rows: tuple[tuple[float, ...], ...], agents: int | None) -> Graph:
    where = "[network] laplacian"
    if not rows or {len(row) for row in rows} != {len(rows)}:
        lengths = ", ".join(str(len(row)) for row in rows[:8]) or "no"
        raise ProblemError(f"{len(rows)} rows of {lengths} numbers", where=where, expected="a square matrix")
    found = f"`agents` is {agents}, but the laplacian has {len(rows)} rows"
    demand(agents in (None, len(rows)), found, "[network] agents", f"{len(rows)}, or no `agents`")
    return Graph.from_laplacian(np.array(rows, dtype=float))


def _without_repeats(pairs: tuple[tuple[str, str], ...]) -> dict[str, str]:
    counts = Counter(name for name, _ in pairs)
    for name, count in counts.items():
        demand(count == 1, f"`{shorten(name)}` is there twice", "[agent.outputs]", "names that differ")
    return dict(pairs)
