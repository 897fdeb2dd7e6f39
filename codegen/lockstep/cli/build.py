"""`lockstep build`: from a problem file to a folder of proved, compiled and checked C, with a report."""

import json
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Group
from rich.text import Text

from lockstep.check.plain_json import plain
from lockstep.cli.console import Answer, of_file, progress_display, respond
from lockstep.cli.files import DESIGN_NAME
from lockstep.cli.folders import check_generated
from lockstep.cli.generate import generated_files

if TYPE_CHECKING:
    from lockstep.lmi.document import Stored
    from lockstep.model.checks import CheckReport
    from lockstep.report import Report
    from lockstep.verification.verify import VerifyReport

VERIFY_STEPS = 10_000

VERIFY_TARGETS = ("host", "sanitizers", "cortex-m4f")
"""`lockstep verify` runs the other cores too; without floating-point hardware they take minutes to emulate."""


def run(path: Path, output: Path, *, jobs: int | None, time_limit: float | None, as_json: bool) -> None:
    """Check, design, certify, generate, verify, report; write the folder last.

    C that differs from its reference is not written. C whose sampled, rounded loop is not proved is written, since the
    continuous loop is, and its header, its report and the exit status say what is not.
    """
    respond(as_json, lambda: _build(path, output, jobs, time_limit))


def _build(path: Path, output: Path, jobs: int | None, time_limit: float | None) -> Answer:
    from lockstep.cli.check import checked
    from lockstep.lmi.document import answer, parse, sampled_answer
    from lockstep.model.problem import load_problem

    check_generated(output)
    problem = load_problem(path)
    with of_file(path):
        checks = checked(problem)
        designed = _designed(problem, jobs, time_limit)
    files = generated_files(designed)
    # What is reported is what a reader of the file sees.
    stored = parse(json.loads(files[DESIGN_NAME]), DESIGN_NAME)
    verified = _verified(files)
    wrong, open_claims = [*checks.problems, *verified.problems], unproved(sampled_answer(stored))
    written = [] if wrong else _written(files, _reported(files, stored, checks, verified), output)
    return _answer(output, problem.title, checks, answer(stored), verified, [*wrong, *open_claims], written)


def unproved(sampled: Mapping[str, Any]) -> list[str]:
    """Return what is not proved of the controllers as they ship, sampled and rounded; nothing if all is.

    >>> unproved({"certified": True})
    []
    >>> unproved({"certified": False, "reason": "at 0.2 s the gain is 1.3", "max_period": 0.03})
    ['the sampled controllers are not certified: at 0.2 s the gain is 1.3; they are up to a period of 0.03 s']
    """
    from lockstep.codegen.sampled_design import NOT_FOR_PERIOD

    if sampled.get("certified") is True:
        return []
    longest, failed = sampled.get("max_period"), sampled.get(NOT_FOR_PERIOD)
    reach = f"; they are up to a period of {longest:g} s" if longest else ""
    reach += f"; no gains were designed for the period: {failed}" if failed else ""
    return [f"the sampled controllers are not certified: {sampled.get('reason') or 'not looked at'}{reach}"]


def _designed(problem: Any, jobs: int | None, time_limit: float | None) -> "Stored":
    from lockstep.codegen.for_the_period import as_shipped
    from lockstep.lmi.design import design
    from lockstep.lmi.document import file_of

    with progress_display() as tell:
        made = design(problem, jobs=jobs, progress=tell, time_limit=time_limit)
        return as_shipped(file_of(made), tell, made.others)


def _verified(files: dict[str, str]) -> "VerifyReport":
    from lockstep.cli.verify import verified
    from lockstep.codegen.folder import write_folder

    with tempfile.TemporaryDirectory(prefix="lockstep-") as temporary:
        return verified(write_folder(files, Path(temporary) / "build"), VERIFY_STEPS, VERIFY_TARGETS)


def _reported(
    files: dict[str, str], stored: "Stored", checks: "CheckReport", verified: "VerifyReport"
) -> "Report":
    from lockstep.report import make_report

    with progress_display() as tell:
        tell("drawing the report", 0.5)
        return make_report(files, stored, checks, verified)


def _written(files: dict[str, str], report: "Report", output: Path) -> list[str]:
    """Write everything, and return the names of the files."""
    from lockstep.codegen.bundle import bundle
    from lockstep.codegen.folder import write_folder

    extras: dict[str, str | bytes] = {**report.texts, **report.figures}
    whole = bundle(files, extras)
    write_folder(whole, output)
    return sorted(whole)


def _answer(
    output: Path,
    title: str,
    checks: "CheckReport",
    design: dict[str, Any],
    verified: "VerifyReport",
    problems: list[str],
    written: list[str],
) -> Answer:
    from lockstep.cli.check import table_of as check_table
    from lockstep.cli.design import summary
    from lockstep.cli.verify import table_of as verify_table
    from lockstep.report.report import PAGE

    holds = bool(written) and not problems
    document = {
        "ok": holds,
        "directory": str(output),
        "check": checks.document(),
        "design": design,
        "verify": plain(verified.as_dict()),
        "files": written,
        "report": PAGE if written else None,
        "problems": problems,
    }
    said = [f"{output / PAGE}: the report" if written else "nothing is written", *problems]
    parts = [
        check_table(checks, title),
        summary(design),
        verify_table(verified),
        Text("\n".join(said), style="bold"),
    ]
    return Answer(document, Group(*parts), holds)
