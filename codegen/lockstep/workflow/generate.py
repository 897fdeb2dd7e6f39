"""C for each agent, with the design it was proved by."""

import json
from collections.abc import Collection
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
        files: relative path -> text, or the bytes of a compiled unit.
    """

    design: Design
    folder: Path
    files: dict[str, str | bytes]

    def document(self) -> dict[str, Any]:
        """Return the contract's keys."""
        return {"ok": True, "directory": str(self.folder), "files": sorted(self.files)}


def generate(
    design: Design | Path | str, folder: Path | str, *, optimize: str = "speed", doors: Collection[str] = ()
) -> Generated:
    """Certify a design, emit its C, prove the controllers by the numbers in the C, and write the folder.

    Args:
        design: itself, its file, or a folder that holds one.
        folder: the folder to write; one that Lockstep wrote before is replaced as a whole.
        optimize: "speed" unrolls, "size" loops over a table.
        doors: more files: "pil" (test vectors and a runner for any board),
            "fmu" (FMI 3.0 co-simulation units, compiled for this machine if it has a compiler),
            "rust" (a `no_std` crate over the C), "arduino" (a library in Arduino's layout).

    Raises:
        ProblemError: no design, or a folder that cannot be written.
        NotCertified: the checker refuses the design: C is generated from certified designs only.
    """
    from lockstep.codegen.bundle import bundle
    from lockstep.codegen.folder import write_folder
    from lockstep.verification.units import units

    folder = Path(folder)
    check_generated(folder)
    texts = generated_files(as_design(design)[0], optimize, doors)
    files: dict[str, str | bytes] = bundle(texts, units(texts)) if "fmu" in doors else {**texts}
    write_folder(files, folder)
    return Generated(Design.of(json.loads(texts[DESIGN_NAME]), DESIGN_NAME, folder), folder, files)


def generated_files(design: Design, optimize: str = "speed", doors: Collection[str] = ()) -> dict[str, str]:
    """Certify a design, and return the files generated from it: relative path -> text.

    Raises:
        NotCertified: the checker refuses the design: C is generated from certified designs only.
    """
    from lockstep.codegen.bundle import bundle
    from lockstep.codegen.c_certificate import certify_texts
    from lockstep.codegen.doors import with_doors
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
    draft = emit(specification(stored, verdict, optimize=optimize))  # type: ignore[arg-type]
    held = certify_texts(draft, stored, longest=False)
    spec = specification(stored, verdict, optimize=optimize, held=held)  # type: ignore[arg-type]
    return bundle(with_doors(emit(spec), doors), {DESIGN_NAME: to_json(stored.document()) + "\n"})
