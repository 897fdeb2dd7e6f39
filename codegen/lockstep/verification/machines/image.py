"""A freestanding program for an emulated core: the folder's C, its harness, and nothing that is not needed.

A core with the arithmetic in hardware gets no library at all; any other gets the compiler's, and every
routine that the generated code calls is checked by name: float32 code never calls a double-precision one.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lockstep.check.errors import ClaimError
from lockstep.check.sampled.discretise import Real
from lockstep.codegen.cost.cores import Core
from lockstep.codegen.emission.rendering import render
from lockstep.codegen.manifest import Manifest
from lockstep.verification.harness import compile_objects, product_sources, write_harness
from lockstep.verification.toolchain import COMPILE_SECONDS, Compiler, run

CODE, DATA = 0x0001_0000, 0x2000_0000
IMAGE_BYTES = 0x100_0000

_MEMORY = r"mem(cpy|set|move)|__aeabi_mem\w+"
_WIDE_SHIFT = r"__aeabi_ll?s[lr]|__aeabi_ls[lr]|__ashldi3|__lshrdi3"
_SOFT = {
    "float32": r"__aeabi_c?f\w+|__(add|sub|mul|neg|eq|ne|lt|le|gt|ge|unord)sf[23]",
    "float64": r"__aeabi_c?d\w+|__(add|sub|mul|neg|eq|ne|lt|le|gt|ge|unord)df[23]",
}


@dataclass(frozen=True)
class Image:
    """A linked program: its loadable pieces (address, bytes, size in memory) and its symbols."""

    segments: tuple[tuple[int, bytes, int], ...]
    symbols: Mapping[str, int]


def machine_flags(core: Core, compiler: Compiler) -> tuple[str, ...]:
    """What tells a compiler the core."""
    if compiler.is_zig:
        return (*core.machine, "-fno-unwind-tables", "-fno-asynchronous-unwind-tables", "-g")
    return (*core.gcc, "-ffreestanding", "-g")


def build_image(
    manifest: Manifest,
    folder: Path,
    core: Core,
    compiler: Compiler,
    level: str,
    directory: Path,
    *,
    strict: bool = True,
) -> Path:
    """Cross-compile and link the folder with its harness; the objects of the product stay beside it.

    strict  refuse an image whose generated code calls a routine that its arithmetic does not need
    """
    flags = (*machine_flags(core, compiler), level)
    include = folder / "include"
    product = compile_objects(compiler, flags, product_sources(manifest, folder), include, directory)
    if strict:
        for path in product:
            controllers = "|".join(agent.name for agent in manifest.agents)
            check_calls(path, manifest.real, core, f"(?:{controllers})_(?:init|reset|step_relative)")
    harness = compile_objects(compiler, flags, write_harness(manifest, directory), include, directory)
    support = directory / "support.c"
    support.write_text(render("support.c.j2"), encoding="utf-8")
    # without -fno-builtin the compiler would turn the loop of memcpy into a call of memcpy
    library = compile_objects(compiler, (*flags, "-fno-builtin"), [support], include, directory)
    bare = strict and manifest.real in core.hardware
    objects, name = [*product, *harness, *library], f"harness_{manifest.agents[0].name}"
    return link_image(objects, name, core, compiler, directory, bare=bare)


def link_image(
    objects: Sequence[Path], entry: str, core: Core, compiler: Compiler, directory: Path, *, bare: bool
) -> Path:
    """Link for the emulator's memory; `bare` leaves the compiler's library out."""
    script, image = directory / "image.ld", directory / "image.elf"
    script.write_text(render("image.ld.j2", entry=entry, code=CODE, data=DATA), encoding="utf-8")
    link = [*compiler.command, *machine_flags(core, compiler), "-O2"]
    # zig leaves its library out when told so; gcc gets none but the one named.
    link += ["-nostdlib"] if bare or not compiler.is_zig else []
    link += ["-Wl,--build-id=none", "-T", str(script), *map(str, objects)]
    link += ["-o", str(image)] if compiler.is_zig or bare else ["-lgcc", "-o", str(image)]
    run(link, directory, f"linking for {core.title}", COMPILE_SECONDS)
    return image


def check_calls(object_file: Path, real: Real, core: Core, own: str = "") -> None:
    """Refuse generated code that calls more than it may; raises `ClaimError` with the routine's name.

    Allowed: copying and clearing memory, wide shifts (a mask of 64 bits), soft arithmetic of its type, and names of
    the folder that match `own`.
    """
    soft = "" if real in core.hardware else "|" + _SOFT[real]
    ours = f"|{own}" if own else ""
    allowed = re.compile(f"(?:{_MEMORY}|{_WIDE_SHIFT}{soft}{ours})")
    for name in undefined_symbols(object_file):
        if not allowed.fullmatch(name):
            raise ClaimError(f"{object_file.stem}: the {real} code for {core.title} calls `{name}`")


def undefined_symbols(object_file: Path) -> Iterator[str]:
    """The names that an object file wants from elsewhere."""
    from elftools.elf.elffile import ELFFile

    with object_file.open("rb") as stream:
        table: Any = ELFFile(stream).get_section_by_name(".symtab")
        for symbol in table.iter_symbols():
            if symbol.name and symbol["st_shndx"] == "SHN_UNDEF":
                yield symbol.name


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
    if any(address + size > CODE + IMAGE_BYTES for address, _, size in segments if address < DATA):
        raise ClaimError("the linked image is laid out in a way that the emulator's memory does not hold")
    return Image(segments, symbols)
