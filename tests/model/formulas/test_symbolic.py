"""Exact nodes as CasADi expressions: read back they are the same nodes, and they have the same values."""

from fractions import Fraction

import casadi as ca
import numpy as np
import pytest

from lockstep.check.errors import ProblemError
from lockstep.check.expression.exact import Exact, Value
from lockstep.check.expression.node import constant, linear, variable
from lockstep.check.expression.text import parse
from lockstep.check.system.agent import ExactAgent
from lockstep.model.agents.agent import Agent
from lockstep.model.bound_search.casadi_graph import read
from lockstep.model.formulas.expression import parse_expression
from lockstep.model.formulas.symbolic import rounds_a_coefficient, symbolic

X, Y, T, U = (ca.SX.sym(name) for name in "xytu")
TEXTS = [
    "x", "3", "x/3 - 2*y + 0.1", "x*y/(1 + x**2)", "x**3*y**-2", "x**0.3", "x**1.5", "x**y", "2**x", "3**(-x*y/2) + x",
    "sin(x)*cos(y) + tan(x/4)", "sinh(x)/cosh(x) + exp(x)*exp(y)", "sqrt(x**2 + 4*y**2)", "abs(x - y)",
    "min(x, y, t) + max(x, 0.5)", "atan2(x, y)", "asin(x/9) + acos(y/9) + atan(t)", "log(x)*sqrt(y)",
    "if_else(x < y, x**2, y)", "if_else(x <= y, if_else(t > 1, 1, x), 3)", "sign(x - 1)*y", "sign(2*x)",
]  # fmt: skip


def exact(text: str) -> Value:
    symbols = {name: Value(variable(k)) for k, name in enumerate("xyt")}
    return parse(text, symbols, Exact(2))


def graph(*expressions: ca.SX):
    return read(ca.Function("phi", [ca.vertcat(X, Y), T], [ca.densify(ca.vertcat(*expressions))]))


@pytest.mark.parametrize("text", TEXTS)
def test_what_is_written_is_read_back(text):
    node = exact(text).node
    (again,) = graph(*symbolic([node], {0: X, 1: Y, 2: T})).outputs
    assert again is graph(parse_expression(text, {"x": X, "y": Y, "t": T})).outputs[0]


@pytest.mark.parametrize("text", TEXTS)
def test_what_is_written_has_the_value_of_the_text(text):
    (mine,) = symbolic([exact(text).node], {0: X, 1: Y, 2: T})
    theirs = parse_expression(text, {"x": X, "y": Y, "t": T})
    compare = ca.Function("compare", [X, Y, T], [mine, theirs])
    for x, y, t in np.random.default_rng(0).uniform(0.1, 3.0, (20, 3)):
        a, b = map(float, compare(x, y, t))
        assert a == pytest.approx(b, rel=1e-13, abs=1e-13)


@pytest.mark.parametrize("operation", ["copysign", "log1p", "hypot"])
def test_operations_that_texts_do_not_have_are_written_too(operation):
    function = getattr(ca, operation)
    f = function(X) if operation == "log1p" else function(X, Y)
    agent = Agent(name="plant", x=ca.vertcat(X, Y), u=U, rhs=ca.vertcat(f, U), y=X)
    lure = agent.lure
    assert graph(f).outputs == read(lure.phi).outputs
    for x in np.random.default_rng(0).uniform(0.2, 3.0, (20, 2)):
        expected = float(ca.Function("f", [X, Y], [f])(*x))
        value = lure.A @ x + lure.G @ np.asarray(lure.phi(lure.H @ x, 0.0)).reshape(-1)
        assert value[0] == pytest.approx(expected, rel=1e-14, abs=1e-14)


@pytest.mark.parametrize(
    ("coefficient", "rounded"), [(Fraction(1, 2), False), (Fraction(2, 3), False), (Fraction(0.1) * 3, True)]
)
def test_a_coefficient_that_is_rounded_is_said_to_be(coefficient, rounded):
    node = linear(0, [(coefficient, variable(0))])
    assert rounds_a_coefficient(node) is rounded
    assert rounds_a_coefficient(constant(Fraction(1, 3)))


def test_a_coefficient_above_all_doubles_is_refused():
    with pytest.raises(ProblemError, match=r"larger than 1\.79e308"):
        symbolic([linear(0, [(Fraction(10) ** 309, variable(0))])], {0: X})


def plant(split: str, *, centre: bool) -> Agent:
    dynamics = {"x": "y + 0.5*tanh(x) - x/4", "y": "u - 2*sin(x - y) - y**3/(1 + y**2)"}
    return Agent.from_expressions(
        "plant",
        states=["x", "y"],
        inputs=["u"],
        dynamics=dynamics,
        outputs={"z": "x"},
        split=split,
        centre=centre,
    )


@pytest.mark.parametrize("split", ["terms", "jacobian"])
@pytest.mark.parametrize("centre", [False, True])
def test_the_moves_give_the_same_agent_exactly(split, centre):
    agent = plant(split, centre=centre)
    assert bool(agent.moves) is (centre or split == "jacobian")
    assert not agent.lure.rounded
    for letter in "ABCGH":
        theirs = np.vectorize(float, otypes=[float])(
            np.vectorize(lambda a: Fraction(int(a.p), int(a.q)), otypes=[object])(
                getattr(agent.exact, letter)
            )
        )
        np.testing.assert_array_equal(getattr(agent.lure, letter), theirs)
    assert read(agent.lure.phi).outputs == agent.exact.phi.outputs


def test_an_agent_from_casadi_is_the_agent_of_its_text():
    x, y, u = (ca.SX.sym(name) for name in "xyu")
    rhs = ca.vertcat(y + 0.5 * ca.tanh(x) - x / 4, u - 2 * ca.sin(x - y) - y**3 / (1 + y**2))
    built = Agent(name="plant", x=ca.vertcat(x, y), u=u, rhs=rhs, y=x).exact
    text: ExactAgent = plant("terms", centre=False).exact
    for letter in "ABCGH":
        assert (getattr(built, letter) == getattr(text, letter)).all()
    assert built.phi.outputs == text.phi.outputs
    assert set(built.phi.conditions) == set(text.phi.conditions)
