"""What a design file keeps of its sampled controllers when they are proved again."""

import json
from dataclasses import replace

import pytest

from lockstep.codegen.sampled_design import NOT_FOR_PERIOD, HeldVerdict, with_sampled
from lockstep.lmi.document import parse, sampled_answer
from lockstep.lmi.sampled import SampledVerdict
from lockstep.workflow.build import unproved


@pytest.fixture
def stored(root):
    folder = root / "generated" / "flexible_joint_arms"
    return parse(json.loads((folder / "design.json").read_text()), "design.json")


def test_why_no_gains_were_designed_for_the_period_is_kept_and_said(stored):
    held = HeldVerdict(SampledVerdict(False, "the gain is 1.3", 0.2, 0))
    assert stored.claims.sampled.certified
    said = replace(stored, info={"sampled": {NOT_FOR_PERIOD: 'discretization is "zoh"'}})
    made = with_sampled(said, held)
    found = sampled_answer(made)
    assert (found["certified"], found["rho"]) == (False, None), "what the file said is not believed"
    assert made.proofs.sampled is None
    assert found[NOT_FOR_PERIOD] == 'discretization is "zoh"'
    (line,) = unproved(found)
    assert "the gain is 1.3" in line
    assert 'discretization is "zoh"' in line
