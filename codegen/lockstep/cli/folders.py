"""A folder of results that stand beside whatever is in it, such as figures."""

import os
from collections.abc import Mapping
from pathlib import Path

from lockstep.cli.files import check_takes_files
from lockstep.model.errors import ProblemError


def check_folder(folder: Path) -> None:
    """Refuse a folder that could not be made or written to."""
    if folder.exists() and not folder.is_dir():
        raise ProblemError("it is a file", where=str(folder), expected="a folder, or none yet")
    parent = folder if folder.is_dir() else folder.parent
    if not parent.is_dir():
        raise ProblemError("there is no such folder", where=str(parent), remedy="make it first")
    check_takes_files(parent)


def write_files(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files into a folder, made if need be: all of them are there, beside the old ones, before any is replaced."""
    fresh: dict[Path, Path] = {}
    try:
        folder.mkdir(exist_ok=True)
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
