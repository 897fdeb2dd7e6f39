"""`split = "jacobian"` moves a slope without changing the agent, and what had to be rounded is named."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lockstep.check.expression.node import linear_terms
from lockstep.check.system.loop import Gains
from lockstep.model.agents.agent import Agent
from lockstep.model.bound_search.casadi_graph import read
from lockstep.model.checks import nonlinearity
from lockstep.model.graphs.graph import Graph
from lockstep.model.network import Network


def pair(
    first: str, second: str = "u", *, split: str = "jacobian", output: str = "x", centre: bool = False
) -> Agent:
    return Agent.from_expressions(
        "pair",
        states=["x", "y"],
        inputs=["u"],
        dynamics={"x": first, "y": second},
        outputs={"z": output},
        split=split,
        centre=centre,
    )


def moved(agent: Agent) -> np.ndarray:
    """S, read off phi - S v as an exact expression."""
    phi = read(agent.lure.phi)
    S = np.full((len(phi.outputs), phi.inputs), Fraction(0), dtype=object)
    for k, w in enumerate(phi.outputs):
        for value, x in linear_terms(w)[1]:
            if x.op == "variable" and x.data < phi.inputs:
                S[k, x.data] = -value
    return S


def exact(matrix: np.ndarray) -> np.ndarray:
    return np.vectorize(lambda x: Fraction(float(x)), otypes=[object])(matrix)


def assert_same_agent(agent: Agent, plain: Agent) -> None:
    lure, old = agent.lure, plain.lure
    expected = exact(old.A) + exact(old.G) @ moved(agent) @ exact(old.H)
    assert (exact(lure.A) == expected).all()
    np.testing.assert_array_equal(lure.G, old.G)
    np.testing.assert_array_equal(lure.H, old.H)


@settings(max_examples=60)
@given(
    a=st.floats(-50, 50, allow_nan=False, allow_subnormal=False),
    g=st.floats(0.01, 50),
    w=st.floats(0.01, 9),
)
def test_the_slope_at_the_origin_is_moved_exactly(a: float, g: float, w: float) -> None:
    force = f"({a!r})*x - ({g!r})*sin(({w!r})*x) + y"
    agent, plain = pair(force), pair(force, split="terms")
    assert_same_agent(agent, plain)
    assert agent.lure.rounded == plain.lure.rounded == ()
    # The slope itself is a double of the product g w; 2e-6 is what 20 bits leave.
    assert agent.lure.A[0, 0] == pytest.approx(a - g * w, rel=2e-6, abs=2e-6 * (abs(a) + g * w))


def test_the_check_sees_a_rounding() -> None:
    """-0.1 - 1 is no double: A[0, 0] and S must make up for each other."""
    agent, plain = pair("-0.1*x - sin(x)"), pair("-0.1*x - sin(x)", split="terms")
    assert agent.lure.A[0, 0] == -0.1 - 1.0
    assert moved(agent)[0, 0] != 1
    assert_same_agent(agent, plain)
    with pytest.raises(AssertionError):
        assert_same_agent(agent, pair("-0.30000000000000004*x - sin(x)", split="terms"))


def test_where_no_amount_fits_the_rounded_entries_are_named() -> None:
    """1 - 0.1 and 1 + 0.3 ask for different amounts of the same sin(x - y): no S leaves both sums exact."""
    agent = pair("0.1*x - sin(x - y)", "0.3*y + sin(x - y) + u")
    assert set(agent.lure.rounded) == {"A[1,1]", "A[2,2]"}
    np.testing.assert_array_equal(agent.lure.A, [[0.1 - 1, 1], [1, 0.3 - 1]])
    row = nonlinearity.exact_numbers(agent)
    assert row.verdict == "ok"  # the search rounds them; what is proved is proved of the exact ones
    assert "A[1,1], A[2,2]" in row.figure


@pytest.mark.parametrize(
    ("first", "output", "rounded"),
    [
        ("0.5*x + 0.25*x + y", "x", ()),
        ("0.1*x + y", "x", ()),  # the double that 0.1 is
        ("0.1*x + 0.2*x + y", "x", ("A[1,1]",)),
        ("x/3 + y", "x", ("A[1,1]",)),
        ("y", "x/3", ("C[1,1]",)),
        ("sin(x/3) + y", "x", ()),  # the quotient is kept as one
        ("sin(0.1*x + 0.2*x + y)", "x", ("H[1,1]",)),
        ("y*(0.1*sin(x) + 0.2*sin(x))", "x", ("phi1",)),
        ("0.1*sin(x) + 0.2*sin(x) + y", "x", ("phi1",)),
    ],
)
def test_what_is_rounded_is_named(first: str, output: str, rounded: tuple) -> None:
    agent = pair(first, "u - y", split="terms", output=output)
    assert agent.lure.rounded == rounded
    assert ("none is rounded" in nonlinearity.exact_numbers(agent).figure) is (not rounded)
    assert pair(first, "u - y", split="terms", output=output, centre=True).lure.rounded == rounded


def test_a_rounded_input_matrix_is_named() -> None:
    assert pair("y", "0.1*u + 0.2*u", split="terms").lure.rounded == ("B[2,1]",)


def test_both_splits_are_the_same_nonlinear_loop() -> None:
    """The right-hand side of (12) from either split, at points: what the split may not change."""
    gains = Gains(
        (np.zeros((0, 0)),) * 2, (np.zeros((0, 1)),) * 2, (np.zeros((1, 0)),) * 2, (np.array([[-2.0]]),) * 2
    )
    graph = Graph.from_edges(2, [[1, 2]])
    loops = [
        Network(pair("y - 9.81*sin(x)", "u - 0.3*y", split=split), graph).closed_loop(gains)
        for split in ("terms", "jacobian")
    ]
    for x in np.random.default_rng(0).uniform(-3, 3, (20, 4)):
        a, b = (np.asarray(f(x, [], 0.0, np.zeros(4))[0]).ravel() for f in loops)
        # Terms of up to 30, added in another order.
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-13)
