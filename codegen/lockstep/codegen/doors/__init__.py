"""Doors: more files of a generated folder, each kind asked for by one option, that carry the C into others' tools.

Every one is text that follows from the manifest and the C alone, so `certify` renders it again and compares bytes. Which
doors a folder has is read off the paths that its manifest lists.
"""

from collections import defaultdict
from collections.abc import Callable, Collection, Mapping

from lockstep.check.errors import ProblemError, demand
from lockstep.codegen.doors import arduino, dbc, fixed, fmu, messages, pil, rust
from lockstep.codegen.folder.bundle import bundle
from lockstep.codegen.manifest import FILE_NAME, Manifest

Texts = dict[str, str]

DOORS: dict[str, Callable[[Manifest, Mapping[str, str]], Texts]] = {
    "pil": pil.files,
    "fmu": fmu.files,
    "rust": rust.files,
    "arduino": arduino.files,
    "messages": messages.files,
    "dbc": dbc.files,
    "fixed": fixed.files,
}
"""By name, which is the option of `generate` and the first part of the paths: (manifest, the folder's texts) -> texts."""


def with_doors(files: Mapping[str, str], doors: Collection[str]) -> Texts:
    """Return the files of a folder with those of some doors, in the order of `DOORS`, listed in the manifest.

    Args:
        files: what `emit` returns.
        doors: names.

    Raises:
        ProblemError: no such door.
    """
    if unknown := sorted(set(doors) - set(DOORS)):
        raise ProblemError(f"`{unknown[0]}`", where="doors", expected=" or ".join(DOORS))
    expected = "both: it describes the bytes of its messages"
    demand("dbc" not in doors or "messages" in doors, "no `--messages`", "--dbc", expected)
    if not doors:
        return dict(files)
    return bundle(files, _rendered(Manifest.model_validate_json(files[FILE_NAME]), doors, files))


def doors_of(manifest: Manifest) -> list[str]:
    """Return the names of the doors of which a manifest lists a file."""
    first = {path.partition("/")[0] for path in manifest.files if "/" in path}
    return [door for door in DOORS if door in first]


def door_paths(manifest: Manifest) -> set[str]:
    """Return the paths of all files that the doors of a folder have."""
    return set(_rendered(manifest, doors_of(manifest), defaultdict(str)))


def _rendered(manifest: Manifest, doors: Collection[str], files: Mapping[str, str]) -> Texts:
    return {
        path: text
        for door, render in DOORS.items()
        if door in doors
        for path, text in render(manifest, files).items()
    }
