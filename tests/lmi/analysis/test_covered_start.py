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


@pytest.mark.parametrize(
    ("starts", "most"),
    [
        ("[[3.0, 2.0], [4.0, 2.0]]", 0.0),  # both out of it
        ("[[3.0, 1.5], [4.0, -0.1]]", 0.0),
        ("[[3.0, 1.0], [4.0, 1.0]]", math.inf),  # at its side, all alike: p alone grows
        ("[[3.0, 0.7], [4.0, 0.7], [5.0, 0.7]]", math.inf),
        ("[[3.0, 1.0], [4.0, 0.0]]", 1.0),
    ],
)
def test_a_start_out_of_the_domain_is_in_it_no_times_and_states_in_agreement_stay_where_they_are(
    starts, most
):
    text = TEXT.replace("[[3.0, 0.4], [3.0, -0.1]]", starts).replace(
        "agents = 2", f"agents = {starts.count('],') + 1}"
    )
    problem = Problem.parse(text)
    assert times_in_domain(problem, initial_deviations(problem)) == most


def test_what_a_radius_covers_is_told_as_far_as_the_domain_goes():
    """|x_d| of the start is 0.25 sqrt(2) = 0.3536: a ball of 1 holds it 2.82 times, one of 10 28 times."""
    claims = SampledClaims(certified=True, radius=1.0, clipped_radius=10.0)
    said = limits_answer(claims, Problem.parse(TEXT), local=True)
    assert said["times_start"] == 2.82
    assert "beyond" not in said
    assert said["clipped_times_start"] in (3.39, 3.4), "three digits, rounded down"
    assert said["clipped_beyond"] == "an agent is out of its domain"
    everywhere = limits_answer(claims, Problem.parse(TEXT))
    assert everywhere["clipped_times_start"] == pytest.approx(28.2, abs=0.1)
    assert "clipped_beyond" not in everywhere
    outside = Problem.parse(TEXT.replace("[3.0, 0.4]", "[3.0, 1.4]"))
    assert limits_answer(SampledClaims(), outside, local=True).keys() <= {"start"}
    assert "times_start" not in limits_answer(claims, outside, local=True)
