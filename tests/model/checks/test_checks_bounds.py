"""Sectors, Lipschitz constants, contraction, passivity, gain and stiffness: each sharp, beside cases that do not hold."""

import numpy as np
import pytest
from checks_cases import field, problem

from lockstep.model.checks.proved.dissipation import contraction, dissipativity, incremental_gain, passivity
from lockstep.model.checks.proved.equilibria import equilibria
from lockstep.model.checks.proved.geometry.lie import Point
from lockstep.model.checks.proved.one_sided_lipschitz import one_sided_lipschitz, quadratic_inner_boundedness
from lockstep.model.checks.proved.sector import sectors
from lockstep.model.checks.proved.stiffness import stiffness
from lockstep.model.checks.proved.storage import Supply


@pytest.mark.parametrize(
    ("dynamics", "domain", "ends"),
    [
        ({"x": "u + tanh(x)"}, {}, (0, 1)),
        ({"x": "u + sin(x)"}, {}, (-0.2172336282, 1)),  # the least value of sin(x)/x
        ({"x": "u + x**3"}, {"x": (-2, 3)}, (0, 9)),
        ({"x": "u + abs(x)"}, {}, (-1, 1)),
        ({"x": "u + max(min(x, 1), -1)"}, {}, (0, 1)),
        ({"x": "u + exp(-x)"}, {"x": (1, 2)}, (np.exp(-2) / 2, np.exp(-1))),
        ({"x": "u + x*abs(x)*cos(t)"}, {"x": (-1, 1)}, (-1, 1)),
    ],
)
def test_sectors_are_sharp_and_never_inside(dynamics, domain, ends):
    (finding,) = sectors(problem(dynamics, domain).agent())
    assert finding.status == "proved"
    a, b = finding.value["a"], finding.value["b"]
    assert ends[0] - 2e-3 <= a <= ends[0] + 1e-9
    assert ends[1] - 1e-9 <= b <= ends[1] + 2e-3


def test_no_sector_without_a_zero_at_0():
    (finding,) = sectors(problem({"x": "u + cos(x)"}).agent())
    assert finding.status == "refuted"
    assert finding.witness["phi"] == pytest.approx(1)


def test_lipschitz_constants():
    # h = -y (x^2 + y^2): at (1, 1) the symmetric part of its slopes is [[0, -1], [-1, -4]], of eigenvalue sqrt(5) - 2.
    two = field({"x": "u + y", "y": "-y - y*(x**2 + y**2)"}, {"x": (-1, 1), "y": (-1, 1)})
    assert np.sqrt(5) - 2 <= one_sided_lipschitz(two).value["rho"] <= np.sqrt(5) - 2 + 0.01
    # h = -x^3: slopes s in [-3, 0], s^2 - gamma s <= 0 for gamma <= -3
    cubic = quadratic_inner_boundedness(field({"x": "u - x**3"}, {"x": (-1, 1)}))
    assert cubic.value["gamma"] <= -2.9
    assert cubic.value["beta"] <= 0.3
    assert one_sided_lipschitz(field({"x": "u + x**3"})).status == "undecided"  # there is none


def test_contraction():
    assert contraction(field({"x": "u - x - x**3"}, {"x": (-1, 1)})).value["rate"] >= 0.9
    skew = field({"x": "u - 2*x + y", "y": "-x - y - tanh(y)"})
    assert contraction(skew).status == "proved"
    assert contraction(skew, metric=[[1, 0], [0, 1]]).status == "proved"
    pendulum = contraction(field({"x": "y", "y": "u - sin(x) - y"}, {"x": (-4, 4), "y": (-1, 1)}))
    assert pendulum.status == "refuted"
    point = pendulum.witness["point"]
    assert np.linalg.eigvals([[0, 1], [-np.cos(point[0]), -1]]).real.max() > 0
    assert contraction(field({"x": "y", "y": "u - y"})).status == "refuted"  # the position never contracts


def test_passivity_and_gain():
    scalar = field({"x": "u - x - x**3"}, {"x": (-1, 1)})
    assert passivity(scalar).status == "proved"
    assert 1.0 <= incremental_gain(scalar).value["gain"] <= 1.1  # 1 at x = 0
    assert dissipativity(scalar, Supply.gain(1, 1, 1.1)).status == "proved"
    assert dissipativity(scalar, Supply.gain(1, 1, 0.9)).status != "proved"
    second = field({"x": "y", "y": "u - x - y"})
    assert passivity(second).status == "refuted"  # relative degree 2
    assert passivity(field({"x": "u + x"})).status == "refuted"  # unstable
    assert incremental_gain(field({"x": "u + x"})).status == "refuted"


def test_stiffness():
    f = field({"x": "u - x", "y": "-1000*y + x"})
    finding = stiffness(f, Point.all(f, equilibria(f)[1])[0])
    assert finding.value["ratio"] == pytest.approx(1000)
    assert finding.value["fastest"] >= 1000
    assert finding.value["period"] == pytest.approx(0.2 / finding.value["fastest"])


def test_slopes_of_0_say_nothing_where_the_function_jumps():
    """(a - b)'(h(a) - h(b)) and |h(a) - h(b)|^2 are 2 |a - b| and 4 across the jump, however near a and b are."""
    jumps = field({"x": "u + sign(x) - x"}, {"x": (-1, 1)})
    assert one_sided_lipschitz(jumps).status == "undecided"
    assert quadratic_inner_boundedness(jumps).status == "undecided"
    in_time = field({"x": "u + sign(t - 1) - x"}, {"x": (-1, 1)})
    assert one_sided_lipschitz(in_time).value["rho"] == 0


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("f", ["1/y - 1", "log(y)", "sqrt(y) - x"])
def test_a_singularity_in_the_box_leaves_questions_open(f):
    singular = field({"x": f, "y": "x - y + u"}, {"x": (-2, 2), "y": (0, 2)})
    assert one_sided_lipschitz(singular).status == "undecided"
    assert quadratic_inner_boundedness(singular).status == "undecided"


def test_a_quotient_is_not_taken_at_0():
    (finding,) = sectors(problem({"x": "u + sqrt(x)"}, {"x": (0, 4)}).agent())
    assert finding.witness["lowest"]["ratio"] == pytest.approx(0.5)  # sqrt(4)/4
    assert 0.4 <= finding.value["a"] <= 0.5
    assert finding.value["b"] is None
