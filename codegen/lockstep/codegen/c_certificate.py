"""The certificate of the C itself: of the controllers in a folder, or printed and not yet written, by their text.

`from_c` reads the numbers, `sampled_design` proves them. A folder is compared with its manifest besides.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lockstep.check.errors import NotCertified, ProblemError
from lockstep.codegen.c_file import nearest
from lockstep.codegen.from_c import ReadController, read_controller, read_controllers
from lockstep.codegen.manifest import FILE_NAME, Manifest, changed_files, load_manifest
from lockstep.codegen.sampled_design import HeldVerdict, prove_controllers, sampled_network
from lockstep.lmi.document import Stored
from lockstep.lmi.sampled import SampledVerdict


@dataclass(frozen=True)
class FolderVerdict:
    """What is proved of the C in a folder, and where that C is not what its manifest says.

    held: of the coefficients and the period in the C;  differences: one line for each thing that differs.
    """

    held: HeldVerdict
    differences: tuple[str, ...]

    @property
    def ok(self) -> bool:
        """Whether the proof holds and the C is what the manifest says."""
        return self.held.verdict.certified and not self.differences


def certify_folder(folder: Path, stored: Stored) -> FolderVerdict:
    """Prove the controllers in a folder by the numbers in their C.

    Args:
        folder: as `lockstep generate` writes it.
        stored: the design beside it, for the agents and alpha, which is proved again; its witnesses are tried first.

    Raises:
        ProblemError: no folder of ours, or one for other agents.
        BoundNotProved: alpha does not bound the nonlinearity.
    """
    manifest = load_manifest(folder)
    problem_fits(stored, manifest)
    differences = [f"{path} is not what manifest.json says it is" for path in changed_files(folder, manifest)]
    names = [agent.name for agent in manifest.agents]
    differences += _misnamed(names, stored) + _strangers(folder, names)
    network = sampled_network(stored, manifest.period)
    try:
        read = read_controllers(folder, names)
        period = _period(read, manifest)
    except NotCertified as error:
        refused = SampledVerdict(False, str(error), manifest.period, network.delay)
        return FolderVerdict(HeldVerdict(refused), tuple(differences))
    differences += _differences(read, manifest, period)
    controllers = tuple(one.controller for one in read)
    held = prove_controllers(stored, network.at(period), controllers)
    return FolderVerdict(held, tuple(differences))


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


def _misnamed(names: list[str], stored: Stored) -> list[str]:
    """Say whether the agents are not in the design's order: each is proved with the inputs B of its place in it."""
    expected = [f"{stored.problem.agent().name}{i}" for i in range(1, stored.gains.N + 1)]
    if names == expected:
        return []
    return [
        f"manifest.json lists the agents as {', '.join(names)}; in the design they are {', '.join(expected)}"
    ]


def _strangers(folder: Path, names: list[str]) -> list[str]:
    """Return a line for each file that a compiler may read in place of a header that was proved.

    With -Iinclude that is any other file there: include/stdint.h, or a precompiled include/arm1.h.gch; and a header
    beside the source that includes it.
    """
    known = {f"{name}.h" for name in names}
    found = [
        path
        for path in _files(folder / "include")
        if path.relative_to(folder / "include").as_posix() not in known
    ]
    found += [path for path in _files(folder / "src") if ".h" in path.name]
    return [
        f"{path.relative_to(folder).as_posix()} was not generated, and a compiler may read it in place of what was"
        for path in found
    ]


def _files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if not path.is_dir())


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
