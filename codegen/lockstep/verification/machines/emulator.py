"""The real code on an emulated microcontroller: equal bits, instructions counted, the stack watched.

A compiler makes the image (`image`), pyelftools loads it, Unicorn runs it. Instructions are counted, never
cycles: the emulator has no pipeline.
"""

import importlib
import importlib.util
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from lockstep.check.errors import ClaimError
from lockstep.codegen.cost.cores import Core, Registers, emulated, registers_of
from lockstep.codegen.emission.calls import Calls
from lockstep.codegen.manifest import AgentEntry, Manifest
from lockstep.verification.harness import Run, inputs, output_arrays, outputs, text_bytes
from lockstep.verification.machines.image import Image, build_image, load_image
from lockstep.verification.one_image import unit_of
from lockstep.verification.toolchain import RUN_SECONDS, Compiler

_RETURN, _ARRAYS, _STACK = 0x0000_1000, 0x2100_0000, 0x3000_0000
_STACK_BYTES = 0x1_0000
_MEASURED = 20
"""Calls of each kind (closed loop, own outputs not finite, adversarial) that run with every instruction observed."""
_PAINT = 0xA5
"""The stack is filled with this byte: what no longer holds it after a run was used."""


def missing_packages() -> list[str]:
    """The optional packages that are not installed."""
    names = {"unicorn": "unicorn", "elftools": "pyelftools"}
    return [package for module, package in names.items() if importlib.util.find_spec(module) is None]


def run_on_core(
    manifest: Manifest,
    folder: Path,
    calls: Mapping[str, Calls],
    directory: Path,
    core: Core,
    compiler: Compiler,
    level: str,
    *,
    strict: bool = True,
) -> Iterator[tuple[AgentEntry, Run]]:
    """Build once, then run each agent's calls: some with every instruction observed, and all plainly.

    The stack is what the observed calls take at the most, and what all calls leave changed in a painted one.
    """
    image = load_image(build_image(manifest, folder, core, compiler, level, directory, strict=strict))
    for agent in manifest.agents:
        recorded = calls[agent.name]
        watch = Watch(image.symbols[f"{unit_of(agent)}_step"] & ~1, registers_of(core))
        Machine(image, core, watch).run(manifest, agent, _sample(recorded))
        machine = Machine(image, core)
        trace, state_bytes = machine.run(manifest, agent, recorded)
        stack = max(watch.stack, watch.top - machine.deepest()) if watch.counts else None
        instructions = max(watch.counts[:_MEASURED], default=None)
        most = max(watch.counts, default=None)
        size = text_bytes(directory / f"{unit_of(agent)}.o")
        yield agent, Run(trace, state_bytes, size, instructions, stack, most)


def _sample(calls: Calls) -> Calls:
    """The first calls (closed loop), the first with a fault of y, and the last ones (adversarial, if there are any)."""
    faults = np.flatnonzero(~np.isfinite(calls.y).all(axis=1))[:_MEASURED]
    rows = np.r_[: min(_MEASURED, len(calls)), faults, max(len(calls) - _MEASURED, 0) : len(calls)]
    parts = (calls.operation, calls.received, calls.y, calls.neighbour_y, calls.r)
    return Calls(*(part[rows] for part in parts))


@dataclass
class Watch:
    """Counts the instructions of each call of a function, its first to its return, and its deepest stack."""

    function: int
    registers: Registers
    counts: list[int] = field(default_factory=list)
    stack: int = 0
    top: int = 0
    _inside: bool = False
    _return: int = 0

    def observe(self, machine: Any, address: int, _size: int, _data: Any) -> None:
        """Unicorn calls this before each instruction."""
        if not self._inside:
            if address != self.function:
                return
            self._inside = True
            self._return = machine.reg_read(self.registers.link) & ~1
            self.top = machine.reg_read(self.registers.sp)
            self.counts.append(0)
        elif address == self._return:
            self._inside = False
            return
        self.counts[-1] += 1
        self.stack = max(self.stack, self.top - machine.reg_read(self.registers.sp))


class Machine:
    """One emulated core with the image loaded."""

    def __init__(self, image: Image, core: Core, watch: Watch | None = None) -> None:
        self.image, self.registers = image, registers_of(core)
        self.core = emulated(core)
        for address, data, size in image.segments:
            self.map(address, size)
            self.core.mem_write(address, data)
        self.map(_STACK, _STACK_BYTES)
        self.core.mem_write(_STACK, bytes([_PAINT]) * _STACK_BYTES)
        self.map(_RETURN, 4)
        if watch:
            self.core.hook_add(importlib.import_module("unicorn").UC_HOOK_CODE, watch.observe)

    def map(self, address: int, size: int) -> None:
        """Map whole pages, skipping those that are mapped."""
        mapped = [(start, end) for start, end, _ in self.core.mem_regions()]
        for page in range(address & ~0xFFF, address + size, 0x1000):
            if not any(start <= page <= end for start, end in mapped):
                self.core.mem_map(page, 0x1000)

    def run(self, manifest: Manifest, agent: AgentEntry, calls: Calls) -> tuple[Any, int]:
        """Place the arrays, call the harness, read the arrays back: (trace, sizeof state)."""
        arrays = output_arrays(agent, manifest, len(calls))
        sizes = [int(np.prod(shape)) * dtype.itemsize for _, dtype, shape in arrays]
        blob, state_bytes = self.exchange(f"harness_{agent.name}", len(calls), inputs(calls), sizes)
        return outputs(agent, manifest, len(calls), blob), state_bytes

    def exchange(
        self, harness: str, count: int, given: Sequence[bytes], sizes: Sequence[int]
    ) -> tuple[bytes, int]:
        """Place arrays, call a harness, read back arrays of some sizes, one after the other, and `sizeof` the state."""
        pointers, end = [], _ARRAYS + 64
        for size in [*map(len, given), *sizes]:
            pointers.append(end)
            end += -(-(size + 8) // 16) * 16
        self.core.mem_map(_ARRAYS, -(-(end - _ARRAYS) // 0x1000) * 0x1000)
        self.core.mem_write(_ARRAYS, struct.pack("<2I12I", count, 0, *pointers))
        for pointer, data in zip(pointers, given, strict=False):
            self.core.mem_write(pointer, data)
        self.call(harness, _ARRAYS)
        written = zip(pointers[len(given) :], sizes, strict=True)
        blob = b"".join(bytes(self.core.mem_read(pointer, size)) for pointer, size in written if size)
        state_bytes = struct.unpack("<I", self.core.mem_read(_ARRAYS + 4, 4))[0]
        return blob, int(state_bytes)

    def deepest(self) -> int:
        """The lowest address of the stack that was written to."""
        stack = np.frombuffer(self.core.mem_read(_STACK, _STACK_BYTES), np.uint8)
        changed = np.flatnonzero(stack != _PAINT)
        return _STACK + int(changed[0] if len(changed) else _STACK_BYTES)

    def call(self, function: str, argument: int) -> None:
        """Call a function with one argument; raises `ClaimError` if it does not come back."""
        core, names = self.core, self.registers
        core.reg_write(names.sp, _STACK + _STACK_BYTES)
        core.reg_write(names.argument, argument)
        core.reg_write(names.link, _RETURN | names.thumb)
        start = (self.image.symbols[function] & ~1) | names.thumb
        try:
            core.emu_start(start, _RETURN, timeout=RUN_SECONDS * 1_000_000)
        except importlib.import_module("unicorn").UcError as error:
            where = core.reg_read(names.pc)
            raise ClaimError(f"the emulated core stopped at 0x{where:x}: {error}") from None
        if core.reg_read(names.pc) & ~1 != _RETURN:
            raise ClaimError(f"the emulated core did not return within {RUN_SECONDS} s")
