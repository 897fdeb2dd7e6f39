"""The package from Python, as a researcher used it: what is said of a design, copies of it, and what is no number."""

import copy
import pickle

import casadi as ca
import networkx as nx
import numpy as np
import pytest

import lockstep
from lockstep.check.errors import ProblemError
from lockstep.model import Agent, Graph
from lockstep.model.checks.check import check_problem

TWO_SLOPES = """
[agent]
name = "motor"
states = ["q", "w"]
inputs = ["u"]
dynamics = { q = "w", w = "u - w - 3*sin(q) - 0.8*w/(1 + w**2)" }
outputs = { y = "q", v = "w" }
[network]
agents = 2
topology = "complete"
[design]
method = "given"
gains = [{ D = [[-4.0, -4.0]] }, { D = [[-4.0, -4.0]] }]
"""
SCALED = """
[agent]
name = "tank"
states = ["h", "q"]
inputs = ["u", "w"]
dynamics = { h = "u - h + 5*sin(10*h) + tanh(q)", q = "w - q + 50*sin(h)" }
outputs = { a = "h", b = "q" }
centre = false
[network]
agents = 2
topology = "complete"
[design]
method = "given"
gains = [{ D = [[-60.0, -1.0], [-1.0, -60.0]] }, { D = [[-60.0, -1.0], [-1.0, -60.0]] }]
[controller]
period = 0.0005
"""
"""The slope of phi at 0 is 70.7, whatever the units are in which alpha is 3.3."""
LOCAL = TWO_SLOPES.replace("0.8*w/(1 + w**2)", "q**3").replace(
    "[network]", "domain = { q = [-0.5, 0.5] }\n[network]"
)


@pytest.fixture(scope="module")
def arms(request) -> lockstep.Design:
    return lockstep.load(request.config.rootpath / "generated" / "flexible_joint_arms")


@pytest.fixture(scope="module")
def two_slopes() -> lockstep.Design:
    return lockstep.design(lockstep.Problem.parse(TWO_SLOPES))


def test_what_is_covered_is_said_slope_by_slope(two_slopes):
    """By the norm alone a slope of 3 in w would be covered, and of that nothing is proved.

    3 sin q has slopes from -3 to 3; 0.8 w/(1 + w^2) from -0.1 to 0.8, of which the middle is in the linear part.
    """
    slopes = [one["slope"] for one in two_slopes.document()["entries"]]
    assert slopes == pytest.approx([3.0, 0.45], rel=1e-2), "the middle is a sum of few powers of two"
    said = next(one for one in lockstep.explain(two_slopes).proved if one.name == "alpha").meaning
    for shown in (repr(two_slopes), said):
        assert f"|d phi1/d v1| <= 3, |d phi1/d v2| <= {slopes[1]:.6g}" in shown
    assert "within these bounds" in said


def test_alpha_is_never_shown_without_the_units_that_it_counts_in(tmp_path):
    problem = lockstep.Problem.parse(SCALED)
    found = lockstep.design(problem)
    assert found.alpha < 50, "d/dh of 5 sin 10 h alone is 50 at 0"
    units = found.alpha_text.split(";", 1)[1]
    assert "phi in units of" in units
    said = next(one for one in lockstep.explain(found).proved if one.name == "alpha")
    header = lockstep.generate(found, tmp_path / "made").files["include/tank1.h"]
    (row,) = [one for one in check_problem(problem).rows if one.name == "bound of the nonlinearity"]
    for shown in (said.value, " ".join(header.replace("\n *", "").split()), row.figure):
        assert units in shown
    assert "in the units named" in row.reason


def test_a_local_certificate_is_shown_as_one():
    found = lockstep.design(lockstep.Problem.parse(LOCAL))
    assert found.document()["scope"] == "local"
    assert "while every agent stays in its domain" in repr(found)
    assert [one.name for one in lockstep.explain(found).assumed][:2] == ["model", "domain"]


def test_sampled_controllers_are_sampled_by_the_rule_of_the_problem(arms):
    """A state of x' = a x by Tustin's rule: (1 + a T/2)/(1 - a T/2), no matter how it is asked for."""
    T = 0.01
    one, named = arms.controllers_to_control(period=T)[0], arms.controllers_to_control(T, "tustin")[0]
    a = np.linalg.eigvals(arms.gains.A[0])
    expected = (1 + a * T / 2) / (1 - a * T / 2)
    np.testing.assert_allclose(np.sort_complex(one.poles()), np.sort_complex(expected), rtol=1e-9)
    np.testing.assert_array_equal(one.A, named.A)
    assert one.dt == T
    for wrong in (-1.0, 0.0, np.nan):
        with pytest.raises(ProblemError, match="expected above 0"):
            arms.controllers_to_control(period=wrong)


def test_gains_of_a_design_stay_those_of_its_file(arms):
    with pytest.raises(ValueError, match="read-only"):
        arms.gains.D[0][0, 0] = 500.0


@pytest.mark.parametrize("how", [lambda one: pickle.loads(pickle.dumps(one)), copy.deepcopy])
def test_designs_problems_and_verdicts_go_to_other_processes(arms, how):
    _ = arms.network  # holds CasADi's expressions, which cannot
    assert how(arms) == arms
    assert how(arms).folder == arms.folder
    assert how(arms.problem).document() == arms.problem.document()
    verdict = lockstep.certify(arms)
    assert how(verdict).document() == verdict.document()


def test_controllers_that_yield_more_than_none_say_so_wherever_they_are_read(tmp_path):
    """x'' = -x - x' + u, u = 0.3 (x_i - x_j): a constant load finds a stiffness of 1 - 2 * 0.3, so 2.5 times the way."""
    text = """
[agent]
name = "spring"
states = ["x", "v"]
inputs = ["u"]
dynamics = { x = "v", v = "-x - v + u" }
outputs = { y = "x" }
[network]
agents = 2
topology = "complete"
[design]
method = "given"
gains = [{ D = [[0.3]] }, { D = [[0.3]] }]
"""
    (tmp_path / "soft.toml").write_text(text, encoding="utf-8")
    built = lockstep.build(tmp_path / "soft.toml", tmp_path / "soft")
    said = "of v moves y 2.5 times as far apart as u = 0 does (computed)"
    assert any(said in note for note in built.notes)
    readme, report = ((tmp_path / "soft" / name).read_text("utf-8") for name in ("README.md", "report.html"))
    header = " ".join((tmp_path / "soft/include/spring1.h").read_text("utf-8").replace("\n *", "").split())
    told = {one.name: one.value for one in lockstep.explain(tmp_path / "soft").open}
    for shown in (readme, report, header, told["constant disturbance"]):
        assert said in shown
    assert lockstep.certify(tmp_path / "soft")


@pytest.mark.parametrize(
    ("outputs", "D"), [('speed = "v"', "-1.5"), ('speed = "v", current = "i"', "-1.5, 0.0")]
)
def test_a_current_that_carries_the_load_does_not_count_as_softer(outputs, D, tmp_path):
    """v' = -v + 2 i + xi, i' = -3 i - v + u, u = -3 v_d for two: v_d = 3 xi_d / 11, 3/5 xi_d without; i_d 20/11 as far.

    Whether the current is measured or not.
    """
    text = f"""
[agent]
name = "motor"
states = ["v", "i"]
inputs = ["u"]
dynamics = {{ v = "-v + 2*i", i = "-3*i - v + u" }}
outputs = {{ {outputs} }}
[network]
agents = 2
topology = "complete"
[design]
method = "given"
gains = [{{ D = [[{D}]] }}, {{ D = [[{D}]] }}]
"""
    (tmp_path / "motor.toml").write_text(text, encoding="utf-8")
    told = lockstep.design(tmp_path / "motor.toml").document()["figures"]["static_response"]
    assert told["moves"] == "speed"
    assert told["times"] == pytest.approx(5 / 11, rel=1e-9)


def test_the_sampled_rho_is_without_errors_of_the_gains_and_says_so(tmp_path):
    """Continuous x_d' = -x_d - 2 (1 +- 0.5) x_d: rho 1/2; sampled, without errors, it is nearer to 1/3."""
    text = """
[agent]
name = "cell"
states = ["x"]
inputs = ["u"]
dynamics = { x = "-x + u" }
outputs = { y = "x" }
[network]
agents = 2
topology = "complete"
[controller]
period = 0.001
[design]
method = "given"
gains = [{ D = [[-1.0]] }, { D = [[-1.0]] }]
fragility = { D = 0.5 }
"""
    (tmp_path / "cell.toml").write_text(text, encoding="utf-8")
    made = lockstep.design(tmp_path / "cell.toml")
    told = {one.name: one for one in lockstep.explain(made).proved}
    assert made.rho == pytest.approx(0.5, rel=0.01)
    assert made.sampled["rho"] < 0.4
    assert "without errors of its gains" in told["rho, sampled"].text


def test_a_refuted_design_is_false_and_the_claim_has_its_name(arms):
    content = arms.stored.document()
    assert lockstep.certify(arms)
    content["claims"]["decay"] = 0.9
    refused = lockstep.certify(lockstep.Design.of(content, "changed"))
    assert not refused
    assert "decays at 0.9 1/s" in refused.reason


@pytest.fixture
def mass() -> Agent:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    return Agent(name="mass", x=x, u=u, rhs=ca.vertcat(x[1], u - ca.sin(x[0])), y=x[0])


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (lambda _: Graph(np.array([[0, 1j], [1, 0]])), "complex"),
        (lambda _: Graph.from_laplacian(np.array([[1j, -1j], [-1, 1]])), "complex"),
        (
            lambda mass: lockstep.Problem.of(mass, Graph.topology("path", 2), B=[np.array([[0], [1j]])] * 2),
            "complex",
        ),
        (
            lambda mass: lockstep.Problem.of(mass, np.ones((2, 2))),
            "a ndarray; expected a `Graph`, or one of networkx",
        ),
    ],
    ids=["graph", "laplacian", "problem", "array for a graph"],
)
def test_what_is_no_real_number_or_no_graph_is_refused(mass, made, said):
    with pytest.raises(ProblemError, match=said):
        made(mass)


def test_an_edge_of_networkx_goes_from_who_is_heard(mass):
    """Of (1, 2) the second hears the first, as signals flow; of `from_edges` the first is the listener."""
    led = lockstep.Problem.of(mass, nx.DiGraph([(1, 2), (2, 3)])).graph()
    np.testing.assert_array_equal(led.adjacency, Graph.from_edges(3, [(2, 1), (3, 2)]).adjacency)


def test_a_path_where_tables_are_meant_names_what_reads_it():
    with pytest.raises(TypeError, match=r"not 'p\.toml'; Problem\.load\(path\)"):
        lockstep.Problem("p.toml")
