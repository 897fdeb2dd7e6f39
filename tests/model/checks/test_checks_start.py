"""How far from agreement a run starts, and how often its controllers are called."""

import math

import pytest

from lockstep.model.checks.plausibility import initial, initial_deviations, period, unstable_alone
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


def test_what_swings_without_damping_runs_away_by_no_rounding():
    """Two masses on springs: symmetric stiffness, so that every mode is on the axis; of eleven springs between them the
    computed real parts of six are above 0, by 1e-17 to 2e-16."""
    for k in range(1, 12):
        text = TEXT.replace('["p", "v"]', '["p", "v", "q", "w"]').replace(
            'p = "v", v = "u - v"', f'p = "v", v = "u - 3*p + {k / 10}*q", q = "w", w = "{k / 10}*p - 2.3*q"'
        )
        assert not list(unstable_alone(Problem.parse(text)))


@pytest.mark.parametrize(
    ("rate", "noted"), [("u - v + 1e4", True), ("u - v + 1e2", False), ("u - 1e4*(v - p)", False)]
)
def test_agents_that_leave_their_domain_by_themselves_within_a_period_are_noted(rate, noted):
    """v is within 10 of 0, a period has 10 ms: a force of 1e4 moves it by 100, one of 100 by 1. A lag of 0.1 ms ends at p,
    1 away, though at its first rate it would come to 100."""
    text = TEXT.replace('v = "u - v"', f'v = "{rate}"').replace(
        "[network]", "domain = { v = [-10.0, 10.0] }\n[network]"
    )
    starts = "[simulation]\ninitial = [[1.0, 0.0], [1.0, 0.0]]\n[controller]\nperiod = 0.01\n"
    rows = list(initial(Problem.parse(text + starts)))
    assert [row.verdict for row in rows] == ["note"] * noted
    if noted:
        assert (
            "with u = 0 v moves by 99.5 in the first 0.01 s, and [agent.domain] is 20 wide" in rows[0].figure
        )
    # A start outside says nothing of the domain, and is told by itself.
    outside = list(initial(Problem.parse(text + starts.replace("1.0, 0.0", "1.0, 50.0"))))
    assert [row.figure for row in outside] == [
        "v of agent 1 is 50, outside of [agent.domain], -10 <= v <= 10"
    ]


@pytest.mark.parametrize(
    ("agents", "said", "time"),
    [
        ("leader_path", "agent 1 leads and gets no u: by itself it left the domain: p = 10", 6.0),
        ("cycle", "from where all are on average one agent with u = 0 left the domain: p = 10", 5.75),
    ],
)
def test_agents_that_leave_their_domain_together_within_the_run_are_noted(
    agents: str, said: str, time: float
):
    """p' = v, v' = u - v + 2 from rest: p = 2 (t - 1 + exp(-t)), which is 10 at t = 6 - exp(-6) s, 9.5 a quarter before."""
    text = TEXT.replace('v = "u - v"', 'v = "u - v + 2 + 1e-9*sin(p)"').replace('"cycle"', f'"{agents}"')
    text = text.replace("[network]", "domain = { p = [-10.0, 10.0] }\n[network]")
    starts = "[simulation]\ninitial = [[0.0, 0.0], [1.0, 0.0]]\nhorizon = "
    for horizon in ("20.0", "1e9"):  # of a run too long to be simulated its beginning is looked at
        (row,) = initial(Problem.parse(text + starts + horizon))
        assert row.figure.startswith(said)
        assert f" at {time:g} s" in row.figure
    assert not list(initial(Problem.parse(text + starts + f"{time - 0.1}")))
    second = text.replace(f'topology = "{agents}"', "edges = [[1, 2]]") + starts.replace(
        "[1.0, 0.0]", "[0.0, 0.0]"
    )
    (row,) = initial(Problem.parse(second + "20.0"))
    assert row.figure.startswith("agent 2 leads and gets no u: by itself it left the domain: p = 10")


def test_a_leader_that_diverges_between_two_records_is_noted_all_the_same():
    """p' = p^2 from 1 is 1 / (1 - t): beyond all numbers at 1 s."""
    text = TEXT.replace('p = "v"', 'p = "p*p + 0*v"').replace('"cycle"', '"leader_path"')
    text = text.replace("[network]", "domain = { p = [-1e12, 1e12] }\n[network]")
    starts = "[simulation]\ninitial = [[1.0, 0.0], [1.0, 0.0]]\nhorizon = 3.0\n"
    (row,) = initial(Problem.parse(text + starts))
    assert "by itself it left the domain: p = inf at 1" in row.figure
