"""The gains of a problem, found or taken, and proved, continuous and as they ship: a step of the workflow."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from lockstep.check.errors import demand
from lockstep.lmi.document import design_file_of
from lockstep.model.problem import Problem
from lockstep.workflow.check import problem_of
from lockstep.workflow.design_cache import keep, recall
from lockstep.workflow.design_file import Design
from lockstep.workflow.output_files import check_writable, of_file, write_text
from lockstep.workflow.output_folders import write_files
from lockstep.workflow.trade_off import check_folder, gains_by_name, trade_off_files
from lockstep.workflow.waiting.progress import Progress, silent

if TYPE_CHECKING:
    from lockstep.lmi.search.stopping import Stop


def _made_before(problem: Problem, progress: Progress) -> Design | None:
    progress("looking for a design that was made before", 0.0)
    found = recall(problem)
    return None if found is None else replace(found, reused=True)


def doubts(problem: Problem) -> list[str]:
    """Return what `check` notes of the signs, period, limits, units and start of a problem: each is seldom meant."""
    from lockstep.model.checks.check import seldom_meant

    return [f"{row.name}: {row.figure}" for row in seldom_meant(problem) if row.verdict == "note"]


def design(
    problem: Problem | Path | str,
    *,
    output: Path | str | None = None,
    trade_off: Path | str | None = None,
    against: Sequence[Path | str] = (),
    jobs: int | None = None,
    scheduler: str | None = None,
    time_limit: float | None = None,
    progress: Progress = silent,
    remark: Callable[[str], None] = silent,
    reuse: bool = False,
    stop: "Stop | None" = None,
) -> Design:
    """Design the gains of a problem, and prove the loop with those very gains, continuous and as they ship.

    A design whose sampled controllers are not certified is returned, and written, since the continuous loop is:
    `sampled["certified"]` says so, and `sampled["reason"]` by how much.

    Args:
        problem: itself, or its file.
        output: where to write the design file, if anywhere.
        trade_off: a folder for what rho costs, as `trade_off.json`, `.csv`, `.png` and `.svg`; or, with a name that ends
            in .csv, a file for the gains' least rho for each alpha.
        against: problem files with gains, or design files, of the same agents: shown in the trade-off.
        jobs: processes to search with; by default one per core.
        scheduler: the address of a Dask scheduler, whose workers search instead; the design is the same.
        time_limit: seconds to search for gains, and as many for those of the period; then the best certified ones so far,
            which depend on the machine.
        progress: told what is being done and the part of it that is done.
        remark: told, before the search begins, what is seldom meant of signs, period, units and start.
        reuse: take the design that was made before of the same problem, proved again, if there is one in the user's cache
            folder, and keep this one there; see `lockstep.workflow.design_cache`.
        stop: ends the search early, and the best certified gains so far are kept; see `lockstep.lmi.search.stopping`.

    Raises:
        ProblemError: bad input, or an output that cannot be written.
        ClaimError: no gains were found, or none that are certified; nothing is written.
    """
    from lockstep.codegen.period_redesign import as_shipped
    from lockstep.lmi.design import design as designed
    from lockstep.lmi.processes.cluster import searching_on

    source, written, curve = (
        None if one is None or isinstance(one, Problem) else Path(one) for one in (problem, output, trade_off)
    )
    check_writable(written, source)
    folder = curve if curve is not None and curve.suffix != ".csv" else None
    if folder is not None:
        check_folder(folder, source, written)
    else:
        check_writable(curve, source, written)
    expected = "--trade-off DIR with it"
    demand(not against or folder is not None, "gains to compare with are named", "--against", expected)
    others = gains_by_name(against)
    posed, place = problem_of(problem)
    with of_file(place):
        for doubt in doubts(posed):
            remark(f"to be noted: {doubt}")
        before = _made_before(posed, progress) if reuse else None
        if before is not None:
            found = before
        else:
            with searching_on(scheduler, time_limit):
                made = designed(posed, jobs=jobs, progress=progress, time_limit=time_limit, stop=stop)
            found = Design(as_shipped(design_file_of(made), progress, made.others, stop, time_limit))
            if stop is not None:
                stop.found = False  # of what comes now, an interrupt ends all
        files = {} if folder is None else trade_off_files(found.stored, others, progress)
    if reuse and before is None:
        keep(posed, found)
    points = None if curve is None or folder is not None else found.trade_off()
    if written is not None:
        write_text(written, found.text())
    if curve is not None and points is not None:
        write_text(curve, points)
    if folder is not None:
        write_files(folder, files)
    return found
