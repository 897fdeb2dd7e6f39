"""FMI 3.0 units compiled for this machine, packed with their sources."""

import platform
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

from lockstep.codegen.exports.fmu import archives, packed
from lockstep.codegen.manifest import FILE_NAME, Manifest
from lockstep.verification.machines.shared_library import build_library
from lockstep.verification.toolchain import host_compilers

_FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fvisibility=hidden")
_SYSTEMS = {"linux": ("linux", "so"), "darwin": ("darwin", "dylib")}


def units(files: Mapping[str, str]) -> dict[str, bytes]:
    """Return the archive of each agent, path -> bytes: sources alone on a machine without a compiler.

    Args:
        files: of a folder with the export "fmu".

    Raises:
        ClaimError: the compiler refuses the sources.
    """
    manifest = Manifest.model_validate_json(files[FILE_NAME])
    return {path: packed(name, files, _binary(name, files)) for path, name in archives(manifest).items()}


def _binary(name: str, files: Mapping[str, str]) -> dict[str, bytes]:
    compilers, system = host_compilers(), _SYSTEMS.get(sys.platform)
    if not compilers or system is None:
        return {}
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(platform.machine().lower(), platform.machine())
    with tempfile.TemporaryDirectory(prefix="lockstep-") as temporary:
        directory = Path(temporary).resolve()
        sources = {
            f"{name}.h": files[f"include/{name}.h"],
            f"{name}.c": files[f"src/{name}.c"],
            "fmi3.c": files[f"fmu/{name}/sources/fmi3.c"],
        }
        for path, text in sources.items():
            (directory / path).write_text(text, encoding="utf-8")
        built = build_library(compilers[0], _FLAGS, [f"{name}.c", "fmi3.c"], directory, f"the unit {name}")
        return {f"binaries/{machine}-{system[0]}/{name}.{system[1]}": built.read_bytes()}
