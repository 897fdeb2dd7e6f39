"""Where designs are read from and outputs may go."""

import tempfile
from pathlib import Path
from typing import Any

from lockstep.model.errors import ProblemError

DESIGN_NAME = "design.json"


def check_writable(output: Path | None) -> None:
    """Refuse an output that could not be written, before hours are spent on what goes into it."""
    if output is None:
        return
    if output.is_dir():
        raise ProblemError("it is a folder", where=str(output), expected="a file to write")
    if not output.parent.is_dir():
        raise ProblemError("there is no such folder", where=str(output.parent), remedy="make it first")
    check_takes_files(output.parent)


def check_takes_files(folder: Path) -> None:
    """Refuse a folder that takes no file, by making one: permissions do not tell of a file system that is read-only."""
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise ProblemError(f"the folder takes no files ({error.strerror})", where=str(folder)) from None


def check_can_be_made(folder: Path) -> None:
    """Refuse a folder of results that could not be made, with the folders above it, before it is computed."""
    above = next(path for path in folder.absolute().parents if path.exists() or path.is_symlink())
    if not above.is_dir():
        raise ProblemError("it is a file", where=str(above), expected="a folder")
    check_takes_files(above)


def read_design(path: Path) -> tuple[dict[str, Any], Any]:
    """Return a design file's content and what it says, from the file or from a folder that holds it."""
    from lockstep.lmi.document import load_json, parse

    place = path / DESIGN_NAME if path.is_dir() else path
    content = load_json(place)
    return content, parse(content, str(place))
