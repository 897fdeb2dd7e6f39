"""Folders of results: whether they can be made, and files that stand beside whatever is in one, such as figures."""

import os
from collections.abc import Mapping
from pathlib import Path

from lockstep.check.errors import ProblemError, demand
from lockstep.workflow.output_files import check_takes_files, seen


def is_generated(path: Path) -> bool:
    """Tell whether a path is a folder of generated C."""
    from lockstep.codegen.manifest import FILE_NAME

    return path.is_dir() and (path / FILE_NAME).is_file()


def check_folder(folder: Path) -> None:
    """Refuse a folder that could not be made, with the folders above it, or written to, before anything is computed."""
    whole = folder.absolute()
    with seen(folder):
        there = next(place for place in (whole, *whole.parents) if place.exists() or place.is_symlink())
        demand(there.is_dir(), "it is no folder", str(there), "a folder, or none yet")
    check_takes_files(there)


def check_generated(folder: Path) -> None:
    """Refuse a folder that could not be written and renamed as a whole, before anything is computed."""
    from lockstep.codegen.folder import check_replaceable

    with seen(folder):
        check_replaceable(folder)
    # It is written beside the folder and renamed: the folder above it is what takes files.
    check_folder(folder.absolute().parent)


def write_files(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files into a folder, made if need be: all of them are there, beside the old ones, before any is replaced."""
    fresh: dict[Path, Path] = {}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in files.items():
            part = folder / f".{name}.{os.getpid()}.part"
            fresh[part] = folder / name
            part.write_bytes(content)
        for part, place in fresh.items():
            part.replace(place)
    except OSError as error:
        raise ProblemError(f"it cannot be written ({error.strerror})", where=str(folder)) from None
    finally:
        for part in fresh:
            part.unlink(missing_ok=True)
