"""`lockstep build`: from a problem file to a folder of proved, compiled and checked C, with a report."""

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Group

from lockstep.cli.console import Answer, of_file, plain, progress_display, respond
from lockstep.cli.files import DESIGN_NAME
from lockstep.cli.generate import generated_files

if TYPE_CHECKING:
    from lockstep.codegen.verify import VerifyReport
    from lockstep.model.checks import CheckReport

VERIFY_STEPS = 10_000

VERIFY_TARGETS = ("host", "sanitizers", "cortex-m4f")
"""`lockstep verify` runs the other cores too; without floating-point hardware they take minutes to emulate."""


def run(path: Path, output: Path, *, jobs: int | None, as_json: bool) -> None:
    """Check, design, certify, generate, verify, report; write the folder last."""
    respond(as_json, lambda: _build(path, output, jobs))


def _build(path: Path, output: Path, jobs: int | None) -> Answer:
    from lockstep.cli.check import checked
    from lockstep.cli.check import table_of as check_table
    from lockstep.cli.design import summary
    from lockstep.cli.verify import table_of as verify_table
    from lockstep.codegen.bundle import bundle
    from lockstep.codegen.folder import check_replaceable, write_folder
    from lockstep.lmi.document import parse
    from lockstep.model.problem import load_problem

    check_replaceable(output)
    problem = load_problem(path)
    with of_file(path):
        checks = checked(problem)
        content = _designed(problem, jobs)
    files = generated_files(content, parse(content, DESIGN_NAME))
    verified = _verified(files)
    report = _report(content, checks, verified, files)
    holds = verified.ok and checks.ok
    if holds:
        write_folder(bundle(files, {"report.md": report}), output)
    document = {
        "ok": holds,
        "directory": str(output),
        "check": checks.document(),
        "design": content,
        "verify": plain(verified.as_dict()),
        "files": sorted([*files, "report.md"]) if holds else [],
    }
    return Answer(
        document, Group(check_table(checks, problem.title), summary(content), verify_table(verified)), holds
    )


def _designed(problem: Any, jobs: int | None) -> dict[str, Any]:
    """Design, and pass the result through JSON, so that what is generated from is what a reader of the file sees."""
    from lockstep.cli.design import sampled_too
    from lockstep.lmi.design import design
    from lockstep.lmi.document import document

    with progress_display() as tell:
        return sampled_too(document(design(problem, jobs=jobs, progress=tell)))


def _verified(files: dict[str, str]) -> "VerifyReport":
    from lockstep.cli.verify import verified
    from lockstep.codegen.folder import write_folder

    with tempfile.TemporaryDirectory(prefix="lockstep-") as temporary:
        return verified(write_folder(files, Path(temporary) / "build"), VERIFY_STEPS, VERIFY_TARGETS)


def _report(
    content: dict[str, Any], checks: "CheckReport", verified: "VerifyReport", files: dict[str, str]
) -> str:
    from lockstep.codegen.rendering import render

    return render("report.md.j2", design=content, checks=checks, verify=verified, files=sorted(files))
