"""The bounds that the project shows: each proved, within 1 % of dense sampling, and never beaten by it."""

import math
import re

import casadi as ca
import numpy as np
import pytest
from bound_cases import smallest_bound

from lockstep.check.errors import BoundNotProved, ProblemError
from lockstep.model.bound_search import BOXES, Box, prove_bound

INF = math.inf


def function_of(expression, size=1):
    v, t = ca.SX.sym("v", size), ca.SX.sym("t")
    return ca.Function("phi", [v, t], [expression(v, t)])


def sampled_slope(slope, lower, upper, count=400_000):
    """The largest |slope| of a hand-written gradient over random points and the corners."""
    generator = np.random.default_rng(1)
    lower, upper = np.array(lower)[:, None], np.array(upper)[:, None]
    points = lower + (upper - lower) * generator.random((len(lower), count))
    corners = np.stack(np.meshgrid(*zip(lower[:, 0], upper[:, 0], strict=True)), axis=0).reshape(
        len(lower), -1
    )
    points = np.concatenate([points, corners], axis=1)
    return float(np.sqrt(sum(np.square(g) for g in slope(*points))).max())


def assert_tight(bound, sampled):
    assert bound.proved
    assert bound.alpha >= sampled
    assert bound.alpha <= 1.01 * sampled
    assert bound.lower <= bound.alpha


def test_the_arms_have_exactly_their_constant():
    phi = function_of(lambda v, _: -3.33 * ca.sin(v))
    bound = smallest_bound(phi, Box.everywhere(1))
    assert bound.boxes <= 16, "two ends of a period: nothing to search"
    assert bound.alpha == 3.33
    assert bound.converged
    assert bound.or_raise() is bound


def test_a_smaller_constant_for_the_arms_is_refuted_with_a_witness():
    phi = function_of(lambda v, _: -3.33 * ca.sin(v))
    answer = prove_bound(phi, Box.everywhere(1), 3.32)
    assert answer.refuted
    assert not answer.proved
    assert abs(3.33 * math.cos(answer.witness.v[0])) > 3.32
    assert prove_bound(phi, Box.everywhere(1), 3.33).proved


def test_a_constant_below_the_truth_by_a_billionth_is_refuted():
    phi = function_of(lambda v, _: v * ca.exp(-(v**2) / 2) + ca.atan(v))
    alpha = smallest_bound(phi, Box.everywhere(1)).alpha
    assert alpha == pytest.approx(2.0, rel=2e-9)  # slope (1 - v^2) exp(-v^2/2) + 1/(1 + v^2), largest at 0
    assert prove_bound(phi, Box.everywhere(1), 2.0 * (1 + 1e-9)).proved
    assert prove_bound(phi, Box.everywhere(1), 2.0 * (1 - 1e-9)).refuted


def test_chua():
    """Chua's diode, m1 v + (m0 - m1)/2 (|v + 1| - |v - 1|): slopes m0 inside, m1 outside (Matsumoto 1984)."""
    m0, m1 = -8.0 / 7.0, -5.0 / 7.0
    phi = function_of(lambda v, _: m1 * v + 0.5 * (m0 - m1) * (ca.fabs(v + 1) - ca.fabs(v - 1)))
    bound = smallest_bound(phi, Box.everywhere(1))
    assert bound.alpha == pytest.approx(8.0 / 7.0, rel=1e-15)
    outer = smallest_bound(phi, Box((1.0,), (INF,)))
    assert outer.alpha == pytest.approx(5.0 / 7.0, rel=1e-15)


@pytest.mark.parametrize(
    "saturate",
    [
        lambda v: ca.fmin(ca.fmax(v, -1), 1),
        lambda v: ca.if_else(v > 1, 1, ca.if_else(v < -1, -1, v)),
        lambda v: 0.5 * (ca.fabs(v + 1) - ca.fabs(v - 1)),
        lambda v: v - ca.if_else(ca.logic_and(v > -1, v < 1), 0, ca.if_else(v > 0, v - 1, v + 1)),
    ],
)
def test_a_saturated_actuator_however_it_is_written(saturate):
    bound = smallest_bound(function_of(lambda v, _: 7.5 * saturate(v)), Box.everywhere(1))
    assert bound.alpha == pytest.approx(7.5, rel=1e-9)
    assert bound.alpha >= 7.5


def test_coulomb_like_friction():
    phi = function_of(
        lambda v, _: 0.4 * ca.tanh(50 * v) + 0.1 * ca.exp(-((v / 0.1) ** 2)) * ca.tanh(50 * v) + 0.02 * v
    )
    v = np.linspace(-0.5, 0.5, 2_000_001)
    th, ex = np.tanh(50 * v), np.exp(-((v / 0.1) ** 2))
    slope = (0.4 + 0.1 * ex) * 50 / np.cosh(50 * v) ** 2 - 20 * v * ex * th + 0.02
    bound = smallest_bound(phi, Box.everywhere(1))
    assert_tight(bound, float(np.abs(slope).max()))
    assert bound.alpha - bound.lower <= 1e-9 * bound.alpha


def test_van_der_pol_on_a_box():
    bound = smallest_bound(function_of(lambda v, _: (1 - v[0] ** 2) * v[1], 2), Box((-2.0, -3.0), (2.0, 3.0)))
    assert_tight(bound, sampled_slope(lambda x, y: (-2 * x * y, 1 - x**2), (-2, -3), (2, 3)))
    assert bound.alpha == pytest.approx(math.hypot(12, 3), rel=1e-9)


def test_a_quadrotor_attitude_row_on_a_box():
    """q' row: ((Iz - Ix)/Iy) p r + (l/Iy) thrust sin(theta) cos(phi), on 40 degrees and 3 rad/s."""
    box = Box((-0.7, -0.7, -3.0, -3.0), (0.7, 0.7, 3.0, 3.0))
    phi = function_of(lambda v, _: 0.62 * v[2] * v[3] + 2.4 * ca.sin(v[1]) * ca.cos(v[0]), 4)
    bound = smallest_bound(phi, box)

    def slope(a, b, p, r):
        return -2.4 * np.sin(b) * np.sin(a), 2.4 * np.cos(b) * np.cos(a), 0.62 * r, 0.62 * p

    assert_tight(bound, sampled_slope(slope, box.lower, box.upper))


def test_six_variables_with_half_of_the_budget():
    """Roll moment of an aircraft: inertia coupling, dihedral, damping with airspeed, and a spin term."""

    def moment(v, _):
        roll, pitch, p, q, r, speed = (v[i] for i in range(6))
        return (
            -0.8 * q * r
            + 0.35 * ca.sin(roll) * ca.cos(pitch)
            + 0.12 * speed**2 * (0.6 * p - 0.2 * ca.sin(pitch))
            + 0.1 * p * q * ca.cos(roll)
        )

    def slope(a, b, p, q, r, s):
        return (
            0.35 * np.cos(a) * np.cos(b) - 0.1 * p * q * np.sin(a),
            -0.35 * np.sin(a) * np.sin(b) - 0.024 * s**2 * np.cos(b),
            0.072 * s**2 + 0.1 * q * np.cos(a),
            -0.8 * r + 0.1 * p * np.cos(a),
            -0.8 * q,
            0.24 * s * (0.6 * p - 0.2 * np.sin(b)),
        )

    box = Box((-0.6, -0.5, -1.5, -1.5, -1.0, -1.0), (0.6, 0.5, 1.5, 1.5, 1.0, 2.0))
    bound = smallest_bound(function_of(moment, 6), box)
    assert bound.boxes < BOXES / 2
    sampled = sampled_slope(slope, box.lower, box.upper)
    assert bound.proved
    assert bound.alpha - bound.lower <= 0.01 * bound.alpha
    assert bound.alpha >= sampled


def test_the_cube_everywhere_is_refused_at_once():
    bound = smallest_bound(function_of(lambda v, _: v**3), Box.everywhere(1))
    assert bound.boxes < BOXES / 100
    assert not bound.proved
    assert bound.alpha == INF
    assert "without bound" in bound.reason
    assert 3 * bound.witness.v[0] ** 2 > 1e6
    assert bound.lower == pytest.approx(3 * bound.witness.v[0] ** 2)
    with pytest.raises(BoundNotProved, match="without bound"):
        bound.or_raise()
    assert smallest_bound(function_of(lambda v, _: v**3), Box((-2.0,), (1.0,))).alpha == pytest.approx(
        12, rel=1e-9
    )


@pytest.mark.parametrize(
    ("expression", "alpha"),
    [
        (lambda v, _: v / (1 + v**2), 1.0),
        (lambda v, _: ca.exp(-(v**2)), math.sqrt(2 / math.e)),
        (lambda v, _: 1 / (1 + ca.exp(-v)), 0.25),
        (lambda v, _: ca.log(1 + ca.exp(v)), 1.0),
        (lambda v, _: ca.sqrt(1 + v**2), 1.0),
        (lambda v, _: ca.sin(v) + 0.3 * ca.sin(2 * v), 1.6),
        (lambda v, _: ca.sin(v) + 0.3 * ca.cos(2.1 * v), 1.63),
        (lambda v, _: 1 / ca.cosh(v), 0.5),
    ],
)
def test_known_constants_everywhere(expression, alpha):
    bound = smallest_bound(function_of(expression), Box.everywhere(1))
    assert bound.converged
    assert bound.alpha == pytest.approx(alpha, rel=3e-9)
    assert bound.alpha >= alpha * (1 - 1e-15)


def test_a_varying_time_is_covered_in_its_range():
    phi = function_of(lambda v, t: ca.sin(v) * (1 + 0.3 * ca.cos(2.1 * t)))
    assert smallest_bound(phi, Box.everywhere(1)).alpha == pytest.approx(1.3, rel=1e-9)
    late = smallest_bound(phi, Box.everywhere(1), (1.0, 2.0))  # cos(2.1 t) is largest at t = 1 or 2
    assert late.alpha == pytest.approx(1 + 0.3 * max(math.cos(2.1), math.cos(4.2)), rel=1e-6)


@pytest.mark.parametrize(
    ("step", "alpha"),
    [
        (lambda v, t: (ca.sign(t - 1) + 0.5) * v, 1.5),
        (lambda v, t: ca.if_else(t == 0.3, 3 * v, v), 3.0),
    ],
)
def test_a_jump_in_time_alone_is_no_jump_in_v(step, alpha):
    assert smallest_bound(function_of(step), Box.everywhere(1), (0.0, 2.5)).alpha == pytest.approx(
        alpha, rel=2e-9
    )


def test_a_norm_and_a_maximum_are_as_tight_as_they_are():
    assert smallest_bound(
        function_of(lambda v, _: ca.norm_2(v), 2), Box.everywhere(2)
    ).alpha == pytest.approx(1.0)
    largest = function_of(lambda v, _: ca.fmax(v[0], ca.fmax(v[1], 2 * v[2])), 3)
    assert smallest_bound(largest, Box.everywhere(3)).alpha == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("jump", "word"),
    [
        (lambda v, _: ca.sign(v), "sign"),
        (lambda v, _: v * (v < 1), "comparison"),
        (lambda v, _: ca.if_else(v > 0, v + 1e-9, v), "if_else"),
        (lambda v, _: ca.if_else(v == 0, 5, v), "if_else"),
        (
            lambda v, _: ca.if_else(v > 0, v * ca.exp(-ca.log(v)), 0),
            "if_else|log",
        ),  # 1 for v > 0: the formula hides it
        (lambda v, _: ca.copysign(1, v), "copysign"),
    ],
)
def test_a_jump_is_refused_by_name(jump, word):
    bound = smallest_bound(function_of(jump), Box((-1.0,), (2.0,)))
    assert not bound.proved
    assert re.search(word, bound.reason)
    assert not prove_bound(function_of(jump), Box((-1.0,), (2.0,)), 1e9).proved


@pytest.mark.parametrize(
    ("expression", "word"),
    [
        (lambda v, _: ca.log(v), "log"),
        (lambda v, _: 1 / v, "division"),
        (lambda v, _: ca.sqrt(v), "sqrt"),
        (lambda v, _: ca.asin(v), "asin"),
        (lambda v, _: ca.tan(v), "tan"),
        (lambda v, _: ca.power(v, 1.5), "power|sqrt"),
        (lambda v, t: v + 0 * v + ca.log(t) - ca.log(t) + 1 / t, "log|division"),
        (lambda v, _: ca.atan2(v, -1), "atan2"),
    ],
)
def test_an_undefined_operation_is_refused_by_name(expression, word):
    bound = smallest_bound(function_of(expression), Box((-1.0,), (2.0,)), (-1.0, 1.0))
    assert not bound.proved
    assert re.search(word, bound.reason)


def test_a_slope_that_is_infinite_at_an_end_is_not_proved():
    assert not smallest_bound(function_of(lambda v, _: ca.sqrt(v)), Box((0.0,), (1.0,))).proved
    assert smallest_bound(function_of(lambda v, _: ca.sqrt(v)), Box((0.25,), (1.0,))).alpha == pytest.approx(
        1.0
    )


def test_an_overflow_is_not_a_proof():
    bound = smallest_bound(function_of(lambda v, _: ca.exp(ca.exp(v))), Box((0.0,), (10.0,)))
    assert bound.alpha == INF
    assert not bound.proved


def test_a_branch_that_is_not_taken_need_not_be_defined():
    guarded = function_of(lambda v, _: ca.if_else(v > 1, 1 / v, 2 - v))
    assert smallest_bound(guarded, Box((-3.0,), (3.0,))).alpha == pytest.approx(1.0)
    other = function_of(lambda v, _: ca.if_else(v > -1, 1 / v, 2 - v))
    assert not smallest_bound(other, Box((-3.0,), (3.0,))).proved


def test_channels_of_their_own_share_one_alpha():
    phi = function_of(lambda v, _: ca.vertcat(3 * ca.sin(v[0]), 0.5 * ca.tanh(v[1])), 2)
    bound = smallest_bound(phi, Box.everywhere(2))
    assert bound.alpha == 3.0
    assert bound.output_scale == pytest.approx((1.0, 1 / 6))
    assert bound.alpha * bound.output_scale[1] >= 0.5
    assert prove_bound(phi, Box.everywhere(2), 3.0, output_scale=bound.output_scale).proved
    assert prove_bound(phi, Box.everywhere(2), 2.9, output_scale=bound.output_scale).refuted


def test_a_coupled_vector_is_bounded_in_its_scaled_norm():
    phi = function_of(lambda v, _: ca.vertcat(v[0] * v[1], 10 * ca.sin(v[0])), 2)
    bound = smallest_bound(phi, Box((-1.0, -1.0), (1.0, 1.0)))
    generator = np.random.default_rng(2)
    x, y = generator.uniform(-1, 1, (2, 50_000))
    J = np.moveaxis(np.array([[y, x], [10 * np.cos(x), 0 * x]]), -1, 0)
    scaled = J / np.array(bound.output_scale)[:, None] * np.array(bound.input_scale)
    sampled = float(np.linalg.norm(scaled, ord=2, axis=(1, 2)).max())
    assert bound.proved
    assert sampled <= bound.alpha <= 1.02 * sampled


def test_the_budget_ends_in_an_honest_enclosure():
    phi = function_of(lambda v, _: ca.sin(3 * v[0] * v[1]) * ca.exp(v[2]) + v[3] * ca.cos(v[0] * v[2]), 4)
    seen = []
    bound = smallest_bound(
        phi, Box((-2.0,) * 4, (2.0,) * 4), boxes=1000, tolerance=1e-9, progress=seen.append
    )
    assert not bound.converged
    assert bound.lower < bound.alpha < INF
    assert "the truth is between" in bound.reason
    assert seen
    assert seen[-1].upper >= bound.lower


def test_the_same_question_has_the_same_answer():
    phi = function_of(lambda v, _: v[0] * ca.sin(v[1]) + ca.tanh(v[0] * v[1]), 2)
    box = Box((-1.0, -2.0), (2.0, 1.0))
    assert smallest_bound(phi, box) == smallest_bound(phi, box)


@pytest.mark.parametrize(
    ("arguments", "expression"),
    [(0, lambda _v, _t: ca.SX(0, 1)), (2, lambda _v, _t: ca.SX(0, 1)), (0, lambda _v, t: ca.sin(t))],
)
def test_what_depends_on_no_state_has_the_bound_zero(arguments, expression):
    v, t = ca.SX.sym("v", arguments), ca.SX.sym("t")
    phi = ca.Function("phi", [v, t], [expression(v, t)])
    bound = smallest_bound(phi, Box.everywhere(arguments))
    assert (bound.alpha, bound.proved, bound.converged) == (0.0, True, True)
    assert "no state" in bound.reason
    assert prove_bound(phi, Box.everywhere(arguments), 0.5).proved
    assert len(bound.input_scale) == arguments


def test_bad_input_is_named():
    phi = function_of(lambda v, _: ca.sin(v))
    with pytest.raises(ProblemError, match="2 components"):
        smallest_bound(phi, Box.everywhere(2))
    with pytest.raises(ProblemError, match="component 1"):
        Box((1.0,), (0.0,))
    with pytest.raises(ProblemError, match="range of t"):
        smallest_bound(phi, Box.everywhere(1), (1.0, 0.0))
    with pytest.raises(ProblemError, match="tolerance"):
        smallest_bound(phi, Box.everywhere(1), tolerance=0.0)
    for alpha in (-1.0, math.inf, math.nan):
        with pytest.raises(ProblemError, match="alpha is"):
            prove_bound(phi, Box.everywhere(1), alpha)
    with pytest.raises(ProblemError, match="output_scale"):
        prove_bound(phi, Box.everywhere(1), 1.0, output_scale=[0.0])
    x = ca.SX.sym("x")
    with pytest.raises(ProblemError, match="phi"):
        smallest_bound(ca.Function("phi", [x], [x]), Box.everywhere(1))
