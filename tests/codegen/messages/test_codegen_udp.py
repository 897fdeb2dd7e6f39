"""The UDP example: three processes agree through a relay that loses and reorders, also if one is killed and started anew."""

import json
import platform
import subprocess

import pytest
from export_cases import generated

from lockstep.verification.toolchain import WARNINGS, host_compilers

pytestmark = pytest.mark.skipif(
    not host_compilers() or platform.system() == "Windows", reason="needs a C compiler and POSIX"
)


@pytest.fixture(scope="module")
def consensus(root, tmp_path_factory):
    directory = tmp_path_factory.mktemp("udp")
    example = root / "examples" / "udp"
    folder = generated(root, directory / "arms", "--messages")
    include = [f"-I{folder / place}" for place in ("include", "messages")]
    compiler = [*host_compilers()[0].command, "-std=c99", "-O2", *include]
    posix = ["-D_DEFAULT_SOURCE", "-Wall", "-Wextra", "-Werror", f"-I{example}"]
    sources = [(folder / "messages" / "arm_controllers_message.c", WARNINGS), (example / "relay.c", posix)]
    for agent in ("arm1", "arm2", "arm3"):
        sources += [
            (folder / "src" / f"{agent}.c", WARNINGS),
            (folder / "messages" / f"{agent}_node.c", WARNINGS),
        ]
        sources.append((example / "node.c", [*posix, f"-DAGENT={agent}"]))
    objects = [f"{k}.o" for k in range(len(sources))]
    for name, (source, flags) in zip(objects, sources, strict=True):
        subprocess.run([*compiler, *flags, "-c", source, "-o", name], cwd=directory, check=True)
    subprocess.run(
        [*compiler, *posix, example / "main.c", *objects, "-lm", "-o", "consensus"], cwd=directory, check=True
    )
    return directory / "consensus"


def outcome(consensus, *arguments):
    done = subprocess.run(
        [consensus, *map(str, arguments)], capture_output=True, text=True, timeout=600, check=False
    )
    return done.returncode, json.loads(done.stdout), done.stderr


@pytest.mark.parametrize(
    ("loss", "ticks", "seed", "kill"),
    [(0, 4000, 1, 0), (0.3, 4000, 1, 0), (0.3, 4000, 2, 0), (0.3, 8000, 1, 1), (0.1, 8000, 3, 1)],
)
def test_the_disagreement_falls_by_1000(consensus, loss, ticks, seed, kill):
    status, found, said = outcome(consensus, loss, ticks, seed, kill)
    assert status == 0, said
    assert found["disagreement_initial"] > 1
    assert found["disagreement_final"] * 1000 < found["disagreement_initial"]
    # One message in fifty has a bit flipped, and some are overtaken or come twice: each of these is refused.
    assert all(count > 0.02 * (1 - loss) * ticks / 2 for count in found["refused"])


def test_a_run_that_is_too_short_is_a_failure(consensus):
    status, found, _ = outcome(consensus, 0, 100, 1)
    assert status == 1
    assert found["disagreement_final"] * 1000 > found["disagreement_initial"]


def test_without_messages_they_do_not_agree(consensus):
    status, found, _ = outcome(consensus, 1, 4000, 1)
    assert status == 1
    assert not found["disagreement_final"] * 1000 < found["disagreement_initial"]
    assert found["refused"] == [0, 0, 0]
