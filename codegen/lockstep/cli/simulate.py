"""`lockstep simulate`: the nonlinear closed loop in time, against what is proved of it."""

import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Group, RenderableType
from rich.text import Text

from lockstep.cli.console import Answer, errors, progress_display, table, two_columns, wrote
from lockstep.workflow.runs.simulate_options import Many, Options, conflict

if TYPE_CHECKING:
    from lockstep.model.simulation import Trajectory
    from lockstep.workflow.runs.simulate import Simulation


def run(path: Path, options: Options, many: Many, *, as_json: bool) -> Answer:
    """Simulate a design: one run, or a campaign of them (see `lockstep.cli.campaign`)."""
    wrong = conflict(options, many)
    if wrong is not None:
        raise wrong
    if many.campaign is None and many.replay is None:
        return _simulate(path, many.output, options, as_json=as_json)
    from lockstep.cli import campaign
    from lockstep.workflow.runs.campaign import CampaignOptions

    asked = CampaignOptions(options.controllers, options.seed, options.horizon)
    if many.replay is not None:
        return campaign.run_replay(path, many.replay, many.output, asked)
    assert many.campaign is not None
    assert many.output is not None  # `conflict` refuses a campaign without
    if many.faults is not None:
        of_network = {"seed": options.seed, "horizon": options.horizon, "jobs": many.jobs}
        return campaign.run_faults(path, many.faults, many.campaign, many.output, **of_network)
    return campaign.run(path, many.campaign, many.output, many.scheduler, many.jobs, asked)


def _simulate(path: Path, output: Path | None, options: Options, *, as_json: bool) -> Answer:
    import lockstep

    asked = asdict(options)
    plotted = asked.pop("plot")
    with progress_display() as tell:
        found = lockstep.simulate(path, **asked, output=output, progress=tell)
    wrote(output, options.figures)
    plot = _plotted(found.trajectory, as_json) if plotted else ""
    return Answer(found.document(), _tables(found, plot), found.ok)


def _plotted(trajectory: "Trajectory", as_json: bool) -> str:
    """Return the plot; beside JSON it goes to standard error instead."""
    from lockstep.cli.terminal_plot import terminal_plot

    text = terminal_plot(trajectory, colour=sys.stdout.isatty() and not as_json)
    if as_json:
        errors.print(text, markup=False)
        return ""
    return text


def _tables(found: "Simulation", plot: str) -> RenderableType:
    from lockstep.model.simulation import effort_indices, indices
    from lockstep.workflow.runs.simulate_rows import rows

    trajectory = found.trajectory
    # Two tables of three digits: in 80 columns a figure that is cut says nothing.
    headings, style = ("agent", "ISE", "IAE", "ITSE", "ITAE"), {"pad_edge": False, "collapse_padding": True}
    parts: list[RenderableType] = [two_columns(found.design.title, rows(found))]
    for title, each in (("disagreement", indices(trajectory)), ("inputs", effort_indices(trajectory))):
        figures = [map(_short, one.document().values()) for one in each]
        cells = [(f"{trajectory.agent}{i}", *some) for i, some in enumerate(figures, start=1)]
        parts.append(table(headings, cells, title, **style))
    return Group(*parts, *([Text.from_ansi(plot)] if plot else []))


def _short(value: float) -> str:
    """Return three digits, and an exponent without a sign and a zero that say nothing.

    >>> _short(6661.0), _short(1.5e-12), _short(0.25)
    ('6.66e3', '1.5e-12', '0.25')
    """
    mantissa, _, exponent = f"{value:.3g}".partition("e")
    return f"{mantissa}e{int(exponent)}" if exponent else mantissa
