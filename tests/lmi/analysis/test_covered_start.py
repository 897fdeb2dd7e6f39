"""How many times sets of starts hold the start of a file: never more often than the domain does."""

import math

import pytest

from lockstep.check.design_file.claims import SampledClaims
from lockstep.lmi.analysis.covered_start import limits_answer, times_in_domain
from lockstep.model.checks.plausibility import initial_deviations
from lockstep.model.problem import Problem

TEXT = """
[agent]
states = ["p", "v"]
inputs = ["u"]
dynamics = { p = "v", v = "u - v - v**3" }
outputs = { y = "p" }
domain = { v = [-1.0, 1.0] }
limits = { u = [-1.0, 1.0] }
[network]
agents = 2
topology = "cycle"
[simulation]
initial = [[3.0, 0.4], [3.0, -0.1]]
"""


def test_a_start_grows_about_its_mean_until_an_agent_is_out_of_the_domain():
    """About 0.15 the agents are 0.25 away: (1 - 0.15) / 0.25 = 3.4, and (0.15 + 1) / 0.25 = 4.6 on the other side."""
    problem = Problem.parse(TEXT)
    assert times_in_domain(problem, initial_deviations(problem)) == pytest.approx(3.4, rel=1e-14)
    everywhere = Problem.parse(TEXT.replace(" - v**3", "").replace("domain = { v = [-1.0, 1.0] }\n", ""))
    assert times_in_domain(everywhere, initial_deviations(everywhere)) == math.inf
    assert times_in_domain(problem, None) == math.inf


def test_what_a_radius_covers_is_told_as_far_as_the_domain_goes():
    """|x_d| of the start is 0.25 sqrt(2) = 0.3536: a ball of 1 holds it 2.82 times, one of 10 28 times."""
    said = limits_answer(SampledClaims(certified=True, radius=1.0, clipped_radius=10.0), Problem.parse(TEXT))
    assert said["times_start"] == 2.82
    assert "in_domain" not in said
    assert (said["clipped_times_start"], said["clipped_in_domain"]) == (pytest.approx(3.4, abs=0.011), True)
    assert said["clipped_times_start"] <= 3.4
