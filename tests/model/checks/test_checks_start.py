"""How far from agreement a run starts, and how often its controllers are called."""

import math

import pytest

from lockstep.model.checks.plausibility import initial_deviations, period, unstable_alone
from lockstep.model.problem import Problem

TEXT = """
[agent]
states = ["p", "v"]
inputs = ["u"]
dynamics = { p = "v", v = "u - v" }
outputs = { y = "p" }
[network]
agents = 2
topology = "cycle"
"""
STARTS = "[simulation]\ninitial = [[1.0, 0.0], [4.0, -4.0]]\n"


def distance(problem: Problem) -> float | None:
    away = initial_deviations(problem)
    return None if away is None else math.hypot(*away.ravel())


def test_two_agents_3_and_4_apart_start_5_over_root_2_from_agreement():
    assert distance(Problem.parse(TEXT + STARTS)) == pytest.approx(5 / 2**0.5, rel=1e-15)


def test_in_a_formation_offsets_are_taken_off():
    offsets = TEXT + "offsets = [[0.0, 0.0], [3.0, 0.0]]\n"
    assert distance(Problem.parse(offsets + STARTS)) == pytest.approx(4 / 2**0.5, rel=1e-15)


def test_states_whose_squares_overflow_are_a_start_and_those_beyond_doubles_none():
    far = TEXT + "[simulation]\ninitial = [[1e200, 0.0], [0.0, 0.0]]\n"
    assert distance(Problem.parse(far)) == pytest.approx(1e200 / 2**0.5, rel=1e-15)
    assert distance(Problem.parse(far.replace("[1e200", "[1.7e308").replace("[0.0", "[-1.7e308"))) is None


def test_drawn_states_are_no_start_of_the_file():
    assert distance(Problem.parse(TEXT)) is None


@pytest.mark.parametrize(
    ("T", "spring", "noted"), [(0.01, "- p", False), (1e-5, "- p", True), (1e-5, "", False)]
)
def test_a_period_far_below_the_shortest_time_constant_is_seldom_meant(T, spring, noted):
    """The spring and the damper of 1 make |s| = 1: 10 ms are a hundredth of it, 10 us are seldom meant; without the spring p
    integrates, and no mode says how fast the agents are to be moved."""
    text = TEXT.replace("u - v", f"u - v {spring}")
    row = period(Problem.parse(f"{text}[controller]\nperiod = {T}\n"))
    assert ("1e-05 of the agent's shortest time constant, 1 s: is it in s?" in row.figure) == noted
    assert (row.verdict == "note") == noted


@pytest.mark.parametrize(
    ("damping", "verdicts", "asked"), [("-", [], False), ("+ 0.001*", ["note"], False), ("+", ["note"], True)]
)
def test_a_sign_is_doubted_where_an_agent_runs_away_within_the_run(damping, verdicts, asked):
    """v' = u + c v grows by e^(20 c) in the 20 s of the run: by 2 % for c = 0.001, which an orbit has for no slip at all."""
    rows = list(unstable_alone(Problem.parse(TEXT.replace("u - v", f"u {damping} v"))))
    assert [row.verdict for row in rows] == verdicts
    assert ["wrong sign" in row.figure for row in rows] == [asked] * len(rows)
