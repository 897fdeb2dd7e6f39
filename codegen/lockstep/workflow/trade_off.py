"""What rho costs, as files: a table, the same for programs with the gains of each point, and a figure."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from lockstep.check.errors import ProblemError, demand
from lockstep.lmi.document import Stored, read
from lockstep.model.problem import load_problem
from lockstep.workflow.output_files import check_takes_files, of_file, seen
from lockstep.workflow.waiting.progress import Progress

if TYPE_CHECKING:
    from lockstep.check.system.loop import Gains
    from lockstep.lmi.trade_off.pareto import ParetoPoint

STEM = "trade_off"


def check_folder(folder: Path, *others: Path | None) -> None:
    """Refuse a folder that could not be written to; one that is not there yet is made at the end.

    Args:
        folder: the folder.
        others: what is read, and what else is written.

    Raises:
        ProblemError: it is a file, is named twice, or cannot be made.
    """
    with seen(folder):
        twice = any(other is not None and other.resolve() == folder.resolve() for other in others)
        there, is_folder, above = folder.exists(), folder.is_dir(), folder.parent.is_dir()
    if twice or (there and not is_folder):
        raise ProblemError(
            "it is named twice" if twice else "it is a file",
            where=str(folder),
            expected="a folder, or a file.csv",
        )
    if not above:
        raise ProblemError("there is no such folder", where=str(folder.parent), remedy="make it first")
    check_takes_files(folder if there else folder.parent, "" if there else folder.name)


def gains_by_name(paths: Sequence[Path | str]) -> dict[str, "Gains"]:
    """Return the gains that files hold, by what they are called: a design file, or a problem with [[design.gains]].

    Raises:
        ProblemError: a file that is neither.
    """
    from lockstep.lmi.proposal import given_gains

    found: dict[str, Gains] = {}
    for path in map(Path, paths):
        with of_file(path):
            if path.suffix == ".json":
                stored = read(path)
                found[stored.problem.title] = stored.gains
                continue
            problem = load_problem(path)
            expected = 'method = "given", with [[design.gains]]'
            demand(problem.gains is not None, "there are no gains", "[design]", expected)
            found[problem.title] = given_gains(problem)
    return found


def trade_off_points(
    stored: Stored, others: Mapping[str, "Gains"], progress: Progress
) -> tuple["ParetoPoint", ...]:
    """Return gains around a design, and others, each proved: see `lockstep.lmi.trade_off.pareto`."""
    from lockstep.lmi.trade_off.pareto import pareto

    return pareto(stored, others, lambda part: progress("what rho costs", part))


def trade_off_files(stored: Stored, others: Mapping[str, "Gains"], progress: Progress) -> dict[str, bytes]:
    """Return the files of a trade-off by name."""
    from lockstep.lmi.trade_off.pareto import pareto_csv
    from lockstep.report.export import png, svg
    from lockstep.report.trade_off import trade_off_figure

    points = trade_off_points(stored, others, progress)
    figure = trade_off_figure(points)
    said = {"title": stored.problem.title, "points": [one.document() for one in points]}
    return {
        f"{STEM}.json": (json.dumps(said, indent=1) + "\n").encode(),
        f"{STEM}.csv": pareto_csv(points).encode(),
        f"{STEM}.png": png(figure, STEM),
        f"{STEM}.svg": svg(figure, STEM),
    }
