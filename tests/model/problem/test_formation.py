"""Offsets that no agent's equation sees, decided exactly; and a leader's reference, as formulas."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cart import cart
from lockstep.check.design_file.problem import ProblemTables
from lockstep.check.errors import ProblemError
from lockstep.check.sampled.discretise import measured_offsets
from lockstep.check.system.agent import ExactAgent
from lockstep.check.system.formation import check_formation
from lockstep.model.problem import Problem
from lockstep.model.simulation.from_problem import scenario_of

CARTS = (
    cart("f - 0.2*tanh(v)")
    + """
[network]
agents = 3
topology = "leader_path"
offsets = [[0.0, 0.0], [-1.1, 0.0], [-2.3, 0.0]]
[design]
weights = { state = 1.0 }
[simulation]
horizon = 5.0
reference = { f = "0.3*sin(t)" }
"""
)


def agent_of(dynamics: dict[str, str], states: list[str]) -> ExactAgent:
    return ExactAgent.from_texts(
        "one", states=states, inputs=["u"], dynamics=dynamics, outputs={"y": states[0]}
    )


ARM = agent_of({"m": "w", "w": "l - m + u", "l": "w", "q": "sin(m - l) + q"}, ["m", "w", "l", "q"])


@pytest.mark.parametrize(
    ("offset", "said"),
    [
        ([0.3, 0.0, 0.3, 0.0], ""),
        ([0.3, 0.0, 0.1 + 0.2, 0.0], "adds .*e-17 to the derivative of `w`"),
        ([0.0, 0.5, 0.0, 0.0], "adds 0.5 to the derivative of `m`"),
        ([0.0, 0.0, 0.0, 2.0], "adds 2 to the derivative of `q`"),
    ],
)
def test_the_term_that_breaks_a_formation_is_named(offset, said):
    """0.1 + 0.2 is another double than 0.3: decided in rationals, the last bit counts."""
    offsets = np.array([[1.0, 2.0, 3.0, 4.0], [1.0, 2.0, 3.0, 4.0]])
    check_formation(ARM, offsets)  # common offsets are none
    offsets = np.array([[0.0] * 4, [0.0] * 4, offset])
    if not said:
        check_formation(ARM, offsets)
        return
    with pytest.raises(ProblemError, match=f"agent 3: its offset from agent 1 {said}"):
        check_formation(ARM, offsets)


def test_an_argument_of_the_nonlinearity_is_named():
    pendulum = agent_of({"a": "w", "w": "u - sin(2*a)"}, ["a", "w"])
    with pytest.raises(ProblemError, match=r"moves . a, on which a nonlinear term depends, by"):
        check_formation(pendulum, np.array([[0.0, 0.0], [1.0, 0.0]]))


SMALL = st.integers(-1, 1)


@given(
    st.lists(st.lists(SMALL, min_size=3, max_size=3), min_size=3, max_size=3),
    st.lists(SMALL, min_size=3, max_size=3),
    st.lists(SMALL, min_size=3, max_size=3),
)
def test_offsets_pass_if_and_only_if_f_does_not_change_along_them(A, H, d):
    """f(x + d) = f(x) at random points, by the formulas themselves: linear terms and a cube of one argument."""
    states = ["a", "b", "c"]

    def sum_of(row):
        return " + ".join(f"({c})*{x}" for c, x in zip(row, states, strict=True))

    nonlinear = f" + ({sum_of(H)})**3" if any(H) else ""
    dynamics = {x: sum_of(row) for x, row in zip(states, A, strict=True)}
    dynamics["c"] += nonlinear + " + u"

    def f(x):
        value = np.array(A) @ x
        value[2] += (np.array(H) @ x) ** 3
        return value

    points = np.random.default_rng(0).integers(-9, 10, (5, 3))
    same = all((f(x + np.array(d)) == f(x)).all() for x in points)
    try:
        check_formation(agent_of(dynamics, states), np.array([[0.0] * 3, list(map(float, d))]))
        assert same
    except ProblemError:
        assert not same


def test_what_the_c_takes_off_is_the_nearest_number_of_its_type():
    seen = measured_offsets(ARM, np.array([[0.1, 0, 0.1, 0], [0.0] * 4]), "float32")
    assert seen is not None and seen.tolist() == [[float(np.float32(0.1))], [0.0]]
    assert measured_offsets(ARM, np.zeros((2, 4)), "float32") is None
    assert measured_offsets(ARM, None, "float64") is None


@pytest.mark.parametrize(
    ("ours", "theirs", "said"),
    [
        ("[-2.3, 0.0]]", "[-2.3, 1e-9]]", "adds 1e-09 to the derivative of `p`"),
        (", [-2.3, 0.0]]", "]", "2 rows of 2 numbers; expected 3 rows"),
        ("[-2.3, 0.0]]", "[-2.3]]", "3 rows of 1, 2 numbers"),
        ("[[0.0, 0.0], [-1.1, 0.0], [-2.3, 0.0]]", "[]", "no rows; expected 3 rows"),
        ('y2 = "v" }', 'y2 = "v" }\ndomain = { p = [-1, 1] }', "set apart in `p`, which has a domain"),
        ('y2 = "v" }', 'y2 = "v" }\noutput_range = { y1 = [-1, 1] }', "`output_range` beside offsets"),
        ('"leader_path"', '"ring"', "no agent leads"),
        ("reference = { f =", "reference = { g =", "`g` is no input"),
        ("0.3*sin(t)", "0.3*sin(p)", "unknown symbol `p`"),
        ("0.3*sin(t)", "1/(t - 2.5)", "not finite at some t"),
    ],
)
def test_what_fits_no_problem_is_refused(ours, theirs, said):
    assert ours in CARTS
    with pytest.raises(ProblemError, match=said):
        Problem.parse(CARTS.replace(ours, theirs))


def test_the_checker_reads_and_refuses_the_same():
    document = Problem.parse(CARTS).document()
    assert ProblemTables.from_document(document).offsets.tolist() == document["network"]["offsets"]
    assert Problem.from_document(document).offsets.tolist() == document["network"]["offsets"]
    document["network"]["offsets"][2][1] = 2.0**-60
    with pytest.raises(ProblemError, match="its offset from agent 1 adds"):
        ProblemTables.from_document(document)
    many = {**document["network"], "topology": None, "agents": None, "spectrum": [1.0, 2.0], "max_degree": 2}
    with pytest.raises(ProblemError, match="none with `spectrum`"):
        ProblemTables.from_document({**document, "network": many})


def test_a_reference_is_the_leaders_disturbance():
    """xi = B v on agent 1 alone; beyond the actuator's limits it is clipped; beside noise it is added."""
    t = np.linspace(0.0, 5.0, 11)
    xi = scenario_of(Problem.parse(CARTS), sampled=True).xi()
    assert xi.hold == "smooth"
    expected = np.zeros((11, 3, 2))
    expected[:, 0, 1] = 0.3 * np.sin(t)
    np.testing.assert_allclose(xi.at(t, t), expected, atol=1e-15)
    limited = CARTS.replace("[network]", "limits = { f = [-0.1, 0.2] }\n[network]")
    v = scenario_of(Problem.parse(limited), sampled=True).xi().at(t, t)[:, 0, 1]
    np.testing.assert_allclose(v, np.clip(expected[:, 0, 1], -0.1, 0.2), atol=1e-15)
    stepped = CARTS + '[simulation.disturbance]\nkind = "step"\namplitude = 2.0\n'
    both = scenario_of(Problem.parse(stepped), sampled=True).xi().at(t, t)
    np.testing.assert_allclose(np.abs(both - expected), 2.0, atol=1e-12)
