"""Measure stack, flash and instructions of random shapes on every emulated core.

Run by hand (each compile and run takes about half a second):

    python benchmarks/cores/bounds.py shapes [--count N] [--seed S] > FILE.jsonl
    python benchmarks/cores/bounds.py leaders [--count N] [--seed S] > FILE.jsonl      shapes that listen to no one
    python benchmarks/cores/bounds.py small [--count N] [--seed S] > FILE.jsonl        what a linear form misses first
    python benchmarks/cores/bounds.py integers [--count N] [--seed S] > FILE.jsonl     the controllers in integers

`bounds_fit.py` fits the bounds to such files, and holds others to them; `soft_arithmetic.py` is for what is counted apart.

Shapes: 0 to 40 neighbours, orders 0 to 16, 1 to 4 outputs, 1 to 12 inputs, with and without limits and offsets, in both
arithmetics and both kinds of sources, at -O2 and -Os by zig's clang and by GCC. Each code is initialised (which steps its
self-check) and stepped with all, no and every second message, before and after one was heard, into both limits, with
an overflow, and with NaN and infinity among y and the last message: the paths that the C has. Instructions of the routines
of soft arithmetic are counted apart: by how often they are called, since what they take depends on their operands.
"""

import argparse
import bisect
import json
import struct
import tempfile
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np
from elftools.elf.elffile import ELFFile

from lockstep.check.c_source.kernel import Shape
from lockstep.codegen.cost.cores import CORES, emulated, registers_of
from lockstep.codegen.emission.emit import emit
from lockstep.codegen.emission.rendering import render
from lockstep.codegen.exports import with_exports
from lockstep.codegen.manifest import FixedEntry
from lockstep.codegen.spec import CodegenSpec, Controller, Neighbour
from lockstep.verification.harness import compile_objects, text_bytes
from lockstep.verification.machines.image import link_image, load_image, machine_flags
from lockstep.verification.toolchain import arm_gcc, zig

RETURN, DATA, STACK, STACK_BYTES = 0x1000, 0x2100_0000, 0x3000_0000, 0x1_0000
STATE, OWN, OTHERS, RESULT = DATA + 64, DATA + 0x8000, DATA + 0x9000, DATA + 0x1_8000
PAINT = 0xA5


class Machine:
    """An emulated core whose functions are called one by one; instructions are counted by blocks."""

    def __init__(self, path, core):
        self.core, self.arm, self.registers = emulated(core), core.architecture == "arm", registers_of(core)
        image = load_image(path)
        self.symbols = image.symbols
        for address, data, size in [
            *image.segments,
            (STACK, b"", STACK_BYTES),
            (RETURN, b"", 4),
            (DATA, b"", 0x2_0000),
        ]:
            for page in range(address & ~0xFFF, address + size, 0x1000):
                if not any(start <= page <= end for start, end, _ in self.core.mem_regions()):
                    self.core.mem_map(page, 0x1000)
            self.core.mem_write(address, data)
        with path.open("rb") as stream:
            table = ELFFile(stream).get_section_by_name(".symtab")
            named = sorted((s["st_value"] & ~1, s.name) for s in table.iter_symbols() if s.name)
        named = [(at, name) for at, name in named if not name.startswith(("$", ".L"))]
        self.starts, self.names = zip(*named, strict=True)
        self.blocks = {}
        from unicorn import UC_HOOK_BLOCK

        self.core.hook_add(UC_HOOK_BLOCK, self._block)
        self.begin()

    def begin(self):
        """Count from nothing."""
        self.own, self.library, self.inside, self.calls = 0, 0, None, defaultdict(int)

    def _block(self, core, address, size, _):
        if (address, size) not in self.blocks:
            code, at, count = bytes(core.mem_read(address, size)), 0, 0
            while at < size:
                half = code[at] | code[at + 1] << 8
                wide = half >> 11 in (0b11101, 0b11110, 0b11111) if self.arm else half & 3 == 3
                at, count = at + (4 if wide else 2), count + 1
            name = self.names[bisect.bisect_right(self.starts, address) - 1]
            self.blocks[address, size] = count, kind_of(name)
        count, kind = self.blocks[address, size]
        if kind == "own" or (kind == "shift" and self.inside is None):
            self.own, self.inside = self.own + count, None
            return
        if self.inside is None:
            self.inside = kind
            self.calls[kind] += 1
        self.library += count

    def call(self, name, *arguments, stacked=b""):
        """Call a function; what it returns."""
        core, registers, top = self.core, self.registers, STACK + STACK_BYTES - 256
        core.reg_write(registers.sp, top)
        core.mem_write(top, stacked)
        for k, argument in enumerate(arguments):
            core.reg_write(registers.argument + k, argument)
        core.reg_write(registers.link, RETURN | registers.thumb)
        core.emu_start((self.symbols[name] & ~1) | registers.thumb, RETURN)
        self.inside = None

    def step(self, name, neighbours, mask):
        """`<agent>_step(state, y, neighbour_y, received, u)`; a mask of 64 bits lies on ARM's stack, with u."""
        low, high = mask & 0xFFFF_FFFF, mask >> 32
        if not self.arm:
            return self.call(name, STATE, OWN, OTHERS, low, *([high] if neighbours > 32 else []), RESULT)
        if neighbours > 32:
            return self.call(name, STATE, OWN, OTHERS, 0, stacked=struct.pack("<3I", low, high, RESULT))
        return self.call(name, STATE, OWN, OTHERS, low, stacked=struct.pack("<I", RESULT))

    def depth(self):
        """Bytes of stack that were written to, once it was painted."""
        stack = np.frombuffer(self.core.mem_read(STACK, STACK_BYTES - 256), np.uint8)
        changed = np.flatnonzero(stack != PAINT)
        return STACK_BYTES - 256 - int(changed[0]) if len(changed) else 0


def kind_of(name):
    """What a function is: our own, a copy, a wide shift (of whoever calls it), or soft arithmetic by its operation."""
    if name.startswith("zz") or "mem" in name or "gnu_thumb1" in name:
        return "own"
    if any(part in name for part in ("shl", "shr", "llsl", "llsr", "shift")):
        return "shift"
    return next((kind for kind in ("mul", "sub", "add") if kind in name), "compare")


def controller(name, random, shape, *, limited, shifted, unit=False):
    """Dense gains: none is printed specially, so that no other gains take more code."""
    n, q, m, nn = shape
    A, B, C, D = (random.normal(size=size) for size in ((n, n), (n, q), (m, n), (m, q)))
    weights = np.ones(nn) if unit else random.uniform(0.1, 3.0, nn)
    sources = tuple(Neighbour(f"peer{j}", float(w)) for j, w in enumerate(weights))
    made = Controller(name, A - (2 + n) * np.eye(n), B, C, D, sources)
    if limited:
        made = replace(made, limits=np.tile([-0.7, 1.3], (m, 1)))
    return replace(made, offsets=random.normal(size=(nn + 1, q))) if shifted and nn else made


def drawn(random):
    """A shape and what comes with it: neighbours often about where compilers unroll, or masks change."""
    some = (0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12, 16, 17, 20, 24, 31, 32, 33, 36, 40)
    nn = int(random.choice(some) if random.random() < 0.8 else random.integers(0, 41))
    shape = Shape(int(random.integers(0, 17)), int(random.integers(1, 5)), int(random.integers(1, 13)), nn)
    return shape, {"limited": bool(random.random() < 0.4), "shifted": bool(random.random() < 0.4 and nn)}


def cases(random, shape, dtype, limited):
    """(mask, y, neighbours' y): the paths of a step, one after the other."""
    q, nn, full = shape.outputs, shape.neighbours, (1 << shape.neighbours) - 1
    y, z = random.normal(size=q).astype(dtype), random.normal(size=(nn, q)).astype(dtype)
    found = [(0, y, z), (full, y, z), (0, y, z), (0x5555_5555_5555_5555 & full, y, z)]
    for size in (1e4, -1e4) if limited else ():
        found += [(full, np.full(q, size, dtype), 0 * z), (0, y, z)]
    large, last = np.finfo(dtype).max, np.eye(q, dtype=dtype)[-1] > 0
    found.append((full, np.full(q, large, dtype), np.full((nn, q), -large, dtype)))
    bad, worse = np.where(last, np.nan, y).astype(dtype), z.copy()
    worse[-1:, -1:] = np.inf
    return [*found, (full, bad, z), (0, bad, z), (full, y, worse)]


def whole_cases(random, shape):
    """The same for the controllers in integers."""
    q, nn, full = shape.outputs, shape.neighbours, (1 << shape.neighbours) - 1
    masks = (0, full, 0, 0x5555_5555_5555_5555 & full)
    ends = [
        (mask, np.full(q, s, np.int16), np.full((nn, q), -1 - s, np.int16))
        for s in (99, 32767, -32768)
        for mask in masks
    ]
    draw = lambda *size: random.integers(-32768, 32768, size).astype(np.int16)  # noqa: E731
    return ends + [(full, draw(q), draw(nn, q)) for _ in range(6)]


def targets(core):
    """Compilers and levels."""
    compilers = [zig(), arm_gcc() if core.gcc else None]
    return [(compiler, level) for compiler in filter(None, compilers) for level in ("-O2", "-Os")]


def measured(texts, unit, shape, given, core, compiler, level, *, bare):
    """Compile one unit, run it on all cases: stack, flash, most instructions, of its own and in all, most calls by kind."""
    with tempfile.TemporaryDirectory(prefix="lockstep-bounds-") as temporary:
        place = Path(temporary)
        for path, text in texts.items():
            (place / Path(path).name).write_text(text, encoding="utf-8")
        (place / "support.c").write_text(render("support.c.j2"), encoding="utf-8")
        flags = (*machine_flags(core, compiler), level)
        objects = compile_objects(compiler, flags, [place / f"{unit}.c"], place, place)
        objects += compile_objects(compiler, (*flags, "-fno-builtin"), [place / "support.c"], place, place)
        machine = Machine(link_image(objects, f"{unit}_step", core, compiler, place, bare=bare), core)
        flash = text_bytes(objects[0])
    machine.core.mem_write(STACK, bytes([PAINT]) * (STACK_BYTES - 256))
    machine.call(f"{unit}_init", STATE)
    most, total, calls = 0, 0, {}
    for mask, y, z in given:
        machine.core.mem_write(OWN, y.tobytes())
        machine.core.mem_write(OTHERS, z.tobytes())
        machine.begin()
        machine.step(f"{unit}_step", shape.neighbours, mask)
        most, total = max(most, machine.own), max(total, machine.own + machine.library)
        calls = {k: max(calls.get(k, 0), machine.calls.get(k, 0)) for k in {*calls, *machine.calls}}
    return {"stack": machine.depth(), "flash": flash, "own": most, "total": total, "calls": calls}


def measure(seed, count, what):
    """Rows of random shapes: `shapes`, `leaders`, `small` or `integers`."""
    random = np.random.default_rng(seed)
    for k in range(count):
        shape, options = drawn(random)
        if what == "leaders":  # of the others one in 25
            shape, options["shifted"] = shape._replace(order=shape.order // 2, neighbours=0), False
        if what == "small":
            shape = Shape(shape.order // 5, shape.outputs, -(-shape.inputs // 4), k % 4)
            options["shifted"] &= k % 4 > 0
        if what == "integers":
            m, q, n = shape.inputs, shape.outputs, shape.order
            agent = controller("zz", random, shape, limited=True, shifted=False, unit=True)
            claimed = {"states": ((22,) * n,), "claims": ("nothing",)}
            formats = FixedEntry(outputs=(11,) * q, inputs=(10,) * m, **claimed)
            agent = replace(agent, limits=np.tile([-9.0, 7.0], (m, 1)))
            spec = CodegenSpec((agent,), period=0.01, name="one", fixed=formats)
            made = {
                path: text
                for path, text in with_exports(emit(spec), ("fixed",)).items()
                if "zz_fixed." in path
            }
            jobs = [("integers", "", made, "zz_fixed", whole_cases(random, shape))]
        else:
            agent, jobs = controller("zz", random, shape, **options), []
            for real in ("float32", "float64"):
                given = cases(random, shape, np.dtype(real).type, options["limited"])
                for kind in ("speed", "size"):
                    made = emit(CodegenSpec((agent,), period=0.01, name="one", real=real, optimize=kind))
                    jobs.append((real, kind, {p: made[p] for p in ("src/zz.c", "include/zz.h")}, "zz", given))
        for real, kind, texts, unit, given in jobs:
            for group, core in CORES.items():
                for compiler, level in targets(core):
                    found = measured(
                        texts, unit, shape, given, core, compiler, level, bare=real in core.hardware
                    )
                    where = {
                        "core": group,
                        "real": real,
                        "optimize": kind,
                        "compiler": compiler.name,
                        "level": level,
                    }
                    yield {"seed": seed, "k": k, "shape": shape, **options, **where, **found}


def main():
    """Rows as JSON, one a line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("shapes", "leaders", "small", "integers"))
    parser.add_argument("--count", type=int, default=10)
    parser.add_argument("--seed", type=int, default=17)
    given = parser.parse_args()
    rows = measure(given.seed, given.count, given.what)
    for row in rows:
        print(json.dumps(row), flush=True)


if __name__ == "__main__":
    main()
