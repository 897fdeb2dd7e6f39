"""Whether a folder is as it is generated: beyond what the checker decides of its design and its C.

Nothing stands in it but what Lockstep writes there, and every text file that follows from the design is rendered again and
compared, byte by byte: headers, sources, harness, CMakeLists.txt, README.md, manifest.json. A report is no such file: it
shows measurements of the machine it was built on, and is named as not proved, as are figures.
"""

from dataclasses import dataclass, replace
from pathlib import Path

from lockstep.check.errors import ProblemError, demand
from lockstep.check.files import read_inside
from lockstep.codegen.bundle import bundle
from lockstep.codegen.emission.emit import emit
from lockstep.codegen.exports import exports_of, with_exports
from lockstep.codegen.exports.fmu import archives_differ
from lockstep.codegen.folder.contents import differs, not_proved, strangers
from lockstep.codegen.from_design import CodeOptions, has_one_controller, specification
from lockstep.codegen.manifest import Manifest, changed_files, load_manifest
from lockstep.lmi.document import Stored


@dataclass(frozen=True)
class Comparison:
    """Where a folder is not what its design says.

    differences: one line for each thing that differs;  not_proved: files of which nothing is said: reports and figures.
    """

    differences: tuple[str, ...]
    not_proved: tuple[str, ...]


def compared(folder: Path, stored: Stored) -> Comparison:
    """Compare a folder with what is generated from the design in it.

    The files print what the design claims, which does not depend on the last bits of a machine; that it claims no more than
    is proved is the checker's to decide.

    Raises:
        ProblemError: no folder of ours, or one for other agents.
    """
    manifest = load_manifest(folder)
    problem_fits(stored, manifest)
    differences = strangers(folder, manifest)
    changed = changed_files(folder, manifest)
    differences += [f"{one} was changed: manifest.json has another SHA-256 of it" for one in changed]
    differences += _misnamed(manifest, stored)
    rendered = _rendered(folder, stored, manifest)
    differences += differs(folder, rendered) + archives_differ(folder, manifest, rendered)
    return Comparison(tuple(differences), not_proved(manifest))


def _rendered(folder: Path, stored: Stored, manifest: Manifest) -> dict[str, str]:
    """Return the text of every file that follows from the design; of the manifest only the hashes of others are read."""
    image = manifest.image
    options = CodeOptions(manifest.optimize, manifest.name, manifest.prefix)
    if image is not None:
        options = replace(options, one_image=True, max_neighbours=image.max_neighbours, table=image.table)
    files = with_exports(emit(specification(stored, options)), exports_of(manifest))
    others = {path: _bytes(folder, path) for path in manifest.files if path not in files}
    together = bundle(files, others)
    return {path: str(together[path]) for path in files}


def _bytes(folder: Path, path: str) -> bytes:
    """Return the bytes of a file, none for one that cannot be read: that it is missing is told already."""
    try:
        return read_inside(folder, path)
    except ProblemError:
        return b""


def _misnamed(manifest: Manifest, stored: Stored) -> list[str]:
    """Say whether the agents are not in the design's order: each is proved with the inputs B of its place in it."""
    base, names = f"{manifest.prefix}{stored.problem.agent().name}", [agent.name for agent in manifest.agents]
    expected = [f"{base}{i}" for i in range(1, stored.gains.N + 1)]
    if manifest.image is not None and has_one_controller(stored):
        expected = [base]
    if names == expected:
        return []
    return [f"manifest.json lists the agents as {', '.join(names)}, the design as {', '.join(expected)}"]


def problem_fits(stored: Stored, manifest: Manifest) -> None:
    """Refuse a design that is not about the agents of a folder.

    Raises:
        ProblemError: another number of agents.
    """
    count = len(manifest.agents) if manifest.image is None else manifest.image.agents
    found = f"{count} controllers"
    demand(count == stored.gains.N, found, "manifest.json", f"{stored.gains.N}, as in the design")
