"""The C that a folder's README shows: it compiles, and a plant that was stopped stays so until it is started anew."""

import re
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest
from codegen_cases import TABLE_1, arms, random_controller

import lockstep
from lockstep.codegen.emission.emit import emit
from lockstep.codegen.folder import write_folder
from lockstep.codegen.manifest import load_manifest
from lockstep.codegen.spec import CodegenSpec
from lockstep.verification.harness import product_sources
from lockstep.verification.one_image import with_nodes
from lockstep.verification.toolchain import WARNINGS, host_compilers

GENERATED = Path(__file__).parents[3] / "generated" / "flexible_joint_arms"
pytestmark = pytest.mark.skipif(not host_compilers(), reason="no compiler here")
MAIN = """
int start(START);
int tick(const float y[Q], const float *neighbour_y, MASK received, float u[M]);
SHOWN
int main(void)
{
    const float y[Q] = {0.5f}, none[Q] = {0.0f / zero}, rows[9 * Q] = {0.1f};
    float u[M];
    int k;

    HEARD
    if (!start(FIRST)) return 1;
    if (!tick(y, rows, 1u, u) || !tick(none, rows, 1u, u) || !tick(none, rows, 1u, u) || !tick(y, rows, 1u, u)) return 2;
    if (!tick(none, rows, 1u, u) || !tick(none, rows, 1u, u) || tick(none, rows, 1u, u)) return 3;
    for (k = 0; k < 50; k++) {
        if (tick(y, rows, 1u, u)) return 4; /* it stays stopped */
    }
    if (!start(FIRST)) return 5;
    for (k = 0; k < 50; k++) {
        if (!tick(y, rows, 0u, u)) return 7; /* nobody was heard yet */
    }
    for (k = 0; k < 50; k++) {
        if (!tick(y, rows, (k < 10) ? 1u : 0u, u)) break;
    }
    return (k == LAST) ? 0 : 6;
}
"""


GAINS = dict(zip("ABCD", TABLE_1[0], strict=True))
IMAGE = {"START": "uint32_t number", "FIRST": "0u", "HEARD": "list.count = 1u; list.weight[0] = 1.0f;"}
NO_IMAGE = {"START": "void", "FIRST": "", "HEARD": ""}


def run(folder, place, who, shape, last, more=NO_IMAGE):
    """The status of a program with what the README shows."""
    shown = re.search(r"```c\n(.*?)```", (folder / "README.md").read_text(), re.DOTALL)[1]
    words = {"Q": shape[0], "M": shape[1], "MASK": f"{who}_mask_t", "LAST": last, **more}
    main = re.sub(rf"\b({'|'.join(words)})\b", lambda found: str(words[found[0]]), MAIN)
    include, rest = shown.split("\n", 1)
    source = place / "main.c"
    declared = main.replace("SHOWN", "static volatile float zero = 0.0f;\n" + rest)
    source.write_text(f"{include}\n{declared}")
    compiler = host_compilers()[0]
    manifest = with_nodes(load_manifest(folder))
    files = [*product_sources(manifest, folder), source]
    flags = [one for one in WARNINGS if one != "-Wdouble-promotion"]
    command = [*compiler.command, *flags, f"-I{folder / 'include'}", *map(str, files), "-o", "main"]
    subprocess.run(command, cwd=place, check=True)
    return subprocess.run([place / "main"], check=False).returncode


@pytest.mark.parametrize("one_image", [False, True])
def test_a_stopped_plant_stays_stopped(tmp_path, one_image):
    """Also by old messages: more than 20 periods, three times; not by neighbours that have not started."""
    made = tmp_path / "made"
    lockstep.generate(GENERATED / "design.json", made, one_image=one_image)
    more = ("arm_node", (2, 1), 32, IMAGE) if one_image else ("arm1", (2, 1), 32)
    assert run(made, tmp_path, *more) == 0
    # What is stated of RAM is what a node, or a controller, takes.
    source, who = tmp_path / "size.c", more[0]
    source.write_text(
        f'#include "{who}.h"\n#include <stdio.h>\nint main(void) {{ printf("%zu", sizeof({who}_state_t)); return 0; }}\n'
    )
    command = [*host_compilers()[0].command, f"-I{made / 'include'}", str(source), "-o", "size"]
    subprocess.run(command, cwd=tmp_path, check=True)
    size = subprocess.run([tmp_path / "size"], capture_output=True, text=True, check=True).stdout
    row = next(line for line in (made / "README.md").read_text().splitlines() if line.startswith("| `arm1`"))
    assert row.endswith(f"| {size} bytes |")


def test_a_leader_hears_nobody(tmp_path):
    agent = random_controller("c", 2, 2, 1, neighbours=0)
    made = write_folder(emit(CodegenSpec((agent,), 0.01, name="cs")), tmp_path / "made")
    assert run(made, tmp_path, "c", (2, 1), 50) == 0


def test_a_readme_says_which_loop_its_claims_are_of():
    """Of lost messages they are of the nodes, not of the loop that is shown; equal gains can share one source."""
    spec = arms()
    equal = replace(spec, agents=tuple(replace(one, **GAINS) for one in spec.agents), plants=())
    lossy = replace(spec, certificate={"certified": True, "messages": "a link loses half of them"})
    plain, alike, told = (emit(one)["README.md"] for one in (spec, equal, lossy))
    assert ("--one-image" in plain, "--one-image" in alike) == (False, True)
    assert ("messages/arm1_node.h" in plain, "messages/arm1_node.h" in told) == (False, True)
