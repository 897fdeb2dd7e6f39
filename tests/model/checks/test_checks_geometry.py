"""Relative degree, zero dynamics and the ranks by brackets, with what none of them may say: at kinks, of rows that are 0."""

import pytest
from checks_cases import field

from lockstep.model.checks.proved.equilibria import equilibria
from lockstep.model.checks.proved.geometry.lie import Point
from lockstep.model.checks.proved.geometry.rank import controllability_rank, observability_rank
from lockstep.model.checks.proved.geometry.relative_degree import relative_degree, zero_dynamics


def test_relative_degree_and_zero_dynamics():
    def both(dynamics, domain=None, output=None):
        f = field(dynamics, domain, output)
        degree = relative_degree(f)
        return degree, zero_dynamics(f, Point.all(f, equilibria(f)[1])[0], degree)

    degree, zeros = both({"x": "y", "y": "u - sin(x) - y"}, {"x": (-1, 1)})
    assert (degree.value["degrees"], zeros.value["states"]) == ([2], 0)
    degree, zeros = both({"x": "u - x + y", "y": "x - y - y**3"}, {"y": (-1, 1)})
    assert (degree.value["degrees"], zeros.status) == ([1], "proved")
    degree, zeros = both({"x": "u + y", "y": "x + y"})
    assert zeros.status == "refuted"
    assert zeros.witness["zero"] == pytest.approx([1.0, 0.0])
    degree, _ = both({"x": "y", "y": "z**3 - x", "z": "u"}, {"z": (-1, 1)})
    assert degree.status == "refuted"
    assert both({"x": "-x", "y": "u - y"})[0].status == "refuted"  # no input reaches x


def test_ranks_by_brackets():
    def both(dynamics, domain=None, output=None):
        f = field(dynamics, domain, output)
        point = Point.all(f, equilibria(f)[1])[0]
        return controllability_rank(f, point), observability_rank(f, point)

    # z^3: the linearisation at 0 is not controllable, the bracket [g, [g, [g, f]]] spans what is missing
    reached, seen = both({"x": "y", "y": "z**3 - x", "z": "u"}, {"z": (-1, 1)})
    assert (reached.status, reached.value["rank"], seen.status) == ("proved", 3, "undecided")
    reached, seen = both({"x": "u - x", "y": "-2*y"})
    assert (reached.status, seen.status) == ("refuted", "refuted")
    assert (reached.witness["never_moved"], seen.witness["never_seen"]) == ([0, 1], [0, 1])
    assert [one.status for one in both({"x": "y + u", "y": "sin(x)"}, {"x": (-1, 1)})] == ["proved", "proved"]


def test_a_row_that_is_0_everywhere_is_not_taken_for_one_that_is_not():
    """u reaches y1 through z alone, after two steps more than through the y that a factor of 0 hides."""
    zero = "(sin(x)**2 + cos(x)**2 - 1)"
    hidden = field({"x": f"z + y*{zero}", "y": "u - y", "z": "w - z", "w": "y - w"}, {"x": (-1, 1)})
    assert relative_degree(hidden).status == "undecided"
    plain = field({"x": "z", "y": "u - y", "z": "w - z", "w": "y - w"}, {"x": (-1, 1)})
    assert relative_degree(plain).value["degrees"] == [4]


def test_nothing_is_said_of_derivatives_at_a_kink():
    """At 0 the selections of a slope are those of one side: with x' = y + abs(y), y below 0 never moves x."""
    f = field({"x": "y + abs(y)", "y": "u - y"}, {"x": (-1, 1), "y": (-1, 1)})
    at_the_kink = Point.all(f, equilibria(f)[1])[0]
    assert relative_degree(f).status == "undecided"
    assert controllability_rank(f, at_the_kink).status == "undecided"
    assert observability_rank(f, at_the_kink).status == "undecided"
    f = field({"x": "2*y", "y": "u - y"}, {"x": (-1, 1), "y": (-1, 1)})
    at_0 = Point.all(f, equilibria(f)[1])[0]
    assert [check(f, at_0).status for check in (controllability_rank, observability_rank)] == ["proved"] * 2


def test_zero_dynamics_at_a_kink_are_undecided():
    """y' = x - y - abs(y)/2: of slope -1/2 or -3/2, so that the linearisation of one side tells nothing of the other."""
    f = field({"x": "u - x", "y": "x - y - abs(y)/2"}, {"x": (-1, 1), "y": (-1, 1)})
    points = Point.all(f, equilibria(f)[1])
    degree = relative_degree(f)
    assert (degree.status, degree.value["degrees"]) == ("proved", [1])
    assert zero_dynamics(f, points[0], degree).status == "undecided"


def test_brackets_that_grow_are_given_up():
    """Without biomass no feed makes any: its brackets vanish at X = 0, however many there are."""
    growth = "53/100*S/(12/100 + S + S**2/(9/20))*X"
    reactor = field(
        {"X": f"{growth} - 0.3*X", "S": f"1.2 - 0.3*S - 2*{growth} + u"}, {"X": (0, 3), "S": (0, 5)}
    )
    _, found = equilibria(reactor)
    finding = controllability_rank(reactor, Point.all(reactor, found)[0])
    assert finding.status == "undecided"
    assert finding.witness["rank"] == 1
    assert any(x is not None for x in found[0].exact)


def test_a_pole_at_the_origin_refutes_no_relative_degree():
    assert (
        relative_degree(field({"x": "1/y - 1", "y": "x - y + u"}, {"x": (-2, 2), "y": (-2, 2)})).status
        == "undecided"
    )
