"""Where outputs may go, files written as a whole, and the file's name in what is wrong with it."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from lockstep.check.errors import ProblemError, demand
from lockstep.model.whole_file import write_whole


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
    demand(not twice, "it is named twice, and one would overwrite the other", str(output), "another file")
    if there and not plain:
        found = "it is a folder" if output.is_dir() else "it is no plain file"
        raise ProblemError(found, where=str(output), expected="a file to write")
    demand(above, "there is no such folder", str(output.parent), remedy="make it first")
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


@contextmanager
def of_file(path: Path | None) -> Iterator[None]:
    """Name the file in whatever turns out to be wrong with what it holds; None: there is no file."""
    try:
        yield
    except ProblemError as error:
        raise (error if path is None or str(path) in error.where else error.within(str(path))) from None


def write_text(path: Path, text: str) -> None:
    """Write a file as a whole or not at all."""
    write_whole(path, text.encode())
