"""The one way in which a file is read: a regular file, up to a size, UTF-8 where it is text, and never out of its folder.

A path that a user names may be a link, as paths are; inside a folder that is read as a whole there are none. A pipe or
a device is refused before it is opened: opening one may wait for ever, or do something.
"""

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath

from lockstep.check.errors import ProblemError, demand
from lockstep.check.wording import shorten

LARGEST = 10_000_000
"""Bytes: a thousand agents with full gains fit, a wrong file is refused before it fills the memory."""


def read_bytes(path: Path, *, expected: str = "a file", at_most: int = LARGEST) -> bytes:
    """Return the bytes of a regular file.

    Args:
        path: of the file; a link to one will do.
        expected: what it should be, for the message.
        at_most: bytes.

    Raises:
        ProblemError: missing, no regular file, larger than `at_most`, or not readable.
    """
    return _read(path, expected, at_most, follow=True)


def read_text(path: Path, *, expected: str = "a file", at_most: int = LARGEST) -> str:
    """Return the text of a regular file in UTF-8.

    Raises:
        ProblemError: as `read_bytes`, and for bytes that are not UTF-8.
    """
    return as_text(read_bytes(path, expected=expected, at_most=at_most), str(path), expected)


def as_text(content: bytes, where: str, expected: str = "a file") -> str:
    """Return bytes as text, strictly: what is not UTF-8 is refused with its place."""
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError as error:
        raise ProblemError(
            f"byte {error.start + 1} is not UTF-8 (0x{error.object[error.start]:02x})",
            where=where,
            expected=expected,
            remedy="save it as UTF-8",
        ) from None


def read_inside(folder: Path, relative: str, *, expected: str = "a file", at_most: int = LARGEST) -> bytes:
    """Return the bytes of a file in a folder, which is reached through no link below the folder.

    Args:
        folder: the folder; it may be a link itself.
        relative: the path in it, with `/`.
        expected, at_most: as of `read_bytes`.

    Raises:
        ProblemError: as `read_bytes`, and for a path that leaves the folder or meets a link.
    """
    parts = inside(relative, str(folder))
    place = folder
    for part in parts[:-1]:
        place = place / part
        if place.is_symlink():
            raise _linked(place)
    return _read(place / parts[-1], expected, at_most, follow=False)


def text_inside(folder: Path, relative: str, *, expected: str = "a file") -> str:
    """Return the text of a file in a folder, as `read_inside` its bytes."""
    return as_text(read_inside(folder, relative, expected=expected), relative, expected)


def inside(relative: str, where: str) -> tuple[str, ...]:
    """Return the parts of a path in a folder; raises `ProblemError` for one that may leave it.

    >>> inside("src/arm1.c", "arms")
    ('src', 'arm1.c')
    """
    path = PurePosixPath(relative)
    parts = path.parts
    leaves = not parts or path.is_absolute() or ".." in parts or any(c in relative for c in "\\\0:")
    demand(not leaves, f"the path `{shorten(relative)}` leaves the folder", where)
    return parts


def _read(path: Path, expected: str, at_most: int, *, follow: bool) -> bytes:
    with named(path, expected):
        _check(path.stat() if follow else path.lstat(), path, expected, at_most)
        flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
        if not follow:
            flags |= getattr(os, "O_NOFOLLOW", 0)
        with os.fdopen(os.open(path, flags), "rb") as stream:
            # Another file may have taken its place since.
            _check(os.fstat(stream.fileno()), path, expected, at_most)
            content = stream.read(at_most + 1)
    demand(len(content) <= at_most, f"it has more than {at_most} bytes", str(path), f"at most {at_most}")
    return content


def _check(status: os.stat_result, path: Path, expected: str, at_most: int) -> None:
    if stat.S_ISLNK(status.st_mode):
        raise _linked(path)
    found = "it is a directory" if stat.S_ISDIR(status.st_mode) else "it is no regular file"
    demand(stat.S_ISREG(status.st_mode), found, str(path), expected)
    small = status.st_size <= at_most
    demand(small, f"it has {status.st_size} bytes", str(path), f"at most {at_most}")


def _linked(path: Path) -> ProblemError:
    return ProblemError(
        "it is a symbolic link",
        where=str(path),
        expected="a file of the folder's own",
        remedy="generate the folder again",
    )


@contextmanager
def named(path: Path, expected: str) -> Iterator[None]:
    """Say of an operating system's error which file it is about."""
    try:
        yield
    except (FileNotFoundError, ValueError):
        # ValueError: a null character in the path, which no file's has.
        raise ProblemError("there is no such file", where=str(path), expected=expected) from None
    except OSError as error:
        raise ProblemError(
            f"it cannot be read ({error.strerror})", where=str(path), expected=expected
        ) from None
