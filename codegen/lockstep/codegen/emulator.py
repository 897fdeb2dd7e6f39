"""The real ARM code on an emulated Cortex-M4F: equal bits, instructions counted, the stack watched.

zig cross-compiles for `thumb-freestanding-eabihf`, pyelftools loads the image, Unicorn runs it. A float32
image is linked without any library: a double-precision routine (`__aeabi_d*`) or a heap would be an undefined
symbol. Instructions are counted, never cycles: the emulator has no pipeline.
"""

import importlib
import importlib.util
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from lockstep.codegen.harness import (
    Run,
    compile_objects,
    inputs,
    output_arrays,
    outputs,
    product_sources,
    text_bytes,
    write_harness,
)
from lockstep.codegen.manifest import Agent, Manifest
from lockstep.codegen.rendering import render
from lockstep.codegen.stimulus import Calls
from lockstep.codegen.toolchain import COMPILE_SECONDS, RUN_SECONDS, Compiler, run
from lockstep.model.errors import ClaimError

MACHINE = ("-target", "thumb-freestanding-eabihf", "-mcpu=cortex_m4+vfp4d16sp", "-fno-unwind-tables", "-g")

_RETURN, _CODE, _DATA, _ARRAYS, _STACK = 0x0000_1000, 0x0001_0000, 0x2000_0000, 0x2100_0000, 0x3000_0000
_STACK_BYTES = 0x1_0000
_IMAGE_BYTES = 0x100_0000
_MEASURED = 50
"""Calls of each kind (closed loop, adversarial) that run with every instruction observed."""


def missing_packages() -> list[str]:
    """The optional packages that are not installed."""
    names = {"unicorn": "unicorn", "elftools": "pyelftools"}
    return [package for module, package in names.items() if importlib.util.find_spec(module) is None]


def _unicorn() -> Any:
    """The emulator: an optional package without types, loaded where it is used."""
    return importlib.import_module("unicorn")


def _registers() -> Any:
    return importlib.import_module("unicorn.arm_const")


@dataclass(frozen=True)
class Image:
    """A linked program: its loadable pieces (address, bytes, size in memory) and its symbols."""

    segments: tuple[tuple[int, bytes, int], ...]
    symbols: Mapping[str, int]


def build_image(manifest: Manifest, folder: Path, compiler: Compiler, level: str, directory: Path) -> Path:
    """Cross-compile and link the folder with its harness; the objects of the product stay beside it."""
    flags = (*MACHINE, level)
    product = compile_objects(
        compiler, flags, product_sources(manifest, folder), folder / "include", directory
    )
    harness = compile_objects(
        compiler, flags, write_harness(manifest, directory), folder / "include", directory
    )
    support = directory / "support.c"
    support.write_text(render("support.c.j2"), encoding="utf-8")
    # without -fno-builtin the compiler would turn the loop of memcpy into a call of memcpy
    library = compile_objects(compiler, (*flags, "-fno-builtin"), [support], folder / "include", directory)
    script = directory / "image.ld"
    entry = f"harness_{manifest.agents[0].name}"
    script.write_text(render("image.ld.j2", entry=entry, code=_CODE, data=_DATA), encoding="utf-8")
    image = directory / "image.elf"
    nothing_else = ("-nostdlib",) if manifest.real == "float32" else ()
    objects = [str(path) for path in product + harness + library]
    link = [
        *compiler.command,
        *MACHINE,
        "-O2",
        *nothing_else,
        "-Wl,--build-id=none",
        "-T",
        str(script),
        *objects,
        "-o",
        str(image),
    ]
    run(link, directory, "linking for Cortex-M4F", COMPILE_SECONDS)
    return image


def load_image(path: Path) -> Image:
    """Read the loadable segments and the symbols of an ELF file."""
    from elftools.elf.elffile import ELFFile

    with path.open("rb") as stream:
        elf = ELFFile(stream)
        segments = tuple(
            (int(s["p_vaddr"]), s.data(), int(s["p_memsz"]))
            for s in elf.iter_segments()
            if s["p_type"] == "PT_LOAD" and s["p_memsz"]
        )
        table: Any = elf.get_section_by_name(".symtab")
        symbols = {s.name: int(s["st_value"]) for s in table.iter_symbols() if s.name}
    if any(address + size > _CODE + _IMAGE_BYTES for address, _, size in segments if address < _DATA):
        raise ClaimError("the linked image is laid out in a way that the emulator's memory does not hold")
    return Image(segments, symbols)


def run_on_cortex_m4f(
    manifest: Manifest,
    folder: Path,
    calls: Mapping[str, Calls],
    compiler: Compiler,
    level: str,
    directory: Path,
) -> Iterator[tuple[Agent, Run]]:
    """Build once, then run each agent's calls: all plainly, and some with every instruction observed."""
    image = load_image(build_image(manifest, folder, compiler, level, directory))
    for agent in manifest.agents:
        recorded = calls[agent.name]
        trace, state_bytes = _Machine(image).run(manifest, agent, recorded)
        watch = _Watch(image.symbols[f"{agent.name}_step"] & ~1)
        _Machine(image, watch).run(manifest, agent, _sample(recorded))
        instructions = max(watch.counts[:_MEASURED], default=None)
        size = text_bytes(directory / f"{agent.name}.o")
        yield agent, Run(trace, state_bytes, size, instructions, watch.stack)


def _sample(calls: Calls) -> Calls:
    """The first calls (closed loop) and the last ones (adversarial, if there are any)."""
    rows = np.r_[: min(_MEASURED, len(calls)), max(len(calls) - _MEASURED, 0) : len(calls)]
    parts = (calls.operation, calls.received, calls.y, calls.neighbour_y, calls.r)
    return Calls(*(part[rows] for part in parts))


@dataclass
class _Watch:
    """Counts the instructions of each call of `step`, from its first to its return, and its deepest stack."""

    step: int
    counts: list[int] = field(default_factory=list)
    stack: int = 0
    _inside: bool = False
    _return: int = 0
    _top: int = 0

    def observe(self, machine: Any, address: int, _size: int, _data: Any) -> None:
        if not self._inside:
            if address != self.step:
                return
            self._inside = True
            self._return = machine.reg_read(_registers().UC_ARM_REG_LR) & ~1
            self._top = machine.reg_read(_registers().UC_ARM_REG_SP)
            self.counts.append(0)
        elif address == self._return:
            self._inside = False
            return
        self.counts[-1] += 1
        self.stack = max(self.stack, self._top - machine.reg_read(_registers().UC_ARM_REG_SP))


class _Machine:
    """One emulated core with the image loaded."""

    def __init__(self, image: Image, watch: _Watch | None = None) -> None:
        unicorn, names = _unicorn(), _registers()
        self.image, self.registers = image, names
        mode = unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS
        self.core = unicorn.Uc(unicorn.UC_ARCH_ARM, mode, names.UC_CPU_ARM_CORTEX_M4)
        for address, data, size in image.segments:
            self._map(address, size)
            self.core.mem_write(address, data)
        self._map(_STACK, _STACK_BYTES)
        self._map(_RETURN, 4)
        self.core.reg_write(names.UC_ARM_REG_FPEXC, 1 << 30)  # the floating-point unit is on
        if watch:
            self.core.hook_add(unicorn.UC_HOOK_CODE, watch.observe)

    def _map(self, address: int, size: int) -> None:
        """Map whole pages, skipping those that are mapped."""
        mapped = [(start, end) for start, end, _ in self.core.mem_regions()]
        for page in range(address & ~0xFFF, address + size, 0x1000):
            if not any(start <= page <= end for start, end in mapped):
                self.core.mem_map(page, 0x1000)

    def run(self, manifest: Manifest, agent: Agent, calls: Calls) -> tuple[Any, int]:
        """Place the arrays, call the harness, read the arrays back: (trace, sizeof state)."""
        count = len(calls)
        given = inputs(calls)
        sizes = [
            int(np.prod(shape)) * dtype.itemsize for _, dtype, shape in output_arrays(agent, manifest, count)
        ]
        pointers, end = [], _ARRAYS + 64
        for size in [*map(len, given), *sizes]:
            pointers.append(end)
            end += -(-(size + 8) // 16) * 16
        self.core.mem_map(_ARRAYS, -(-(end - _ARRAYS) // 0x1000) * 0x1000)
        self.core.mem_write(_ARRAYS, struct.pack("<2I12I", count, 0, *pointers))
        for pointer, data in zip(pointers, given, strict=False):
            self.core.mem_write(pointer, data)
        try:
            self._call(self.image.symbols[f"harness_{agent.name}"])
        except _unicorn().UcError as error:
            where = self.core.reg_read(self.registers.UC_ARM_REG_PC)
            raise ClaimError(f"the emulated core stopped at 0x{where:x}: {error}") from None
        written = zip(pointers[len(given) :], sizes, strict=True)
        blob = b"".join(bytes(self.core.mem_read(pointer, size)) for pointer, size in written if size)
        state_bytes = struct.unpack("<I", self.core.mem_read(_ARRAYS + 4, 4))[0]
        return outputs(agent, manifest, count, blob), int(state_bytes)

    def _call(self, function: int) -> None:
        names, core = self.registers, self.core
        core.reg_write(names.UC_ARM_REG_SP, _STACK + _STACK_BYTES)
        core.reg_write(names.UC_ARM_REG_R0, _ARRAYS)
        core.reg_write(names.UC_ARM_REG_LR, _RETURN | 1)
        core.emu_start(function | 1, _RETURN, timeout=RUN_SECONDS * 1_000_000)
        if core.reg_read(names.UC_ARM_REG_PC) & ~1 != _RETURN:
            raise ClaimError(f"the emulated core did not return within {RUN_SECONDS} s")
