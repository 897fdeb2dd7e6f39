"""The figures of a report: drawn, described in words with their numbers, and written in three formats."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup

from lockstep.lmi.analysis.decimals import above
from lockstep.lmi.trade_off.pareto import ParetoPoint
from lockstep.model.graphs.graph import Graph
from lockstep.model.simulation import Trajectory
from lockstep.report import figures
from lockstep.report.export import as_files, inline_svg
from lockstep.report.poles import Spectrum, poles_figure, singular_values_figure
from lockstep.report.report_data import Facts
from lockstep.report.trade_off import described, trade_off_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PANELS = 6
"""States in one figure; an agent with more of them has several."""

MOST_EDGES_TOLD = 12
"""Edges named one by one in the words for those who cannot see the graph."""


@dataclass(frozen=True)
class Drawing:
    """name: of its files;  caption: under it;  description: in its place;  svg: for the page;  files: by extension."""

    name: str
    caption: str
    description: str
    svg: Markup
    files: dict[str, bytes]


@dataclass(frozen=True)
class Drawings:
    """The figures by the section they are shown in."""

    graph: Drawing
    run: tuple[Drawing, ...]
    spectrum: tuple[Drawing, ...]
    trade_off: tuple[Drawing, ...] = ()

    def __iter__(self) -> Iterator[Drawing]:
        """In the order of the page."""
        yield from (self.graph, *self.run, *self.spectrum, *self.trade_off)

    @property
    def files(self) -> dict[str, bytes]:
        """Relative path -> content of PNG and PDF of every figure."""
        return {f"figures/{one.name}.{kind}": content for one in self for kind, content in one.files.items()}


def draw(facts: Facts, spectrum: Spectrum) -> Drawings:
    """Draw everything that there is something to draw of."""
    agent = facts.problem.agent()
    return Drawings(
        _graph(facts.problem.graph()),
        () if facts.trajectory is None else tuple(_run(facts.trajectory, agent.shown_units)),
        tuple(_spectrum(spectrum, agent.name, facts.stored.claims.rho or np.inf)),
        tuple(_trade_off(facts.trade_off)),
    )


def _drawing(name: str, figure: "Figure", caption: str, description: str) -> Drawing:
    svg = inline_svg(figure, name, description)
    return Drawing(name, caption, description, svg, as_files(figure, name))


def _graph(graph: Graph) -> Drawing:
    told = [
        f"agent {i} hears agent {j}" + (f" with weight {weight:.3g}" if weight != 1 else "")
        for i, j, weight in graph.edges
    ]
    more = len(told) - MOST_EDGES_TOLD
    listed = "; ".join(told[:MOST_EDGES_TOLD]) + (f"; and {more} more" if more > 0 else "")
    drawn = "Arrows run the way messages go: listener ← source."
    if len(graph.edges) > figures.MOST_ARROWS:
        drawn = "With this many edges, their direction is left out."
    return _drawing(
        "graph",
        figures.graph_figure(graph),
        f"{drawn} Filled: agents from which information reaches every other one.",
        f"Graph of {graph.N} agents: {listed}.",
    )


def _run(run: Trajectory, units: dict[str, str]) -> Iterator[Drawing]:
    names = run.state_names
    for first in range(0, len(names), PANELS):
        chosen = names[first : first + PANELS]
        columns = slice(first, first + len(chosen))
        yield _drawing(
            "states" if len(names) <= PANELS else f"states-{first // PANELS + 1}",
            figures.states_figure(run, chosen, units),
            "States of all agents.",
            f"Against time: {', '.join(chosen)} of {run.N} agents over {run.t[-1]:.4g} s."
            f" At the start they lie up to {_spread(run.less_offsets[0, :, columns]):.3g} apart, at the end up to"
            f" {_spread(run.less_offsets[-1, :, columns]):.3g}.",
        )
    each = zip(names, run.disagreement_by_state().T, strict=True)
    yield _drawing(
        "disagreement",
        figures.disagreement_figure(run, units),
        "Distance from agreement, (Σ (x_i − mean)²)^½ of each state in its own unit, on a logarithmic axis.",
        f"The distance from agreement, at the start, at most, and after {run.t[-1]:.4g} s: "
        + "; ".join(f"{name} {d[0]:.3g}, {d.max():.3g}, {d[-1]:.3g}" for name, d in each),
    )
    yield _drawing(
        "effort",
        figures.effort_figure(run, units),
        "What the controllers ask for, held between the samples.",
        f"Against time: {', '.join(run.input_names)} of {run.N} agents; the largest magnitude is"
        f" {np.abs(run.u).max():.3g}, that at the end {np.abs(run.u[-1]).max():.3g}.",
    )


def _spectrum(spectrum: Spectrum, agent: str, rho: float | None) -> Iterator[Drawing]:
    unstable = sum(bool((poles.real >= 0).any()) for poles in spectrum.controllers if len(poles))
    said = "Poles of each controller by itself; the loop has too many states for its own to be drawn here."
    rightmost = ""
    if spectrum.abscissa is not None:
        said = "Poles of the loop and of each controller by itself; the shaded half of the plane is unstable."
        rightmost = f", the rightmost with the real part {spectrum.abscissa:.4g} per second"
    yield _drawing(
        "poles",
        poles_figure(spectrum, agent),
        said,
        f"{len(spectrum.loop)} poles of the loop{rightmost};"
        f" controllers that are unstable by themselves: {unstable} of {len(spectrum.controllers)}.",
    )
    if spectrum.peak is not None:
        peak, at = spectrum.peak
        line = f", below the certified rho of {above(rho, 4)}" if rho is not None and peak < rho else ""
        yield _drawing(
            "singular-values",
            singular_values_figure(spectrum, rho),
            "Singular values of the loop's linear part, from w, the disturbances and noise in their scales,"
            " to z, what rho weighs (states, controller states, inputs); rho holds for the nonlinear loop.",
            f"The largest singular value peaks at {peak:.4g}, at {at:.3g} rad/s{line}.",
        )


def _trade_off(points: tuple[ParetoPoint, ...]) -> Iterator[Drawing]:
    if points:
        yield _drawing(
            "trade-off",
            trade_off_figure(points),
            "Gains around the design, each with proved figures: what a smaller ρ costs. A line joins the points that no"
            " other beats in both figures.",
            described(points),
        )


def _spread(values: np.ndarray) -> float:
    return float(np.ptp(values, axis=0).max())
