"""What a design file keeps of its sampled controllers when they are proved again."""

from lockstep.codegen.sampled_design import NOT_FOR_PERIOD, HeldVerdict, with_sampled
from lockstep.lmi.sampled import SampledVerdict
from lockstep.workflow.build import unproved


def test_why_no_gains_were_designed_for_the_period_is_kept_and_said():
    held = HeldVerdict(SampledVerdict(False, "the gain is 1.3", 0.2, 0))
    content = {"sampled": {"certified": True, "rho": 1.0, NOT_FOR_PERIOD: 'discretization is "zoh"'}}
    found = with_sampled(content, held)["sampled"]
    assert (found["certified"], found["rho"]) == (False, None), "what the file said is not believed"
    assert found[NOT_FOR_PERIOD] == 'discretization is "zoh"'
    (line,) = unproved(found)
    assert "the gain is 1.3" in line
    assert 'discretization is "zoh"' in line
