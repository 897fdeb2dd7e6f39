"""What is claimed of limits is claimed of exact readings: it is said, and a run shows that it has to be."""

import numpy as np

from lockstep.codegen.manifest import load_manifest
from lockstep.verification.reference import references


def test_limits_are_claimed_of_exact_readings_and_not_of_rounded_ones(generated):
    """Two arms 0.2 rad apart at 1e8 rad, where floats are 8 apart: within the radius, and the first step clips."""
    said = " ".join((generated / "include" / "arm1.h").read_text().replace("\n *", " ").split())
    for claim in ("limits: |u| < 10 V for ever from", "clipped: from a disagreement of at most"):
        rest = said.split(claim)[1]
        assert "controllers at rest, no disturbance, readings and messages exact" in rest[:140]
    assert "counted as `disturbances` says, all else exact" in said
    controller = references(load_manifest(generated))["arm1"]
    y, other = np.float32(1e8 + 4.1), np.float32(1e8 + 3.9)
    assert abs(y - other) == 8, "the readings of 0.2"
    status, _ = controller.step(np.array([y, 0], np.float32), np.array([[other, 0]], np.float32), 1)
    assert status == 8, "CLIPPED"


def test_the_header_says_what_rho_is(generated):
    said = " ".join((generated / "include" / "arm1.h").read_text().replace("\n *", " ").split())
    assert "rho: the L2 gain from the disturbances to what is weighed, from agreement at rest" in said
