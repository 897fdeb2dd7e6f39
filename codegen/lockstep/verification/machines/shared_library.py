"""C in this process: a shared library, built by a compiler of this machine and loaded through ctypes."""

import ctypes
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from lockstep.verification.toolchain import COMPILE_SECONDS, Compiler, run


def build_library(
    compiler: Compiler, flags: Sequence[str], sources: Sequence[Path | str], directory: Path, what: str
) -> Path:
    """Compile sources to a library in a directory, in which the compiler is started; raises `ClaimError` as `run` does.

    what: is compiled, for the message.
    """
    library = directory / "library.so"
    shared = ("-fPIC", "-shared", *map(str, sources), "-o", str(library), "-lm")
    run([*compiler.command, *flags, *shared], directory, f"compiling {what}", COMPILE_SECONDS)
    return library


@contextmanager
def loaded(library: Path) -> Iterator[ctypes.CDLL]:
    """Give a library for as long as the context lasts, so that many can be had one after the other in one process."""
    opened = ctypes.CDLL(str(library))
    try:
        yield opened
    finally:
        close = ctypes.CDLL(None).dlclose
        close.argtypes = [ctypes.c_void_p]
        close(opened._handle)
