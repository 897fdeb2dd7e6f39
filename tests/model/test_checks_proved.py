"""The checks that prove, each with cases that hold beside cases that do not; twenty models against dense sampling and facts.

The facts are in the literature that the model's file names; sampling uses CasADi's numbers, not the enclosures.
"""

from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from lockstep.check.errors import ProblemError
from lockstep.model.checks.proved.dissipation import contraction, dissipativity, incremental_gain, passivity
from lockstep.model.checks.proved.equilibria import equilibria
from lockstep.model.checks.proved.everything import prove
from lockstep.model.checks.proved.field import Field, as_written
from lockstep.model.checks.proved.lie import Point
from lockstep.model.checks.proved.lipschitz import one_sided_lipschitz, quadratic_inner_boundedness
from lockstep.model.checks.proved.rank import controllability_rank, observability_rank
from lockstep.model.checks.proved.relative_degree import relative_degree, zero_dynamics
from lockstep.model.checks.proved.sector import sectors
from lockstep.model.checks.proved.stiffness import stiffness
from lockstep.model.checks.proved.storage import Supply
from lockstep.model.checks.proved.units import check_units
from lockstep.model.problem import Problem, load_problem

MODELS = Path(__file__).parents[1] / "models"


def problem(dynamics, domain=None, output=None, **agent):
    return Problem.from_document(
        {
            "agent": {
                "states": list(dynamics),
                "inputs": ["u"],
                "dynamics": dynamics,
                "outputs": {"y1": output or next(iter(dynamics))},
                "domain": {name: list(map(float, ends)) for name, ends in (domain or {}).items()},
                **agent,
            },
            "network": {"agents": 2, "topology": "path"},
        }
    )


def field(dynamics, domain=None, output=None):
    return Field.of(problem(dynamics, domain, output).agent())


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


@pytest.mark.parametrize(
    ("dynamics", "units", "told"),
    [
        ({**SPRING, "x": "v + x"}, UNITS, r"\[agent.dynamics\] x: the term `x` has the dimension \[length\]"),
        ({**SPRING, "v": "u/m - k*x"}, UNITS, r"\[agent.dynamics\] v: the term `k\*x`"),
        ({**SPRING, "v": "(u - k*v)/m"}, UNITS, r"`u - k\*v` is made of parts"),
        ({**SPRING, "v": "u/m + k*x/m*sin(x)"}, UNITS, r"`sin\(x\)` is a function of a quantity"),
        ({**SPRING, "v": "u/m + k*x/m*2**x"}, UNITS, r"exponent"),
        (SPRING, {**UNITS, "y1": "s"}, r"\[agent.outputs\] y1"),
        (SPRING, {**UNITS, "k": "furlongs per banana"}, r"\[agent.units\] k: .* is no unit"),
    ],
)
def test_units_that_do_not_fit_are_an_error_that_names_the_term(dynamics, units, told):
    with pytest.raises(ProblemError, match=told):
        check_units(spring(dynamics, units))


def test_stiffness():
    f = field({"x": "u - x", "y": "-1000*y + x"})
    finding = stiffness(f, Point.all(f, equilibria(f)[1])[0])
    assert finding.value["ratio"] == pytest.approx(1000)
    assert finding.value["fastest"] >= 1000
    assert finding.value["period"] == pytest.approx(0.2 / finding.value["fastest"])


COUNTS = {  # equilibria on the domain, as the sources of the files have them
    **{
        "chua": 3,
        "van_der_pol": 1,
        "lorenz": 3,
        "rossler": 2,
        "fitzhugh_nagumo": 1,
        "duffing": 3,
        "pendulum": 3,
    },
    **{
        "lotka_volterra": 2,
        "cstr": 3,
        "glucose": 1,
        "four_tanks": 1,
        "buck_converter": 1,
        "acrobot": 9,
        "dc_motor": 1,
    },
}
FAST = ("van_der_pol", "pendulum", "dc_motor", "fitzhugh_nagumo", "lotka_volterra")
ALL = sorted(path.stem for path in MODELS.glob("*.toml"))


def test_there_are_twenty_models():
    assert len(ALL) == 20


@cache
def findings(name):
    posed = load_problem(MODELS / f"{name}.toml")
    return posed.agent(), {finding.name: finding for finding in prove(posed)}


def held_against_samples(name):
    agent, found = findings(name)
    lower, upper = (np.clip(end, -10.0, 10.0) if np.isinf(end).any() else end for end in agent.box.T)
    random = np.random.default_rng(7)
    x = lower + (upper - lower) * random.uniform(size=(4000, agent.n))
    x[:2000] = np.where(
        random.uniform(size=(2000, agent.n)) < 0.5,
        np.round((x[:2000] - lower) / (upper - lower)) * (upper - lower) + lower,
        x[:2000],
    )
    zero = np.zeros((agent.m, len(x)))
    f = np.asarray(agent.dynamics(x.T, zero, 0.0)).T
    near = np.clip(x + 1e-3 * (upper - lower) * random.normal(size=x.shape), lower, upper)
    pairs = [
        (x[::2], f[::2], x[1::2], f[1::2]),
        (x, f, near, np.asarray(agent.dynamics(near.T, zero, 0.0)).T),
    ]
    written = as_written(agent)
    A = np.array([[int(v.p) / int(v.q) for v in row] for row in written.A])
    for a, fa, b, fb in pairs:
        check_pairs(found, agent, a - b, fa - fb, (fa - fb) - (a - b) @ A.T, random)
    check_equilibria(found["equilibria"], agent, x[:200], lower, upper)
    check_slopes(found, agent, x[:500])
    return found


def check_pairs(found, agent, d, df, dh, random):
    size, close = (d**2).sum(axis=1), 1e-9
    inner = (d * dh).sum(axis=1)
    scale = (np.abs(d) * (np.abs(dh) + np.abs(df))).sum(axis=1) + size  # of what rounding is relative to
    rho = found["one-sided Lipschitz"]
    if rho.status == "proved":
        assert (inner <= rho.value["rho"] * size + close * scale).all()
    inner_bound = found["quadratic inner-boundedness"]
    if inner_bound.status == "proved":
        beta, gamma = inner_bound.value["beta"], inner_bound.value["gamma"]
        assert (
            (dh**2).sum(axis=1)
            <= beta * size
            + gamma * inner
            + close * ((df**2).sum(axis=1) + (dh**2).sum(axis=1) + abs(gamma) * scale)
        ).all()
    metric = found["contraction"]
    if metric.status == "proved":
        P = np.array(metric.value["P"])
        assert (
            ((d @ P) * df).sum(axis=1) <= -metric.value["rate"] * ((d @ P) * d).sum(axis=1) * (1 - 1e-6)
        ).all()
    B, C = agent.lure.B, agent.lure.C
    du = random.normal(size=(len(d), agent.m)) * random.choice([1e-2, 1.0, 1e2], size=(len(d), 1))
    dy = d @ C.T
    for name in ("incremental passivity", "incremental L2 gain"):
        finding = found[name]
        if finding.status == "proved":
            P = np.array(finding.value["P"])
            rate = 2 * ((d @ P) * (df + du @ B.T)).sum(axis=1)
            passive = name.endswith("passivity")
            supply = (
                2 * (dy * du).sum(axis=1)
                if passive
                else finding.value["gain"] ** 2 * (du**2).sum(axis=1) - (dy**2).sum(axis=1)
            )
            assert (
                rate
                <= supply
                + 1e-9 * (np.abs(rate) + np.abs(supply) + (np.abs(d @ P) * np.abs(du @ B.T)).sum(axis=1))
            ).all()


def check_equilibria(finding, agent, starts, lower, upper):
    from scipy.optimize import root

    def f(x):
        return np.asarray(agent.dynamics(x, np.zeros(agent.m), 0.0)).ravel()

    if finding.status == "proved":
        points = np.array([one["x"] for one in finding.value["points"]]).reshape(-1, agent.n)
        for point in points:
            assert np.abs(f(point)).max() <= 1e-6 * (1 + np.abs(point).max())
        for start in starts:
            end = root(f, start)
            if (
                end.success
                and np.abs(f(end.x)).max() < 1e-9
                and (lower <= end.x).all()
                and (end.x <= upper).all()
            ):
                assert len(points)
                # fsolve stops early at a double zero: compare in the size of the domain
                assert (np.abs(points - end.x) <= 1e-4 * (upper - lower)).all(axis=1).any(), (end.x, points)


def check_slopes(found, agent, points):
    J = ca.Function("J", [agent.x, agent.u, agent.t], [ca.densify(ca.jacobian(agent.rhs, agent.x))])

    def eigenvalues(x):
        return np.linalg.eigvals(np.asarray(J(x, np.zeros(agent.m), 0.0)))

    fastest = (found["stiffness"].value or {}).get("fastest")
    if fastest is not None:
        assert max(np.abs(eigenvalues(x)).max() for x in points) <= fastest * (1 + 1e-9)
    if found["contraction"].status == "refuted" and "point" in found["contraction"].witness:
        witness = found["contraction"].witness
        assert eigenvalues(witness["point"]).real.max() == pytest.approx(witness["real_part"], rel=1e-6)
    for one in (found["equilibria"].value or {}).get("points", []):
        real = eigenvalues(one["x"]).real
        assert one["stable"] is None or one["stable"] == (real.max() < 0)


@pytest.mark.parametrize("name", FAST)
def test_five_models_against_samples_and_facts(name):
    found = held_against_samples(name)
    assert found["equilibria"].value["count"] == COUNTS[name]


@pytest.mark.slow
@pytest.mark.parametrize("name", ALL)
def test_twenty_models_against_samples_and_facts(name):
    found = held_against_samples(name)
    if name in COUNTS:
        assert found["equilibria"].status == "proved"
        assert found["equilibria"].value["count"] == COUNTS[name]


def test_facts_from_the_literature():
    """Of the models above, where the source states more than how many equilibria there are."""
    _, motor = findings("dc_motor")
    assert motor["incremental passivity"].status == "proved"  # voltage to current, with monotone friction
    _, oscillator = findings("van_der_pol")
    assert [one["stable"] for one in oscillator["equilibria"].value["points"]] == [False]
    _, pendulum = findings("pendulum")
    assert sorted(one["stable"] for one in pendulum["equilibria"].value["points"]) == [False, False, True]


@pytest.mark.slow
def test_more_facts_from_the_literature():
    tanks = findings("four_tanks")[1]
    assert tanks["equilibria"].value["points"][0]["x"] == pytest.approx([12.4, 12.7, 1.8, 1.4], abs=0.2)
    zeros = sorted(re for re, _ in tanks["zero dynamics"].value["zeros"])
    assert zeros == pytest.approx([-0.060, -0.018], rel=0.1)
    quadrotor = findings("quadrotor")[1]
    assert (
        quadrotor["relative degree"].status == "refuted"
    )  # singular until the thrust is a double integrator
    lorenz = findings("lorenz")[1]["equilibria"].value["points"]
    side = np.sqrt(72)
    expected = [[-side, -side, 27], [0, 0, 0], [side, side, 27]]
    assert np.allclose(sorted(one["x"] for one in lorenz), expected)
