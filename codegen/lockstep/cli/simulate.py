"""`lockstep simulate`: the nonlinear closed loop in time, against what is proved of it."""

import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Group
from rich.text import Text

from lockstep.cli.console import Answer, errors, progress_display, two_columns, wrote
from lockstep.workflow.runs.simulate_options import Many, Options, conflict

if TYPE_CHECKING:
    from lockstep.model.simulation import Trajectory


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
    plot = [Text.from_ansi(_plotted(found.trajectory, as_json))] if plotted else []
    return Answer(found.document(), Group(two_columns(found.design.title, found.rows()), *plot), found.ok)


def _plotted(trajectory: "Trajectory", as_json: bool) -> str:
    """Return the plot; beside JSON it goes to standard error instead."""
    from lockstep.cli.terminal_plot import terminal_plot

    text = terminal_plot(trajectory, colour=sys.stdout.isatty() and not as_json)
    if as_json:
        errors.print(text, markup=False)
        return ""
    return text
