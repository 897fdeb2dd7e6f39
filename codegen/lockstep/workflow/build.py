"""From a problem file to a folder of proved, compiled and checked C, with a report."""

import json
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lockstep.check.errors import ClaimError, demand
from lockstep.model.plain_json import plain
from lockstep.model.problem import Problem
from lockstep.model.problem.tables.load import read_problem
from lockstep.workflow.check import check
from lockstep.workflow.design import design, doubts
from lockstep.workflow.design_file import DESIGN_NAME, Design
from lockstep.workflow.generate import generated_files
from lockstep.workflow.output_files import of_file
from lockstep.workflow.output_folders import check_generated
from lockstep.workflow.trade_off import gains_by_name, trade_off_points
from lockstep.workflow.verify import verify
from lockstep.workflow.waiting.progress import Progress, silent

if TYPE_CHECKING:
    from lockstep.lmi.search.stopping import Stop
    from lockstep.model.checks import CheckReport
    from lockstep.report import Report
    from lockstep.verification.verify import VerifyReport

VERIFY_STEPS = 10_000

VERIFY_TARGETS = ("host", "sanitizers", "cortex-m4f")
"""`lockstep verify` runs the other cores too; without floating-point hardware they take minutes to emulate."""


@dataclass(frozen=True, eq=False)
class Build:
    """What a build found, and what it wrote.

    Args:
        folder: where the files are, if they were written.
        checks: of the problem.
        design: with what is proved of the controllers in the C.
        verified: what running the C showed.
        problems: a sentence for everything that is not as it should be.
        notes: what takes the run of the report out of what is proved; no claim.
        written: names of the files; none where the C differs from its reference or the model is wrong.
    """

    folder: Path
    checks: "CheckReport"
    design: Design
    verified: "VerifyReport"
    problems: tuple[str, ...]
    notes: tuple[str, ...]
    written: tuple[str, ...]

    @property
    def ok(self) -> bool:
        """Whether every claim holds."""
        return bool(self.written) and not self.problems

    def document(self) -> dict[str, Any]:
        """Return the contract's keys."""
        from lockstep.report.report import PAGE

        return {
            "ok": self.ok,
            "directory": str(self.folder),
            "check": self.checks.document(),
            "design": self.design.document(),
            "verify": plain(self.verified.as_dict()),
            "files": list(self.written),
            "report": PAGE if self.written else None,
            "problems": list(self.problems),
            "notes": list(self.notes),
        }


def build(
    problem: Problem | Path | str,
    folder: Path | str,
    *,
    trade_off: bool = False,
    against: Sequence[Path | str] = (),
    jobs: int | None = None,
    time_limit: float | None = None,
    progress: Progress = silent,
    remark: Callable[[str], None] = silent,
    reuse: bool = False,
    stop: "Stop | None" = None,
) -> Build:
    """Check, design, certify, generate, verify, report; write the folder last.

    C that differs from its reference is not written. C whose sampled, rounded loop is not proved is written, since the
    continuous loop is, and its header, its report and `problems` say what is not.

    Args:
        problem: itself, or its file.
        folder: the folder to write; one that Lockstep wrote before is replaced as a whole.
        trade_off: whether the report shows what rho costs.
        against: problem files with gains, or design files, of the same agents: shown there.
        jobs: processes to search with; by default one per core.
        time_limit: seconds to search for gains, and as many for those of the period; then the best certified ones so far,
            which depend on the machine.
        progress: told what is being done and the part of it that is done.
        remark: told, before the search begins, what is to be noted of the problem; see `lockstep.design`.
        reuse: take the design that was made before of the same problem; see `lockstep.design`.
        stop: ends the search early; see `lockstep.design`.

    Raises:
        ProblemError: bad input, or a folder that cannot be written.
        ClaimError: no gains were found, or none that are certified; nothing is written.
    """
    from lockstep.lmi.diagnosis.open_loop import softer
    from lockstep.report import make_report

    folder = Path(folder)
    check_generated(folder)
    demand(not against or trade_off, "gains to compare with are named", "--against", "--trade-off with it")
    others = gains_by_name(against)
    source = "" if isinstance(problem, Problem) else read_problem(Path(problem))
    posed, checks = check(problem, every=True, progress=progress)
    with of_file(None if isinstance(problem, Problem) else Path(problem)), _with_notes_of(posed):
        options: dict[str, Any] = {"progress": progress, "remark": remark, "reuse": reuse, "stop": stop}
        designed = design(posed, jobs=jobs, time_limit=time_limit, **options)
    files = generated_files(designed, () if posed.messages is None else ("messages",))
    # What is reported is what a reader of the file sees.
    made = replace(Design.of(json.loads(files[DESIGN_NAME]), DESIGN_NAME, folder), reused=designed.reused)
    verified = _verified(files, progress)
    wrong, open_claims = [*checks.problems, *verified.problems], unproved(made.sampled)
    if open_claims and (noted := "; ".join(doubts(posed))):
        open_claims[-1] += f"; to be noted: {noted}"
    written, notes = tuple[str, ...](), tuple[str, ...]()
    if not wrong:
        points = trade_off_points(made.stored, others, progress) if trade_off else ()
        progress("drawing the report", 0.5)
        report = make_report(files, made.stored, checks, verified, points, source)
        soft = [f"a constant disturbance {said}"] if (said := softer(made.document()["figures"])) else []
        written, notes = _written(files, report, folder), (*report.notes, *soft)
    return Build(folder, checks, made, verified, (*wrong, *open_claims), notes, written)


@contextmanager
def _with_notes_of(problem: Problem) -> Iterator[None]:
    """Say with a design that fails what is seldom meant of its signs, period, units and start: that may be why."""
    try:
        yield
    except ClaimError as error:
        if notes := "; ".join(doubts(problem)):
            raise type(error)(f"{error}; to be noted: {notes}", **error.figures) from None
        raise


def unproved(sampled: Mapping[str, Any]) -> list[str]:
    """Return what is not proved of the controllers as they ship, sampled and rounded; nothing if all is.

    >>> unproved({"certified": True})
    []
    >>> unproved({"certified": False, "reason": "at 0.2 s the gain is 1.3", "max_period": 0.03})
    ['the sampled controllers are not certified: at 0.2 s the gain is 1.3; they are at a period of 0.03 s']
    >>> unproved({"certified": True, "rate": 0.044, "rate_asked": 0.2})
    ['0.044 1/s is proved of the sampled controllers, not the 0.2 1/s of [design] decay']
    """
    from lockstep.codegen.sampled_design import NOT_FOR_PERIOD

    if sampled.get("certified") is True:
        rate, asked = sampled.get("rate") or 0.0, sampled.get("rate_asked") or 0.0
        said = f"{rate:g} 1/s is proved of the sampled controllers, not the {asked:g} 1/s of [design] decay"
        return [said] * (rate < asked)
    longest, failed = sampled.get("max_period"), sampled.get(NOT_FOR_PERIOD)
    reach = f"; they are at a period of {longest:g} s" if longest else ""
    reach += f"; no gains were designed for the period: {failed}" if failed else ""
    return [f"the sampled controllers are not certified: {sampled.get('reason') or 'not looked at'}{reach}"]


def _verified(files: dict[str, str], progress: Progress) -> "VerifyReport":
    from lockstep.codegen.folder import write_folder

    with tempfile.TemporaryDirectory(prefix="lockstep-") as temporary:
        folder = write_folder(files, Path(temporary) / "build")
        return verify(folder, steps=VERIFY_STEPS, targets=VERIFY_TARGETS, progress=progress)


def _written(files: dict[str, str], report: "Report", folder: Path) -> tuple[str, ...]:
    """Write everything, and return the names of the files."""
    from lockstep.codegen.bundle import bundle
    from lockstep.codegen.folder import write_folder

    extras: dict[str, str | bytes] = {**report.texts, **report.figures}
    whole = bundle(files, extras)
    write_folder(whole, folder)
    return tuple(sorted(whole))
