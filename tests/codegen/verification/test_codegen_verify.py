"""The C runs and equals the reference to the bit; when it does not, that is seen."""

import platform
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from codegen_cases import arms, random_controller, shapes

from lockstep.check.errors import ProblemError
from lockstep.codegen.emission.emit import emit
from lockstep.codegen.folder import write_folder
from lockstep.codegen.manifest import Manifest
from lockstep.codegen.spec import CodegenSpec, Controller, Neighbour
from lockstep.verification import targets, toolchain
from lockstep.verification.toolchain import Compiler, host_compilers
from lockstep.verification.verify import verify_folder

needs_compiler = pytest.mark.skipif(not host_compilers(), reason="no C compiler here")
QUICK = {"steps": 200, "adversarial_steps": 800}


@pytest.fixture(autouse=True)
def one_level(request, monkeypatch):
    """Compile at one level only, where the level is not what is tested."""
    if "all_levels" not in request.fixturenames:
        monkeypatch.setattr(targets, "LEVELS", ("-O0",))


@pytest.fixture
def all_levels():
    """Asked for by tests that are about all levels."""


def folder_of(tmp_path, spec):
    return write_folder(emit(spec), tmp_path / spec.name)


@pytest.mark.slow
@needs_compiler
@pytest.mark.parametrize("optimize", ["speed", "size"])
@pytest.mark.parametrize("real", ["float32", "float64"])
@pytest.mark.usefixtures("all_levels")
def test_the_arms_are_equal_to_the_bit_at_every_level(tmp_path, real, optimize):
    seen = []
    report = verify_folder(
        folder_of(tmp_path, arms(real=real, optimize=optimize)),
        targets=["host"],
        progress=lambda _, done, total: seen.append((done, total)),
        **QUICK,
    )
    assert report.ok
    assert [t.name.split()[-1] for t in report.targets[:3]] == ["-O0", "-O2", "-O3"]
    for target in report.targets:
        assert (target.bitwise, target.max_abs_error, target.steps) == (True, 0.0, QUICK["steps"])
        assert target.ram_bytes == (56 if real == "float64" else 36)
    assert seen[-1][0] == seen[-1][1] and [d for d, _ in seen] == sorted(d for d, _ in seen)


@pytest.mark.slow
@needs_compiler
@pytest.mark.parametrize("optimize", ["speed", "size"])
def test_every_shape_is_equal_to_the_bit(tmp_path, optimize):
    """Orders 0 to 12, 1 and 3 outputs, 0 to 3 neighbours."""
    report = verify_folder(
        folder_of(tmp_path, shapes([0, 2, 5, 12], [1, 3], [2], optimize=optimize)),
        targets=["host"],
        **QUICK,
    )
    assert report.problems == ()
    assert {a.agent for t in report.targets for a in t.agents} >= {"c012", "c032", "c1232"}


@pytest.mark.slow
@needs_compiler
def test_many_neighbours_take_a_wide_mask(tmp_path):
    agents = tuple(random_controller(f"n{nn}", 1, 1, 1, neighbours=nn) for nn in (32, 33, 64))
    report = verify_folder(folder_of(tmp_path, arms(agents=agents, plants=())), targets=["host"], **QUICK)
    assert report.problems == ()


@pytest.mark.slow
@needs_compiler
def test_sanitizers_find_nothing_or_say_why_they_cannot_look(tmp_path):
    report = verify_folder(folder_of(tmp_path, shapes([0, 2], [2], [1])), targets=["sanitizers"], **QUICK)
    assert all(t.bitwise or t.skipped for t in report.targets)


def break_source(folder, old, new):
    path = folder / "src" / "arm1.c"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


@needs_compiler
def test_a_gain_changed_by_one_unit_in_the_last_place_is_a_mismatch(tmp_path):
    folder = folder_of(tmp_path, arms())
    gain = re.search(r"(-?\d\.\d+)f \* r0", (folder / "src" / "arm1.c").read_text()).group(1)
    other = str(np.nextafter(np.float32(gain), np.float32(9)))
    break_source(folder, f"{gain}f * r0", f"{other}f * r0")
    report = verify_folder(folder, targets=["host"], run_changed=True, **QUICK)
    assert not report.ok and report.changed_files == ("src/arm1.c",)
    assert [a.bitwise for a in report.targets[0].agents] == [False, True, True]
    assert report.targets[0].max_abs_error > 0
    assert any("src/arm1.c is not what" in problem for problem in report.problems)


@needs_compiler
@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("const float t4 = t1 + t3;", "const float t4 = t3 + t1 + 0.0f;"),  # only the sign of a zero changes
        (
            "if (check == 0.0f)",
            "if (check == check + 1.0f - 1.0f)",
        ),  # NaN is caught, infinity minus itself too
        ("state->misses[j] += (", "state->misses[j] += 0u * ("),
        ("    arm1_output(state, u); /* last", "    u[0] = u[0]; /* last"),
    ],
)
def test_small_changes_of_behaviour_are_seen(tmp_path, old, new):
    folder = folder_of(tmp_path, arms())
    break_source(folder, old, new)
    report = verify_folder(folder, targets=["host"], run_changed=True, steps=300, adversarial_steps=3000)
    assert not report.ok and report.changed_files == ("src/arm1.c",)


@needs_compiler
def test_contraction_is_seen(tmp_path, monkeypatch):
    """With fused multiply-add allowed, by flags and by the source, the C differs: the comparison is sharp."""
    if " fma " not in Path("/proc/cpuinfo").read_text():
        pytest.skip("no fused multiply-add here")
    folder = folder_of(tmp_path, arms())
    for guard in (
        '#pragma GCC optimize("fp-contract=off", "no-tree-vectorize")',
        "#pragma STDC FP_CONTRACT OFF",
    ):
        for agent in folder.glob("src/arm?.c"):
            agent.write_text(agent.read_text().replace(guard, ""))
    monkeypatch.setattr(targets, "LEVELS", ("-O2",))
    fused = (*toolchain.WARNINGS[:-1], "-ffp-contract=fast", "-mfma")
    monkeypatch.setattr("lockstep.verification.harness.WARNINGS", fused)
    report = verify_folder(folder, targets=["host"], run_changed=True, **QUICK)
    assert not report.ok
    assert any("differs in" in problem for problem in report.problems)


@needs_compiler
def test_a_vector_of_neighbours_is_not_fused(tmp_path, monkeypatch):
    """GCC 12.2 fuses a x + b r beside c x - r into one instruction for vectors, with -ffp-contract=off: it may make none."""
    if " fma " not in Path("/proc/cpuinfo").read_text():
        pytest.skip("no fused multiply-add here")
    one = Controller("cart1", [[-4.0]], [[0.5, 0.5]], [[-0.4]], [[-1.0, -1.5]], (Neighbour("cart2"),))
    spec = CodegenSpec((one,), period=0.01, discretization="zoh", real="float64", name="cart_controllers")
    folder = folder_of(tmp_path, spec)
    monkeypatch.setattr(targets, "LEVELS", ("-O2",))
    monkeypatch.setattr("lockstep.verification.harness.WARNINGS", (*toolchain.WARNINGS, "-mfma"))
    assert verify_folder(folder, targets=["host"], **QUICK).ok


def test_a_changed_header_a_missing_file_and_a_changed_manifest_are_reported(tmp_path):
    folder = folder_of(tmp_path, arms())
    (folder / "README.md").unlink()
    (folder / "include" / "arm2.h").write_text((folder / "include" / "arm2.h").read_text() + "\n")
    manifest = folder / "manifest.json"
    manifest.write_text(manifest.read_text().replace('"title": "', '"title": "My '))
    report = verify_folder(folder, targets=["host"], steps=5, adversarial_steps=0)
    assert set(report.changed_files) == {"README.md", "include/arm2.h", "manifest.json"}
    assert not report.ok


@needs_compiler
def test_code_that_does_not_compile_is_a_failed_target_with_the_compilers_words(tmp_path):
    folder = folder_of(tmp_path, arms())
    break_source(folder, "check == 0.0f", "chekc == 0.0f")
    report = verify_folder(folder, targets=["host"], run_changed=True, **QUICK)
    assert not report.ok and "chekc" in report.targets[0].error
    assert str(tmp_path) not in report.targets[0].error or "src/arm1.c" in report.targets[0].error


@pytest.mark.slow
@needs_compiler
def test_code_that_crashes_or_hangs_does_not_take_us_along(tmp_path, monkeypatch):
    folder = folder_of(tmp_path, arms())
    break_source(folder, "    float check;\n", "    float check;\n    *(volatile int *)0 = 1;\n")
    report = verify_folder(folder, targets=["host"], run_changed=True, **QUICK)
    assert "failed (status -11)" in report.targets[0].error
    folder = write_folder(emit(arms()), tmp_path / "hang")
    break_source(folder, "    float check;\n", "    float check;\n    for (;;) {\n    }\n")
    monkeypatch.setattr("lockstep.verification.harness.RUN_SECONDS", 1)
    report = verify_folder(folder, targets=["host"], run_changed=True, **QUICK)
    assert "took longer than 1 s" in report.targets[0].error


def test_without_a_compiler_nothing_is_claimed(tmp_path, monkeypatch):
    monkeypatch.setattr(targets, "host_compilers", list)
    report = verify_folder(folder_of(tmp_path, arms()), targets=["host"], steps=5, adversarial_steps=0)
    assert not report.ok and report.targets[0].bitwise is None
    assert "no C compiler" in report.targets[0].skipped and "nothing is verified" in report.problems[0]


def test_a_wrong_CC_is_bad_input(monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler -O1")
    with pytest.raises(ProblemError, match="no-such-compiler"):
        host_compilers()


@needs_compiler
def test_a_given_stimulus_is_used_and_checked(tmp_path):
    folder = folder_of(tmp_path, arms())
    record = np.random.default_rng(0).normal(size=(50, 3, 2))
    assert verify_folder(folder, targets=["host"], steps=50, adversarial_steps=0, stimulus=record).ok
    for bad in (record[:49], record[:, :2], record[:, :, :1]):
        with pytest.raises(ProblemError, match="stimulus"):
            verify_folder(folder, targets=["host"], steps=50, adversarial_steps=0, stimulus=bad)


@pytest.mark.parametrize("bad", [{"steps": 0}, {"targets": ["mars"]}, {"adversarial_steps": -1}])
def test_bad_arguments_are_refused(tmp_path, bad):
    with pytest.raises(ProblemError):
        verify_folder(folder_of(tmp_path, arms()), **bad)


@needs_compiler
def test_nothing_is_written_into_the_folder(tmp_path):
    folder = folder_of(tmp_path, arms())
    before = {p: p.stat().st_mtime_ns for p in folder.rglob("*")}
    verify_folder(folder, targets=["host"], steps=5, adversarial_steps=5)
    assert {p: p.stat().st_mtime_ns for p in folder.rglob("*")} == before


def compile_arm(tmp_path, *flags):
    folder = write_folder(emit(arms()), tmp_path / "arms")
    compiler: Compiler = host_compilers()[0]
    command = [*compiler.command, *flags, "-I", str(folder / "include"), "-c", str(folder / "src" / "arm1.c")]
    done = subprocess.run(
        [*command, "-o", str(tmp_path / "arm1.o")], capture_output=True, text=True, check=False
    )
    return done.returncode, done.stderr


@needs_compiler
def test_the_source_refuses_shortcuts(tmp_path):
    assert compile_arm(tmp_path, "-std=c99")[0] == 0
    for flag in ("-ffast-math", "-ffinite-math-only"):
        status, message = compile_arm(tmp_path, "-std=c99", flag)
        assert status != 0 and "#error" in message


@needs_compiler
def test_gcc_in_its_gnu_mode_is_told_by_the_source_not_to_contract(tmp_path):
    if "gcc" not in host_compilers()[0].name or platform.machine() != "x86_64":
        pytest.skip("another compiler or processor")
    source = folder_of(tmp_path, arms()) / "src" / "arm1.c"

    def fused():
        command = [
            *host_compilers()[0].command,
            "-std=gnu99",
            "-O2",
            "-mfma",
            f"-I{source.parents[1] / 'include'}",
            "-S",
            "-o",
            "-",
        ]
        return (
            "vfm"
            in subprocess.run([*command, str(source)], check=True, capture_output=True, text=True).stdout
        )

    assert not fused()
    source.write_text(
        source.read_text().replace('#pragma GCC optimize("fp-contract=off", "no-tree-vectorize")', "")
    )
    assert fused()


@needs_compiler
@pytest.mark.skipif(not (shutil.which("cmake") and shutil.which("make")), reason="no cmake here")
def test_cmake_takes_the_folder_by_add_subdirectory(tmp_path):
    folder_of(tmp_path, arms())
    (tmp_path / "main.c").write_text(
        '#include "arm1.h"\nint main(void) { arm1_state_t s; float y[2] = {1, 2}, n[2] = {0, 0}, u[1];\n'
        "arm1_init(&s); return (int)arm1_step(&s, y, n, ARM1_ALL_RECEIVED, u); }\n"
    )
    (tmp_path / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.13)\nproject(firmware C)\nadd_subdirectory(arms)\n"
        "add_executable(firmware main.c)\ntarget_link_libraries(firmware PRIVATE arms)\n"
    )
    for command in (["cmake", "-S", ".", "-B", "b"], ["cmake", "--build", "b"], ["b/firmware"]):
        subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)


@needs_compiler
@pytest.mark.slow
@pytest.mark.parametrize("optimize", ["speed", "size"])
@pytest.mark.parametrize("real", ["float32", pytest.param("float64", marks=pytest.mark.by_hand)])
@pytest.mark.usefixtures("all_levels")
def test_all_shapes_10_000_steps_on_all_host_targets(tmp_path, real, optimize):
    spec = shapes(range(9), [1, 2, 3, 4], [1, 2], real=real, optimize=optimize)
    assert verify_folder(folder_of(tmp_path, spec), targets=["host", "sanitizers"]).problems == ()


def test_a_manifest_reads_back_to_the_same_text():
    files = emit(arms())
    assert Manifest.model_validate_json(files["manifest.json"]).text() == files["manifest.json"]


def test_sanitizers_that_do_not_link_are_told_by_the_first_line(tmp_path):
    """A linker names every library that it lacks: the first line says enough, and is not cut within a path."""
    compiler = tmp_path / "cc"
    compiler.write_text(f"#!/bin/sh\necho 'no {'long/' * 60}libasan.a' >&2\necho more >&2\nexit 1\n")
    compiler.chmod(0o755)
    said = targets._no_sanitizers(Compiler("cc", (str(compiler),)))
    assert said.endswith("libasan.a)")
