"""`lockstep generate`: C for each agent, with the design it was proved by."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from lockstep.check.errors import NotCertified, ProblemError
from lockstep.check.plain_json import to_json
from lockstep.cli.console import Answer, respond, two_columns
from lockstep.cli.files import DESIGN_NAME, read_design
from lockstep.cli.folders import check_generated

if TYPE_CHECKING:
    from lockstep.lmi.document import Stored


def run(path: Path, output: Path, *, optimize: str, as_json: bool) -> None:
    """Generate the folder of a certified design."""
    respond(as_json, lambda: _generate(path, output, optimize))


def _generate(path: Path, output: Path, optimize: str) -> Answer:
    from lockstep.codegen.folder import write_folder

    check_generated(output)
    stored = read_design(path)
    files = generated_files(stored, optimize)
    write_folder(files, output)
    table = two_columns(
        f"{stored.problem.title}: {output}",
        {name: f"{len(files[name].encode())} bytes" for name in sorted(files)},
    )
    return Answer({"ok": True, "directory": str(output), "files": sorted(files)}, table)


def generated_files(stored: "Stored", optimize: str = "speed") -> dict[str, str]:
    """Certify a design, and return the files generated from it.

    Raises:
        NotCertified: the checker refuses the design: C is generated from proved designs only.
    """
    from lockstep.codegen.bundle import bundle
    from lockstep.codegen.c_certificate import certify_texts
    from lockstep.codegen.emit import emit
    from lockstep.codegen.from_design import specification
    from lockstep.codegen.sampled_design import prove_design, with_sampled
    from lockstep.lmi.certify import certify

    if optimize not in ("speed", "size"):
        raise ProblemError(f"`--optimize` is {optimize!r}", expected='"speed" or "size"')
    verdict = certify(stored)
    if not verdict.certified:
        raise NotCertified(
            f"no C is generated from a design that is not certified: {verdict.reason}", **verdict.figures
        )
    # Printed twice: the numbers do not depend on what is said of them, and what is said is proved of the printed ones.
    # The design file claims of its gains what can be proved without the C, which may round less often.
    stored = with_sampled(
        replace(stored, claims=replace(stored.claims, scope=verdict.scope)), prove_design(stored)
    )
    draft = emit(specification(stored, verdict, optimize=optimize))  # type: ignore[arg-type]
    held = certify_texts(draft, stored, longest=False)
    spec = specification(stored, verdict, optimize=optimize, held=held)  # type: ignore[arg-type]
    return bundle(emit(spec), {DESIGN_NAME: to_json(stored.document()) + "\n"})
