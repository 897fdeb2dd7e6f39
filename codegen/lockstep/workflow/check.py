"""Check a problem: the bound of its nonlinearity, structure, graph."""

import math
from pathlib import Path
from typing import TYPE_CHECKING

from lockstep.model.problem import Problem
from lockstep.workflow.output_files import of_file
from lockstep.workflow.waiting.progress import Progress, silent

if TYPE_CHECKING:
    from lockstep.model.bound_search import SearchState
    from lockstep.model.checks import CheckReport


def check(
    problem: Problem | Path | str,
    *,
    boxes: int | None = None,
    every: bool = False,
    progress: Progress = silent,
) -> tuple[Problem, "CheckReport"]:
    """Return a problem and what was found of it.

    Args:
        problem: itself, or its file.
        boxes: budget of the search that proves the bound.
        every: also the checks that prove equilibria, sectors, contraction and the like.
        progress: told the enclosure of the bound so far, and the part of the budget that is spent.

    Raises:
        ProblemError: a file that is no problem.
    """
    from lockstep.model.bound_search import BOXES
    from lockstep.model.checks import check_problem

    posed, place = problem_of(problem)
    progress("checking the model", 0.0)
    with of_file(place):
        found = check_problem(
            posed,
            boxes=BOXES if boxes is None else boxes,
            progress=lambda p: progress(enclosure(p), p.part),
            every=every,
            proving=lambda name: progress(f"proving: {name}", 0.0),
        )
    return posed, found


def problem_of(problem: Problem | Path | str) -> tuple[Problem, Path | None]:
    """Return a problem, and the file it was read from, if it was."""
    if isinstance(problem, Problem):
        return problem, None
    return Problem.load(problem), Path(problem)


def enclosure(progress: "SearchState") -> str:
    """Return where a proof of a bound stands.

    >>> from lockstep.model.bound_search import SearchState
    >>> enclosure(SearchState(512, 3.0, 4.5, 0.1))
    'bound: between 3 and 4.5 after 512 boxes'
    """
    upper = f"and {progress.upper:.5g}" if math.isfinite(progress.upper) else "and no limit yet"
    return f"bound: between {progress.lower:.5g} {upper} after {progress.boxes} boxes"
