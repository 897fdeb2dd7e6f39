"""The certificate of the C itself: of the controllers in a folder, or printed and not yet written, by their text.

`lockstep.check.c_source` reads the numbers, `sampled_design` proves them. Every text file of a folder is then rendered again
from its design and what was proved, and compared byte by byte: headers, sources, CMakeLists.txt, README.md, manifest.json.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lockstep.check.c_source.reader import ReadController, read_controller
from lockstep.check.c_source.text import nearest
from lockstep.check.errors import NotCertified, ProblemError
from lockstep.check.files import read_inside
from lockstep.codegen.bundle import bundle
from lockstep.codegen.contents import DESIGN_NAME, differs, not_proved, strangers
from lockstep.codegen.emit import emit
from lockstep.codegen.from_c import read_controllers
from lockstep.codegen.from_design import specification
from lockstep.codegen.manifest import FILE_NAME, Manifest, changed_files, load_manifest
from lockstep.codegen.sampled_design import (
    HeldVerdict,
    prove_controllers,
    sampled_network,
    stated_verdict,
)
from lockstep.lmi.certify import Verdict
from lockstep.lmi.document import Stored
from lockstep.lmi.sampled import SampledVerdict


@dataclass(frozen=True)
class FolderVerdict:
    """What is proved of the C in a folder, and where the folder is not what its design says.

    held: of the coefficients and the period in the C;  differences: one line for each thing that differs;  not_proved:
    files that the certificate says nothing about: drawings, simulations and measurements.
    """

    held: HeldVerdict
    differences: tuple[str, ...]
    not_proved: tuple[str, ...] = ()

    @property
    def ok(self) -> bool:
        """Whether the proof holds and the folder is what its design says."""
        return self.held.verdict.certified and not self.differences


def certify_folder(folder: Path, stored: Stored, verdict: Verdict) -> FolderVerdict:
    """Prove the controllers in a folder by the numbers in their C, and that the folder is what its design says.

    Args:
        folder: as `lockstep generate` writes it.
        stored: the design in it, for the agents and alpha, which is proved again; its witnesses are tried first.
        verdict: what was proved of the design's continuous controllers just now.

    Raises:
        ProblemError: no folder of ours, or one for other agents.
        BoundNotProved: alpha does not bound the nonlinearity.
    """
    manifest = load_manifest(folder)
    problem_fits(stored, manifest)
    differences = strangers(folder, manifest)
    differences += [
        f"{path} is not what manifest.json says it is" for path in changed_files(folder, manifest)
    ]
    names = [agent.name for agent in manifest.agents]
    differences += _misnamed(names, stored, manifest.prefix)
    network = sampled_network(stored, manifest.period)
    try:
        read = read_controllers(folder, names)
        period = _period(read, manifest)
    except NotCertified as error:
        refused = SampledVerdict(False, str(error), manifest.period, network.delay)
        return FolderVerdict(HeldVerdict(refused), tuple(differences))
    differences += _differences(read, manifest, period)
    controllers = tuple(one.controller for one in read)
    held = prove_controllers(stored, network.at(period), controllers, longest=False)
    if held.verdict.certified:
        differences += [f"{DESIGN_NAME}: {said}" for said in stored.claims.sampled.better_than(held.claims())]
    if verdict.certified:
        differences += differs(folder, _rendered(folder, stored, verdict, manifest))
    return FolderVerdict(held, tuple(differences), not_proved(manifest))


def _rendered(folder: Path, stored: Stored, verdict: Verdict, manifest: Manifest) -> dict[str, str]:
    """Return the text of every file that follows from the design; of the manifest only the hashes of others are read.

    The files print what the design claims of its sampled controllers, which does not depend on the last bits of a
    machine; that it claims no more than is proved is asked apart.
    """
    names = {"name": manifest.name, "prefix": manifest.prefix}
    files = emit(
        specification(stored, verdict, optimize=manifest.optimize, held=stated_verdict(stored), **names)
    )
    others = {path: _bytes(folder, path) for path in manifest.files if path not in files}
    together = bundle(files, others)
    return {path: str(together[path]) for path in files}


def _bytes(folder: Path, path: str) -> bytes:
    """Return the bytes of a file, none for one that cannot be read: that it is missing is told already."""
    try:
        return read_inside(folder, path)
    except ProblemError:
        return b""


def certify_texts(files: Mapping[str, str], stored: Stored, *, longest: bool = True) -> HeldVerdict:
    """Prove controllers that are printed and not yet written, by the numbers in their text.

    Args:
        files: what `emit` returns: relative path -> text.
        stored: the design; its witnesses are tried first.
        longest: whether to look for the largest period of the design's gains too.
    """
    manifest = Manifest.model_validate_json(files[FILE_NAME])
    names = [agent.name for agent in manifest.agents]
    read = [
        read_controller(name, files[f"include/{name}.h"], files[f"src/{name}.c"], names) for name in names
    ]
    network = sampled_network(stored, _period(read, manifest))
    controllers = tuple(one.controller for one in read)
    return prove_controllers(stored, network, controllers, longest=longest)


def _period(read: list[ReadController], manifest: Manifest) -> float:
    """Return the period in the C: the manifest's double where the header's literal is its rounding."""
    literals = {one.period_literal for one in read}
    if len(literals) != 1:
        raise NotCertified(f"the headers state different periods: {', '.join(sorted(literals))}")
    (literal,) = literals
    same = nearest(literal, manifest.real) == float(manifest.real_type.dtype.type(manifest.period))
    return manifest.period if same else read[0].period


def _misnamed(names: list[str], stored: Stored, prefix: str) -> list[str]:
    """Say whether the agents are not in the design's order: each is proved with the inputs B of its place in it."""
    expected = [f"{prefix}{stored.problem.agent().name}{i}" for i in range(1, stored.gains.N + 1)]
    if names == expected:
        return []
    return [
        f"manifest.json lists the agents as {', '.join(names)}; in the design they are {', '.join(expected)}"
    ]


def _differences(read: list[ReadController], manifest: Manifest, period: float) -> list[str]:
    """Compare the C with its manifest, number by number."""
    found = []
    if period != manifest.period:
        found.append(f"the headers state a period of {period:g} s, manifest.json {manifest.period:g} s")
    names = [agent.name for agent in manifest.agents]
    for one, agent in zip(read, manifest.agents, strict=True):
        if one.real != manifest.real:
            found.append(f"src/{one.name}.c computes in {one.real}, manifest.json says {manifest.real}")
            continue
        table = agent.table(manifest.real_type).astype(float)
        if table.shape != one.controller.table.shape:
            found.append(f"src/{one.name}.c has gains of another size than manifest.json")
            continue
        for row, column in np.argwhere(table != one.controller.table):
            values = f"{one.controller.table[row, column]:.9g}, manifest.json {table[row, column]:.9g}"
            found.append(f"src/{one.name}.c: entry ({row + 1}, {column + 1}) of [A B; C D] is {values}")
        sources = tuple(names.index(s.source) if s.source in names else -1 for s in agent.neighbours)
        weights = agent.weights(manifest.real_type).astype(float)
        if sources != one.controller.sources or not np.array_equal(weights, one.controller.weights):
            found.append(
                f"{one.name} listens to others in its C than in manifest.json, or with other weights"
            )
    return found


def problem_fits(stored: Stored, manifest: Manifest) -> None:
    """Refuse a design that is not about the agents of a folder.

    Raises:
        ProblemError: another number of agents.
    """
    if len(manifest.agents) != stored.gains.N:
        raise ProblemError(
            f"{len(manifest.agents)} controllers",
            where="manifest.json",
            expected=f"{stored.gains.N}, as in the design",
        )
