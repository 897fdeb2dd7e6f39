"""The problems of benchmarks/designs.py, what was measured of them as a table, and the figures that are asked for."""

import math
import re
import statistics
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from page import markdown

from lockstep.model.problem import Problem, load_problem

ROOT = Path(__file__).resolve().parents[1]
PROBLEMS = ROOT / "benchmarks" / "designs"
EXAMPLES = ("carts", "flexible_joint_arms", "fragile_arms", "slow_arms")
"""Problems of examples/ that are measured too; they are robotics, and feasible."""

HEAD = (
    "problem", "certified", "sampled", "median / floor", "processor, s", "rho: best", "median", "worst", "floor",
    "sampled rho: best", "worst", "field", "agents", "order",
)  # fmt: skip

MOST_SPREAD, MOST_OVER_FLOOR, SHARE = 1.05, 1.5, 0.9
"""Asked: worst / best and median / floor at most these, in nine of ten problems."""


@dataclass(frozen=True)
class Case:
    """A problem file: its name, field, and the reason where no controllers exist."""

    name: str
    file: Path
    field: str
    infeasible: str

    @property
    def problem(self) -> Problem:
        """The file, read and checked."""
        return load_problem(self.file)


@dataclass(frozen=True)
class Run:
    """One design. rho, sampled_rho: proved, absent where they are not; floor: as printed; seconds: of processor.

    message: why there is no certificate, or none of the sampled loop; stopped_after: s, of a run that took too long.
    """

    seed: int
    rho: float | None
    sampled: bool
    sampled_rho: float | None
    floor: float | None
    seconds: float
    message: str = ""
    stopped_after: float | None = None


@dataclass(frozen=True)
class Row:
    """The runs of a problem. A run without a certificate counts as an infinite rho."""

    case: Case
    runs: tuple[Run, ...]

    @property
    def rhos(self) -> list[float]:
        """The rho of each run, smallest first."""
        return sorted(math.inf if run.rho is None else run.rho for run in self.runs)

    @property
    def sampled_rhos(self) -> list[float]:
        """The rho of each run's sampled loop, smallest first."""
        return sorted(math.inf if run.sampled_rho is None else run.sampled_rho for run in self.runs)

    @property
    def certified(self) -> int:
        """How many runs have a certificate."""
        return sum(run.rho is not None for run in self.runs)

    @property
    def sampled(self) -> int:
        """How many runs have one of the sampled loop as well."""
        return sum(run.sampled and run.rho is not None for run in self.runs)

    @property
    def floor(self) -> float:
        """The smallest floor printed; nan where there is none."""
        return min((run.floor for run in self.runs if run.floor is not None), default=math.nan)

    @property
    def spread(self) -> float:
        """Worst over best rho; infinite unless all runs are certified."""
        return ratio(self.rhos[-1], self.rhos[0])

    @property
    def over_floor(self) -> float:
        """Median rho over the floor."""
        return ratio(statistics.median(self.rhos), self.floor)


def ratio(above: float, below: float) -> float:
    """Return above / below, infinite where that says nothing.

    >>> ratio(3.0, 2.0), ratio(3.0, 0.0), ratio(math.inf, math.inf), ratio(1.0, math.nan)
    (1.5, inf, inf, inf)
    """
    return above / below if below > 0 and math.isfinite(above) else math.inf


def cases(only: Sequence[str] = ()) -> list[Case]:
    """Return the problems by name, all or those that are named."""
    files = [*PROBLEMS.glob("*.toml"), *(ROOT / "examples" / f"{name}.toml" for name in EXAMPLES)]
    found = sorted((case_of(file) for file in files), key=lambda case: case.name)
    unknown = set(only) - {case.name for case in found}
    if unknown:
        raise SystemExit(
            f"no such problem: {', '.join(sorted(unknown))}; there are {', '.join(c.name for c in found)}"
        )
    return [case for case in found if not only or case.name in only]


def case_of(file: Path) -> Case:
    """Return a problem file with what its first comment says: `# Field: ...`, `# Infeasible: ...`."""
    head = re.sub(r"\n# (?!\w+: )", " ", file.read_text(encoding="utf-8").split("\n\n")[0])
    said = dict(re.findall(r"^# (Field|Infeasible): (.*?)\.?$", head, re.MULTILINE))
    return Case(file.stem, file, said.get("Field", "robotics"), said.get("Infeasible", ""))


def cells(row: Row) -> Iterator[str]:
    """Yield a row of the table; rho of the certified runs only."""
    problem, runs = row.case.problem, len(row.runs)
    yield row.case.name
    yield "none exist" if row.case.infeasible and not row.certified else f"{row.certified} of {runs}"
    yield f"{row.sampled} of {runs}"
    over_floor, floor = (f"{x:.3g}" if math.isfinite(x) else "-" for x in (row.over_floor, row.floor))
    yield from (over_floor, f"{statistics.median(run.seconds for run in row.runs):.0f}")
    rhos, sampled = ([x for x in values if math.isfinite(x)] for values in (row.rhos, row.sampled_rhos))
    yield from (f"{x:.4g}" for x in (rhos[0], statistics.median(rhos), rhos[-1])) if rhos else "---"
    yield floor
    yield from (f"{x:.4g}" for x in (sampled[0], sampled[-1])) if sampled else "--"
    yield from (row.case.field, str(problem.graph().agents), str(problem.order))


def table_of(rows: Sequence[Row]) -> str:
    """Return the figures as a table in Markdown."""
    return markdown(HEAD, map(cells, rows))


def summary(rows: Sequence[Row]) -> list[tuple[bool, str]]:
    """Return each figure that is asked for, with whether it is reached.

    Problems that no seed solves do not count in the shares, which are about the search's luck; they are named.
    """
    feasible = [row for row in rows if not row.case.infeasible]
    solved = [row for row in feasible if row.sampled]
    lucky = [row for row in solved if row.sampled < len(row.runs)]
    even = sum(row.spread <= MOST_SPREAD for row in solved)
    close = sum(row.over_floor <= MOST_OVER_FLOOR for row in solved)
    beaten = [row for row in rows if row.certified and row.rhos[0] < row.floor * (1 - 1e-3)]
    wrong = [row for row in rows if row.case.infeasible and row.certified]
    unsolved = [row for row in feasible if not row.sampled]
    return [
        (not lucky, f"solved by some seeds only: {named(lucky)}"),
        (even >= SHARE * len(solved), f"worst / best at most {MOST_SPREAD}: {even} of {len(solved)}"),
        (close >= SHARE * len(solved), f"median / floor at most {MOST_OVER_FLOOR}: {close} of {len(solved)}"),
        (not beaten, f"a floor above a certified rho: {named(beaten)}"),
        (not wrong, f"certified though said to be infeasible: {named(wrong)}"),
        (not unsolved, f"solved by no seed: {named(unsolved)}"),
    ]


def named(rows: Sequence[Row]) -> str:
    """Return the names of problems."""
    return ", ".join(row.case.name for row in rows) or "none"


def verdicts(rows: Sequence[Row]) -> str:
    """Return the summary as a list."""
    return "\n".join(f"- {'reached' if holds else 'not reached'}: {text}" for holds, text in summary(rows))
