"""Units of an agent's equations: those that fit, and those that do not, each with the term that is named."""

import math
import re

import pytest
from checks_cases import problem

from lockstep.check.errors import ProblemError
from lockstep.model.agents.state_sizes import state_sizes
from lockstep.model.checks import check, check_problem
from lockstep.model.checks.plausibility import units
from lockstep.model.checks.proved.dimensions import check_units

UNITS = {"x": "m", "v": "m/s", "u": "N", "k": "N/m", "m": "kg", "c": "kg/s", "y1": "m"}
SPRING = {"x": "v", "v": "(u - k*x - c*v)/m"}


def spring(dynamics, units, parameters=("k", "m", "c")):
    return problem(dynamics, units=units, parameters=dict.fromkeys(parameters, 2.0)).file.agent


def test_units_that_fit():
    assert check_units(spring(SPRING, UNITS)).status == "proved"
    assert (
        check_units(spring({**SPRING, "v": "(u - k*x*tanh(v**2*m/(k*x**2)) - c*v)/m"}, UNITS)).status
        == "proved"
    )
    part = {name: unit for name, unit in UNITS.items() if name != "k"}
    assert check_units(spring(SPRING, part)).status == "undecided"
    assert check_units(spring(SPRING, {})).status == "undecided"


def test_units_whose_factors_cancel_fit_and_a_unit_of_time_of_its_own_is_told():
    """1 kN = 1 t m/s^2; a parameter that has a unit may hold a factor; in minutes all of it is in minutes."""
    in_kN = {**UNITS, "u": "kN", "k": "kN/m", "m": "t", "c": "t/s"}
    assert check_units(spring(SPRING, in_kN)).status == "proved"
    mixed = check_units(
        spring(
            {**SPRING, "v": "(u*f - k*x - c*v)/m"}, {**UNITS, "u": "kN", "f": "N/kN"}, ("k", "m", "c", "f")
        )
    )
    assert mixed.status == "proved"
    assert "units of" not in mixed.figure
    minutes = {**UNITS, "v": "m/min", "u": "kg m/min^2", "k": "kg/min^2", "c": "kg/min"}
    told = check_units(spring(SPRING, minutes))
    assert told.status == "proved"
    assert "with time, and the period, in units of 60 s" in told.figure


def test_newton_metres_are_no_yarn():
    """pint reads Nm as the metric count of a yarn, 1 km/kg."""
    turned = {
        **UNITS,
        "x": "rad",
        "v": "rad/s",
        "u": "Nm",
        "k": "kNm/rad",
        "m": "kg m^2",
        "c": "Nm s/rad",
        "y1": "rad",
    }
    with pytest.raises(ProblemError, match="1000"):
        check_units(spring(SPRING, turned))
    assert check_units(spring(SPRING, {**turned, "k": "N*m/rad"})).status == "proved"


def test_an_agent_is_in_a_unit_of_time_that_there_is():
    """x' = v with x in m and v in km/h alone, and no other term to hold it against: 3.6 s is none."""
    with pytest.raises(ProblemError, match=r"term `v` is 0\.277778 times that of d/dt x"):
        check_units(spring(SPRING, {"x": "m", "v": "km/h"}))
    assert check_units(spring(SPRING, {"x": "m", "v": "m/h"})).status == "undecided"


def test_degrees_celsius_differ_from_kelvins_by_no_factor():
    """A difference of 1 degC is one of 1 K; one of 1 degF is 5/9 K."""
    heated = {"x": "v", "v": "(u - k*(x - c))/m"}
    units = {"x": "degC", "v": "K/s", "u": "W", "k": "W/K", "c": "K", "m": "J s/K", "y1": "degC"}
    assert check_units(spring(heated, units)).status == "proved"
    with pytest.raises(ProblemError, match="made of parts"):
        check_units(spring(heated, {**units, "c": "degF"}))


def test_degrees_celsius_beside_kelvins_are_noted():
    heated = {"x": "v", "v": "(u - k*(x - c))/m"}
    units = {"x": "degC", "v": "K/s", "u": "W", "k": "W/K", "c": "K", "m": "J s/K", "y1": "degC"}
    (told,) = rows(heated, units, parameters=dict.fromkeys("kcm", 2.0))
    assert (told.name, told.verdict) == ("units", "note")
    assert told.figure.startswith("c is in K and x in degC: 0 degC is 273.15 K")
    assert rows(heated, {**units, "c": "degC"}, parameters=dict.fromkeys("kcm", 2.0)) == []


def test_a_number_may_hold_the_factor_of_a_unit():
    """pi/180 and 3.6: what is multiplied by a number has the factor that the number is there for."""
    turned = {**SPRING, "v": "u/m - k/m*x*sin(c*pi/180)"}
    assert check_units(spring(turned, {**UNITS, "c": "deg"})).status == "proved"
    fast = {"x": "v/3.6", "v": "3.6*(u - k*x - c*v/3.6)/m"}
    assert check_units(spring(fast, {**UNITS, "v": "km/h"})).status == "proved"
    assert check_units(spring({**SPRING, "v": "(u - k*x)/m*(0.5*c/c)**(c/c)"}, UNITS)).status == "proved"


@pytest.mark.parametrize(
    ("dynamics", "units", "told"),
    [
        ({**SPRING, "x": "v + x"}, UNITS, r"\[agent.dynamics\] x: the term `x` has the dimension \[length\]"),
        ({**SPRING, "v": "u/m - k*x"}, UNITS, r"\[agent.dynamics\] v: the term `k\*x`"),
        ({**SPRING, "v": "(u - k*v)/m"}, UNITS, r"`u - k\*v` is made of parts"),
        ({**SPRING, "v": "u/m + k*x/m*sin(x)"}, UNITS, r"`sin\(x\)` is a function of a quantity"),
        ({**SPRING, "v": "u/m + k*x/m*2**x"}, UNITS, r"exponent"),
        (SPRING, {**UNITS, "y1": "s"}, r"\[agent.outputs\] y1"),
        (
            SPRING,
            {**UNITS, "u": "kN"},
            r"`u - k\*x` is made of parts whose units differ by a factor of 1000,",
        ),
        (
            SPRING,
            {**UNITS, "v": "km/h"},
            r"\[agent.dynamics\] x: the unit of the term `v` is 0.277778 times that of d/dt x",
        ),
        (
            SPRING,
            {**UNITS, "y1": "mm"},
            r"\[agent.outputs\] y1: the unit of the term `x` is 1000 times that of y1, and numbers are",
        ),
        (
            {**SPRING, "v": "u/m - k/m*x*sin(c)"},
            {**UNITS, "c": "deg"},
            r"`sin\(c\)` is a function of a quantity",
        ),
        (SPRING, {**UNITS, "k": "furlongs per banana"}, r"\[agent.units\] k: .* is no unit"),
        # N and kN beside a number that may hold any factor, whichever stands first.
        ({**SPRING, "v": "(-20*k*x + u - c*v)/m"}, {**UNITS, "u": "kN"}, "1000"),
        ({**SPRING, "v": "(u - 20*k*x - c*v)/m"}, {**UNITS, "u": "kN"}, "1000"),
        # 4 beta/V of a cylinder, half of a square: no unit converts by them, and a slip beside them was silent.
        ({**SPRING, "v": "4*(u - k*x - c*v)/m"}, {**UNITS, "m": "g"}, "1000 times"),
        ({**SPRING, "v": "(u - k*x - 0.5*c*v)/m"}, {**UNITS, "c": "kg/ms"}, "1000"),
    ],
)
def test_units_that_do_not_fit_are_an_error_that_names_the_term(dynamics, units, told):
    with pytest.raises(ProblemError, match=told):
        check_units(spring(dynamics, units))


def rows(dynamics, units, **kept):
    report = check_problem(problem(dynamics, units=units, **kept))
    return [row for row in report.rows if row.name.startswith("units")]


@pytest.mark.parametrize(
    ("v", "noted"),
    [
        ("(u - k*x - c*v)/m", ""),
        ("(u - 2*k*x - 0.5*c*v)/m", ""),
        ("1000*(u - k*x - c*v)/m", "1000 in the formulas"),
        ("(u - k*x - c*v*1e-5)/m", "1e-05 in the formulas"),
    ],
)
def test_numbers_that_look_like_factors_between_units_are_noted(v, noted):
    """In mm and N, v' = 1000 (u - k x - c v) / m: whether the 1000 is due depends on units, which a number has none of."""
    found = rows({**SPRING, "v": v}, UNITS, parameters={"k": 2.0, "m": 2.0, "c": 2.0})
    assert [row.verdict for row in found] == ["note"] * bool(noted)
    assert all(noted in row.figure and "mm/m" in row.figure for row in found)
    assert not rows(
        {**SPRING, "v": "f*(u - k*x - c*v)/m"},
        {**UNITS, "x": "mm", "v": "mm/s", "y1": "mm", "k": "N/mm", "c": "N s/mm", "f": "mm/m"},
        parameters={"k": 2.0, "m": 2.0, "c": 2.0, "f": 1000.0},
    )


@pytest.mark.parametrize(
    ("value", "unit", "noted"),
    [
        (1000.0, "mm/m", ""),
        (100.0, "mm/m", "100 mm/m is 0.1"),
        (1.0, "mm/m", "1 mm/m is 0.001"),
        (5.0, "mm/m", ""),
        (1000.0, "1", "1000 in the formulas"),
    ],
)
def test_what_converts_a_unit_is_the_number_1(value, unit, noted):
    """1000 mm are 1 m. A slope of 5 mm/m is one, and converts nothing; 1000 without a unit may."""
    units = {**UNITS, "x": "mm", "v": "mm/s", "y1": "mm", "k": "N/mm", "c": "N s/mm", "f": unit}
    if unit == "1":
        units = {**UNITS, "f": unit}
    found = rows(
        {**SPRING, "v": "f*(u - k*x - c*v)/m"}, units, parameters={"k": 2.0, "m": 2.0, "c": 2.0, "f": value}
    )
    assert [row.verdict for row in found] == ["note"] * bool(noted)
    assert all(noted in row.figure for row in found)


def test_check_decides_units_before_it_looks_for_a_bound(monkeypatch):
    monkeypatch.setattr(check, "bound_of", None)
    wrong = problem({**SPRING, "v": "u - k*x - c*v/m"}, units=UNITS, parameters=dict.fromkeys("kmc", 2.0))
    with pytest.raises(ProblemError, match=r"the term `u` has|the term `k\*x` has|the term `c\*v/m` has"):
        check_problem(wrong)


def test_a_slip_of_a_unit_that_loses_a_mode_is_told_as_a_slip_of_a_unit():
    """A lever of 400 mm written as 400: its slopes hide the force's, and the pair looks as if no input moved a mode."""
    dynamics = {"x": "v", "v": "(a*cos(x)*f - k*x - c*v)/m", "f": "(u - f)/tau"}
    parameters = {"a": 400.0, "k": 290.0, "c": 60.0, "m": 120.0, "tau": 0.08}
    box = {"x": [-0.35, 0.35], "f": [-800.0, 800.0]}
    units = {
        "x": "rad",
        "v": "rad/s",
        "f": "N",
        "u": "N",
        "a": "mm",
        "k": "N m/rad",
        "c": "N m s/rad",
        "m": "kg m^2",
        "tau": "s",
    }
    with pytest.raises(ProblemError, match="dimensions"):
        check_problem(problem(dynamics, units=units, parameters=parameters, domain=box))


def test_parameters_without_a_unit_are_told_where_states_have_one():
    given = dict.fromkeys("kmc", 2.0)
    some = {name: unit for name, unit in UNITS.items() if name not in ("m", "c")}
    (told,) = rows(SPRING, some, parameters=given)
    assert (told.name, told.verdict) == ("units of parameters", "note")
    assert told.figure.startswith("2 have none (m, c): ")
    assert rows(SPRING, {}, parameters=given) == rows(SPRING, UNITS, parameters=given) == []


def test_a_unit_of_time_that_no_second_is_is_told():
    (told, _) = rows(SPRING, {"x": "mm", "v": "m/s", "u": "N"}, parameters=dict.fromkeys("kmc", 2.0))
    assert (told.verdict, "units of 0.001 s alone" in told.figure) == ("note", True)


def test_degrees_in_a_sine_are_refused_with_what_to_write():
    turned = {"x": "v", "v": "u - sin(x)"}
    with pytest.raises(ProblemError, match=r"\[agent.units\] x: degrees; .*write x\*pi/180"):
        rows(turned, {"x": "deg", "v": "deg/s", "u": "deg/s^2"})


def test_states_that_move_by_numbers_far_apart_are_named_with_what_they_move_by() -> None:
    """x' = v, v' = 1e-6 p, p' = -1e10 v swings at 100 rad/s: p is 1e8 times v then, and x a hundredth of it, 1e10 below p."""
    posed = problem({"x": "v", "v": "1e-6*p", "p": "u - 1e10*v - p"})
    (note,) = (row for row in units(posed) if "alike" in row.figure)
    found = re.match(r"(\w) moves by numbers about (\S+) times those of (\w): ", note.figure)
    assert found is not None
    assert found[1] + found[3] == "px"
    assert math.log2(float(found[2])) == pytest.approx(math.log2(1e10), abs=1.5), "balanced in powers of two"
    sizes = state_sizes(posed.agent())
    assert sizes[2] / sizes[1] == pytest.approx(1e8, rel=0.5)
    assert sizes[0] / sizes[1] == pytest.approx(0.01, rel=0.5)
    assert not any("alike" in row.figure for row in units(problem({"x": "v", "v": "u - x"})))
