"""Centring: the same agent, exactly, with a smaller bound; and nothing is moved where nothing is gained."""

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lockstep.model import Agent, ProblemError, load_problem, parse_problem
from lockstep.model.assembly import bound_of

EXAMPLES = Path(__file__).parents[3] / "examples"


def cart(force: str, *, centre: bool = True, **changes: object) -> Agent:
    given = {
        "states": ["p", "v"],
        "inputs": ["f"],
        "outputs": {"y1": "p"},
        "dynamics": {"p": "v", "v": f"f + {force}"},
        "centre": centre,
    }
    return Agent.from_expressions("cart", **{**given, **changes})


def assert_same_agent(moved: Agent, plain: Agent) -> None:
    """A + G S H in exact arithmetic, and phi - S v at points."""
    lure, old = moved.lure, plain.lure
    exact = {index: Fraction(float(a)) for index, a in np.ndenumerate(old.A)}
    for move in moved.centring.moves:
        for i, j in exact:
            exact[i, j] += (
                move.amount
                * Fraction(float(old.G[i, move.component]))
                * Fraction(float(old.H[move.argument, j]))
            )
    assert exact == {index: Fraction(float(a)) for index, a in np.ndenumerate(lure.A)}
    for letter in "BCGH":
        np.testing.assert_array_equal(getattr(lure, letter), getattr(old, letter))
    S = moved.centring.matrix(old.G.shape[1], old.H.shape[0])
    for v in np.random.default_rng(0).uniform(-3, 3, size=(20, old.H.shape[0])):
        before, after = (np.asarray(phi(v, 0.3)).ravel() for phi in (old.phi, lure.phi))
        np.testing.assert_allclose(after, before - S @ v, rtol=1e-13, atol=1e-14)


@pytest.mark.parametrize(
    ("force", "domain", "before", "after"),
    [
        ("-tanh(v)", {}, 1.0, 0.5),  # slopes [-1, 0]
        ("max(v, 0)", {}, 1.0, 0.5),  # [0, 1]
        ("min(max(v, -1), 1)", {}, 1.0, 0.5),  # saturation, [0, 1]
        ("3*abs(v) + v", {}, 3.0, 3.0),  # [-3, 3] once the linear term is apart: centred already
        ("2*abs(v) - 1.5*max(v, 0)", {}, 2.0, 1.25),  # -2 below 0, 0.5 above
        ("-v*abs(v)", {"v": (-3.0, 5.0)}, 10.0, 5.0),  # [-10, 0]
        ("v**3", {"v": (-1.0, 2.0)}, 12.0, 6.0),  # [0, 12]
        ("-3.33*sin(p)", {}, 3.33, 3.33),
        ("-3.33*sin(p)", {"p": (-1.0, 1.0)}, 3.33, 3.33 * (1 - np.cos(1.0)) / 2),  # cos from cos 1 to 1
    ],
)
def test_alpha_becomes_half_the_range_of_the_slopes(
    force: str, domain: dict, before: float, after: float
) -> None:
    moved, plain = cart(force, domain=domain), cart(force, domain=domain, centre=False)
    assert bound_of(plain).alpha == pytest.approx(before, rel=1e-8)
    # S may miss the middle by 1e-3 of half the range.
    assert bound_of(moved).alpha == pytest.approx(after, rel=1.1e-3)
    assert bool(moved.centring.moves) == (before != after)
    assert_same_agent(moved, plain)


@pytest.mark.parametrize("unit", [1.0, 1e4, 1e-4])
def test_a_small_number_is_centred_beside_a_large_one(unit: float) -> None:
    """a^2 has slopes in +-0.1 and a^3 in [0, 0.0075] at |a| <= 0.05; in another unit of a the second is the larger number.

    The two are bounded with scales of their own, and each slope with a multiplier of its own: S = (0, 0.00375).
    """
    dynamics = {"a": f"b + (a/{unit!r})**2", "b": f"f + (a/{unit!r})**3"}
    agent = cart(
        "0",
        states=["a", "b"],
        outputs={"y1": "a"},
        dynamics=dynamics,
        domain={"a": (-0.05 * unit, 0.05 * unit)},
    )
    (move,) = agent.centring.moves
    assert (move.highest, move.lowest) == pytest.approx((0.0075 / unit, 0.0))
    assert float(move.amount) == pytest.approx(0.00375 / unit, rel=1.1e-3)


def test_the_arms_stay_as_the_paper_writes_them() -> None:
    agent = load_problem(EXAMPLES / "flexible_joint_arms.toml").agent()
    assert agent.centre
    assert agent.centring.moves == ()
    assert "around zero already" in agent.centring.reason
    np.testing.assert_array_equal(
        agent.lure.A, [[0, 1, 0, 0], [-48.6, -1.25, 48.6, 0], [0, 0, 0, 1], [19.5, 0, -19.5, 0]]
    )
    assert bound_of(agent).alpha == 3.33


def test_it_can_be_turned_off() -> None:
    agent = cart("-tanh(v)", centre=False)
    assert (agent.lure.A[1, 1], agent.centring.reason) == (
        0.0,
        "[agent] centre is false, or [design] alpha is of phi as it is written",
    )


@pytest.mark.parametrize(("line", "entry"), [("", -0.5), ("centre = true", -0.5), ("centre = false", 0.0)])
def test_the_problem_file_has_a_switch(line: str, entry: float) -> None:
    problem = parse_problem(f"""
    [agent]
    states = ["v"]
    inputs = ["f"]
    {line}
    dynamics = {{ v = "f - tanh(v)" }}
    outputs = {{ y = "v" }}
    [network]
    agents = 2
    topology = "path"
    """)
    assert problem.agent().lure.A.item() == entry
    assert type(problem).from_document(problem.document()).agent().lure.A.item() == entry


def test_the_switch_is_true_or_false() -> None:
    text = (EXAMPLES / "flexible_joint_arms.toml").read_text(encoding="utf-8")
    with pytest.raises(ProblemError, match="centre"):
        parse_problem(text.replace("[agent]\n", '[agent]\ncentre = "yes"\n', 1))


@pytest.mark.parametrize(
    ("force", "domain", "says"),
    [
        ("v**3", {}, "growing"),
        ("exp(v)", {}, "no finite range"),
        ("sqrt(abs(v))", {}, "around zero already"),
        ("v*log(1 + v**2)", {}, "growing"),
        ("0.5*p", {}, "no nonlinearity"),
    ],
)
def test_what_has_no_middle_stays(force: str, domain: dict, says: str) -> None:
    agent = cart(force, domain=domain)
    assert says in agent.centring.reason
    assert_same_agent(agent, cart(force, domain=domain, centre=False))


def test_a_sum_that_no_double_holds_is_met_by_another_amount() -> None:
    """-0.1 - 0.5 has more bits than a double; -0.6 has not, and S makes up for it exactly."""
    moved, plain = cart("-0.1*v - tanh(v)"), cart("-0.1*v - tanh(v)", centre=False)
    assert Fraction(-0.1) - Fraction(1, 2) != Fraction(-0.1 - 0.5)
    assert moved.lure.A[1, 1] == -0.1 - 0.5
    assert moved.centring.moves[0].amount == Fraction(-0.1 - 0.5) - Fraction(-0.1) != Fraction(-1, 2)
    assert_same_agent(moved, plain)
    assert bound_of(moved).alpha == pytest.approx(0.5, rel=1e-12)


def test_sums_that_no_amount_makes_doubles_are_rounded_once() -> None:
    """tanh(v - p) enters two entries of A, 0 and -0.1; no S gives two doubles, and the middle is -3.33 / 2 all the same."""
    agent = cart("-0.1*v - 3.33*tanh(v - p)")
    assert agent.lure.rounded == ("A[2,2]",)
    np.testing.assert_allclose(agent.lure.A[1], [3.33 / 2, -0.1 - 3.33 / 2], rtol=1e-3)
    assert bound_of(agent).alpha == pytest.approx(3.33 / 2, rel=2e-3)
    # The checker has the sum itself.
    exact, amount = agent.exact.A[1, 1], agent.centring.moves[0].amount
    assert Fraction(int(exact.p), int(exact.q)) == Fraction(-0.1) + amount != Fraction(agent.lure.A[1, 1])


@pytest.mark.parametrize("factor", [1.0, 7.2e10, 3.3e-9])
def test_a_middle_does_not_depend_on_how_a_term_is_written(factor: float) -> None:
    """k * sin(v) / k moves as much as sin(v) does, whatever the bits of k."""
    plain = cart("-0.1*v - 209.2*tanh(v)")
    other = cart(f"-0.1*v - 209.2*{factor!r}*(tanh(v)/{factor!r})")
    assert other.lure.A[1, 1] == pytest.approx(plain.lure.A[1, 1], rel=2e-3)


def test_a_shared_force_is_moved_in_both_equations() -> None:
    dynamics = {"a": "b", "b": "-tanh(a - c) + f", "c": "d", "d": "0.5*tanh(a - c)"}
    changes = {"states": list(dynamics), "dynamics": dynamics, "outputs": {"y1": "a"}}
    moved, plain = cart("", **changes), cart("", **changes, centre=False)
    assert_same_agent(moved, plain)
    np.testing.assert_array_equal(moved.lure.A[1], [-0.5, 0, 0.5, 0])
    np.testing.assert_array_equal(moved.lure.A[3], [0.25, 0, -0.25, 0])


def test_a_product_on_a_box_is_expanded_around_its_middle() -> None:
    """p v on [-1, 2] x [-1, 5]: the gradient (v, p) has its middle at (2, 1/2) and the radius |(3, 3/2)|."""
    domain = {"p": (-1.0, 2.0), "v": (-1.0, 5.0)}
    moved, plain = cart("p*v", domain=domain), cart("p*v", domain=domain, centre=False)
    np.testing.assert_array_equal(moved.lure.A[1], [2.0, 0.5])
    assert_same_agent(moved, plain)
    assert bound_of(moved).alpha == pytest.approx(np.hypot(3.0, 1.5), rel=1e-5)
    assert bound_of(plain).alpha == pytest.approx(np.hypot(5.0, 2.0), rel=1e-5)


def test_all_agents_stay_equal_but_for_b() -> None:
    """[network] parameters compares A and h of variants that are centred each for itself."""
    text = """
    [agent]
    states = ["v"]
    inputs = ["f"]
    parameters = { b = 1.0 }
    dynamics = { v = "b*f - tanh(v)" }
    outputs = { y = "v" }
    [network]
    agents = 2
    topology = "path"
    parameters = [{ b = 2.0 }, {}]
    """
    problem = parse_problem(text)
    assert [B.item() for B in problem.agents_B()] == [2.0, 1.0]
    assert problem.agent().lure.A.item() == -0.5


@settings(max_examples=25)
@given(
    a=st.floats(-5, 5, allow_nan=False, allow_subnormal=False),
    g=st.floats(0.01, 50, allow_nan=False),
    k=st.floats(-3, 3, allow_nan=False, allow_subnormal=False),
)
def test_any_gain_is_moved_exactly_or_not_at_all(a: float, g: float, k: float) -> None:
    force = f"({a!r})*v + ({k!r})*p - ({g!r})*tanh(v)"
    moved, plain = cart(force), cart(force, centre=False)
    assert_same_agent(moved, plain)
    assert moved.centring.moves


def test_a_domain_in_pascals_is_centred_as_one_in_megapascals() -> None:
    """A box has no far end, however large its numbers are: valve flow w sqrt(1 - p/ps), with friction on the whole line."""
    amounts = []
    for Pa, ps in ((1.0, 21.0), (1e6, 21e6)):
        agent = Agent.from_expressions(
            "cylinder",
            states=["v", "p", "w"],
            inputs=["u"],
            outputs={"y": "v"},
            dynamics={
                "v": f"p/{Pa} - v - tanh(v)",
                "p": f"{Pa}*(w*sqrt(1 - p/{ps}) - v)",
                "w": "u - w",
            },
            domain={"p": (-2.0 * Pa, 2.0 * Pa), "w": (-1.0, 1.0)},
            centre=True,
        )
        assert not agent.centring.reason
        amounts.append({(m.component, m.argument): float(m.amount) for m in agent.centring.moves})
    small, large = amounts
    assert small.keys() == large.keys()
    assert (0, 0) in small
    assert small[0, 0] == large[0, 0] == -0.5
    flow = next(key for key in small if key not in ((0, 0),))
    assert large[flow] == pytest.approx(1e6 * small[flow], rel=0.02)


@pytest.mark.filterwarnings("error")
def test_slopes_that_no_double_holds_the_range_of_stay() -> None:
    moved = cart("-1e308*(v + 0.9*sin(v))").lure
    assert moved.A[1, 1] == -1e308
