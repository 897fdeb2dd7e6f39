"""Network tests: many random runs of a design against its certificate, here or on a cluster, and one of them again."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from lockstep.check.errors import ProblemError, demand
from lockstep.lmi.processes.cluster import check_address
from lockstep.workflow.design_file import DESIGN_NAME, Design, as_design
from lockstep.workflow.generate import generated_files
from lockstep.workflow.output_files import check_writable, of_file, write_text
from lockstep.workflow.output_folders import check_folder
from lockstep.workflow.waiting.progress import Progress, silent

if TYPE_CHECKING:
    from lockstep.campaign import Campaign, Plan, Replay
    from lockstep.campaign.guarantee import Controllers
    from lockstep.lmi.document import Stored


@dataclass(frozen=True)
class CampaignOptions:
    """What fixes a campaign beside its design; None leaves the choice to the design.

    controllers: "sampled" (the C that ships; "compiled" is the same) or "continuous" (the gains, with Delta at the
    bound of (11)); by default what the design's fragility is about;  seed: of all draws;  horizon: of each run,
    in s; by default the problem's.
    """

    controllers: str | None = None
    seed: int | None = None
    horizon: float | None = None


def run_campaign(
    design: Design | Path | str,
    runs: int,
    output: Path | str,
    options: CampaignOptions,
    *,
    scheduler: str | None = None,
    jobs: int | None = None,
    progress: Progress = silent,
) -> "Campaign":
    """Run a campaign, or what is left of it; what is done is kept, also where it is interrupted.

    Args:
        design: itself, its file, or a folder that holds one.
        runs: how many.
        output: a folder; each campaign has one of its own in it.
        options: seed, controllers, horizon: with the design they fix every run.
        scheduler: the address of a Dask scheduler; None for this machine.
        jobs: threads; None for one per core.
        progress: told what is being done and the part of it that is done.

    Raises:
        NotCertified: the checker refuses the design, or there is no rho to hold the runs against.
        ProblemError: bad input, or a folder that cannot be written.
        KeyboardInterrupt: after a word on what is kept.
    """
    from joblib import cpu_count

    from lockstep.campaign import run_campaign as run

    output = Path(output)
    check_folder(output)
    check_address(scheduler)
    progress("proving the design", 0.0)
    plan, _ = planned(design, options)
    try:
        return run(plan, runs, output, jobs=jobs or cpu_count(), scheduler=scheduler, report=progress)
    except KeyboardInterrupt:
        kept = "interrupted; the runs that are done are kept: the same command goes on from there"
        raise KeyboardInterrupt(kept) from None


def replay(
    design: Design | Path | str, index: int, options: CampaignOptions, *, output: Path | str | None = None
) -> "Replay":
    """Run one of a campaign's runs again, by its index.

    Args:
        design, options: the campaign's: they fix the run.
        index: as in the campaign's table.
        output: where to write the trajectory (CSV), if anywhere.

    Raises:
        NotCertified, ProblemError: as `run_campaign`; or a run that is not finite from its first step on.
    """
    from lockstep.campaign import replay as again
    from lockstep.model.simulation.results.table import to_csv

    written = None if output is None else Path(output)
    check_writable(written, None if isinstance(design, Design) else Path(design))
    plan, stored = planned(design, options)
    found = again(plan, stored.problem.agent(), index)
    if written is not None:
        write_text(written, to_csv(found.trajectory))
    return found


def planned(design: Design | Path | str, options: CampaignOptions) -> tuple["Plan", "Stored"]:
    """Certify a design, emit its C, and return the campaign and the design.

    Raises:
        NotCertified: the checker refuses the design, or there is no rho to hold the runs against.
        ProblemError: no such controllers.
    """
    from lockstep.campaign import plan_of
    from lockstep.lmi.document import parse

    kind = _kind(options.controllers)
    found, path = as_design(design)
    with of_file(path):
        # Proved anew, here and in plan_of: what the file says of itself does not count.
        files = generated_files(found)
        stored = parse(json.loads(files[DESIGN_NAME]), DESIGN_NAME)
        seed = stored.problem.simulation.seed if options.seed is None else options.seed
        horizon = stored.problem.simulation.horizon if options.horizon is None else options.horizon
        check_periods(horizon, stored.problem.controller.period)
        return plan_of(stored, files, controllers=kind, seed=seed, horizon=horizon), stored


def check_periods(horizon: float, period: float) -> None:
    """Refuse a run that is longer than any other: its periods are counted in a machine word."""
    from lockstep.model.simulation.disturbance import MOST_INSTANTS

    if horizon / period > MOST_INSTANTS:
        found = f"{horizon:g} s are {horizon / period:.3g} periods"
        raise ProblemError(found, where="--horizon", expected=f"at most {MOST_INSTANTS}")


def _kind(controllers: str | None) -> "Controllers | None":
    kinds: dict[str | None, Controllers | None]
    kinds = {None: None, "continuous": "continuous", "sampled": "sampled", "compiled": "sampled"}
    demand(controllers in kinds, f"`{controllers}`", "--controllers", '"sampled" or "continuous"')
    return kinds[controllers]
