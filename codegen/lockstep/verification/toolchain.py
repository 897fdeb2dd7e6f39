"""The compilers at hand, and running them: with a time limit, in a temporary directory, errors as claims."""

import importlib.util
import os
import shlex
import shutil
import stat
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from lockstep.check.errors import ClaimError, demand

WARNINGS = (
    *(
        "-std=c99",
        "-Wall",
        "-Wextra",
        "-Wpedantic",
        "-Wconversion",
        "-Wdouble-promotion",
        "-Wmissing-prototypes",
    ),
    *("-Wshadow", "-Werror", "-ffp-contract=off"),
)
"""What the generated C must pass without a word; contraction is off because each operation rounds once."""

TO_INSTALL = "set CC, install gcc or clang, or the extra `toolchain`"
"""What to do where there is no compiler for this machine."""

COMPILE_SECONDS = 180
RUN_SECONDS = 600
"""After so long code counts as hung. A watchdog, not a measure: twenty thousand steps take seconds, minutes if emulated."""


@dataclass(frozen=True)
class Compiler:
    """A C compiler: its short name for reports and how to call it."""

    name: str
    command: tuple[str, ...]
    is_zig: bool = False


def zig() -> Compiler | None:
    """The compiler of the `ziglang` package (extra `toolchain`), if it is installed."""
    if importlib.util.find_spec("ziglang") is None:
        return None
    # At -O0 it would add a sanitizer that needs a library.
    command = (sys.executable, "-m", "ziglang", "cc", "-fno-sanitize=undefined")
    return Compiler("zig cc", command, is_zig=True)


def arm_gcc() -> Compiler | None:
    """GCC for bare ARM (Debian: gcc-arm-none-eabi), if it is installed."""
    path = shutil.which("arm-none-eabi-gcc")
    return Compiler("gcc", (path,)) if path else None


def host_compilers() -> list[Compiler]:
    """Each distinct compiler for this machine: `$CC`, gcc, clang, cc; if there is none of them, zig.

    Raises `ProblemError` if `$CC` is set to something that is not there.
    """
    found: dict[str, Compiler] = {}
    chosen = shlex.split(os.environ.get("CC", ""))
    for command in filter(None, [chosen, ["gcc"], ["clang"], ["cc"]]):
        path = shutil.which(command[0])
        if path is None:
            absent, remedy = f"`{command[0]}` is not found", "unset or correct it"
            demand(command is not chosen, absent, "the variable CC", remedy=remedy)
            continue
        found.setdefault(os.path.realpath(path), Compiler(Path(command[0]).name, (path, *command[1:])))
    fallback = zig()
    return list(found.values()) or ([fallback] if fallback else [])


def first_compiler(where: str) -> Compiler:
    """Return the first of `host_compilers`; raises `ProblemError` if there is none, saying where one is needed."""
    found = host_compilers()
    demand(found, "there is no C compiler", where, remedy=TO_INSTALL)
    return found[0]


def environment() -> dict[str, str]:
    """The environment for compilers: zig's cache outlives a run, since filling it takes about ten seconds."""
    values = dict(os.environ)
    if "ZIG_GLOBAL_CACHE_DIR" not in values:
        values["ZIG_GLOBAL_CACHE_DIR"] = str(own_folder("zig-cache"))
    return values


def own_folder(name: str) -> Path:
    """Return this user's own folder of a name in the temporary directory, made if need be.

    What is read from it runs: a folder that others could write to is not used, a fresh one is taken instead.
    """
    user = os.getuid() if hasattr(os, "getuid") else 0
    folder = Path(tempfile.gettempdir()) / f"lockstep-{name}-{user}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        status = folder.lstat()
        private = stat.S_ISDIR(status.st_mode) and status.st_uid == user and not status.st_mode & 0o022
    except OSError:
        private = False
    return folder if private else _fresh_folder(name)


@lru_cache
def _fresh_folder(name: str) -> Path:
    """One for as long as this process lasts."""
    return Path(tempfile.mkdtemp(prefix=f"lockstep-{name}-"))


def run(command: Sequence[str], directory: Path, what: str, seconds: float) -> str:
    """Run a command, return its output; raises `ClaimError` with its message if it fails or hangs."""
    try:
        done = subprocess.run(
            list(command),
            cwd=directory,
            env={**environment(), "ZIG_LOCAL_CACHE_DIR": str(directory / "zig-cache")},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=seconds,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise ClaimError(f"{what} took longer than {seconds} s", seconds=seconds) from None
    except OSError as error:
        raise ClaimError(f"{what} could not be started: {error.strerror}") from None
    if done.returncode != 0:
        message = done.stderr.decode(errors="replace").replace(f"{directory}{os.sep}", "").strip()
        raise ClaimError(
            f"{what} failed (status {done.returncode}): {message[:2000] or 'no message'}",
            status=done.returncode,
        )
    return done.stdout.decode(errors="replace")
