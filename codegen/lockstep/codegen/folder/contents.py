"""What a generated folder holds, entry by entry, against what it should hold.

A compiler or CMake may read any file of a folder in place of one that was proved: `include/stdint.h`, a precompiled
`src/arm1.h.gch/c99`, `CMakePresets.json`. So nothing stands in the folder but what Lockstep writes there.
"""

import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath

from lockstep.check.c_source.one_image import read_node
from lockstep.check.c_source.reader import read_controller
from lockstep.check.certify import DESIGN_NAME
from lockstep.check.errors import NotCertified, ProblemError, demand
from lockstep.check.files import as_text, named, read_inside
from lockstep.check.wording import shorten
from lockstep.codegen.emission.one_image import table_paths
from lockstep.codegen.exports import export_paths
from lockstep.codegen.exports.fmu import archives
from lockstep.codegen.manifest import FILE_NAME, Manifest, changed_files, units

MEASURED = ("report.html", "report.md")
_SHOWN = re.compile(r"figures/[a-z0-9_-]+\.(png|pdf)|evidence/[A-Za-z0-9_]+\.md")

MOST_ENTRIES = 20_000
"""Files and folders in a folder: four files for each agent, and figures."""

_MOST_LINES = 20
"""Entries told one by one; of more, their number."""


def not_proved(manifest: Manifest) -> tuple[str, ...]:
    """Return what a certificate says nothing about: drawings and evidence by their folder, measurements, compiled units."""
    whole = set(manifest.files) & {*MEASURED, *archives(manifest)}
    drawn = {f"{path.split('/')[0]}/" for path in manifest.files if _SHOWN.fullmatch(path)}
    return tuple(sorted(whole | drawn))


def strangers(folder: Path, manifest: Manifest) -> list[str]:
    """Return a line for each entry of a folder that Lockstep does not write there, or not in this form.

    Args:
        folder: the folder.
        manifest: for the names of its agents and the files that it lists.

    Raises:
        ProblemError: the folder cannot be listed.
    """
    expected = _expected(manifest)
    files = {FILE_NAME, *(path for path in manifest.files if path in expected or _SHOWN.fullmatch(path))}
    folders = {str(above) for path in files for above in PurePosixPath(path).parents}
    found = [
        f"{path} is listed in {FILE_NAME}, but is no file that is generated"
        for path in manifest.files
        if path not in files
    ]
    entries = entries_of(folder)
    holding = {str(above) for path in entries for above in PurePosixPath(path).parents}
    for path, entry in entries.items():
        shown = shorten(path)
        if entry.is_symlink():
            found.append(f"{shown} is a symbolic link: what it leads to is not part of the folder")
        elif entry.is_dir(follow_symlinks=False):
            if path not in folders | holding:
                found.append(f"{shown}/ was not generated")
        elif path not in files:
            found.append(f"{shown} was not generated, and a compiler may read it in place of what was")
        elif not entry.is_file(follow_symlinks=False):
            found.append(f"{shown} is no regular file")
    if len(found) > _MOST_LINES:
        found[_MOST_LINES:] = [f"and {len(found) - _MOST_LINES} more files that were not generated"]
    return found


def entries_of(folder: Path) -> dict[str, os.DirEntry[str]]:
    """Return everything in a folder by its path in it, folders included, links as what they are and never followed.

    Raises:
        ProblemError: no folder, not readable, or more than `MOST_ENTRIES` entries.
    """
    found: dict[str, os.DirEntry[str]] = {}
    with named(folder, "a folder"):
        waiting = [("", str(folder))]
        while waiting:
            prefix, place = waiting.pop()
            with os.scandir(place) as listed:
                for entry in listed:
                    found[prefix + entry.name] = entry
                    expected = f"at most {MOST_ENTRIES} files"
                    demand(len(found) <= MOST_ENTRIES, "it holds too much", str(folder), expected)
                    if entry.is_dir(follow_symlinks=False):
                        waiting.append((f"{prefix}{entry.name}/", entry.path))
    return dict(sorted(found.items()))


def refusals(folder: Path, manifest: Manifest) -> list[str]:
    """Return why the C of a folder is not compiled and run unasked: what was added or changed, or is no C of ours.

    Raises:
        ProblemError: a source is missing, or no text.
    """
    found = strangers(folder, manifest)
    found += [
        f"{path} is not what {FILE_NAME} says: it was changed, or is missing"
        for path in changed_files(folder, manifest)
    ]
    if found:
        return found
    agents = [agent.name for agent in manifest.agents]
    known = sorted({*agents, *(one.source for agent in manifest.agents for one in agent.neighbours)})
    try:
        for name in agents:
            header, source = _header_and_source(folder, name)
            read = read_controller(name, header, source, known)
        if manifest.image is not None:
            node = manifest.image.name
            read_node(node, agents, read, *_header_and_source(folder, node))
    except NotCertified as error:
        return [str(error)]
    return []


def _header_and_source(folder: Path, name: str) -> Iterator[str]:
    for path in (f"include/{name}.h", f"src/{name}.c"):
        yield as_text(read_inside(folder, path), path)


def differs(folder: Path, files: Mapping[str, str]) -> list[str]:
    """Return a line for each file of a folder whose bytes are not those of a text, with the first line that differs.

    Args:
        folder: the folder.
        files: relative path -> the text that is generated.
    """
    found = []
    for path, text in files.items():
        try:
            content = read_inside(folder, path)
        except ProblemError as error:
            found.append(f"{path} is not as it is generated: {error.found}")
            continue
        if content != text.encode():
            found.append(f"{path} is not what its design gives: {_first(content, text)}")
    return found


def _expected(manifest: Manifest) -> set[str]:
    names = [agent.name for agent in manifest.agents]
    per_agent = ("include/{}.h", "src/{}.c", "proof/{}_eva.c")
    return {
        *("CMakeLists.txt", "README.md", DESIGN_NAME, *MEASURED),
        *(f"include/{manifest.name}.h", f"src/{manifest.name}.c", f"cmake/{manifest.name}-config.cmake"),
        *(form.format(name) for name in names for form in per_agent),
        *(form.format(name) for name in units(manifest) for form in per_agent[:2]),
        *([] if manifest.image is None else table_paths(manifest.image.name, manifest.image.table)),
        *export_paths(manifest),
        *archives(manifest),
    }


def _first(content: bytes, text: str) -> str:
    """Say where two texts begin to differ."""
    theirs, ours = content.decode("utf-8", "replace").split("\n"), text.split("\n")
    for number, (found, generated) in enumerate(zip(theirs, ours, strict=False), start=1):
        if found != generated:
            same = next((k for k, c in enumerate(generated) if found[k : k + 1] != c), len(generated))
            part = slice(found.rfind(" ", 0, max(0, same - 20)) + 1, same + 40)  # from where a word begins
            return f"line {number}: `{shorten(found[part])}` where `{shorten(generated[part])}` is generated"
    return f"it has {len(theirs)} lines where {len(ours)} are generated"
