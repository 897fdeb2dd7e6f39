"""Numbers that are seldom meant are noted: a long period, degrees, a start outside of the domain; look-alikes are offered."""

import math
import re

import pytest

from lockstep.check.errors import ProblemError
from lockstep.check.expression.text import SPELLED
from lockstep.model.assembly import bound_of
from lockstep.model.checks import actuators, check_problem, nonlinearity, plausibility
from lockstep.model.formulas.confusables import typed_instead
from lockstep.model.problem import Problem
from lockstep.workflow.design import doubts

PENDULUM = """
[agent]
states = ["theta", "omega"]
inputs = ["u"]
parameters = { w2 = 16.0 }
dynamics = { theta = "omega", omega = "u - w2*sin(theta) - 0.1*omega" }
outputs = { y = "theta" }
[network]
agents = 3
topology = "cycle"
[controller]
period = 0.05
[simulation]
initial = [[0.5, 0.0], [0.0, 0.0], [0.0, 0.0]]
"""


def with_change(old: str, new: str) -> Problem:
    assert old in PENDULUM
    return Problem.parse(PENDULUM.replace(old, new, 1))


@pytest.mark.parametrize(
    ("period", "verdict", "said"),
    [
        ("0.05", "ok", "0.2 rad"),
        # 0.6 rad is the long end of the rule, pi where the samples cannot show the swing: 4 rad/s.
        ("0.14", "ok", "rad"),
        ("0.16", "note", "0.05 to 0.15 s is usual"),
        ("0.78", "note", "long for that mode"),
        ("0.79", "note", "cannot show at all"),
        ("10.0", "note", "40 rad of the agent's fastest mode that swings or grows, 4 rad/s"),
    ],
)
def test_a_period_that_is_too_long_for_the_plant_is_noted(period, verdict, said):
    row = plausibility.period(with_change("period = 0.05", f"period = {period}"))
    assert row.verdict == verdict
    assert said in row.figure


def test_a_mode_that_dies_out_by_itself_asks_for_no_short_period():
    fast = PENDULUM.replace("u - w2*sin(theta) - 0.1*omega", "u - 1000*omega").replace(
        "period = 0.05", "period = 1.0"
    )
    row = plausibility.period(Problem.parse(fast))
    assert (row.verdict, "no oscillatory or unstable mode" in row.figure) == ("ok", True)
    grows = PENDULUM.replace("u - w2*sin(theta) - 0.1*omega", "u + 16*theta").replace(
        "period = 0.05", "period = 1.0"
    )
    row = plausibility.period(Problem.parse(grows))
    assert row.verdict == "note"
    assert "4 time constants of the agent's fastest mode that swings or grows, 4 1/s" in row.figure


def test_a_resonance_beside_a_number_in_another_unit_is_seen():
    """The pendulum's rate in a unit of 1e-10 rad/s: 4 rad/s beside slopes of 1.6e11, which hid it as a rounding."""
    odd = PENDULUM.replace('theta = "omega"', 'theta = "1e-10*omega"')
    odd = odd.replace("u - w2*sin(theta) - 0.1*omega", "1e10*u - 1e10*w2*sin(theta) - 0.1*omega")
    row = plausibility.period(Problem.parse(odd.replace("period = 0.05", "period = 10.0")))
    assert (row.verdict, "fastest mode that swings or grows, 4 rad/s" in row.figure) == ("note", True)


def test_an_origin_where_h_is_not_defined_is_said_to_be_none():
    tank = PENDULUM.replace("u - w2*sin(theta)", "u - 1/theta").replace(
        'inputs = ["u"]', 'inputs = ["u"]\ndomain = { theta = [1.0, 2.0] }'
    )
    row = nonlinearity.origin(Problem.parse(tank).agent())
    assert (row.verdict, row.figure) == ("note", "h(t, 0) is not defined: the agents never are at the origin")


def test_an_agent_that_settles_between_two_samples_is_noted():
    """-0.25 and -1000 1/s: the longest time constant is 4 s, of which a tenth to a quarter is usual."""
    lag = PENDULUM.replace("u - w2*sin(theta) - 0.1*omega", "u - 1000*omega")
    lag = lag.replace('theta = "omega"', 'theta = "omega - 0.25*theta"')
    assert plausibility.period(Problem.parse(lag.replace("period = 0.05", "period = 3.9"))).verdict == "ok"
    row = plausibility.period(Problem.parse(lag.replace("period = 0.05", "period = 10.0")))
    assert (row.verdict, "2.5 times" in row.figure, "0.4 to 1 s" in row.figure) == ("note", True, True)


CART = """
[agent]
states = ["p", "v"]
inputs = ["u"]
dynamics = {{ p = "v", v = "u" }}
outputs = {{ y = "p" }}
limits = {{ u = [-1.0, 1.0] }}
[network]
agents = 2
topology = "path"
[controller]
period = {period}
[simulation]
initial = [[0.0, 0.0], [{apart}, 0.0]]
"""


@pytest.mark.parametrize(
    ("period", "apart", "time"), [(0.25, 8.0, 4.0), (1.0, 2.0, 2.0), (4.0, 8.0, 4.0), (9.0, 8.0, 9.0)]
)
def test_how_long_actuators_take_to_move_the_outputs_so_far(period, apart, time):
    """t^2 / 2 = 8 after 4 s, 2 after 2 s; a period that is longer is noted, as no mode of an integrator tells of it.

    In place of what else says that it is ok; and before a design begins, as the tutorial says.
    """
    posed = Problem.parse(CART.format(period=period, apart=apart))
    assert actuators.time_to_move(posed) == time
    rows = [(row.name, row.verdict) for row in actuators.period(posed)]
    assert rows == [("period", "note" if period >= 4.0 else "ok")]
    assert plausibility.period(posed).verdict == "ok"
    assert any("inputs at [agent.limits] move" in doubt for doubt in doubts(posed)) == (period >= 4.0)


@pytest.mark.parametrize(("apart", "noted"), [(1800.0, False), (2300.0, True)])
def test_limits_that_need_more_than_the_run_are_noted(apart, noted):
    """1 m/s^2 moves t^2 / 2: 1 800 m after 60 s, within a run of 64 s, and 2 300 m after 68 s: a limit in another unit.

    Times are told in steps of a factor of root two of the period; before a design begins, too.
    """
    posed = Problem.parse(CART.format(period=1.0, apart=apart) + "horizon = 64.0")
    rows = [
        row for row in actuators.slow(posed, controllable=True) if "of a run of 64 s, to move" in row.figure
    ]
    assert [(row.name, row.verdict) for row in rows] == [("limits", "note")] * noted
    assert any(doubt.startswith("limits: ") for doubt in doubts(posed)) is noted


def test_limits_that_never_suffice_are_noted():
    """A spring of 1 1/s^2 holds 1 N at 1 m from rest, damped: 2 m are never reached, 0.5 m are."""
    damped = CART.replace('v = "u"', 'v = "u - p - 2*v"')
    (row,) = actuators.slow(Problem.parse(damped.format(period=0.25, apart=2.0)), controllable=True)
    assert "never move" in row.figure
    assert list(actuators.slow(Problem.parse(damped.format(period=0.25, apart=0.5)), controllable=True)) == []


@pytest.mark.parametrize(("most", "noted"), [(0.6, False), (40.0, False), (600.0, True)])
def test_limits_that_take_an_agent_across_its_domain_within_a_period_are_noted(most, noted):
    """I' = (u - I)/10: 600 for 0.6 kA moves I by 236 in 5 s, 1 - e^-0.5 of it, where its domain is 20 wide; 40 by 15.7."""
    posed = Problem.parse(f"""
[agent]
states = ["I"]
inputs = ["u"]
dynamics = {{ I = "(u - I)/10 + 0.01*sin(I)" }}
outputs = {{ y = "I" }}
limits = {{ u = [-{most}, {most}] }}
domain = {{ I = [-10.0, 10.0] }}
[network]
agents = 2
topology = "path"
[controller]
period = 5.0
""")
    rows = list(actuators.limits(posed, controllable=True))
    assert [(row.name, row.verdict) for row in rows] == [("limits", "note")] * noted
    assert all("move I by 23" in row.figure and "is 20 wide" in row.figure for row in rows)
    assert any("in the unit of u" in doubt for doubt in doubts(posed)) is noted


def test_of_inputs_without_a_limit_nothing_is_said():
    """q' = w moves as far as w, which has none, would."""
    other = CART.replace('states = ["p", "v"]', 'states = ["p", "v", "q"]').replace(
        'inputs = ["u"]', 'inputs = ["u", "w"]'
    )
    other = other.replace('v = "u"', 'v = "u", q = "w"').replace('y = "p"', 'y = "p", z = "q"')
    other = other.replace("[[0.0, 0.0], [{apart}, 0.0]]", "[[0.0, 0.0, 0.0], [{apart}, 0.0, 1.0]]")
    assert list(actuators.slow(Problem.parse(other.format(period=0.25, apart=2.0)), controllable=True)) == []


def test_a_pair_that_is_nearly_lost_is_noted_before_a_design_begins():
    """p' = -p + 1e-9 v: u moves p, and y shows v, by way of that alone, a thousandth in natural units."""
    nearly = CART.replace('p = "v", v = "u"', 'p = "-p + 1e-9*v", v = "-1000*v + u"')
    said = [
        doubt for doubt in doubts(Problem.parse(nearly.format(period=1e-4, apart=1e-6))) if "slip" in doubt
    ]
    assert [doubt.split(":")[0] for doubt in said] == ["(A, B) controllable", "(A, C) observable"]
    assert not any(
        "controllable" in doubt for doubt in doubts(Problem.parse(CART.format(period=0.25, apart=8.0)))
    )


def test_a_period_that_is_too_long_for_modes_and_actuators_is_told_for_both():
    spring = CART.replace('v = "u"', 'v = "u - p"').format(period=9.0, apart=0.5)
    figures = [row.figure for row in actuators.period(Problem.parse(spring))]
    assert ["rad/s" in figures[0], "[agent.limits]" in figures[1]] == [True, True]


def test_without_limits_or_a_start_nothing_is_said_of_actuators():
    posed = CART.format(period=9.0, apart=8.0)
    plain = plausibility.period(Problem.parse(posed))
    for without in ("limits = { u = [-1.0, 1.0] }\n", "initial = [[0.0, 0.0], [8.0, 0.0]]\n"):
        assert without in posed
        assert list(actuators.period(Problem.parse(posed.replace(without, "")))) == [plain]
    at_rest = Problem.parse(CART.format(period=9.0, apart=0.0))
    assert list(actuators.period(at_rest)) == [plain]


def test_an_agent_that_moves_away_by_itself_is_noted():
    assert list(plausibility.unstable_alone(Problem.parse(PENDULUM))) == []
    (row,) = plausibility.unstable_alone(Problem.parse(PENDULUM.replace("- 0.1*omega", "+ 0.1*omega")))
    assert (row.verdict, "0.05 1/s" in row.figure) == ("note", True)  # s^2 - 0.1 s + 16 = 0: Re s = 0.05


@pytest.mark.parametrize(("stiffness", "noted"), [(1.0, False), (1e14, True)])
def test_states_that_move_by_sizes_far_apart_are_noted(stiffness, noted):
    """v' = -p, p' = s v: p moves by s^1/2 of what v does, here to a power of two."""
    oscillator = f"""
    [agent]
    states = ["alone", "v", "p"]
    inputs = ["u"]
    dynamics = {{ alone = "-alone", v = "-p + u", p = "{stiffness!r}*v" }}
    outputs = {{ y = "v" }}
    [network]
    agents = 2
    topology = "path"
    """
    rows = list(plausibility.units(Problem.parse(oscillator)))
    assert bool(rows) == noted
    assert not rows or "p moves by numbers about 8e+06 times those of v" in rows[0].figure


def test_units_that_contradict_the_formulas_are_noted_without_all_checks():
    units = '[agent.units]\ntheta = "{}"\nomega = "{}"\n'
    assert list(plausibility.units(Problem.parse(PENDULUM))) == []
    assert list(plausibility.units(Problem.parse(PENDULUM + units.format("rad", "rad/s")))) == []
    (row,) = plausibility.units(Problem.parse(PENDULUM + units.format("rad", "rad")))
    assert (row.verdict, "[agent.dynamics] theta" in row.figure) == ("note", True)
    (row,) = plausibility.units(Problem.parse(PENDULUM + units.format("rad", "rad/s2")))
    assert "a power is written with ^: `rad/s^2`" in row.figure
    (row,) = plausibility.units(Problem.parse(PENDULUM + units.format("deg", "deg/s")))
    assert (row.verdict, "theta*pi/180" in row.figure) == ("note", True)


def test_degrees_are_noted_with_what_they_would_be_in_radians():
    (row,) = plausibility.initial(with_change("[0.5, 0.0]", "[30.0, 0.0]"))
    assert row.verdict == "note"
    assert "theta of agent 1 is 30" in row.figure
    assert f"{math.radians(30):.4g}" in row.figure
    assert list(plausibility.initial(with_change("[0.5, 0.0]", "[6.28, 0.0]"))) == []
    # omega is the argument of no sine: 30 rad/s are what they are.
    assert list(plausibility.initial(with_change("[0.5, 0.0]", "[0.5, 30.0]"))) == []
    # An angle that the file turns into radians itself is in degrees.
    in_degrees = PENDULUM.replace("sin(theta)", "sin(theta*pi/180)").replace("[0.5, 0.0]", "[30.0, 0.0]")
    assert list(plausibility.initial(Problem.parse(in_degrees))) == []


def test_a_state_in_radians_by_its_unit_is_an_angle_too():
    in_rad = PENDULUM.replace("sin(theta)", "tanh(theta)").replace("[0.5, 0.0]", "[30.0, 0.0]")
    assert list(plausibility.initial(Problem.parse(in_rad))) == []
    (row,) = plausibility.initial(Problem.parse(in_rad + '[agent.units]\ntheta = "rad"\nomega = "rad/s"\n'))
    assert "theta of agent 1 is 30, and [agent.units] has theta in rad" in row.figure


def test_random_states_far_beyond_a_turn_are_noted_too():
    given = "initial = [[0.5, 0.0], [0.0, 0.0], [0.0, 0.0]]"
    (row,) = plausibility.initial(with_change(given, "spread = 30.0"))
    assert "`spread` is 30" in row.figure
    assert list(plausibility.initial(with_change(given, "spread = 3.0"))) == []


def test_a_start_outside_of_the_domain_is_noted():
    boxed = PENDULUM + "[agent.domain]\ntheta = [-0.4, 0.4]\n"
    (row,) = plausibility.initial(Problem.parse(boxed))
    assert "theta of agent 1 is 0.5, outside of [agent.domain], -0.4 <= theta <= 0.4" in row.figure
    assert list(plausibility.initial(Problem.parse(boxed.replace("[0.5, 0.0]", "[0.3, 0.0]")))) == []


def test_check_tells_them():
    notes = check_problem(with_change("period = 0.05", "period = 10.0")).notes
    assert any("cannot show" in note for note in notes)
    assert not any("period" in note for note in check_problem(Problem.parse(PENDULUM)).notes)


@pytest.mark.parametrize(
    ("old", "new", "typed"),
    [
        ("u - w2", "u \u2212 w2", "`-` for \\u2212 (minus sign)"),
        ("w2*sin", "w2\u00d7sin", "`*` for \\xd7"),
        ("w2*sin", "w2\u00b7sin", "`*` for \\xb7"),
        ("sin(theta)", "sin(theta)\u00b2", "`**2` for \\xb2"),
        ("u - w2", "u \uff0d w2", "`-` for \\uff0d"),
        ("u - w2", "u\u00a0- w2", "a space for \\xa0"),
        ("w2 = 16.0", "w2 = \u221216.0", "`-` for \\u2212"),
        ("w2 = 16.0", "w2 = 16.0e\u22123", "`-` for \\u2212"),
        ('"cycle"', "\u201ccycle\u201d", '`"` for \\u201c'),
        ('states = ["theta"', 'states = ["\u03b8"', "`theta` for \\u03b8"),
        ("sin(theta)", "sin(\u03b8)", "`theta` for \\u03b8"),
    ],
)
def test_what_only_looks_like_a_character_of_the_keyboard_is_offered_as_it(old, new, typed):
    with pytest.raises(ProblemError) as refused:
        with_change(old, new)
    assert typed in refused.value.remedy


def test_letters_of_other_alphabets_that_look_like_nothing_here_are_not():
    assert typed_instead("e") == typed_instead("\u00e9") == ""
    with pytest.raises(ProblemError) as refused:
        with_change("w2*sin", "\u00e9*sin")
    assert "write" not in refused.value.remedy


@pytest.mark.parametrize(
    ("old", "new"), [("0.1*omega", "0,1*omega"), ("0.1*omega", "(0,05 + 0.05)*omega"), ("= 0.05", "= 0,05")]
)
def test_a_decimal_comma_is_told_to_be_a_point(old, new):
    with pytest.raises(ProblemError) as refused:
        with_change(old, new)
    assert refused.value.remedy == "decimal numbers have a point: 0.5, not 0,5"


def test_a_design_in_place_of_a_problem_is_told_what_takes_it():
    with pytest.raises(ProblemError, match="this is not TOML") as refused:
        Problem.parse('{\n "format": "lockstep-design 1"\n}')
    assert "`lockstep explain`" in refused.value.remedy


def test_a_function_may_have_commas():
    with_change("0.1*omega", "0.1*max(omega,2*omega)").agent()


def test_limits_from_zero_are_told_to_be_counted_from_the_value_at_rest():
    with pytest.raises(ProblemError) as refused:
        Problem.parse(PENDULUM + "[agent.limits]\nu = [0.0, 5.0]\n")
    assert "`u_0 + u` in [agent.dynamics]" in refused.value.remedy


def test_a_prime_is_told_that_no_quotes_belong_there():
    with pytest.raises(ProblemError, match="without quotes"):
        with_change("sin(theta)", "sin(theta\u2019)")


@pytest.mark.parametrize(
    ("edges", "said"),
    [
        ("[[1, 2], [1, 3], [3, 4]]", "the edges are probably reversed: turned round, they lead from agent 1"),
        ("[[1, 2], [3, 4]]", "let agent 2 listen to agent 4"),
        ("[[1, 2], [2, 1], [3, 4], [4, 3]]", "let agents 1, 2 listen to agents 3, 4"),
    ],
)
def test_edges_from_a_leader_that_are_written_source_first_are_told_so(edges, said):
    text = PENDULUM.replace('agents = 3\ntopology = "cycle"', f"agents = 4\nedges = {edges}")
    text = text[: text.index("[simulation]")]
    with pytest.raises(ProblemError) as refused:
        Problem.parse(text).validate()
    assert said in refused.value.remedy


def test_turned_round_they_are_accepted():
    text = PENDULUM.replace('agents = 3\ntopology = "cycle"', "agents = 4\nedges = [[2, 1], [3, 1], [4, 3]]")
    problem = Problem.parse(text[: text.index("[simulation]")])
    problem.validate()
    assert problem.graph().roots == (1,)


def test_asinh_as_it_is_told_to_be_written_has_the_slopes_of_asinh():
    """1 / sqrt(1 + theta^2), which is 1 at most, everywhere."""
    assert "unknown function" in refusal("asinh(theta)")
    told = SPELLED["asinh"]
    formula = told.split("write ")[1].split(", p = ")[0]
    for short, meant in (("p", "max(theta, 0)"), ("n", "max(-theta, 0)")):
        formula = re.sub(rf"\b{short}\b", meant, formula)
    as_written = PENDULUM.replace('inputs = ["u"]', 'inputs = ["u"]\ncentre = false')
    found = bound_of(Problem.parse(as_written.replace("w2*sin(theta)", formula)).agent())
    assert found.alpha == pytest.approx(
        1.0, rel=1e-3
    )  # the proved one is a little above, to close in finite time


def refusal(formula: str) -> str:
    with pytest.raises(ProblemError) as error:
        with_change("w2*sin(theta)", formula).agent()
    return str(error.value)
