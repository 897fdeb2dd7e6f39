"""`lockstep simulate --campaign N`: network tests against the certificate, here or on a cluster."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich import box
from rich.console import Group, RenderableType
from rich.table import Table as RichTable
from rich.text import Text

from lockstep.check.errors import ProblemError
from lockstep.check.wording import shorten
from lockstep.cli.console import Answer, of_file, progress_display, respond, two_columns, write_text
from lockstep.cli.files import DESIGN_NAME, check_writable, read_design
from lockstep.cli.folders import check_folder

if TYPE_CHECKING:
    from lockstep.campaign import Campaign, Plan
    from lockstep.campaign.guarantee import Controllers
    from lockstep.lmi.document import Stored

HORIZON = 10.0
"""Of each run, in s, unless another is asked for."""

ADDRESS = r"inproc://.+|(\w+://)?[^/\s]+:\d+"
"""Of a Dask scheduler: a host and a port, with or without a protocol."""


@dataclass(frozen=True)
class Options:
    """What fixes a campaign beside its design; None leaves the choice to the design.

    controllers: "sampled" (the C that ships; "compiled" is the same) or "continuous" (the gains, with Delta at the
    bound of (11)); by default what the design's fragility is about;  seed: of all draws;  horizon: in s.
    """

    controllers: str | None = None
    seed: int | None = None
    horizon: float | None = None


def run(
    path: Path,
    runs: int,
    output: Path,
    scheduler: str | None,
    jobs: int | None,
    seed: int | None,
    as_json: bool,
    *,
    controllers: str | None = None,
    horizon: float | None = None,
) -> None:
    """Run a campaign, or what is left of it.

    Args:
        path: a certified design, or a folder that holds one.
        runs: how many.
        output: a folder; each campaign has one of its own in it.
        scheduler: the address of a Dask scheduler; None for this machine.
        jobs: threads; None for one per core.
        as_json: print JSON.
        seed, controllers, horizon: see `Options`.
    """
    options = Options(controllers, seed, horizon)
    respond(as_json, lambda: _run(path, runs, output, scheduler, jobs, options))


def run_replay(
    path: Path,
    index: int,
    output: Path | None,
    seed: int | None,
    as_json: bool,
    *,
    controllers: str | None = None,
    horizon: float | None = None,
) -> None:
    """Run one of a campaign's runs again, by its index, and write its trajectory (CSV) to `output`, if given.

    Seed, controllers and horizon are to be the campaign's: they fix the run.
    """
    respond(as_json, lambda: _replay(path, index, output, Options(controllers, seed, horizon)))


def planned(path: Path, options: Options) -> tuple["Plan", "Stored"]:
    """Certify a design, emit its C, and return the campaign and the design.

    Raises:
        NotCertified: the checker refuses the design, or there is no rho to hold the runs against.
        ProblemError: no such controllers.
    """
    import json

    from lockstep.campaign import plan_of
    from lockstep.cli.generate import generated_files
    from lockstep.lmi.document import parse

    kind = _kind(options.controllers)
    stored = read_design(path)
    with of_file(path):
        # Proved anew, here and in plan_of: what the file says of itself does not count.
        files = generated_files(stored)
        stored = parse(json.loads(files[DESIGN_NAME]), DESIGN_NAME)
        seed = stored.problem.simulation.seed if options.seed is None else options.seed
        horizon = HORIZON if options.horizon is None else options.horizon
        _check_periods(horizon, stored.problem.controller.period)
        return plan_of(stored, files, controllers=kind, seed=seed, horizon=horizon), stored


def _check_address(scheduler: str | None) -> None:
    """Refuse what Dask would only refuse after the proof, with a traceback of its own."""
    if scheduler is not None and not re.fullmatch(ADDRESS, scheduler):
        expected = "the address of a running one, such as tcp://127.0.0.1:8786"
        raise ProblemError(f"`{shorten(scheduler)}` is no address", where="--scheduler", expected=expected)


def _check_periods(horizon: float, period: float) -> None:
    """Refuse a run that is longer than any other: its periods are counted in a machine word."""
    from lockstep.model.simulation.scenario import MOST_INSTANTS

    if horizon / period > MOST_INSTANTS:
        found = f"{horizon:g} s are {horizon / period:.3g} periods"
        raise ProblemError(found, where="--horizon", expected=f"at most {MOST_INSTANTS}")


def _kind(controllers: str | None) -> "Controllers | None":
    if controllers is None:
        return None
    if controllers == "continuous":
        return "continuous"
    if controllers in ("sampled", "compiled"):
        return "sampled"
    raise ProblemError(f"`{controllers}`", where="--controllers", expected='"sampled" or "continuous"')


def _run(
    path: Path, runs: int, output: Path, scheduler: str | None, jobs: int | None, options: Options
) -> Answer:
    from joblib import cpu_count

    from lockstep.campaign import run_campaign

    check_folder(output)
    _check_address(scheduler)
    threads = jobs or cpu_count()
    with progress_display() as tell:
        tell("proving the design", 0.0)
        plan, _ = planned(path, options)
        try:
            found = run_campaign(plan, runs, output, jobs=threads, scheduler=scheduler, report=tell)
        except KeyboardInterrupt:
            kept = "interrupted; the runs that are done are kept: the same command goes on from there"
            raise KeyboardInterrupt(kept) from None
    return Answer(found.document(), table_of(found), found.ok)


def table_of(found: "Campaign") -> RenderableType:
    """Return a campaign's figures for people."""
    document = found.document()
    covered, worst = document["covered"], document["worst_ratio"]
    judged = (
        f"all {covered} runs that the certificate covers are below it"
        if not document["above"]
        else f"{document['above']} of {covered} runs that the certificate covers are ABOVE it"
    )
    shown = "infinite" if worst is None else f"{worst:.4f}"
    speed = f"{document['runs_per_second']:.0f} runs/s" if document["computed"] else "nothing was left to run"
    rows = {
        "runs": f"{document['runs']} of {document['horizon']:g} s each, {document['controllers']} controllers",
        "certified rho": f"{document['rho']:g}",
        "worst": f"{shown} of the bound, run {document['worst_run']}; {judged}",
        "not covered": _not_covered(document),
        "linear loop": f"{document['linear_gain']:.4f} is the largest gain of the linearised loop found",
        "diverged": f"{document['diverged']} runs, {document['faults']} faulty controller steps",
        "speed": f"{document['computed']} runs in {document['seconds']:.1f} s, {speed}",
        "results": document["results"],
    }
    verdict = "as certified" if document["ok"] else "NOT as certified"
    return Group(two_columns("Network tests", rows), _families(document), Text(verdict, style="bold"))


def _not_covered(document: dict[str, Any]) -> str:
    """Say what became of the runs that nothing is claimed of: lost messages, or an agent out of its domain."""
    count, worst = document["runs"] - document["covered"], document["worst_ratio_not_covered"]
    if not count:
        return "no run"
    shown = "" if worst is None else f"; the worst came to {worst:.4f} of the bound"
    return f"{count} runs, of which nothing is claimed{shown}"


def _families(document: dict[str, Any]) -> RenderableType:
    table = RichTable(box=box.SIMPLE_HEAD)
    for heading in ("family", "runs", "covered", "worst ratio", "diverged"):
        table.add_column(heading, justify="left" if heading == "family" else "right")
    for name, one in document["families"].items():
        ratio = "-" if one["worst_ratio"] is None else f"{one['worst_ratio']:.4f}"
        table.add_row(name, str(one["runs"]), str(one["covered"]), ratio, str(one["diverged"]))
    return table


def _replay(path: Path, index: int, output: Path | None, options: Options) -> Answer:
    from lockstep.campaign import replay
    from lockstep.campaign.draw import FAMILIES
    from lockstep.model.simulation.table import to_csv

    check_writable(output, path)
    plan, stored = planned(path, options)
    found = replay(plan, stored.problem.agent(), index)
    if output is not None:
        write_text(output, to_csv(found.trajectory))
    figures: dict[str, float | bool] = {
        name: found[name] for name in found.columns if name not in ("run", "family")
    }
    figures |= {name: bool(figures[name]) for name in ("covered", "diverged")}
    holds = not figures["diverged"] and not (figures["covered"] and found["ratio"] > 1)
    document = {
        "ok": holds,
        "identity": plan.identity,
        "run": index,
        "family": FAMILIES[int(found["family"])],
        **figures,
        "trajectory": None if output is None else str(output),
    }
    rows = {name: f"{value}" for name, value in document.items() if not name.startswith("x_")}
    return Answer(document, two_columns(f"Run {index} again", rows), holds)
