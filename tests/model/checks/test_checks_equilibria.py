"""All equilibria on a domain: known ones beside cases in which nothing may be said; kinks and free states."""

import numpy as np
import pytest
from checks_cases import field
from flint import acb, acb_mat, fmpz_mat

from lockstep.model.checks.proved.equilibria import equilibria
from lockstep.model.checks.proved.interval_algebra.eigenvalues import gershgorin

TIED = {"x": "x - y + u", "y": "2*x - 2*y"}


@pytest.mark.parametrize(
    ("dynamics", "domain", "status", "points"),
    [
        ({"x": "x - x**3 + u"}, {}, "proved", [[-1], [0], [1]]),
        ({"x": "x*(x - 1) + u"}, {"x": (0, 1)}, "proved", [[0], [1]]),  # both on the boundary
        ({"x": "x**2 - 1e-6 + u"}, {"x": (-1, 1)}, "proved", [[-1e-3], [1e-3]]),
        ({"x": "x**2 + 1e-12 + u"}, {"x": (-1, 1)}, "proved", []),
        ({"x": "x**2 + u"}, {"x": (-1, 1)}, "proved", [[0]]),
        ({"x": "x**2 - 2 + u"}, {"x": (0, 1)}, "proved", []),
        ({"x": "abs(x) - 0.5 + u"}, {"x": (-1, 1)}, "proved", [[-0.5], [0.5]]),
        ({"x": "u + cos(x) - x"}, {}, "proved", [[0.7390851332151607]]),  # the Dottie number
        ({"x": "y", "y": "u - sin(x) - x/2 - y"}, {}, "proved", [[0, 0]]),
        ({"x": "x*y - x + u", "y": "x*y - y"}, {"x": (0, 3), "y": (0, 3)}, "proved", [[0, 0], [1, 1]]),
        ({"x": "u + exp(x/10) + 1e-3*x**2"}, {"x": (-50, 50)}, "proved", []),
        ({"x": "y", "y": "u - y"}, {}, "refuted", None),  # every x
        ({"x": "u - sin(x)"}, {}, "undecided", None),  # infinitely many
        ({"x": "u - x + cos(t)"}, {}, "undecided", None),
        ({"x": "u + if_else(x > 0.5, 1, -1)*(1 + x**2)"}, {"x": (-1, 1)}, "undecided", None),  # jumps over 0
    ],
)
def test_equilibria(dynamics, domain, status, points):
    finding, _ = equilibria(field(dynamics, domain))
    assert finding.status == status, finding
    if points is not None:
        assert finding.value["count"] == len(points)
        found = sorted(one["x"] for one in finding.value["points"])
        assert np.allclose(np.array(found).ravel(), np.array(points).ravel(), rtol=1e-12, atol=1e-9)


def test_a_budget_that_does_not_suffice_is_said():
    finding, _ = equilibria(field({"x": "u + sin(20*x) - 0.1"}, {"x": (-3, 3)}), boxes=3)
    assert finding.status == "undecided"
    assert finding.witness["open"]


@pytest.mark.parametrize(
    ("dynamics", "domain", "status", "point"),
    [
        # x = y along a line: a state that is solved for hides behind the free one, and has to stay in the domain with it.
        (TIED, {"x": (-3, 3), "y": (-2, 2)}, "refuted", [0, 0]),
        (TIED, {"x": (0.5, 3), "y": (1, 2)}, "refuted", [1, 1]),
        (TIED, {"x": (-1, 1), "y": (-2, 2)}, "undecided", None),
        (TIED, {"x": (-1, 1)}, "undecided", None),
        (TIED, {"x": (3, 4), "y": (1, 2)}, "proved", None),
        (
            {"x": "u - sin(x)**2 - cos(x)**2 + 1"},
            {"x": (-1, 1)},
            "undecided",
            None,
        ),  # every x, written otherwise
    ],
)
def test_equilibria_that_are_not_isolated(dynamics, domain, status, point):
    finding, found = equilibria(field(dynamics, domain))
    assert finding.status == status, finding
    if point is None:
        assert not found
        assert ("move with y" in finding.figure) == (status == "undecided" and dynamics is TIED)
    else:
        assert (finding.value["families"], finding.value["along"]) == (1, ["y"])
        assert found[0].middle == point


@pytest.mark.parametrize(
    ("f", "stable"),
    [
        ("-x - abs(x)/2", None),
        ("-x - max(x, 2*x)/2", None),
        ("-3*x/2 + abs(x - 1)/2 - 1/2", True),  # beside a kink: -2 x
        ("2*x + abs(x + 1) - 1", False),  # and 3 x
    ],
)
def test_at_a_kink_no_linearisation_tells_of_stability(f, stable):
    _, found = equilibria(field({"x": f"u + {f}"}, {"x": (-0.5, 0.5)}))
    assert [(one.middle, one.stable) for one in found] == [([0.0], stable)]


@pytest.mark.parametrize(
    ("dynamics", "stable"),
    [
        ({"x": "u - x", "y": "x**2 - y", "z": "y**2 - z"}, True),  # -1 three times, in a chain
        ({"x": "u - x", "y": "x*y - y"}, True),
        ({"x": "u - x", "y": "y - x**3", "z": "z + x*y"}, False),  # 1 twice
        ({"x": "y + u", "y": "-x**3"}, None),  # 0 twice
    ],
)
def test_multiple_eigenvalues_tell_of_stability(dynamics, stable):
    _, found = equilibria(field(dynamics, dict.fromkeys(dynamics, (-0.5, 0.5))))
    assert [(one.middle, one.stable) for one in found] == [([0.0] * len(dynamics), stable)]


@pytest.mark.parametrize("seed", range(20))
def test_the_balls_hold_the_eigenvalues_they_are_built_from(seed):
    """T diag(s) T^-1 with whole-number T of determinant 1: each s as often as it was put there."""
    random = np.random.default_rng(seed)
    n = 4
    s = random.choice([-2, -1, 3], size=n)
    T = fmpz_mat(np.tril(random.integers(-2, 3, size=(n, n)), -1).tolist()) + fmpz_mat(
        np.eye(n, dtype=int).tolist()
    )
    J = T * fmpz_mat(np.diag(s).tolist()) * T.inv(integer=True)
    found = gershgorin(acb_mat(J))
    assert found is not None
    for value in {*s.tolist()}:
        assert sum(ball.contains(acb(value)) for ball in found) == (s == value).sum()
