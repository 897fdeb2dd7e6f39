"""The largest certified periods of three designs of the arms, each confirmed from both sides.

The published gains (Table 1, Corollary 1), the certified design of least rho in `tests/designs/`, and one made for 20 ms.
"""

import json
from dataclasses import replace

import numpy as np
import pytest
from sampled_cases import brute_force_radius

from lockstep.check.continuous.inequality import Performance
from lockstep.check.design_file.proofs import Proofs
from lockstep.check.system.loop import Gains
from lockstep.codegen.sampled_design import longest_period, sampled_network
from lockstep.codegen.sampled_modes import sampled_controllers
from lockstep.lmi.document import parse
from lockstep.lmi.proposal import given_gains
from lockstep.lmi.sampled import certify_sampled, sampled_rho
from lockstep.model.problem import load_problem

FOR_20_MS = np.array(
    [
        [
            [12.3735, 21.7111, 1.9935, -0.1968],
            [-18.5997, -8.8518, -5.3764, -0.4562],
            [-39.4113, 21.842, -15.9484, -2.3792],
        ],
        [
            [25.3306, -25.3809, -15.3241, -2.814],
            [-0.1575, 15.5231, 6.7067, 0.6459],
            [32.9801, -3.3455, -7.5981, -2.4456],
        ],
        [
            [-2.9896, -7.5794, -0.4262, 0.0121],
            [3.5073, 1.693, -0.04, -0.0336],
            [2.9079, -8.329, -0.9436, -0.0823],
        ],
    ]
)
"""[A B; C D] of each arm, as `lockstep design examples/slow_arms.toml` with `for_period = true` made them."""

M_FOR_20_MS = np.array([0.325502, 0.217888, 0.846254])
"""The pair weights that prove its rho."""


@pytest.fixture(scope="module")
def certified(root):
    path = root / "tests" / "designs" / "arms_rho_only.json"
    return parse(json.loads(path.read_text()), str(path))


@pytest.fixture(scope="module")
def designs(root, certified):
    published = load_problem(root / "examples" / "table_1.toml")
    return {
        "published": replace(certified, problem=published, gains=given_gains(published), proofs=Proofs()),
        "certified": certified,
        "for 20 ms": replace(certified, gains=Gains.from_blocks(FOR_20_MS, 2), proofs=Proofs()),
    }


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "certified_to", "broken_at"),
    [("published", 0.09646, 0.0967), ("certified", 0.03361, 0.0338), ("for 20 ms", 0.03448, 0.0347)],
)
def test_the_largest_period_is_confirmed_from_both_sides(designs, name, certified_to, broken_at):
    stored = designs[name]
    network = replace(sampled_network(stored), period=0.005)
    longest = longest_period(stored, network, None)
    assert longest.period == pytest.approx(certified_to, rel=2e-3)
    shorter = 0.98 * longest.period
    assert certify_sampled(
        replace(network, period=shorter), sampled_controllers(stored, shorter), thorough=False
    ).certified
    # The same slope in every arm, constant, at most alpha: plain exponentials, in coordinates of their own.
    beyond = replace(network, period=broken_at)
    assert brute_force_radius(beyond, sampled_controllers(stored, broken_at)) > 1
    assert brute_force_radius(replace(network, period=shorter), sampled_controllers(stored, shorter)) < 1


@pytest.mark.slow
def test_a_design_for_20_ms_does_better_there(designs):
    weights = Performance(np.eye(4), 2 * np.eye(2))
    found = {}
    for name, m in (("certified", designs["certified"].proofs.certificate.m), ("for 20 ms", M_FOR_20_MS)):
        network = replace(sampled_network(designs[name]), period=0.02)
        controllers = sampled_controllers(designs[name], 0.02)
        assert certify_sampled(network, controllers, m, thorough=False).certified
        found[name] = sampled_rho(network, controllers, weights, m).rho
    assert found["certified"] == pytest.approx(3.636, rel=5e-3)
    assert found["for 20 ms"] < 0.95 * found["certified"]
