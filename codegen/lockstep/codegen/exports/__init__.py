"""Exports: more files of a generated folder, each kind asked for by one option, that carry the C into other tools.

Every one is text that follows from the manifest and the C alone, so `certify` renders it again and compares bytes. Which
exports a folder has is read off the paths that its manifest lists.
"""

from collections import defaultdict
from collections.abc import Callable, Collection, Mapping

from lockstep.check.errors import ProblemError, demand
from lockstep.codegen.bundle import bundle
from lockstep.codegen.exports import arduino, dbc, fixed_point, fmu, messages, pil, rust
from lockstep.codegen.manifest import FILE_NAME, Manifest

Texts = dict[str, str]

EXPORTS: dict[str, Callable[[Manifest, Mapping[str, str]], Texts]] = {
    "pil": pil.files,
    "fmu": fmu.files,
    "rust": rust.files,
    "arduino": arduino.files,
    "messages": messages.files,
    "dbc": dbc.files,
    "fixed": fixed_point.files,
}
"""By name, which is the option of `generate` and the first part of the paths: (manifest, the folder's texts) -> texts."""


def with_exports(files: Mapping[str, str], exports: Collection[str]) -> Texts:
    """Return the files of a folder with those of some exports, in the order of `EXPORTS`, listed in the manifest.

    Args:
        files: what `emit` returns.
        exports: names.

    Raises:
        ProblemError: no such export.
    """
    if unknown := sorted(set(exports) - set(EXPORTS)):
        raise ProblemError(f"`{unknown[0]}`", where="exports", expected=" or ".join(EXPORTS))
    expected = "both: it describes the bytes of its messages"
    demand("dbc" not in exports or "messages" in exports, "no `--messages`", "--dbc", expected)
    if not exports:
        return dict(files)
    return bundle(files, _rendered(Manifest.model_validate_json(files[FILE_NAME]), exports, files))


def exports_of(manifest: Manifest) -> list[str]:
    """Return the names of the exports of which a manifest lists a file."""
    first = {path.partition("/")[0] for path in manifest.files if "/" in path}
    return [export for export in EXPORTS if export in first]


def export_paths(manifest: Manifest) -> set[str]:
    """Return the paths of all files that the exports of a folder have."""
    return set(_rendered(manifest, exports_of(manifest), defaultdict(str)))


def _rendered(manifest: Manifest, exports: Collection[str], files: Mapping[str, str]) -> Texts:
    return {
        path: text
        for export, render in EXPORTS.items()
        if export in exports
        for path, text in render(manifest, files).items()
    }
