"""Agents that may differ in B only: what differs is named."""

import pytest
from text_cases import plant

from lockstep.check.errors import ProblemError
from lockstep.check.system.agent import ExactAgent
from lockstep.model.agents.variants import check_same_but_B

TANK = ("-c*y + b*u - tanh(k*x)", "d*t - sqrt(e + x**2)")
OWN = {"b": 2.0, "c": 1.0, "k": 3.0, "d": 0.5, "e": 4.0, "o": 1.0}


def tank(**changed: float) -> ExactAgent:
    return plant(*TANK, outputs={"y1": "o*x"}, parameters={**OWN, **changed})


def test_agents_that_differ_in_B_are_the_same_but_B():
    common, other = tank(), tank(b=5.0)
    check_same_but_B(common, other, where="entry 2")
    assert (common.B != other.B).any()


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"c": 1.5}, "A differs: d/dt x has -1.0*y, and -1.5*y here"),
        ({"o": 2.0}, "C differs: output 1 has 1.0*x, and 2.0*x here"),
        ({"k": 3.5}, "h differs in d/dt x: `(-tanh((3*x)))` and `(-tanh((3.5*x)))`"),
        ({"d": 0.75}, "h differs in d/dt y"),
        ({"e": 4.0000000000000009}, "h differs in d/dt y"),
    ],
)
def test_agents_that_differ_in_more_than_B_are_refused(changed, says):
    with pytest.raises(ProblemError) as caught:
        check_same_but_B(tank(), tank(**changed), where="entry 2")
    assert str(caught.value).startswith(f"entry 2: {says}")


@pytest.mark.parametrize("others", [("1*y/y", "(x/x)*y/y"), ("1", "y/y")])
def test_agents_whose_needs_differ_are_refused(others):
    common, variant = (plant(f"x*{a} + sin(x)", "u") for a in others)
    with pytest.raises(ProblemError, match="needs to have a value differs"):
        check_same_but_B(common, variant, where="entry 2")
