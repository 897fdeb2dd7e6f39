"""Static analysis of generated folders, each part with a defect that it must find; tools that are absent are said.

Debian: clang, clang-tidy, cppcheck (with its MISRA add-on), frama-c-base.
"""

import os
import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from codegen_cases import arms, shapes

from lockstep.codegen.emission.emit import emit
from lockstep.codegen.exports import with_exports
from lockstep.codegen.folder import write_folder
from lockstep.codegen.manifest import FixedEntry
from lockstep.verification.toolchain import WARNINGS

# what the guards of the sources ask the compiler, which cppcheck is not
CPPCHECK = """--std=c99 --addon=misra --enable=warning,style,performance,portability -q --error-exitcode=0
    -DFLT_EVAL_METHOD=0 -DFLT_RADIX=2 -DFLT_MANT_DIG=24 -DDBL_MANT_DIG=53 -DUINT32_MAX=4294967295U
    -Iinclude src""".split()  # noqa: SIM905
# easily-swappable-parameters: y and neighbour_y have the type they have. implicit-widening: an index below 64 q.
TIDY = (
    "-*,bugprone-*,cert-*,clang-analyzer-*,misc-*,performance-*,portability-*"
    ",-bugprone-easily-swappable-parameters,-bugprone-implicit-widening-of-multiplication-result"
)


def needs(tool):
    return pytest.mark.skipif(shutil.which(tool) is None, reason=f"{tool} is not installed")


@pytest.fixture(params=["speed", "size"])
def folder(request, tmp_path):
    spec = shapes([0, 1], [2], [1, 2], optimize=request.param)
    return write_folder(emit(spec), tmp_path / "shapes")


def sources(folder):
    return sorted(str(path.relative_to(folder)) for path in (folder / "src").glob("*.c"))


def said(command, folder):
    place = {**os.environ, "PWD": str(folder)}  # Frama-C believes PWD
    done = subprocess.run(
        command, cwd=folder, env=place, capture_output=True, text=True, timeout=600, check=False
    )
    return done.returncode, done.stdout + done.stderr


def change(folder, name, old, new):
    path = folder / "src" / f"{name}.c"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


@pytest.mark.parametrize("compiler", [pytest.param(c, marks=needs(c)) for c in ("gcc", "clang")])
def test_no_compiler_has_a_warning(folder, compiler):
    command = [compiler, *WARNINGS, "-fsyntax-only", "-Iinclude"]
    assert said([*command, *sources(folder)], folder) == (0, "")
    change(folder, "c121", "uint32_t k;", "uint32_t k; int narrow = 0.5f;")
    assert said([*command, *sources(folder)], folder)[0] != 0


@pytest.mark.parametrize("compiler", [pytest.param(c, marks=needs(c)) for c in ("g++", "clang++")])
def test_a_header_in_cpp_has_no_warning(folder, compiler):
    flags = "-std=c++11 -Wall -Wextra -Wpedantic -Wconversion -Wold-style-cast -Wshadow -Werror".split()  # noqa: SIM905
    unit = '#include "c122.h"\nstatic_assert(C122_ALL_RECEIVED == {}, "one bit per neighbour");\nc122_mask_t m = {};\n'
    command = [compiler, *flags, "-fsyntax-only", "-Iinclude", "unit.cpp"]
    (folder / "unit.cpp").write_text(unit.format("0x1", "C122_ALL_RECEIVED"))
    assert said(command, folder) == (0, "")
    (folder / "unit.cpp").write_text(unit.format("0x1", "(c122_mask_t)C122_ALL_RECEIVED"))
    assert said(command, folder)[0] != 0


@needs("clang-tidy")
def test_clang_tidy_finds_nothing(folder):
    command = ["clang-tidy", "--quiet", "--warnings-as-errors=*", f"-checks={TIDY}"]
    flags = ["--", "-std=c99", "-Iinclude"]
    status, text = said([*command, *sources(folder), *flags], folder)
    assert status == 0, text
    change(
        folder, "c121", "check = 0.0f;\n", "check = 0.0f;\n    uint32_t zero = 0u;\n    zero = 1u / zero;\n"
    )
    assert said([*command, *sources(folder), *flags], folder)[0] != 0


def documented(root, found_by=""):
    rows = re.findall(r"^\| ([\d.]+|Dir [\d.]+) \|(.*)$", (root / "docs" / "misra.md").read_text(), re.M)
    return {rule for rule, rest in rows if found_by in rest}


def misra_rules(folder):
    _, text = said(["cppcheck", *CPPCHECK], folder)
    findings = set(re.findall(r"\[([\w.-]+)\]$", text, re.M))
    other = {finding for finding in findings if not finding.startswith("misra-c2012-")}
    assert other == set(), text
    return {finding.removeprefix("misra-c2012-") for finding in findings}


@pytest.mark.slow
@needs("cppcheck")
def test_misra_deviations_are_those_of_the_table(tmp_path, root):
    found = set()
    for optimize, real in (("speed", "float32"), ("size", "float64")):
        spec = shapes([0, 2], [2], [1, 2], optimize=optimize, real=real)
        found |= misra_rules(write_folder(emit(spec), tmp_path / optimize))
        found |= misra_rules(
            write_folder(emit(arms(optimize=optimize, real=real)), tmp_path / f"arms_{optimize}")
        )
        found |= misra_rules(write_folder(emit(limited(optimize, real)), tmp_path / f"limited_{optimize}"))
    assert found <= documented(root)
    assert found >= documented(root, "cppcheck")


def limited(optimize="speed", real="float32"):
    """The arms, u being clipped."""
    spec = arms(optimize=optimize, real=real)
    return replace(spec, agents=tuple(replace(one, limits=np.array([[-6.0, 5.0]])) for one in spec.agents))


@pytest.mark.slow
@needs("cppcheck")
def test_integers_deviate_in_macros_for_the_caller_alone(tmp_path):
    """No shift of a signed value, no cast of a composite expression: what is found is 2.5."""
    formats = FixedEntry(outputs=(11,) * 2, inputs=(10,), states=((22,) * 2,) * 3, claims=())
    spec = replace(limited(), fixed=formats)
    folder = write_folder(with_exports(emit(spec), ["fixed"]), tmp_path / "arms")
    command = ["cppcheck", *CPPCHECK[:-2], "-Ifixed", "fixed"]
    assert set(re.findall(r"\[([\w.-]+)\]$", said(command, folder)[1], re.M)) == {"misra-c2012-2.5"}
    path = folder / "fixed" / "arm1_fixed.c"
    path.write_text(path.read_text().replace("return (int32_t)shifted - 131072;", "return value >> 14;"))
    assert "misra-c2012-10.1" in said(command, folder)[1]


@needs("gcc")
def test_floats_are_compared_for_equality_only_where_the_misra_page_says(folder, tmp_path):
    """v - v is 0 or NaN: what is compared is always a sum of these, and nothing but 0."""
    clips = write_folder(emit(limited()), tmp_path / "limited")
    for made in (folder, clips):
        _, text = said(
            ["gcc", "-std=c99", "-Wfloat-equal", "-fsyntax-only", "-Iinclude", *sources(made)], made
        )
        sites = re.findall(r"^ +[0-9]+ \| (.*)$", text, re.M)
        assert len(sites) == text.count("[-Wfloat-equal]") > 0
        checks = r"_check\(([yru]|&neighbour_y\[j \* \d+u\]), \d+u\) [!=]= 0\.0f\)"
        allowed = rf"\(check == 0\.0f\)|\(inputs == 0\.0f\)|{checks}|\* scale\) == answer\["
        assert [site for site in sites if not re.search(allowed, site)] == []


@needs("cppcheck")
def test_a_new_deviation_would_be_seen(tmp_path, root):
    folder = write_folder(emit(arms()), tmp_path / "arms")
    change(
        folder, "arm1", "    return status;", "    if (status == ARM1_OK) return ARM1_OK;\n    return status;"
    )
    assert "15.5" in misra_rules(folder) - documented(root)


def eva(folder, agent, *options, extra=""):
    """The number of alarms, of functions that were not reached, and whether every statement of the others was: without
    that, no alarm means little."""
    command = ["frama-c", "-eva", "-eva-precision", "2", *options, f"-cpp-extra-args=-Iinclude {extra}"]
    status, text = said([*command, f"proof/{agent}_eva.c", f"src/{agent}.c"], folder)
    assert status == 0, text
    alarms = int(re.search(r"(\d+) alarms? generated by the analysis", text)[1])
    reached, functions = map(int, re.search(r"(\d+) functions analyzed \(out of (\d+)\)", text).groups())
    return alarms, functions - reached, "): 100% coverage" in text.split("In these functions")[1]


PROVED, OF_A_STEP = (0, 0, True), (0, 3, True)
"""Of all; of all but init, its self-check, which computes with NaN on purpose, and what both start with."""

RANGES, ANY = ("-warn-special-float", "non-finite"), ("-warn-special-float", "none")


@needs("frama-c")
@pytest.mark.parametrize("optimize", ["speed", "size"])
def test_eva_proves_that_a_step_within_the_limits_is_safe_and_finite(tmp_path, optimize):
    folder = write_folder(emit(arms(optimize=optimize)), tmp_path / "arms")
    for agent in ("arm1", "arm2", "arm3"):
        assert eva(folder, agent, *RANGES) == OF_A_STEP
    assert eva(folder, "arm1", *RANGES, extra="-DLOCKSTEP_LIMIT=1e38f")[0] > 0, "which does overflow"


@needs("frama-c")
def test_eva_proves_memory_safety_for_every_bit_pattern(tmp_path):
    folder = write_folder(emit(arms()), tmp_path / "arms")
    assert eva(folder, "arm1", *ANY, extra="-DLOCKSTEP_ANY") == PROVED
    change(folder, "arm1", "k < 2u; k++", "k <= 2u; k++")
    assert eva(folder, "arm1", *ANY, extra="-DLOCKSTEP_ANY")[0] > 0, "one step beyond the array"


@needs("frama-c")
@pytest.mark.slow
@pytest.mark.parametrize("real", ["float32", pytest.param("float64", marks=pytest.mark.by_hand)])
@pytest.mark.parametrize("optimize", ["speed", "size"])
def test_eva_on_many_shapes(tmp_path, optimize, real):
    spec = shapes([0, 1, 4, 8], [1, 4], [1, 2], optimize=optimize, real=real)
    folder = write_folder(emit(spec), tmp_path / "shapes")
    for agent in spec.agents:
        assert eva(folder, agent.name, *RANGES) == OF_A_STEP, agent.name
        assert eva(folder, agent.name, *ANY, extra="-DLOCKSTEP_ANY") == PROVED, agent.name
