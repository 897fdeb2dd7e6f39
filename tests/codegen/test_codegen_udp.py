"""The UDP example: three processes agree, with and without losses; too short a run is said to fail."""

import json
import platform
import subprocess

import pytest

from lockstep.verification.toolchain import WARNINGS, host_compilers

pytestmark = pytest.mark.skipif(
    not host_compilers() or platform.system() == "Windows", reason="needs a C compiler and POSIX"
)


@pytest.fixture(scope="module")
def consensus(root, tmp_path_factory):
    directory = tmp_path_factory.mktemp("udp")
    example, folder = root / "examples" / "udp", root / "generated" / "flexible_joint_arms"
    compiler = [*host_compilers()[0].command, "-std=c99", "-O2", f"-I{folder / 'include'}"]
    posix = ["-D_POSIX_C_SOURCE=200809L", "-Wall", "-Wextra", "-Werror", f"-I{example}"]
    objects = []
    for agent in ("arm1", "arm2", "arm3"):
        for source, flags in (
            (folder / "src" / f"{agent}.c", WARNINGS),
            (example / "node.c", [*posix, f"-DAGENT={agent}"]),
        ):
            objects.append(f"{source.stem}_{agent}.o")
            subprocess.run([*compiler, *flags, "-c", source, "-o", objects[-1]], cwd=directory, check=True)
    subprocess.run(
        [*compiler, *posix, example / "main.c", *objects, "-lm", "-o", "consensus"], cwd=directory, check=True
    )
    return directory / "consensus"


def outcome(consensus, *arguments):
    done = subprocess.run(
        [consensus, *map(str, arguments)], capture_output=True, text=True, timeout=600, check=False
    )
    return done.returncode, json.loads(done.stdout), done.stderr


@pytest.mark.parametrize(("loss", "seed"), [(0, 1), (0.1, 1), (0.1, 2), (0.1, 3)])
def test_the_disagreement_falls_by_1000(consensus, loss, seed):
    status, found, said = outcome(consensus, loss, 4000, seed)
    assert status == 0, said
    assert found["disagreement_initial"] > 1
    assert found["disagreement_final"] * 1000 < found["disagreement_initial"]
    missing = [int(line.split()[2]) for line in said.splitlines() if "missing" in line]
    assert len(missing) == 3
    for count in missing:  # 3999 messages: 400 on average, standard deviation 19; one more is the first tick
        assert 300 < count < 500 if loss else count < 100


def test_a_run_that_is_too_short_is_a_failure(consensus):
    status, found, _ = outcome(consensus, 0, 100, 1)
    assert status == 1
    assert found["disagreement_final"] * 1000 > found["disagreement_initial"]


def test_without_messages_they_do_not_agree(consensus):
    status, found, _ = outcome(consensus, 1, 4000, 1)
    assert status == 1
    assert not found["disagreement_final"] * 1000 < found["disagreement_initial"]
