"""C for each agent, with the design it was proved by."""

import json
from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lockstep.check.errors import NotCertified, ProblemError, demand
from lockstep.model.plain_json import to_json
from lockstep.workflow.design_file import DESIGN_NAME, Design, as_design
from lockstep.workflow.output_folders import check_generated

if TYPE_CHECKING:
    from lockstep.codegen.from_design import CodeOptions


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
    design: Design | Path | str,
    folder: Path | str,
    *,
    optimize: str = "speed",
    exports: Collection[str] = (),
    name: str = "",
    prefix: str = "",
    one_image: bool | None = None,
    max_neighbours: int | None = None,
    table: str = "none",
) -> Generated:
    """Certify a design, emit its C, prove the controllers by the numbers in the C, and write the folder.

    Args:
        design: itself, its file, or a folder that holds one.
        folder: the folder to write; one that Lockstep wrote before is replaced as a whole.
        optimize: "speed" unrolls, "size" loops over a table.
        exports: more files: "pil" (test vectors and a runner for any board),
            "fmu" (FMI 3.0 co-simulation units, compiled for this machine if it has a compiler),
            "rust" (a `no_std` crate over the C), "arduino" (a library in Arduino's layout),
            "messages" (each agent as a node that sends, receives and holds stamped differences),
            "dbc" (its messages as CAN FD frames, for bus analysers),
            "fixed" (each controller in integers, for cores without floating point, certified as such).
        name: of the CMake target and the umbrella header; by default the agent's name and `_controllers`.
        prefix: put before the agents' names, so that two designs fit one program.
        one_image: one image for all nodes, whom a node hears given at run time; by default from 17 agents on whose gains are
            all the same, where no exports are asked for, and for `spectrum`, whose graphs the nodes are told later.
        max_neighbours: of a node of one image; by default the largest in-degree of the design's graph, or `max_degree`.
        table: of whom each node hears, beside one image: "none", since a node needs its own list alone, "csv" for what
            installs the nodes, or "c" for an image that holds all lists.

    Raises:
        ProblemError: no design, a name that is no C identifier, or a folder that cannot be written.
        NotCertified: the checker refuses the design: C is generated from certified designs only.
    """
    from lockstep.codegen.bundle import bundle
    from lockstep.codegen.folder import write_folder
    from lockstep.codegen.from_design import CodeOptions
    from lockstep.verification.fmu import units

    folder = Path(folder)
    check_generated(folder)
    found = as_design(design)[0]
    if one_image is None:
        asked = max_neighbours is not None or table != "none"
        one_image = asked or (not exports and _is_swarm(found))
    options = CodeOptions(optimize, name, prefix, one_image, max_neighbours, table)  # type: ignore[arg-type]
    texts = generated_files(found, exports, options)
    files: dict[str, str | bytes] = bundle(texts, units(texts)) if "fmu" in exports else {**texts}
    write_folder(files, folder)
    return Generated(Design.of(json.loads(texts[DESIGN_NAME]), DESIGN_NAME, folder), folder, files)


def _is_swarm(design: Design) -> bool:
    """Tell whether a design is of many agents with the same gains, and no offsets."""
    from lockstep.codegen.from_design import has_one_controller
    from lockstep.codegen.one_image import ONE_IMAGE_FROM

    stored = design.stored
    many = stored.gains.N >= ONE_IMAGE_FROM or stored.problem.spectrum is not None
    return many and stored.problem.offsets is None and has_one_controller(stored)


def generated_files(
    design: Design, exports: Collection[str] = (), options: "CodeOptions | None" = None
) -> dict[str, str]:
    """Certify a design, and return the files generated from it: relative path -> text.

    What the design claims of its sampled controllers is printed in the C. Where it claims nothing of them, or what is not
    proved, what can be claimed is looked for here. The checker then decides the folder: the claims, by the numbers in the C.

    Raises:
        NotCertified: the checker refuses the design: C is generated from certified designs only.
    """
    from lockstep.codegen.bundle import bundle
    from lockstep.codegen.emission.emit import emit
    from lockstep.codegen.exports import with_exports
    from lockstep.codegen.fixed_point import with_fixed, without_fixed
    from lockstep.codegen.from_design import BY_DEFAULT, specification
    from lockstep.codegen.limit_claims import with_limits
    from lockstep.codegen.message_redesign import lacks_messages
    from lockstep.codegen.sampled_design import certify_files, prove_design, with_sampled
    from lockstep.lmi.design_verdict import certify
    from lockstep.lmi.document import messages_answer, with_bound_proof

    asked = options or BY_DEFAULT
    found = f"`--optimize` is {asked.optimize!r}"
    demand(asked.optimize in ("speed", "size"), found, "", '"speed" or "size"')
    if asked.one_image and exports:
        expected = "one or the other: the exports are for agents with neighbours of their own"
        raise ProblemError(f"one image, and `--{min(exports)}`", where="lockstep generate", expected=expected)
    of_nodes = {"--max-neighbours": asked.max_neighbours is not None, "--table": asked.table != "none"}
    for option, given in of_nodes.items():
        if given and not asked.one_image:
            raise ProblemError(f"`{option}` with `--per-agent`", where="lockstep generate")
    stored = with_bound_proof(design.stored)
    verdict = certify(stored)
    if not verdict.certified:
        raise NotCertified(
            f"no C is generated from a design that is not certified: {verdict.reason}", **verdict.figures
        )
    claims = stored.claims.sampled
    if not (verdict.ok and claims.certified and claims.rho and claims.max_period):
        stored = with_limits(with_sampled(stored, prove_design(stored)), stored)
    if lacks_messages(stored):
        why = messages_answer(design.stored, certified=False)["messages"]["reason"]
        raise NotCertified(f"no C is generated: [network.messages] asks for more than is proved: {why}")
    stored = with_fixed(stored) if "fixed" in exports else without_fixed(stored)
    stored = replace(stored, claims=replace(stored.claims, scope=verdict.scope))
    files = with_exports(emit(specification(stored, asked)), exports)
    decided = certify_files(files, stored)
    if stored.claims.sampled.certified and not decided.ok:
        raise NotCertified(f"the C does not hold what its design claims: {decided.reason}", **decided.figures)
    return bundle(files, {DESIGN_NAME: to_json(stored.document()) + "\n"})
