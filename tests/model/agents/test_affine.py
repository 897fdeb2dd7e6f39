"""The normal form, and the split into A, B, G, H, phi and the offset made of it."""

from dataclasses import replace
from fractions import Fraction

import casadi as ca
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from lockstep.check.errors import ProblemError
from lockstep.check.expression.node import Node, linear_terms
from lockstep.check.system.nonlinearity import solve
from lockstep.model.agents.agent import Agent
from lockstep.model.formulas.expression import parse_expression
from lockstep.model.loop_transformation.lure import Lure

X, Y, Z, T = (ca.SX.sym(name) for name in "xyzt")


def split(expression: ca.SX) -> tuple[dict[int, Fraction], Fraction, list[Fraction]]:
    constant, terms = linear_terms(node(expression))
    row = {x.data: c for c, x in terms if x.op == "variable" and x.data < 3}
    return row, constant, sorted(c for c, x in terms if x.op != "variable" or x.data == 3)


def node(expression: ca.SX) -> Node:
    plant = Agent(name="plant", x=ca.vertcat(X, Y), u=Z, rhs=ca.vertcat(Z, X), y=X, t=T)
    return plant.value(expression, where="here").node


@pytest.mark.parametrize(
    ("expression", "row", "constant", "weights"),
    [
        (X, {0: 1}, 0, []),
        (2 * X, {0: 2}, 0, []),
        (-X, {0: -1}, 0, []),
        (X / 4, {0: Fraction(1, 4)}, 0, []),
        (X / 3, {0: Fraction(1, 3)}, 0, []),
        (2 * (X + ca.sin(X)), {0: 2}, 0, [2]),
        ((X + ca.sin(Y)) / 2, {0: Fraction(1, 2)}, 0, [Fraction(1, 2)]),
        (3 * (X - 2 * (Y + 1)), {0: 3, 1: -6}, -6, []),
        (ca.sin(X) + ca.sin(X), {}, 0, [2]),
        (ca.sin(X + Y) - ca.sin(Y + X), {}, 0, []),
        (X * Y + Y * X, {}, 0, [2]),
        ((2 * X) * (3 * Y), {}, 0, [6]),
        (X * (3 * X), {}, 0, [3]),
        ((2 * X) ** 2, {}, 0, [4]),
        (5 / (2 * X), {}, 0, [Fraction(5, 2)]),
        (X / (4 * Y), {}, 0, [Fraction(1, 4)]),
        (ca.sin(T) * X, {}, 0, [1]),
        (X + T, {0: 1}, 0, [1]),
        ((X + 1) ** 2 - X * X, {}, 0, [-1, 1]),
        (ca.cos(ca.SX(0)) * X, {0: 1}, 0, []),
        (ca.sin(X - X + 0 * Y) + X, {0: 1}, 0, []),
        # CasADi's two halves, of one branch each, are joined again: one term.
        (ca.if_else(X < 1, X, Y), {}, 0, [1]),
    ],
)
def test_the_affine_part_is_exact(expression: ca.SX, row: dict, constant: Fraction, weights: list) -> None:
    assert split(expression) == (row, constant, weights)


def test_tenths_add_up_exactly_before_they_are_rounded() -> None:
    row, _, _ = split(X * 0.1 + (Y + X) * 0.2)
    assert row[0] == Fraction(0.1) + Fraction(0.2) != Fraction(0.3)


def test_a_deep_expression_needs_no_recursion() -> None:
    deep = X
    for _ in range(5000):
        deep = ca.sin(deep) + Y
    row, _, weights = split(deep)
    assert (row, weights) == ({1: 1}, [1])


def test_a_symbol_from_elsewhere_is_refused() -> None:
    with pytest.raises(ProblemError, match="`w` is neither a state"):
        split(X + ca.SX.sym("w"))


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_a_coefficient_that_is_not_finite_is_refused(bad: float) -> None:
    with pytest.raises(ProblemError, match="finite"):
        split(X * bad)


def test_solve_is_exact() -> None:
    third = Fraction(1, 3)
    rows = [((0, Fraction(1)), (1, Fraction(3))), ((1, third), (2, Fraction(1)))]
    target = ((0, Fraction(2)), (1, 6 + 5 * third), (2, Fraction(5)))
    assert solve(rows, target) == [2, 5]
    assert solve(rows, ((2, Fraction(1)),)) is None


def agent(*dynamics: str, split: str = "terms", parameters: dict | None = None) -> Agent:
    states = ["x", "y", "z", "w"][: len(dynamics)]
    return Agent.from_expressions(
        "plant",
        states=states,
        inputs=["u"],
        dynamics=dict(zip(states, dynamics, strict=True)),
        outputs={"y1": "x"},
        parameters=parameters,
        split=split,
    )


@pytest.mark.parametrize(
    ("dynamics", "G", "H"),
    [
        (("y", "u - sin(x)"), [[0], [1]], [[1, 0]]),
        (("y", "u - sin(x - y)"), [[0], [1]], [[1, -1]]),
        (("y", "u - sin(y - x)"), [[0], [1]], [[-1, 1]]),
        (("y", "u - sin(2*x - 2*y)"), [[0], [1]], [[1, -1]]),
        (("y", "u - sin(0.1*x - 0.1*y)"), [[0], [1]], [[1, -1]]),
        (("y", "u - sin((x - y)/3)"), [[0], [1]], [[1, -1]]),
        (("y", "u - sin(2*x)"), [[0], [1]], [[1, 0]]),
        (("y", "u - sin(x + 1) + cos(1 - x)"), [[0], [1]], [[1, 0]]),
        # One spring force in two equations is one component, and G carries both coefficients.
        (("3*(x - y)**3 + u", "-7*(x - y)**3"), [[3], [-7]], [[1, -1]]),
        (("3*(sin(x) + sin(y)) + u", "-7*(sin(y) + sin(x))"), [[3], [-7]], [[1, 0], [0, 1]]),
        # Two rows with two terms: the terms are the components, each with one argument.
        (("sin(x) + sin(y) + u", "sin(x) - sin(y)"), [[1, 1], [1, -1]], [[1, 0], [0, 1]]),
        # Two rows with three terms: the rows are the components.
        (("sin(x) + sin(y) + u", "sin(x) + cos(y)"), [[1, 0], [0, 1]], [[1, 0], [0, 1]]),
        (("y", "u - sin((x - y)/0.7)"), [[0], [1]], [[1, -1]]),
        # x - y and x + y and y span the plane: plain states are as few.
        (("sin(x - y) + u", "sin(x + y)*y"), [[1, 0], [0, 1]], [[1, 0], [0, 1]]),
        # x, x + y: independent as they are.
        (("sin(x) + u", "sin(x + y)"), [[1, 0], [0, 1]], [[1, 0], [1, 1]]),
        # Three differences, two of them independent, of three states.
        (("sin(x - y) + u", "sin(y - z)", "sin(x - z)"), np.eye(3), [[1, -1, 0], [1, 0, -1]]),
        (("-x*y*z + u", "x", "y"), [[1], [0], [0]], np.eye(3)),
        (("y + u", "-x"), np.zeros((2, 0)), np.zeros((0, 2))),
        (("y + u + sin(t)", "-x + 3"), np.zeros((2, 0)), np.zeros((0, 2))),
        (("sin(t)*x + u", "-x"), [[1], [0]], [[1, 0]]),
    ],
)
def test_the_structure_is_as_small_as_the_terms_show(dynamics: tuple, G: list, H: list) -> None:
    lure = agent(*dynamics).lure
    np.testing.assert_array_equal(lure.G, G)
    np.testing.assert_array_equal(lure.H, H)
    check_split(agent(*dynamics))


def check_split(plant: Agent, lure: Lure | None = None, *, points: int = 20, scale: float = 2.0) -> None:
    """f = A x + B u + G phi(H x, t) + offset(t) at random points, to rounding of the terms added."""
    generator = np.random.default_rng(0)
    lure = lure or plant.lure
    for _ in range(points):
        x, u = scale * generator.standard_normal(plant.n), generator.standard_normal(plant.m)
        t = float(generator.uniform(0, 5))
        phi = np.asarray(lure.phi(lure.H @ x, t)).reshape(-1)
        parts = [lure.A @ x, lure.B @ u, lure.G @ phi, np.asarray(lure.offset(t)).reshape(-1)]
        expected = np.asarray(plant.dynamics(x, u, t)).reshape(-1)
        size = 1 + np.abs(expected) + sum(np.abs(part) for part in parts)
        # 1e-12: a few hundred roundings; phi is smooth and of moderate slope in these tests.
        assert (np.abs(sum(parts) - expected) <= 1e-12 * size).all()
    origin = np.asarray(plant.dynamics(np.zeros(plant.n), np.zeros(plant.m), 0.3)).reshape(-1)
    np.testing.assert_allclose(np.asarray(lure.at_origin(0.3)).reshape(-1), origin, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("mode", ["terms", "jacobian"])
@pytest.mark.parametrize(
    "dynamics",
    [
        ("y", "-9.81*sin(x) - 0.3*y + u"),
        ("y", "1.7*(1 - x**2)*y - x + u"),
        ("y + cos(2)", "-x/(1 + x**2) + u/3 + 0.1*sin(3*t)*cos(x) + t"),
        ("0.3*(y - x)**3 + u", "-0.7*(y - x)**3 + tanh(x - y)", "exp(-z**2) + x"),
    ],
)
def test_the_split_adds_up(dynamics: tuple, mode: str) -> None:
    check_split(agent(*dynamics, split=mode))


def test_the_check_of_the_split_can_fail() -> None:
    plant = agent("y", "-9.81*sin(x) + u")
    wrong = plant.lure.A + np.array([[0, 1e-9], [0, 0]])
    with pytest.raises(AssertionError):
        check_split(plant, replace(plant.lure, A=wrong))
    with pytest.raises(ValueError, match="read-only"):
        plant.lure.A[0, 1] = 2.0


def _terms() -> st.SearchStrategy[str]:
    # Tiny numbers are left out: half of the smallest double is none.
    numbers = st.integers(-4000, 4000).map(lambda k: f"({k / 1000})")
    leaves = st.sampled_from(["x", "y", "z", "t"]) | numbers

    def grow(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
        return st.one_of(
            st.builds("({} {} {})".format, inner, st.sampled_from("+-*"), inner),
            st.builds("{}({})".format, st.sampled_from(["sin", "cos", "tanh", "atan", "-"]), inner),
            st.builds("{}*({})".format, numbers, inner),
            st.builds("({})/(2 + sin({}))".format, inner, inner),
            st.builds("({})/3".format, inner),
            st.builds("tanh({})**2".format, inner),
        )

    return st.recursive(leaves, grow, max_leaves=8)


@given(_terms(), _terms(), _terms())
@settings(max_examples=120)
def test_random_agents_split_exactly(a: str, b: str, c: str) -> None:
    try:
        plant = agent(f"{a} + u", f"{b} - 2*u", c)
    except ProblemError as refused:
        assume("all nonlinear terms cancel" not in str(refused))  # 0/(2 + sin(x)), and nothing beside it
        raise
    lure = plant.lure
    assert lure.G.shape[1] <= 3
    assert lure.H.shape[0] <= 3
    assert np.linalg.matrix_rank(lure.H) == lure.H.shape[0] if lure.H.size else True
    whole = ca.mtimes(ca.DM(lure.A), plant.x) + ca.mtimes(ca.DM(lure.B), plant.u) + lure.offset(plant.t)
    if lure.G.shape[1]:
        whole += ca.mtimes(ca.DM(lure.G), lure.phi(ca.mtimes(ca.DM(lure.H), plant.x), plant.t))
    size = 1 + ca.fabs(plant.rhs) + ca.fabs(whole)
    compare = ca.Function("compare", [plant.x, plant.u, plant.t], [(whole - plant.rhs) / size])
    for seed in range(5):
        generator = np.random.default_rng(seed)
        gap = np.asarray(
            compare(generator.uniform(-1, 1, 3), generator.uniform(-1, 1), generator.uniform(0, 2))
        )
        # Sums that cancel inside sin(...) of large arguments lose digits: 1e-9 is far below any
        # wrong coefficient.
        assert np.abs(gap).max() < 1e-9


def test_terms_that_all_have_the_factor_0_are_to_be_left_out() -> None:
    with pytest.raises(ProblemError, match=r"the factor 0, and the division among them may have no value"):
        agent("y", "-x + 0*y/(2 + sin(x)) + u")
    assert agent("y", "-sin(x) + 0*y/(2 + sin(x)) + u").lure.G.shape[1] == 1, "sin(x) remains"


@given(_terms())
@settings(max_examples=60)
def test_coefficients_do_not_depend_on_how_the_sum_is_written(text: str) -> None:
    symbols = {"x": X, "y": Y, "z": Z, "t": T}
    plain = node(parse_expression(f"{text} + 3*x - y", symbols))
    moved = node(parse_expression(f"2*(x - y/2 + ({text})/2) + x", symbols))
    assert plain is moved


def test_the_jacobian_split_moves_the_slope_at_the_origin() -> None:
    plant = agent("y", "-9.81*sin(x) + u", split="jacobian")
    np.testing.assert_array_equal(plant.lure.A, [[0, 1], [-9.81, 0]])
    assert float(plant.lure.phi(1e-4, 0.0)) == pytest.approx(9.81e-12 / 6, rel=1e-3)


@pytest.mark.parametrize(
    ("equation", "says"),
    [
        ("abs(x) + u", "no slope at the origin"),
        ("sqrt(x) + u", "no slope at the origin"),
        ("max(x, 0) + u", "no slope at the origin"),
        ("sign(x)*x + u", "no slope at the origin"),
        ("sin(t)*x + u", "depends on t"),
    ],
)
def test_a_jacobian_that_is_not_there_is_refused(equation: str, says: str) -> None:
    agent(equation)
    with pytest.raises(ProblemError, match=says):
        agent(equation, split="jacobian")


def test_drag_has_a_jacobian() -> None:
    assert agent("-x*abs(x) - 2*x + u", split="jacobian").lure.A.item() == -2.0
