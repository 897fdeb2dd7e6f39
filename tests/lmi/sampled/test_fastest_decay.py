"""The decay of what ships, by a V of its own: near that of a loop whose decay is known, and never beyond it."""

import math
from dataclasses import replace

import pytest
from lmi_cases import PATH_2, problem

from lockstep.codegen.sampled_design import prove_design, with_sampled
from lockstep.lmi.design import design
from lockstep.lmi.design_verdict import certify
from lockstep.lmi.document import Stored, design_file_of

D, PERIOD = 2.0, 0.05


@pytest.fixture(scope="module")
def shipped() -> Stored:
    """x_i' = u_i, u_i = -D (x_i - x_j), held: x_d+ = (1 - 2 D T) x_d, and V+ = (1 - 2 D T)^2 V."""
    gain = f"{{ A = [], B = [], C = [[]], D = [[{-D}]] }}"
    posed = problem(
        dynamics={"x": "u"},
        outputs={"y": "x"},
        network=PATH_2,
        design=f'method = "given"\ngains = [{gain}, {gain}]\n[controller]\nperiod = {PERIOD}',
    )
    made = design_file_of(design(posed))
    return with_sampled(made, prove_design(made))


def test_the_decay_of_a_known_loop_is_nearly_all_of_it(shipped: Stored) -> None:
    claimed, exact = shipped.claims.sampled, (1 - 2 * D * PERIOD) ** 2
    assert claimed.fastest_decay is not None
    assert claimed.decay is not None
    assert exact <= claimed.fastest_decay < claimed.decay
    assert math.log(claimed.fastest_decay) < 0.9 * math.log(exact), (
        "the rate is at least 0.9 of that of the loop"
    )
    assert certify(shipped).certified


def test_a_decay_that_is_claimed_faster_than_its_witness_s_is_refused(shipped: Stored) -> None:
    claims = shipped.claims.sampled
    assert claims.fastest_decay is not None
    faster = replace(claims, fastest_decay=claims.fastest_decay * (1 - 1e-12))
    verdict = certify(replace(shipped, claims=replace(shipped.claims, sampled=faster)))
    assert verdict.failed == "sampled_decay"
    slower = replace(claims, fastest_decay=claims.fastest_decay * (1 + 1e-12))
    assert certify(replace(shipped, claims=replace(shipped.claims, sampled=slower))).ok


def test_a_decay_beyond_that_of_the_loop_has_no_witness(shipped: Stored) -> None:
    """Of the witness for it, with its factor lowered below that of the linear loop, Omega is not positive definite."""
    witness, beyond = shipped.proofs.sampled_decay, 0.999 * (1 - 2 * D * PERIOD) ** 2
    for lowered in (replace(witness, decay=beyond), None):
        proofs = replace(shipped.proofs, sampled_decay=lowered)
        claims = replace(shipped.claims, sampled=replace(shipped.claims.sampled, fastest_decay=beyond))
        assert certify(replace(shipped, claims=claims, proofs=proofs)).failed == "sampled_decay"
