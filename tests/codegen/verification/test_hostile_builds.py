"""Compilers told to change the arithmetic: each build is refused, or equal to the reference to the last bit.

Refused is what does not compile, and what `<agent>_init` finds unfit at start-up. `-s` prints the table.
Debian: gcc, clang, lib32gcc-12-dev and libc6-dev-i386 (-m32), gcc-riscv64-linux-gnu and qemu-user, gcc-arm-none-eabi.
"""

import platform
import shutil
import subprocess
from collections import Counter

import numpy as np
import pytest
from codegen_cases import arms, random_controller

from lockstep.check.errors import ClaimError
from lockstep.codegen.cost.cores import CORES, emulated
from lockstep.codegen.emission.calls import Operation
from lockstep.codegen.emission.emit import emit
from lockstep.codegen.emission.rendering import render
from lockstep.codegen.folder import write_folder
from lockstep.codegen.manifest import load_manifest
from lockstep.verification.comparison import compare
from lockstep.verification.harness import inputs, layout, outputs, product_sources, write_harness
from lockstep.verification.machines.emulator import missing_packages, run_on_core
from lockstep.verification.reference import NOT_READY, Reference
from lockstep.verification.stimulus import (
    adversarial_calls,
    closed_loop_calls,
    fault_calls,
    recorded_outputs,
    run_reference,
)
from lockstep.verification.toolchain import Compiler

WAYS = {
    "as documented": "-std=c99 -ffp-contract=off",
    "contraction": "-std=c99 -ffp-contract=fast",
    "contraction, GNU mode": "-std=gnu11",
    "reassociation": "-std=c99 -fassociative-math -fno-signed-zeros -fno-trapping-math",
    "unsafe": "-std=c99 -funsafe-math-optimizations",
    "finite": "-std=c99 -ffinite-math-only",
    "finite, its macro undefined": "-std=c99 -ffinite-math-only -U__FINITE_MATH_ONLY__",
    "no NaN": "-std=c99 -fno-honor-nans",  # of clang, which defines no macro
    "fast": "-std=c99 -ffast-math",
    "fast, its macro undefined": "-std=c99 -ffast-math -U__FAST_MATH__ -U__FINITE_MATH_ONLY__",
    "link time": "-std=c99 -ffp-contract=fast -flto",
}
X86 = {
    "flush to zero, in the processor": "-std=c99 -DHOSTILE_CSR=0x8040u",
    "rounding up, in the processor": "-std=c99 -DHOSTILE_CSR=0x4000u",
    "x87": "-std=c99 -mfpmath=387",
    "32 bits": "-std=c99 -m32",
    "32 bits, SSE": "-std=c99 -m32 -msse2 -mfpmath=sse",
}
MODE = """
#ifdef HOSTILE_CSR
#include <xmmintrin.h>
__attribute__((constructor)) static void hostile(void) { _mm_setcsr(_mm_getcsr() | HOSTILE_CSR); }
#endif
typedef int not_empty;
"""
LEVELS = ("-O0", "-O1", "-O2", "-O3", "-Os", "-Ofast")
HOSTS = {
    "gcc": (("gcc", "-mfma"), ()),
    "clang": (("clang", "-mfma"), ()),
    "riscv64": (("riscv64-linux-gnu-gcc", "-static"), ("qemu-riscv64",)),
}
EQUAL, REFUSED, UNFIT, SILENT, NOT_HERE = "equal", "refused", "unfit", "SILENT", "-"


def folder_of(place, optimize="speed", real="float32"):
    agents = (
        *arms().agents[:1],
        random_controller("s", 0, 1, 1, neighbours=3),
        random_controller("c", 4, 2, 2),
    )
    return write_folder(emit(arms(agents=agents, plants=(), optimize=optimize, real=real)), place)


def without_the_self_check(folder):
    """What init finds is no longer acted on."""
    for source in product_sources(load_manifest(folder), folder):
        text = source.read_text()
        assert "        state->ready = 0u;\n" in text
        source.write_text(text.replace("        state->ready = 0u;\n", "        (void)status;\n"))


class Bench:
    """A folder, the calls that it is fed, and what must come out."""

    def __init__(self, folder, place):
        self.folder, self.manifest, self.place = folder, load_manifest(folder), place
        loop = closed_loop_calls(self.manifest, recorded_outputs(self.manifest, 200))
        self.calls = {
            a.name: loop[a.name] + fault_calls(self.manifest, a) + adversarial_calls(self.manifest, a, 800)
            for a in self.manifest.agents
        }
        self.expected = {
            a.name: run_reference(Reference.of(a, self.manifest), self.calls[a.name])
            for a in self.manifest.agents
        }
        (place / "mode.c").write_text(MODE)
        views = [layout(agent, self.manifest) for agent in self.manifest.agents]
        (place / "main.c").write_text(render("host_main.c.j2", agents=views))
        self.driver = [*write_harness(self.manifest, place), place / "main.c", place / "mode.c"]

    def judge(self, traces):
        """Of all agents the worst: a difference that nothing told, an instance that refuses every step, or equality."""
        found = set()
        for name, trace in traces.items():
            steps = self.calls[name].operation <= Operation.STEP_RELATIVE
            refused = bool((trace.status[steps] == NOT_READY).all())
            equal = compare(trace, self.expected[name]).bitwise
            found.add(EQUAL if equal else UNFIT if refused else SILENT)
        return next(kind for kind in (SILENT, UNFIT, EQUAL) if kind in found)

    def on_host(self, compiler, runner, flags):
        sources = [*product_sources(self.manifest, self.folder), *self.driver]
        places = [f"-I{self.folder / 'include'}", f"-I{self.place}", "-w", "-o", str(self.place / "driver")]
        built = subprocess.run(
            [*compiler, *flags, *places, *map(str, sources)], capture_output=True, text=True, check=False
        )
        if built.returncode:
            return REFUSED if "#error" in built.stderr or 'error: "' in built.stderr else NOT_HERE
        traces = {}
        for k, agent in enumerate(self.manifest.agents):
            calls, count = self.calls[agent.name], str(len(self.calls[agent.name]))
            (self.place / "in").write_bytes(b"".join(inputs(calls)))
            command = [*runner, self.place / "driver", str(k), count, self.place / "in", self.place / "out"]
            subprocess.run(command, check=True)
            traces[agent.name] = outputs(
                agent, self.manifest, len(calls), (self.place / "out").read_bytes()[4:]
            )
        return self.judge(traces)

    def on_core(self, core, flags, level):
        try:
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr("lockstep.verification.harness.WARNINGS", ("-w", *flags))
                compiler = Compiler("gcc", (shutil.which("arm-none-eabi-gcc"),))
                runs = run_on_core(
                    self.manifest, self.folder, self.calls, self.place, core, compiler, level, strict=False
                )
                return self.judge({agent.name: run.trace for agent, run in runs})
        except ClaimError as error:
            return REFUSED if "#error" in str(error) else f"{NOT_HERE} {error}"


def table_of(title, cells):
    print(f"\n{title}")
    for (way, level), kind in cells.items():
        print(f"  {way:34}{level:8}{kind}")
    return Counter(cells.values())


def matrix_on_host(bench, host, levels):
    compiler, runner = HOSTS[host]
    ways = WAYS | (X86 if host != "riscv64" and platform.machine() == "x86_64" else {})
    return {
        (way, level): bench.on_host(compiler, runner, [*flags.split(), level])
        for way, flags in ways.items()
        for level in levels
    }


@pytest.fixture(params=HOSTS)
def host(request):
    compiler, runner = HOSTS[request.param]
    if missing := [tool for tool in (compiler[0], *runner) if shutil.which(tool) is None]:
        pytest.skip(f"{missing[0]} is not installed")
    return request.param


def test_what_no_macro_tells_is_found_at_start_up(host, tmp_path):
    bench = Bench(folder_of(tmp_path / "c"), tmp_path)
    compiler, runner = HOSTS[host]
    told = {
        way: bench.on_host(compiler, runner, [*WAYS[way].split(), "-O2"])
        for way in (
            "as documented",
            "contraction",
            "reassociation",
            "finite, its macro undefined",
            "no NaN",
            "fast",
        )
    }
    assert told == {
        "as documented": EQUAL,
        "contraction": UNFIT if host == "clang" else EQUAL,
        "reassociation": UNFIT if host == "clang" else REFUSED,
        "finite, its macro undefined": UNFIT,
        "no NaN": UNFIT if host == "clang" else NOT_HERE,
        "fast": REFUSED,
    }


@pytest.mark.slow
@pytest.mark.parametrize(
    ("optimize", "real"),
    [
        ("speed", "float32"),
        pytest.param("size", "float64", marks=pytest.mark.by_hand),
        pytest.param("size", "float32", marks=pytest.mark.by_hand),
    ],
)
def test_no_build_differs_silently_at_any_level(host, optimize, real, tmp_path):
    bench = Bench(folder_of(tmp_path / "c", optimize, real), tmp_path)
    cells = matrix_on_host(bench, host, LEVELS)
    assert table_of(f"{host} {optimize} {real}", cells)[SILENT] == 0
    assert all(cells["as documented", level] == EQUAL for level in LEVELS[:-1])


@pytest.mark.slow
def test_without_the_self_check_some_do(host, tmp_path):
    """clang contracts across statements whatever the pragmas say; GCC obeys its own, but not a processor that flushes."""
    folder = folder_of(tmp_path / "c")
    without_the_self_check(folder)
    cells = matrix_on_host(Bench(folder, tmp_path), host, ["-O2"])
    if host == "riscv64":
        pytest.skip("GCC for RISC-V obeys the pragma, and its processor has no mode that flushes")
    assert table_of(f"{host}, no self-check", cells)[SILENT] > 0


ARM = ("cortex-m4f", "cortex-m0")
needs_arm = pytest.mark.skipif(
    shutil.which("arm-none-eabi-gcc") is None or bool(missing_packages()),
    reason="arm-none-eabi-gcc or unicorn is missing",
)


def flushing(core):
    """The core with the bit FZ of its floating-point status set, as some start-up code leaves it."""
    from unicorn.arm_const import UC_ARM_REG_LR, UC_ARM_REG_R0

    machine, code = emulated(core), 0x0800_0000
    machine.mem_map(code, 0x1000)
    machine.mem_write(code, bytes.fromhex("e1ee100a 7047"))  # vmsr fpscr, r0; bx lr
    machine.reg_write(UC_ARM_REG_R0, 1 << 24)
    machine.reg_write(UC_ARM_REG_LR, code + 0x101)
    machine.emu_start(code | 1, code + 0x100)
    return machine


@needs_arm
@pytest.mark.slow
@pytest.mark.parametrize("group", ARM)
def test_no_build_for_a_microcontroller_differs_silently(group, tmp_path):
    bench = Bench(folder_of(tmp_path / "c"), tmp_path)
    cells = {
        (way, level): bench.on_core(CORES[group], flags.split(), level)
        for way, flags in WAYS.items()
        if "link" not in way  # the emulator's image is made of objects
        for level in ("-O2", "-Os")
    }
    count = table_of(group, cells)
    assert count[SILENT] == 0
    assert cells["as documented", "-O2"] == cells["as documented", "-Os"] == EQUAL


@needs_arm
def test_gnu_mode_with_half_precision_is_no_excess_precision(tmp_path):
    """FLT_EVAL_METHOD is 16 there."""
    folder = folder_of(tmp_path / "c")
    gcc = "arm-none-eabi-gcc -mcpu=cortex-m55 -mfloat-abi=hard -std=gnu11 -O2 -fsyntax-only".split()  # noqa: SIM905
    for source in product_sources(load_manifest(folder), folder):
        subprocess.run([*gcc, f"-I{folder / 'include'}", source], check=True)


@needs_arm
def test_a_core_that_flushes_to_zero_is_found_at_start_up(tmp_path, monkeypatch):
    monkeypatch.setattr("lockstep.verification.machines.emulator.emulated", flushing)
    bench = Bench(folder_of(tmp_path / "c"), tmp_path)
    flags = WAYS["as documented"].split()
    assert bench.on_core(CORES["cortex-m4f"], flags, "-Os") == UNFIT
    without_the_self_check(bench.folder)
    assert bench.on_core(CORES["cortex-m4f"], flags, "-Os") == SILENT


def test_the_answers_are_those_of_the_reference_and_tell_every_variation():
    """The reference shares nothing with the emission; what each variation changes is computed apart from both."""
    from lockstep.check.c_source.kernel import Shape
    from lockstep.codegen.emission.known_answers import VARIATIONS, known_answers

    for optimize in ("speed", "size"):
        for real in (np.float32, np.float64):
            agent = random_controller("c", 3, 2, 2, neighbours=2)
            table = np.block([[agent.A, agent.B], [agent.C, agent.D]]).astype(real)
            weights = np.array([n.weight for n in agent.neighbours]).astype(real)
            known = known_answers(Shape(3, 2, 2, 2), table, weights, optimize == "speed", "c")
            assert set(known.sensitive) == set(VARIATIONS)
            reference = Reference(table, weights, 3, optimize == "speed")
            for k, row in enumerate(known.answers):
                given = known.given[k]
                reference.step(given, known.given[k + 1 : k + 3], 3) if k else reference.step_relative(given)
                scale = real(1 if k else 2.0**100)
                assert (
                    np.concatenate([reference.state.x, reference.state.u]) * scale
                ).tobytes() == row.tobytes()
