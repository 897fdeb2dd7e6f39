"""C for each agent, with the design it was proved by."""

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from lockstep.check.errors import NotCertified, ProblemError
from lockstep.check.plain_json import to_json
from lockstep.workflow.design import DESIGN_NAME, Design, as_design
from lockstep.workflow.folders import check_generated


@dataclass(frozen=True, eq=False)
class Generated:
    """What was generated, and where it was written.

    Args:
        design: the one in the folder, with what is proved of the controllers in its C.
        folder: where the files are.
        files: relative path -> text.
    """

    design: Design
    folder: Path
    files: dict[str, str]

    def document(self) -> dict[str, Any]:
        """Return the contract's keys."""
        return {"ok": True, "directory": str(self.folder), "files": sorted(self.files)}


def generate(
    design: Design | Path | str,
    folder: Path | str,
    *,
    optimize: str = "speed",
    name: str = "",
    prefix: str = "",
) -> Generated:
    """Certify a design, emit its C, prove the controllers by the numbers in the C, and write the folder.

    Args:
        design: itself, its file, or a folder that holds one.
        folder: the folder to write; one that Lockstep wrote before is replaced as a whole.
        optimize: "speed" unrolls, "size" loops over a table.
        name: of the CMake target and the umbrella header; by default the agent's name and `_controllers`.
        prefix: put before the agents' names, so that two designs fit one program.

    Raises:
        ProblemError: no design, a name that is no C identifier, or a folder that cannot be written.
        NotCertified: the checker refuses the design: C is generated from certified designs only.
    """
    from lockstep.codegen.folder import write_folder

    folder = Path(folder)
    check_generated(folder)
    files = generated_files(as_design(design)[0], optimize, name=name, prefix=prefix)
    write_folder(files, folder)
    return Generated(Design.of(json.loads(files[DESIGN_NAME]), DESIGN_NAME, folder), folder, files)


def generated_files(
    design: Design, optimize: str = "speed", *, name: str = "", prefix: str = ""
) -> dict[str, str]:
    """Certify a design, and return the files generated from it: relative path -> text.

    Raises:
        NotCertified: the checker refuses the design: C is generated from certified designs only.
    """
    from lockstep.codegen.bundle import bundle
    from lockstep.codegen.c_certificate import certify_texts
    from lockstep.codegen.emit import emit
    from lockstep.codegen.from_design import specification
    from lockstep.codegen.sampled_design import prove_design, with_sampled
    from lockstep.lmi.certify import certify

    if optimize not in ("speed", "size"):
        raise ProblemError(f"`--optimize` is {optimize!r}", expected='"speed" or "size"')
    stored = design.stored
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
    names = {"name": name, "prefix": prefix}
    draft = emit(specification(stored, verdict, optimize=optimize, **names))  # type: ignore[arg-type]
    held = certify_texts(draft, stored, longest=False)
    spec = specification(stored, verdict, optimize=optimize, held=held, **names)  # type: ignore[arg-type]
    return bundle(emit(spec), {DESIGN_NAME: to_json(stored.document()) + "\n"})
