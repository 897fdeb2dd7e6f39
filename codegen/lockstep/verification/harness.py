"""Build the folder's C with a small driver, feed it recorded calls, and read the trace back.

The driver is a program of its own: a crash of the code under test cannot take this process with it.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lockstep.check.errors import ClaimError
from lockstep.codegen.emission.calls import Calls
from lockstep.codegen.emission.rendering import render
from lockstep.codegen.manifest import AgentEntry, Manifest
from lockstep.verification.one_image import node_layout, unit_of
from lockstep.verification.stimulus import Trace
from lockstep.verification.toolchain import COMPILE_SECONDS, RUN_SECONDS, WARNINGS, Compiler, run


@dataclass(frozen=True, eq=False)
class Run:
    """One agent's trace on one target, with what was measured there."""

    trace: Trace
    state_bytes: int
    text_bytes: int | None = None
    instructions: int | None = None
    stack_bytes: int | None = None
    most_instructions: int | None = None


def layout(agent: AgentEntry, manifest: Manifest) -> dict[str, Any]:
    """What the driver's templates need to know of an agent."""
    q, m, nn, real = len(agent.outputs), len(agent.inputs), len(agent.neighbours), manifest.real_type.bytes
    return {
        "name": agent.name,
        "NAME": agent.name.upper(),
        "order": agent.order,
        "q": q,
        "m": m,
        "nn": nn,
        "in_bytes": [4, 8, q * real, nn * q * real, q * real],
        "out_bytes": [4, m * real, agent.order * real, nn * q * real, 8, 4 * nn, 4 * nn],
        **node_layout(agent, manifest),
        "limits": agent.limits is not None,
    }


def write_harness(manifest: Manifest, directory: Path) -> list[Path]:
    """Write harness.h and one harness per agent; returns the C files."""
    views = [layout(agent, manifest) for agent in manifest.agents]
    (directory / "harness.h").write_text(render("harness.h.j2", agents=views), encoding="utf-8")
    paths = []
    for view in views:
        path = directory / f"harness_{view['name']}.c"
        path.write_text(render("harness.c.j2", a=view, c_real=manifest.real_type.c_name), encoding="utf-8")
        paths.append(path)
    return paths


def compile_objects(
    compiler: Compiler, flags: Sequence[str], sources: Sequence[Path], include: Path, directory: Path
) -> list[Path]:
    """Compile each source to an object in `directory`, every warning an error; raises `ClaimError`."""
    objects = []
    compiling = [*compiler.command, *WARNINGS, *flags, f"-I{include}", f"-I{directory}", "-c"]
    for source in sources:
        target = directory / f"{source.stem}.o"
        command = [*compiling, str(source), "-o", str(target)]
        run(command, directory, f"compiling {source.name}", COMPILE_SECONDS)
        objects.append(target)
    return objects


def product_sources(manifest: Manifest, folder: Path) -> list[Path]:
    """The generated sources, one per agent, and that of the nodes."""
    return [folder / "src" / f"{unit}.c" for unit in dict.fromkeys(map(unit_of, manifest.agents))]


def run_on_host(
    manifest: Manifest,
    folder: Path,
    calls: Mapping[str, Calls],
    directory: Path,
    compiler: Compiler,
    flags: Sequence[str],
) -> Iterator[tuple[AgentEntry, Run]]:
    """Build once, then run each agent's calls; `directory` is a temporary one."""
    product = compile_objects(
        compiler, flags, product_sources(manifest, folder), folder / "include", directory
    )
    main = directory / "main.c"
    harness = [*write_harness(manifest, directory), main]
    main.write_text(
        render("host_main.c.j2", agents=[layout(a, manifest) for a in manifest.agents]), encoding="utf-8"
    )
    driver = compile_objects(compiler, flags, harness, folder / "include", directory)
    given = [(len(calls[agent.name]), inputs(calls[agent.name])) for agent in manifest.agents]
    names = [agent.name for agent in manifest.agents]
    blobs = drive(product + driver, given, names, compiler, flags, directory)
    for agent, (blob, state_bytes) in zip(manifest.agents, blobs, strict=True):
        trace = outputs(agent, manifest, len(calls[agent.name]), blob)
        yield agent, Run(trace, state_bytes, text_bytes(directory / f"{unit_of(agent)}.o"))


def drive(
    objects: Sequence[Path],
    given: Sequence[tuple[int, list[bytes]]],
    names: Sequence[str],
    compiler: Compiler,
    flags: Sequence[str],
    directory: Path,
) -> Iterator[tuple[bytes, int]]:
    """Link a driver, run it once per agent on its number of calls and its arrays: what it wrote, and `sizeof` the state."""
    program = directory / "driver"
    linking = [*compiler.command, *flags, *map(str, objects), "-o", str(program)]
    run(linking, directory, "linking", COMPILE_SECONDS)
    for index, (name, (count, arrays)) in enumerate(zip(names, given, strict=True)):
        asked, taken = directory / "calls.bin", directory / "trace.bin"
        asked.write_bytes(b"".join(arrays))
        command = [str(program), str(index), str(count), str(asked), str(taken)]
        run(command, directory, f"running {name}", RUN_SECONDS)
        blob = taken.read_bytes()
        yield blob[4:], int(np.frombuffer(blob[:4], np.uint32)[0])


def inputs(calls: Calls) -> list[bytes]:
    """The arrays that the harness reads, in its order."""
    words = calls.operation.astype(np.uint32), calls.received.astype(np.uint64)
    return [np.ascontiguousarray(one).tobytes() for one in (*words, calls.y, calls.neighbour_y, calls.r)]


def output_arrays(
    agent: AgentEntry, manifest: Manifest, count: int
) -> list[tuple[str, np.dtype[Any], tuple[int, ...]]]:
    """Name, type and shape of the arrays that the harness writes, in its order."""
    real, n = manifest.real_type.dtype, agent.order
    q, m = len(agent.outputs), len(agent.inputs)
    nn = len(agent.neighbours)
    return [
        ("status", np.dtype(np.int32), (count,)),
        ("u", real, (count, m)),
        ("x", real, (count, n)),
        ("held", real, (count, nn, q)),
        ("heard", np.dtype(np.uint64), (count,)),
        ("age", np.dtype(np.uint32), (count, nn)),
        ("misses", np.dtype(np.uint32), (count, nn)),
    ]


def outputs(agent: AgentEntry, manifest: Manifest, count: int, blob: bytes) -> Trace:
    """Read a trace from the arrays that the harness wrote one after the other."""
    parts: dict[str, np.ndarray] = {}
    offset = 0
    for name, dtype, shape in output_arrays(agent, manifest, count):
        size = int(np.prod(shape)) * dtype.itemsize
        if offset + size > len(blob):
            raise ClaimError(f"the trace of {agent.name} ends after {len(blob)} bytes")
        parts[name] = np.frombuffer(blob, dtype, int(np.prod(shape)), offset).reshape(shape)
        offset += size
    return Trace(**parts)


def text_bytes(object_file: Path) -> int | None:
    """Code and constants of an object file in bytes; None without pyelftools or if it is no ELF file."""
    try:
        from elftools.common.exceptions import ELFError
        from elftools.elf.constants import SH_FLAGS
        from elftools.elf.elffile import ELFFile
    except ImportError:
        return None
    with object_file.open("rb") as stream:
        try:
            sections = list(ELFFile(stream).iter_sections())
        except ELFError:
            return None
        return sum(
            int(s["sh_size"])
            for s in sections
            if s["sh_type"] == "SHT_PROGBITS"
            and s["sh_flags"] & SH_FLAGS.SHF_ALLOC
            and not s["sh_flags"] & SH_FLAGS.SHF_WRITE
            and s.name not in (".eh_frame", ".debug_frame")
        )
