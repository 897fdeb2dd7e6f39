"""Compile a campaign's C to a shared library, once: kept by the hash of the text and of how it was compiled."""

import ctypes
import hashlib
import platform
import tempfile
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

from lockstep.campaign.compiled.c_text import CFiles
from lockstep.campaign.compiled.source import CampaignSource
from lockstep.check.errors import ClaimError
from lockstep.verification.machines.shared_library import build_library
from lockstep.verification.toolchain import Compiler, first_compiler, own_folder

FLAGS = (
    # Every operation rounds once, whatever the machine: the results are those of any other machine's.
    *("-std=c99", "-O2", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math"),
    # GCC 12 fuses a b + c and a b - c of two neighbours all the same where it makes vectors of its own; ours are written out.
    "-fno-tree-vectorize",
    # Vectors wider than the machine's registers are passed in memory; nothing here is called from elsewhere.
    *("-Wall", "-Wextra", "-Wno-psabi", "-Wno-unknown-pragmas"),
)
FOR_THIS_MACHINE = ("-march=native",)
"""Wider registers, the same roundings. Left out where the compiler does not know it."""

SYMBOL = "lockstep_campaign"


def compiled(source: CFiles, compiler: Compiler | None = None) -> Path:
    """Return the path of the library of a source, compiled now if it was not before.

    Raises:
        ProblemError: there is no C compiler.
        ClaimError: the compiler refuses the C, with what it says.
    """
    compiler = compiler or first_compiler("campaign")
    library = own_folder("campaign") / f"{_key(source, compiler)}.so"
    if library.is_file():
        return library
    with tempfile.TemporaryDirectory(prefix="build-", dir=library.parent) as temporary:
        built = _build(source, compiler, Path(temporary))
        # A rename: another process sees the whole library or none.
        built.replace(library)
    return library


@lru_cache(maxsize=16)
def load(source: CampaignSource) -> Callable[..., None]:
    """Return the C function of a source, compiled if need be; calls release the interpreter's lock."""
    return function_in(compiled(source))


def function_in(library: Path) -> Callable[..., None]:
    """Return the C function of a compiled library."""
    function: Any = getattr(ctypes.CDLL(str(library)), SYMBOL)
    pointer: Any = ctypes.c_void_p
    function.argtypes = [ctypes.c_int64, *(pointer,) * 4, ctypes.c_int64, *(pointer,) * 2]
    function.restype = None
    found: Callable[..., None] = function
    return found


def _key(source: CFiles, compiler: Compiler) -> str:
    """A name for the text, the compiler as it is now, and the processor it compiles for."""
    program = Path(compiler.command[0])
    status = program.stat() if program.exists() else None
    known = (
        *(source.fingerprint, compiler.command, FLAGS, FOR_THIS_MACHINE, platform.machine(), _processor()),
        *((status.st_size, status.st_mtime_ns) if status else ()),
    )
    return hashlib.sha256(repr(known).encode()).hexdigest()[:32]


@lru_cache(maxsize=1)
def _processor() -> str:
    """The processor's features where Linux tells: a folder may be shared by different machines."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return platform.processor()
    return next((line for line in lines if line.startswith(("flags", "Features"))), platform.processor())


def _build(source: CFiles, compiler: Compiler, directory: Path) -> Path:
    for name, text in source.files:
        (directory / name).write_text(text, encoding="utf-8", newline="\n")
    units, what = [name for name, _ in source.files if name.endswith(".c")], "the campaign's loop"
    try:
        return build_library(compiler, (*FLAGS, *FOR_THIS_MACHINE), units, directory, what)
    except ClaimError:
        return build_library(compiler, FLAGS, units, directory, what)
