"""Figures of a network and its runs: data in, a matplotlib `Figure` out. Nothing is written and nothing is shown.

All of them are drawn for the width of a telephone; agents differ by colour and by dashes. matplotlib and networkx are
imported when something is drawn.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from lockstep.check.errors import demand
from lockstep.model.graphs.graph import Graph
from lockstep.report.canvas import legend, logarithmic, panels, power_of_ten, rows_of
from lockstep.report.style import LIGHT, WIDTH, line, styled

if TYPE_CHECKING:
    import networkx as nx
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

    from lockstep.model.simulation.results.trajectory import Trajectory

MOST_POINTS = 1200
"""Of a drawn line: the width of a figure has fewer pixels than that on most screens."""

MOST_NAMED = 8
"""Agents with a colour and an entry in the legend; more of them are drawn alike."""

LEGEND_COLUMNS = 4

MOST_LABELLED = 40
"""Agents with a number in the drawing of the graph."""

BEND = 0.18
"""How far two arrows between the same agents bow apart, as a part of their length."""

MOST_ARROWS = 300
"""Edges drawn as arrows; more of them are drawn as plain lines."""


@styled
def graph_figure(graph: Graph) -> "Figure":
    """Draw who hears whom: an arrow runs from the source to its listener, the way the messages go.

    Filled agents are those from which information reaches every other one. Weights that are not all 1 are written
    at their arrows.
    """
    import networkx as nx
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, 2.6))
    axes = figure.add_axes((0.02, 0.02, 0.96, 0.96))
    flow = nx.DiGraph()
    flow.add_nodes_from(range(1, graph.N + 1))
    flow.add_edges_from((source, listener) for listener, source, _ in graph.edges)
    places = {i: _on_circle(i, graph.N) for i in flow}
    labelled, roots = graph.N <= MOST_LABELLED, set(graph.roots)
    size = 520 if labelled else 18
    nx.draw_networkx_nodes(
        flow,
        places,
        ax=axes,
        node_size=size,
        node_color=[LIGHT["series-1"] if i in roots else LIGHT["paper"] for i in flow],
        edgecolors=LIGHT["series-1"],
        linewidths=1.4,
    )
    _draw_edges(flow, places, axes, size)
    if labelled:
        for i, (x, y) in places.items():
            shade = LIGHT["paper" if i in roots else "ink"]
            axes.text(x, y, str(i), ha="center", va="center_baseline", color=shade, weight="bold")
    if labelled and any(weight != 1 for *_, weight in graph.edges):
        _write_weights(graph, places, axes)
    axes.set_aspect("equal")
    axes.margins(0.18)
    axes.set_axis_off()
    return figure


@styled
def states_figure(
    trajectory: "Trajectory", states: Sequence[str] = (), units: Mapping[str, str] | None = None
) -> "Figure":
    """Draw states of all agents against time, one panel per state.

    Args:
        trajectory: the run.
        states: which of them; all by default.
        units: unit by state.
    """
    chosen = tuple(states) or trajectory.state_names
    signals = {name: trajectory.x[:, :, trajectory.state_names.index(name)] for name in chosen}
    return _stack(trajectory, signals, 1.15, units)


@styled
def effort_figure(trajectory: "Trajectory", units: Mapping[str, str] | None = None) -> "Figure":
    """Draw what each controller asks for, u_i, against time, one panel per input; held values as steps."""
    signals = {name: trajectory.u[:, :, k] for k, name in enumerate(trajectory.input_names)}
    drawstyle = "steps-post" if trajectory.u_hold == "held" else "default"
    return _stack(trajectory, signals, 1.8 if len(signals) == 1 else 1.15, units, drawstyle)


@styled
def disagreement_figure(run: "Trajectory", units: Mapping[str, str] | None = None) -> "Figure":
    """Draw (sum_i (x_ij - mean)^2)^1/2 of each state j, in its own unit, against time on a logarithmic axis."""
    distances, names = run.disagreement_by_state(), run.state_names
    figure, (axes,) = panels(1, 1.8, rows=rows_of(min(len(names), MOST_NAMED), LEGEND_COLUMNS))
    for k, name in enumerate(names):
        t, values = thinned(run.t, np.where(distances[:, k] > 0, distances[:, k], np.nan))
        axes.plot(t, values, label=_with_unit(name, units) * (k < MOST_NAMED), **line(k))
    if (distances > 0).any():
        axes.set_yscale("log")
        logarithmic(axes.yaxis)
        largest = distances.max(axis=0)
        axes.set_ylim(bottom=max(axes.get_ylim()[0], 1e-9 * largest[largest > 0].min()))
    axes.set_title("distance from agreement")
    axes.set_xlabel(_named(axes.xaxis, run.t, "t", {"t": "s"}))
    axes.margins(x=0)
    legend(figure, axes, LEGEND_COLUMNS)
    return figure


def run_figure(trajectory: "Trajectory", what: str, units: Mapping[str, str] | None = None) -> "Figure":
    """Draw one of the figures of a run: "states", "disagreement", "effort" or "phase".

    Raises:
        ProblemError: another word.
    """
    draws: dict[str, Callable[..., Figure]] = {"phase": phase_figure, "disagreement": disagreement_figure}
    draws |= {"states": states_figure, "effort": effort_figure}
    demand(what in draws, f"`{what}`", "plot", '"states", "disagreement", "effort" or "phase"')
    return draws[what](trajectory, units=units)


@styled
def phase_figure(trajectory: "Trajectory", units: Mapping[str, str] | None = None) -> "Figure":
    """Draw two states of every agent against each other, by default the first two; a dot where each begins."""
    names = (trajectory.state_names * 2)[:2]
    figure, (axes,) = panels(1, 2.6, rows=_rows(trajectory))
    first, second = (trajectory.x[:, :, trajectory.state_names.index(name)] for name in names)
    for i in range(trajectory.N):
        name = f"{trajectory.agent}{i + 1}"
        drawn = axes.plot(first[:, i], second[:, i], label=name, **line(i % MOST_NAMED))
        axes.plot(first[:1, i], second[:1, i], "o", color=drawn[0].get_color(), markersize=4)
    axes.set_xlabel(_with_unit(names[0], units))
    axes.set_title(f"{_with_unit(names[1], units)} against {names[0]}")
    if trajectory.N <= MOST_NAMED:
        legend(figure, axes, LEGEND_COLUMNS)
    return figure


def thinned(t: Float[np.ndarray, " K"], values: Float[np.ndarray, " K"]) -> tuple[np.ndarray, np.ndarray]:
    """Return a line with few points that looks the same: the least and the largest value of each stretch of time.

    >>> t, values = thinned(np.arange(10_000.0), np.where(np.arange(10_000) == 4_321, 9.0, 0.0))
    >>> len(t) <= 1_200, bool(values.max() == 9)
    (True, True)
    """
    if len(t) <= MOST_POINTS:
        return t, values
    chosen = [0]
    for stretch in np.array_split(np.arange(len(t)), MOST_POINTS // 2 - 1):
        known = stretch[~np.isnan(values[stretch])]
        if len(known):
            chosen += [int(known[values[known].argmin()]), int(known[values[known].argmax()])]
    chosen = sorted({*chosen, len(t) - 1})
    return t[chosen], values[chosen]


def _stack(
    run: "Trajectory",
    signals: Mapping[str, Float[np.ndarray, "K N"]],
    height: float,
    units: Mapping[str, str] | None,
    drawstyle: str = "default",
) -> "Figure":
    """Draw signals of all agents against time, one panel for each by its name."""
    figure, stack = panels(len(signals), height, rows=_rows(run))
    named = run.N <= MOST_NAMED
    for axes, (name, signal) in zip(stack, signals.items(), strict=True):
        for i in range(run.N):
            look = line(i) if named else {"color": LIGHT["series-1"], "linewidth": 0.6, "alpha": 0.6}
            t, values = thinned(run.t, signal[:, i])
            axes.plot(t, values, label=f"{run.agent}{i + 1}" * named, drawstyle=drawstyle, **look)
        axes.margins(x=0)
        axes.set_title(_named(axes.yaxis, signal, name, units))
    stack[-1].set_xlabel(_named(stack[-1].xaxis, run.t, "t", {"t": "s"}))
    if named:
        legend(figure, stack[0], LEGEND_COLUMNS)
    return figure


def _rows(trajectory: "Trajectory") -> int:
    return rows_of(trajectory.N, LEGEND_COLUMNS) if trajectory.N <= MOST_NAMED else 0


def _named(axis: "Axis", values: Float[np.ndarray, "..."], name: str, units: Mapping[str, str] | None) -> str:
    """Return what an axis is, with a power of a thousand where ticks would be too wide for their room."""
    from matplotlib.ticker import FuncFormatter

    most, unit = float(np.abs(values).max()), (units or {}).get(name, "")
    if np.ptp(values) > 0.01 * most and not 0.01 <= most < 1e4:
        scale = 1000.0 ** math.floor(math.log10(most) / 3)
        axis.set_major_formatter(FuncFormatter(lambda at, _: f"{at / scale:.4g}".replace("-", "−")))
        unit = f"{power_of_ten(scale)} {unit}"
    return _with_unit(name, {name: unit.strip()})


def _with_unit(name: str, units: Mapping[str, str] | None) -> str:
    unit = (units or {}).get(name)
    return f"{name} in {unit}".replace("^2", "²").replace("^3", "³") if unit else name


def _on_circle(i: int, N: int) -> tuple[float, float]:
    """Agent 1 at the top, then clockwise."""
    angle = np.pi / 2 - 2 * np.pi * (i - 1) / N
    return float(np.cos(angle)), float(np.sin(angle))


def _draw_edges(
    flow: "nx.DiGraph", places: Mapping[int, tuple[float, float]], axes: "Axes", size: int
) -> None:
    import networkx as nx

    look = {"ax": axes, "edge_color": LIGHT["ink"], "node_size": size}
    if flow.number_of_edges() > MOST_ARROWS:
        nx.draw_networkx_edges(flow, places, arrows=False, width=0.3, alpha=0.5, **look)
        return
    for mutual, bend in ((False, 0.0), (True, BEND)):
        chosen = [(a, b) for a, b in flow.edges if flow.has_edge(b, a) is mutual]
        nx.draw_networkx_edges(
            flow,
            places,
            edgelist=chosen,
            arrows=True,
            arrowstyle="-|>",
            arrowsize=13,
            width=1.2,
            connectionstyle=f"arc3,rad={bend}",
            **look,
        )


def _write_weights(graph: Graph, places: Mapping[int, tuple[float, float]], axes: "Axes") -> None:
    hears = {(listener, source) for listener, source, _ in graph.edges}
    for listener, source, weight in graph.edges:
        start, end = np.array(places[source]), np.array(places[listener])
        bend = BEND if (source, listener) in hears else 0.0
        across = np.array([end[1] - start[1], start[0] - end[0]])
        control = (start + end) / 2 + bend * across
        x, y = 0.4**2 * end + 2 * 0.4 * 0.6 * control + 0.6**2 * start
        box = {"facecolor": LIGHT["paper"], "edgecolor": "none", "pad": 0.8}
        axes.text(x, y, f"{weight:.3g}", ha="center", va="center", fontsize=8, bbox=box)
