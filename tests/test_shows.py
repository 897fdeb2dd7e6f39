"""What the designs promise, on the examples: the figures come from the issue tracker and from the paper, not from us."""

import numpy as np
import pytest

import lockstep
from lockstep.check.errors import Infeasible
from lockstep.lmi.certify import certify
from lockstep.lmi.design import design
from lockstep.lmi.document import file_of, parse
from lockstep.model.problem import load_problem, parse_problem

pytestmark = pytest.mark.slow


def designed(path, **changes):
    problem = load_problem(path)
    if changes:
        content = problem.document()
        content["design"].update(changes)
        problem = type(problem).from_document(content)
    found = design(problem)
    assert certify(parse(file_of(found).document(), "design")).certified
    return found


def test_the_arms_by_default(examples):
    """Issue 19: each controller stable, 10 V from 1.5, rho 4.7, decay 0.3 1/s, 100 per message error, 90 ms: all proved."""
    answer = lockstep.design(examples / "flexible_joint_arms.toml").document()
    sampled = answer["sampled"]
    assert answer["certified"]
    assert sampled["certified"]
    assert answer["controllers_stable"]
    assert answer["rho"] <= 4.7
    assert answer["decay"] >= 0.3
    assert answer["limits"]["radius"] >= 1.5
    assert sampled["residual_per_message_error"] <= 100
    assert sampled["max_period"] >= 0.09


def test_the_arms(examples):
    """For rho alone: one key away."""
    found = designed(examples / "flexible_joint_arms.toml", gain_limit=50.0, weights={"controller": 2.0})
    assert found.claim.alpha >= 3.33
    assert max(np.linalg.norm(block, 2) for block in found.gains.blocks) <= 50.0
    # The published gains give 13.23; no controllers at all, central and of full order, do better than 1.97.
    assert found.floor is not None
    assert found.floor.rho == pytest.approx(1.97, rel=0.01)
    assert found.floor.rho < found.certificate.rho <= 3.5


def test_the_arms_with_the_full_delta_of_the_paper(examples):
    found = designed(examples / "fragile_arms.toml")
    assert found.problem.fragility == {"A": 0.5, "B": 0.2, "C": 0.2, "D": 0.2}
    assert found.claim.alpha >= 3.33
    assert found.certificate.rho <= 40


def test_positions_only(examples):
    assert designed(examples / "carts.toml").gains.order == 1
    with pytest.raises(Infeasible, match="no stabilising gains"):
        designed(examples / "carts.toml", order=0)


def test_the_largest_alpha_for_a_given_rho(examples):
    found = designed(examples / "flexible_joint_arms.toml", objective="alpha", rho=8.0, starts=1)
    # The published Corollary 1 gains carry 4.58 at any rho (measured apart from this code).
    assert found.certificate.rho <= 8.0
    assert found.claim.alpha > 4.58


def test_ten_agents_with_gains_of_their_own():
    problem = parse_problem(
        """
        [agent]
        name = "pendulum"
        states = ["angle", "rate"]
        inputs = ["u"]
        dynamics = { angle = "rate", rate = "-2*sin(angle) - 0.3*rate + u" }
        outputs = { y1 = "angle", y2 = "rate" }
        [network]
        agents = 10
        edges = [[1, 2, 0.7], [2, 3], [3, 4], [4, 5, 1.5], [5, 6], [6, 7], [7, 8], [8, 9], [9, 10], [10, 1], [1, 5, 0.4]]
        [design]
        order = 0
        starts = 1
        """,
        "ten.toml",
    )
    found = design(problem)
    assert certify(parse(file_of(found).document(), "design")).certified
    assert not np.allclose(found.gains.D[0], found.gains.D[1])


def test_a_cart_and_pole_behind_a_leader(examples):
    """Issue 19: a certified radius of 0.1 in a box of 0.6 rad; from its boundary, none leaves and all agree."""
    found = designed(examples / "cart_poles.toml")
    states, box = found.initial, found.network.agent.argument_box
    assert states.radius >= 0.1
    assert box.upper[0] == 0.6
    apart = np.random.default_rng(1).standard_normal((5, 400))
    apart[:, :10] = np.eye(5)[:, [2] * 10]  # the pole alone
    apart *= np.sqrt(2) * states.radius / np.linalg.norm(apart, axis=0)  # |x_d|^2 = |x_2 - x_1|^2 / 2
    leader = np.zeros((5, 400))
    leader[1] = np.linspace(-1, 1, 400)  # at a constant speed, its pole upright
    x, x_C = np.vstack([leader, leader + apart]), np.zeros((2 * found.gains.order, 400))
    f, largest = found.network.closed_loop(found.gains).map(400), np.zeros(2)

    def rate(y):
        dx, dx_C, _ = f(y[:10], y[10:], 0.0, np.zeros((10, 400)))
        return np.vstack([np.asarray(dx), np.asarray(dx_C)])

    y, step = np.vstack([x, x_C]), 2e-3
    for _ in range(10_000):
        largest = np.maximum(largest, np.abs(y[[7, 9]]).max(axis=1))
        a = rate(y)
        b = rate(y + step / 2 * a)
        c = rate(y + step / 2 * b)
        y = y + step / 6 * (a + 2 * b + 2 * c + rate(y + step * c))
    assert (largest < box.upper).all()
    assert np.abs(y[5:10] - y[:5]).max() < 0.05 * states.radius
