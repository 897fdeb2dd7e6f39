"""The runner of `pil/` on QEMU's Cortex-M7 with the double-precision unit, which Unicorn does not decode.

Machine mps2-an500; what is computed comes back by semihosting, as the same log that a board prints.
"""

import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path

from lockstep.check.errors import ClaimError, ProblemError
from lockstep.codegen.cost.cores import Core
from lockstep.codegen.emission.calls import Calls
from lockstep.codegen.emission.rendering import render
from lockstep.codegen.exports.pil import runner
from lockstep.codegen.manifest import AgentEntry, Manifest
from lockstep.verification.harness import Run, compile_objects, text_bytes
from lockstep.verification.machines.image import check_calls, machine_flags
from lockstep.verification.one_image import without_nodes
from lockstep.verification.pil_log import runs
from lockstep.verification.toolchain import COMPILE_SECONDS, RUN_SECONDS, Compiler, run

QEMU = "qemu-system-arm"

M7 = Core(
    "qemu-cortex-m7",
    "Cortex-M7 with double precision",
    "arm",
    "",
    ("-target", "thumb-freestanding-eabihf", "-mcpu=cortex_m7+fp_armv8d16"),
    ("-mthumb", "-mcpu=cortex-m7", "-mfloat-abi=hard", "-mfpu=fpv5-d16"),
    ("float32", "float64"),
)


def missing() -> list[str]:
    """Return the programs that are not installed."""
    return [] if shutil.which(QEMU) else [QEMU]


def run_on_qemu(
    manifest: Manifest,
    folder: Path,
    calls: Mapping[str, Calls],
    directory: Path,
    compiler: Compiler,
    level: str,
) -> Iterator[tuple[AgentEntry, Run]]:
    """Build and run an image per agent: its C, the runner with its calls, and the way from reset to main.

    Raises:
        ClaimError: it cannot be built, calls a library, hangs, or prints no whole log.
    """
    manifest = without_nodes(manifest)
    for agent in manifest.agents:
        made = _image(agent, manifest, folder, calls[agent.name], compiler, level, directory)
        log = directory / "log.txt"
        machine = [QEMU, "-M", "mps2-an500", "-display", "none", "-serial", "null", "-monitor", "none"]
        channel = ["-chardev", f"file,id=log,path={log.name}"]
        channel += ["-semihosting-config", "enable=on,target=native,chardev=log"]
        run([*machine, *channel, "-kernel", str(made)], directory, f"running {agent.name}", RUN_SECONDS)
        count = {agent.name: len(calls[agent.name])}
        try:
            ((_, found),) = runs(log.read_text(errors="replace"), manifest, count, QEMU)
        except ProblemError as error:
            raise ClaimError(str(error)) from None
        yield agent, Run(found.trace, found.state_bytes, text_bytes(directory / f"{agent.name}.o"))


def _image(
    agent: AgentEntry,
    manifest: Manifest,
    folder: Path,
    calls: Calls,
    compiler: Compiler,
    level: str,
    directory: Path,
) -> Path:
    texts = runner(manifest, {agent.name: calls})
    texts |= {"start.c": render("qemu_start.c.j2"), "support.c": render("support.c.j2")}
    texts |= {"qemu.ld": render("qemu.ld.j2")}
    for path, text in texts.items():
        (directory / path).parent.mkdir(exist_ok=True)
        (directory / path).write_text(text, encoding="utf-8")
    flags, include = (*machine_flags(M7, compiler), level, "-fno-builtin"), folder / "include"
    product = folder / "src" / f"{agent.name}.c"
    names = (f"{agent.name}_pil.c", "pil.c", "pil_run.c", "pil_semihosting.c")
    ours = [directory / "pil" / name for name in names]
    ours += [directory / "start.c", directory / "support.c"]
    objects = compile_objects(compiler, (*flags[:-1],), [product], include, directory)
    check_calls(objects[0], manifest.real, M7)
    objects += compile_objects(compiler, flags, ours, include, directory)
    image = directory / f"{agent.name}.elf"
    link = [*compiler.command, *flags, "-nostdlib", "-Wl,--build-id=none", "-T", "qemu.ld"]
    # The library: divisions of 64 bits in the printing, none in the product, whose calls were looked at.
    link += [*map(str, objects), *([] if compiler.is_zig else ["-lgcc"]), "-o", str(image)]
    run(link, directory, f"linking for {M7.title}", COMPILE_SECONDS)
    return image
