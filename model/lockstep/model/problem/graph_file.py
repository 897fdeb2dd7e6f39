"""[network] file: a graph read from beside the problem, as edges where it is small, as its spectrum where it is large."""

from pathlib import Path
from typing import Any

from lockstep.check.errors import ProblemError
from lockstep.check.system.graph_family import SpectrumRange
from lockstep.model.graphs.membership import Membership, membership, within_interval
from lockstep.model.graphs.sparse_graph import SparseGraph, read_graph
from lockstep.model.problem.tables.schema import NetworkTable, ProblemFile

MOST_WRITTEN = 200
"""Agents of a graph that is written into design files edge by edge, and decided exactly; larger ones go by their spectrum."""


def with_graph(file: ProblemFile, folder: Path) -> tuple[ProblemFile, Membership | None]:
    """Return a problem with its graph read, and how a large one is known to have its spectrum; unchanged without a file.

    Raises:
        ProblemError: a graph that cannot be read, does not fit the problem, or is not shown to have the spectrum asked for.
    """
    table = file.network
    if table.file is None:
        return file, None
    given = [key for key in ("edges", "laplacian", "topology") if getattr(table, key) is not None]
    if given:
        raise ProblemError(f"`file` and `{given[0]}` are given", where="[network]", expected="one graph")
    network, found = network_of_graph(
        read_graph(folder / table.file), table, method=file.design.method, seed=file.design.seed
    )
    return file.model_copy(update={"network": network}), found


def network_of_graph(
    graph: SparseGraph, table: NetworkTable, *, method: str, seed: int
) -> tuple[NetworkTable, Membership | None]:
    """Return [network] with a graph in it, as its edges or as its spectrum."""
    if table.agents not in (None, graph.agents):
        found, expected = f"`agents` is {table.agents}", f"{graph.agents}, or no `agents`"
        raise ProblemError(found, where=f"[network] agents, {graph.where}", expected=expected)
    kept: dict[str, Any] = table.model_dump(exclude_none=True)
    if graph.agents <= MOST_WRITTEN and table.spectrum is None:
        kept.pop("file", None)
        edges = [[i, j] if a == 1 else [i, j, a] for i, j, a in graph.edges]
        return NetworkTable.model_validate({**kept, "agents": graph.agents, "edges": edges}), None
    if method != "modal":
        raise ProblemError(
            f'`method` is "{method}" for {graph.agents} agents',
            where=graph.where,
            expected=f'[design] method = "modal", or at most {MOST_WRITTEN} agents',
        )
    found_there = membership(graph, seed=seed, below=None if table.spectrum is None else table.spectrum[0])
    if table.spectrum is not None:
        found_there = within_interval(found_there, *table.spectrum)
    kept |= {"agents": graph.agents, "spectrum": [found_there.lower, found_there.upper]}
    most = SpectrumRange.of(kept).neighbours
    if graph.most_neighbours > most:
        if table.max_degree is not None:
            raise ProblemError(
                f"an agent of {graph.where} has {graph.most_neighbours} neighbours",
                where="[network] max_degree",
                expected=f"{graph.most_neighbours} at least",
            )
        kept["max_degree"] = graph.most_neighbours
    elif table.spectrum is None:
        kept["max_degree"] = graph.most_neighbours if table.max_degree is None else table.max_degree
    return NetworkTable.model_validate(kept), found_there
