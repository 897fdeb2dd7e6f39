"""Other people's CMake: two generated folders in one tree, and one that was installed and is found as a package."""

import json
import shutil
import subprocess
from pathlib import Path

import pytest
from typer.testing import CliRunner

import lockstep
from lockstep.check.certify import certify as certify_alone
from lockstep.check.errors import ProblemError
from lockstep.cli.main import app
from lockstep.verification.toolchain import host_compilers

GENERATED = Path(__file__).parents[3] / "generated" / "flexible_joint_arms"
needs_cmake = pytest.mark.skipif(
    not (shutil.which("cmake") and shutil.which("make") and host_compilers()),
    reason="no cmake, make or compiler here",
)

MAIN = """
#include "left_arm_controllers.h"
#include "fallback_controllers.h"
#include <stdio.h>
int main(void)
{
    left_arm1_state_t left;
    spare_arm1_state_t spare;
    unsigned k;

    if ((left_arm1_init(&left) != LEFT_ARM1_OK) || (spare_arm1_init(&spare) != SPARE_ARM1_OK)) return 1;
    for (k = 0u; k < LEFT_ARM_CONTROLLERS_AGENTS; k++) {
        const left_arm_controllers_descriptor_t *d = &left_arm_controllers_descriptors[k];
        printf("%s %s %s ", d->name, d->design, d->claims);
        printf("%g %u %u\\n", (double)d->period, (unsigned)d->order, (unsigned)d->state_bytes);
    }
    printf("%s %s\\n", fallback_controllers_descriptors[0].name, fallback_controllers_descriptors[0].design);
    return 0;
}
"""
TREE = """
cmake_minimum_required(VERSION 3.13)
project(firmware C)
add_subdirectory(left)
add_subdirectory(spare)
add_executable(firmware main.c)
target_link_libraries(firmware PRIVATE lockstep::left_arm_controllers lockstep::fallback_controllers)
"""
PACKAGE = """
cmake_minimum_required(VERSION 3.13)
project(firmware C)
find_package(left_arm_controllers CONFIG REQUIRED)
add_subdirectory(spare)
add_executable(firmware main.c)
target_link_libraries(firmware PRIVATE lockstep::left_arm_controllers fallback_controllers)
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """The arms as `left_arm1`, ...; the same design again, in a loop over a table, as a fallback."""
    place = tmp_path_factory.mktemp("consumer")
    lockstep.generate(GENERATED / "design.json", place / "left", prefix="left_")
    lockstep.generate(
        GENERATED / "design.json",
        place / "spare",
        optimize="size",
        name="fallback_controllers",
        prefix="spare_",
    )
    (place / "main.c").write_text(MAIN)
    return place


def test_a_folder_is_not_named_as_a_header_of_a_compiler_may_be(tmp_path):
    """`include/features.h` would stand in the place of the one that the compiler's own stdint.h includes."""
    with pytest.raises(ProblemError, match="a name that ends in _controllers"):
        lockstep.generate(GENERATED / "design.json", tmp_path / "out", name="features_of_mine")
    assert not (tmp_path / "out").exists()


def cmake(place, *arguments):
    return subprocess.run(
        ["cmake", *map(str, arguments)], cwd=place, capture_output=True, text=True, check=False
    )


def built(place, lists, build, *options):
    (place / "CMakeLists.txt").write_text(lists)
    for arguments in (["-S", ".", "-B", build, *options], ["--build", build]):
        done = cmake(place, *arguments)
        assert done.returncode == 0, done.stdout + done.stderr
    return subprocess.run(
        [place / build / "firmware"], capture_output=True, text=True, check=True
    ).stdout.splitlines()


def check_descriptors(place, lines):
    manifest = json.loads((place / "left" / "manifest.json").read_text())
    identity = manifest["identity"]
    assert identity["design"] == manifest["design_hash"]
    for agent, line in zip(manifest["agents"], lines, strict=False):
        name, design, claims, period, order, state_bytes = line.split()
        assert (name, design, claims) == (agent["name"], identity["design"], identity["claims"])
        assert (float(period), int(order), int(state_bytes)) == (0.005, agent["order"], agent["state_bytes"])
    assert lines[-1].split() == ["spare_arm1", identity["design"]]


@needs_cmake
def test_two_folders_in_one_tree(place):
    check_descriptors(place, built(place, TREE, "tree"))


@needs_cmake
def test_an_installed_folder_is_found_as_a_package(place):
    for arguments in (
        ["-S", "left", "-B", "left-build", f"-DCMAKE_INSTALL_PREFIX={place / 'installed'}"],
        ["--build", "left-build", "--target", "install"],
    ):
        done = cmake(place, *arguments)
        assert done.returncode == 0, done.stdout + done.stderr
    check_descriptors(place, built(place, PACKAGE, "package", f"-DCMAKE_PREFIX_PATH={place / 'installed'}"))


@needs_cmake
def test_the_same_folder_twice_is_told_what_to_do(place):
    shutil.copytree(place / "left", place / "again", dirs_exist_ok=True)
    (place / "CMakeLists.txt").write_text(TREE.replace("(spare)", "(again)"))
    done = cmake(place, "-S", ".", "-B", "twice")
    assert done.returncode != 0
    assert "with --prefix" in " ".join(done.stderr.split())


@pytest.mark.parametrize("folder", ["left", "spare"])
def test_a_folder_with_a_prefix_is_certified(place, folder):
    result = CliRunner().invoke(app, ["certify", str(place / folder), "--json"])
    answer = json.loads(result.stdout)
    assert (result.exit_code, answer["differences"]) == (0, [])
    assert certify_alone(place / folder).proved, "by the checker without the rest, too"


@pytest.mark.parametrize("options", [{"prefix": "1"}, {"prefix": "a-"}, {"name": "a b"}, {"name": "ARM1"}])
def test_a_name_that_c_cannot_have_is_refused(tmp_path, options):
    with pytest.raises(ProblemError):
        lockstep.generate(GENERATED / "design.json", tmp_path / "c", **options)
    assert not (tmp_path / "c").exists()
