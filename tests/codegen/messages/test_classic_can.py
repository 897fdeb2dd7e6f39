"""The period of a node on classic CAN, as the page shows it: the bits of the reference, one period late."""

import re
import subprocess

import numpy as np
import pytest

from lockstep.codegen.manifest import load_manifest
from lockstep.verification.reference import Reference
from lockstep.verification.toolchain import WARNINGS, host_compilers

pytestmark = pytest.mark.skipif(not host_compilers(), reason="no compiler here")
PERIODS = 40
LOST = 7
"""Of every so many periods one, in which the neighbour's frame is of the period before."""
BUS = """
#include <stdio.h>
static float reading[2];
static uint32_t sent;
void can_send(uint32_t identifier, const uint8_t data[8]) { (void)data; sent = identifier; }
void read_sensors(float into[2]) { into[0] = reading[0]; into[1] = reading[1]; }
void set_actuator(const float u[1]) { printf("%a %u\\n", (double)u[0], (unsigned)controller.age[0]); }
int main(void)
{
    unsigned k, of;
    float heard[2];
    uint8_t data[8];
    if (arm1_init(&controller) != ARM1_OK) return 1;
    for (k = 0u; scanf("%f %f %f %f %u", &reading[0], &reading[1], &heard[0], &heard[1], &of) == 5; k++) {
        if (on_sync(k) != ARM1_OK || sent != (ARM1_FRAME | (k & 1u))) return 2;
        memcpy(data, heard, sizeof data);
        on_frame(ARM2_FRAME | (of & 1u), data);
        on_frame(0x130u | (k & 1u), data); /* of a node that this one does not hear */
    }
    return 0;
}
"""


def test_the_node_of_the_page_steps_as_its_reference_one_period_late(root, tmp_path):
    """By hand: u set at SYNC k + 1 is the step of the readings and the frames of period k, and a late frame is none."""
    page = (root / "docs" / "howto-messages.md").read_text("utf-8").split("## On classic CAN")[1]
    main = tmp_path / "main.c"
    main.write_text(re.search(r"```c\n(.*?)```", page, re.DOTALL)[1] + BUS)
    folder, random = root / "generated" / "flexible_joint_arms", np.random.default_rng(3)
    flags = [one for one in WARNINGS if one != "-Wdouble-promotion"]
    command = [
        *host_compilers()[0].command,
        *flags,
        f"-I{folder / 'include'}",
        str(folder / "src" / "arm1.c"),
        str(main),
    ]
    subprocess.run([*command, "-o", "loop"], cwd=tmp_path, check=True)
    rows = random.normal(size=(PERIODS, 4)).astype(np.float32)
    of = [k - (k % LOST == LOST - 1) for k in range(PERIODS)]
    given = "\n".join(
        " ".join([*(repr(float(v)) for v in row), str(j)]) for row, j in zip(rows, of, strict=True)
    )
    done = subprocess.run([tmp_path / "loop"], input=given, capture_output=True, text=True, check=True)
    manifest = load_manifest(folder)
    reference, ages = Reference.of(manifest.agents[0], manifest), 0
    shown = [line.split() for line in done.stdout.splitlines()]
    assert len(shown) == PERIODS - 1, "the first SYNC sets nothing"
    for k, (u, age) in enumerate(shown):
        there = of[k] == k
        status, expected = reference.step(rows[k, :2], rows[k : k + 1, 2:], int(there))
        ages = 0 if there else ages + 1
        assert (status, float.fromhex(u), int(age)) == (0, float(expected[0]), ages)
