"""Where designs are read from and outputs may go."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from lockstep.check.errors import ProblemError

if TYPE_CHECKING:
    from lockstep.lmi.document import Stored

DESIGN_NAME = "design.json"


def check_writable(output: Path | None, *others: Path | None) -> None:
    """Refuse an output that could not be written, before hours are spent on what goes into it.

    Args:
        output: the file, or None.
        others: what is read, and what else is written: none of them is to be overwritten.
    """
    if output is None:
        return
    with seen(output):
        twice = any(other is not None and other.resolve() == output.resolve() for other in others)
        there, plain, above = output.exists(), output.is_file(), output.parent.is_dir()
    if twice:
        raise ProblemError(
            "it is named twice, and one would overwrite the other", where=str(output), expected="another file"
        )
    if there and not plain:
        found = "it is a folder" if output.is_dir() else "it is no plain file"
        raise ProblemError(found, where=str(output), expected="a file to write")
    if not above:
        raise ProblemError("there is no such folder", where=str(output.parent), remedy="make it first")
    check_takes_files(output.parent, output.name)


def check_takes_files(folder: Path, name: str = "") -> None:
    """Refuse a folder that takes no file of about this name, by making one.

    Permissions do not tell of a file system that is read-only, nor of how long a name may be.
    """
    try:
        with tempfile.NamedTemporaryFile(dir=folder, prefix=f".{name}.", suffix=".part"):
            pass
    except OSError as error:
        raise ProblemError(f"the folder takes no files ({error.strerror})", where=str(folder)) from None


@contextmanager
def seen(path: Path) -> Iterator[None]:
    """Refuse a path that cannot even be looked at: a name too long, or a folder above it that is closed to us."""
    try:
        yield
    except OSError as error:
        raise ProblemError(f"it cannot be used ({error.strerror})", where=str(path)) from None


def read_design(path: Path) -> "Stored":
    """Return what a design file says, from the file or from a folder that holds it."""
    from lockstep.check.design_file.json_text import A_DESIGN, parse_json
    from lockstep.check.files import as_text, read_inside
    from lockstep.lmi.document import parse, read

    with seen(path):
        is_folder = path.is_dir()
    if not is_folder:
        return read(path)
    place = str(path / DESIGN_NAME)
    text = as_text(read_inside(path, DESIGN_NAME, expected=A_DESIGN), place, A_DESIGN)
    return parse(parse_json(text, place), place)
