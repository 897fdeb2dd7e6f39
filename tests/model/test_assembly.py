"""From problem to network: domains go through H outwards, scales stay exact, and asked bounds are decided."""

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lockstep.check.bound.decide import decide_bound
from lockstep.check.system.domain import argument_box
from lockstep.model import Agent, BoundNotProved, Graph, ProblemError, load_problem
from lockstep.model.assembly import bound_of, bound_with_scales, network_of
from lockstep.model.network import Network

EXAMPLES = Path(__file__).parents[2] / "examples"
FINITE = st.floats(-1e6, 1e6, allow_nan=False)


def agent(dynamics: dict[str, str], domain: dict | None = None) -> Agent:
    return Agent.from_expressions(
        "body",
        states=list(dynamics),
        inputs=["f"],
        outputs={"y1": next(iter(dynamics))},
        dynamics=dynamics,
        domain=domain or {},
    )


def test_the_arms_are_assembled_as_the_paper_has_them() -> None:
    problem = load_problem(EXAMPLES / "flexible_joint_arms.toml")
    bound = bound_of(problem.agent())
    network = network_of(problem, bound)
    assert (bound.alpha, bound.output_scale, bound.input_scale) == (3.33, (1.0,), (1.0,))
    np.testing.assert_array_equal(network.plant.H, [[0, 0, 1, 0]])
    assert network.coordinates == "orthonormal"
    assert network.N == 3


@settings(max_examples=60)
@given(data=st.data(), n=st.integers(1, 4))
def test_the_box_of_the_arguments_contains_every_corner(data: st.DataObject, n: int) -> None:
    H = np.array([data.draw(st.lists(FINITE, min_size=n, max_size=n))])
    ends = [sorted(data.draw(st.tuples(FINITE, FINITE))) for _ in range(n)]
    box = argument_box(H, np.array(ends))
    for corner in range(2**n):
        picks = [ends[j][corner >> j & 1] for j in range(n)]
        value = sum(
            (Fraction(h) * Fraction(x) for h, x in zip(H[0].tolist(), picks, strict=True)), Fraction(0)
        )
        assert Fraction(box.lower[0]) <= value <= Fraction(box.upper[0])
    # No more than one rounding away from the hull.
    low = sum(
        (
            min(Fraction(h) * Fraction(a), Fraction(h) * Fraction(b))
            for h, (a, b) in zip(H[0].tolist(), ends, strict=True)
        ),
        Fraction(0),
    )
    assert Fraction(box.lower[0]) >= Fraction(np.nextafter(float(low), -np.inf))


def test_open_sides_stay_open_and_unseen_states_do_not_matter() -> None:
    box = argument_box(np.array([[1.0, 0.0], [-1.0, 1.0]]), np.array([[0.0, np.inf], [-1.0, 2.0]]))
    assert (box.lower, box.upper) == ((0.0, -np.inf), (np.inf, 2.0))


def test_two_forces_are_scaled_so_that_one_alpha_is_sharp_for_both() -> None:
    body = agent({"p": "v - 3.0*sin(p)", "v": "f - tanh(v)"})
    bound = bound_of(body)
    assert bound.alpha == pytest.approx(3.0, rel=1e-8)
    # Component 2 has slopes up to 1: scaled by D_w it must stay below alpha, and come close to it.
    assert 1.0 / bound.output_scale[1] <= bound.alpha
    assert 1.0 / bound.output_scale[1] >= 0.999 * bound.alpha


@pytest.mark.parametrize(
    ("dynamics", "domain"),
    [
        ({"p": "v - 3.0*sin(p)", "v": "f - tanh(v)"}, {}),
        (
            {"p": "0.1*r*q + f", "q": "-0.9*r*p", "r": "0.4*p*q + f"},
            {"p": (-1, 1), "q": (-2, 2), "r": (-1, 3)},
        ),
        ({"a": "-0.1*tanh(a - 0.3*b) + f", "b": "0.7*tanh(a - 0.3*b) + 2*sin(b)"}, {}),
    ],
)
def test_scaled_matrices_are_exact_and_the_scaled_bound_holds_at_samples(
    dynamics: dict, domain: dict
) -> None:
    body = agent(dynamics, domain)
    bound = bound_of(body)
    network = Network(body, Graph.topology("cycle", 3), scales=(bound.output_scale, bound.input_scale))
    G, H = body.lure.G, body.lure.H
    D_w, D_v = np.array(bound.output_scale), np.array(bound.input_scale)
    for (i, k), g in np.ndenumerate(network.plant.G):
        assert Fraction(float(g)) == Fraction(float(G[i, k])) * Fraction(float(D_w[k]))
    for (k, j), h in np.ndenumerate(network.plant.H):
        assert Fraction(float(h)) * Fraction(float(D_v[k])) == Fraction(float(H[k, j]))
    generator, box = np.random.default_rng(0), argument_box(H, body.box)
    low, high = np.maximum(box.lower, -9.0), np.minimum(box.upper, 9.0)
    largest = 0.0
    for _ in range(4000):
        a, b = generator.uniform(low, high), generator.uniform(low, high)
        b = a + 10.0 ** generator.uniform(-4, 0) * (b - a)
        change = np.asarray(body.lure.phi(a, 0.0) - body.lure.phi(b, 0.0)).ravel() / D_w
        largest = max(largest, float(np.linalg.norm(change) / np.linalg.norm((a - b) / D_v)))
    assert 0.7 * bound.alpha < largest <= bound.alpha * (1 + 1e-9)
    assert bound.lower <= bound.alpha


def test_scales_that_would_round_are_refused() -> None:
    body = agent({"p": "f - 0.1*tanh(p - v)", "v": "0.7*tanh(p - v)"})
    assert body.lure.G.tolist() != [[1.0], [0.0]]
    Network(body, Graph.topology("cycle", 3), scales=((0.5,), (2.0,)))
    for scales in (((0.3,), (1.0,)), ((1.0,), (3.0,)), ((1.0, 1.0), (1.0,))):
        with pytest.raises(ProblemError, match="scales"):
            Network(body, Graph.topology("cycle", 3), scales=scales)


def test_asked_bounds_are_decided_for_several_components_too() -> None:
    body = agent({"p": "v - 3.0*sin(p)", "v": "f - tanh(v)"})
    assert bound_of(body, alpha=3.5).alpha == 3.5
    with pytest.raises(BoundNotProved) as raised:
        bound_of(body, alpha=2.9)
    assert raised.value.figures["lower"] > 2.9
    assert bound_of(agent({"p": "f - 2*p"}), alpha=1.0).alpha == 1.0
    assert bound_of(agent({"p": "f - 2*p"})).alpha == 0.0


def test_no_finite_bound_is_bad_input() -> None:
    with pytest.raises(ProblemError, match="no finite bound"):
        bound_of(agent({"p": "f - p**3"}))
    assert bound_of(agent({"p": "f - p**3"}, {"p": (-1.0, 1.0)})).alpha == pytest.approx(3.0, rel=1e-8)


@pytest.mark.slow
def test_a_stored_bound_is_proved_again_with_its_own_scales() -> None:
    body = agent({"a": "b + 0.2*sin(a)*cos(b)", "b": "-9.81*sin(a) - 0.3*tanh(b) + f"}, {})
    bound = bound_of(body)
    scales = bound.output_scale, bound.input_scale
    again = bound_with_scales(body, bound.alpha, scales)
    assert again.proved
    assert (again.alpha, again.output_scale, again.input_scale) == (bound.alpha, *scales)
    with pytest.raises(BoundNotProved, match="does not bound"):
        bound_with_scales(body, 0.9 * bound.lower, scales)
    with pytest.raises(BoundNotProved, match="does not bound"):  # a smaller D_w is a larger scaled slope
        bound_with_scales(body, bound.alpha, (tuple(w / 2 for w in scales[0]), scales[1]))
    with pytest.raises(ProblemError, match="output_scale"):
        bound_with_scales(body, bound.alpha, (scales[0][:1], scales[1]))


@pytest.mark.parametrize("seed", range(6))
def test_the_bound_of_several_components_is_proved_again_by_who_checks_it(seed: int) -> None:
    """Components that share one alpha by their scales touch it: nothing may be lost between two enclosures of it."""
    a, b, c = np.random.default_rng(seed).uniform(0.05, 2.0, 3).round(2)
    mover = Agent.from_expressions(
        "mover",
        states=["px", "vx", "py", "vy"],
        inputs=["fx", "fy"],
        outputs={"x": "px", "y": "py"},
        dynamics={
            "px": "vx",
            "vx": f"fx - {a}*tanh(vx) + 0.2*vy",
            "py": "vy",
            "vy": f"fy - {b}*tanh(vy) + {c}*sin(px)",
        },
        centre=True,
    )
    bound = bound_of(mover)
    scales = (bound.output_scale, bound.input_scale)
    assert bound_with_scales(mover, bound.alpha, scales).proved
    assert bound_of(mover, alpha=bound.alpha).proved
    with pytest.raises(BoundNotProved):
        bound_with_scales(mover, 0.999 * bound.lower, scales)


@pytest.mark.parametrize(
    "formula",
    [
        # The constants' product is rational; in doubles it is rounded three times, here below itself.
        "u + 376.99/(2*3.5)*(-1.35*sin(x))",
        "u + 10*(0.295*(abs(x + 1) - abs(x - 1)))",
        "u + 2*sin(x)",
    ],
)
def test_the_smallest_bound_is_one_of_the_agent_that_the_checker_sees(formula):
    agent = Agent.from_expressions(
        "a", states=["x"], inputs=["u"], outputs={"y": "x"}, dynamics={"x": formula}, centre=True
    )
    bound = bound_of(agent)
    scales = bound.output_scale, bound.input_scale
    exact = agent.exact.phi
    assert decide_bound(exact, agent.argument_box, bound.alpha, *scales, bound.entries, boxes=1000).proved
    below = bound.alpha * (1 - 1e-8)
    assert not decide_bound(exact, agent.argument_box, below, *scales, bound.entries, boxes=1000).proved


def test_the_smallest_bound_of_two_components_can_be_asked_for() -> None:
    """0.2 tanh(v/0.1) has slopes of 0 to 2, centred of 1 in size at most: not of the nearest doubles."""
    robot = Agent.from_expressions(
        "robot",
        states=["vx", "vy"],
        inputs=["fx", "fy"],
        outputs={"x": "vx", "y": "vy"},
        dynamics={"vx": "fx - 0.2*tanh(vx/0.1)", "vy": "fy - 0.2*tanh(vy/0.1)"},
        centre=True,
    )
    assert bound_of(robot).alpha == bound_of(robot, alpha=1.0).alpha == 1.0
