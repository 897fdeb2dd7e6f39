"""The lifted period against optimal control on a fine grid, and the conjugate points that would make it mean
nothing."""

from itertools import pairwise

import numpy as np
import pytest
from flint import arb, fmpq
from scipy.linalg import expm

from lockstep.check.numbers import exactly
from lockstep.check.sampled import balls
from lockstep.check.sampled.conjugate_points import lifted_if_regular
from lockstep.check.sampled.lifting import copies, lift


def agent(rng):
    A, B = rng.standard_normal((3, 3)), rng.standard_normal((3, 1))
    E, F = rng.standard_normal((3, 1)), 0.8 * rng.standard_normal((1, 3))
    return A, B, E, F


def largest_value(A, B, E, F, T, a, P, pieces):
    """max over w constant on each piece of x(T)'P x(T) + int |z|^2 - |w|^2: a quadratic form, maximised as such."""
    n, k, h = len(A), B.shape[1], T / pieces
    whole = expm(h * np.block([[A, B, E], [np.zeros((k + 1, n + k + 1))]]))
    states = [np.hstack([np.eye(n + k), np.zeros((n + k, pieces))])]
    for i in range(pieces):
        row = states[-1].copy()
        row[:n] = whole[:n, : n + k] @ states[-1]
        row[:n, n + k + i] += whole[:n, n + k]
        states.append(row)
    form = states[-1][:n].T @ P @ states[-1][:n]
    for before, after in pairwise(states):
        z0, z1 = F @ before[:n], F @ after[:n]
        form = form + h / 3 * (z0.T @ z0 + z1.T @ z1 + (z0.T @ z1 + z1.T @ z0) / 2)
    inner = h * np.eye(pieces) - form[n + k :, n + k :]
    side = form[: n + k, n + k :]
    total = form[: n + k, : n + k] + side @ np.linalg.solve(inner, side.T)
    return a @ total @ a


@pytest.mark.parametrize("seed", range(4))
def test_one_step_is_the_largest_value_over_all_inputs(seed):
    rng = np.random.default_rng(seed)
    A, B, E, F = agent(rng)
    T, a = 0.4, rng.standard_normal(4)
    one = lift(A, B, E @ E.T, F.T @ F, T, expm)
    root = 0.3 * rng.standard_normal((3, 3))
    P = root @ root.T + 0.1 * np.eye(3)
    step = one.A_d @ a
    value = step @ np.linalg.solve(np.linalg.inv(P) - one.BB_d, step) + a @ one.CC_d @ a
    coarse, fine = (largest_value(A, B, E, F, T, a, P, pieces) for pieces in (100, 200))
    # Fewer inputs can only lose, and the loss shrinks with the square of the grid.
    assert value == pytest.approx(fine + (fine - coarse) / 3, rel=1e-5)
    assert abs(fine - value) < abs(coarse - value)


def test_without_ways_in_it_is_the_zero_order_hold():
    A, B, _, _ = agent(np.random.default_rng(9))
    one = lift(A, B, np.zeros((3, 3)), np.zeros((3, 3)), 0.3, expm)
    hold = expm(0.3 * np.block([[A, B], [np.zeros((1, 4))]]))[:3]
    np.testing.assert_allclose(one.A_d, hold, atol=1e-13)
    assert not one.BB_d.any()


def test_balls_hold_what_doubles_compute_and_are_narrow():
    A, B, E, F = agent(np.random.default_rng(3))
    doubles = lift(A, B, E @ E.T, F.T @ F, 0.2, expm)
    with balls.working_precision():
        A_, B_, E_, F_ = (exactly(M) for M in (A, B, E, F))
        enclosed = lift(A_, B_, E_ @ E_.T, F_.T @ F_, 0.2)
        assert max(float(arb(v).rad()) for v in enclosed.CC_d.ravel()) < 1e-60
    np.testing.assert_allclose(balls.midpoints(enclosed.CC_d), doubles.CC_d, atol=1e-12)
    np.testing.assert_allclose(balls.midpoints(enclosed.BB_d), doubles.BB_d, atol=1e-12)


def test_a_multiplier_couples_copies_as_one_big_period_would():
    """(W (x) I) takes the coupled agents apart: lifting all of them at once gives the same matrices."""
    A, B, E, F = agent(np.random.default_rng(5))
    M = np.array([[2.0, -0.5], [-0.5, 1.0]])
    unit = np.eye(2)
    together = lift(
        np.kron(unit, A), np.kron(unit, B), np.kron(np.linalg.inv(M), E @ E.T), np.kron(M, F.T @ F), 0.3, expm
    )
    apart = copies(lift(A, B, E @ E.T, F.T @ F, 0.3, expm), M)
    for name in ("A_d", "BB_d", "CC_d"):
        np.testing.assert_allclose(getattr(apart, name), getattr(together, name), atol=1e-12)


def no_conjugate_point(A, EE, CC, period):
    """Whether a period without inputs is shown to hold none."""
    with balls.working_precision():
        return lifted_if_regular(A, exactly(np.zeros((len(A), 0))), EE, CC, period) is not None


def test_a_conjugate_point_inside_the_period_is_not_overlooked():
    # Gamma_11 = cos t: singular at pi/2, and perfectly invertible at t = 2.5, where the formulas would mean nothing.
    one, zero = exactly(np.eye(1)), exactly(np.zeros((1, 1)))
    assert no_conjugate_point(zero, one, one, 1.57)
    assert not no_conjugate_point(zero, one, one, 1.58)
    assert not no_conjugate_point(zero, one, one, 2.5)


def test_entries_beyond_all_doubles_are_no_proof_and_no_error():
    """cos t again, in units in which EE, FF or their sums are no doubles: nothing is known of how short a part is."""
    zero, one = exactly(np.zeros((2, 2))), exactly(np.eye(2))
    for size in (fmpq(2) ** 1023, fmpq(10) ** 400):
        ones = exactly(np.ones((2, 2)))
        assert not no_conjugate_point(zero, one, size * ones, 2.0)
        assert not no_conjugate_point(zero, one, size * ones + one / size, 1e-300)
    assert not no_conjugate_point(zero, one * np.array(arb("nan")), one, 1.0)
    assert not no_conjugate_point(zero, one, one, 1e308), "twice that is no double"


def test_a_part_that_is_no_double_is_no_proof():
    """Below the normal doubles a quarter of a number with all its places is rounded, and four of these are another period."""
    A, one = exactly(np.array([[-(2.0**1022)]])), exactly(np.array([[2.0**1021]]))
    least = 2.0**-1022
    assert 2 * (least * (1 + 2**-52) / 2) != least * (1 + 2**-52)
    assert no_conjugate_point(A, one, one, least)
    assert no_conjugate_point(A, one, one, least * (1 + 2**-50))
    assert not no_conjugate_point(A, one, one, least * (1 + 2**-52))


def test_a_stiff_agent_needs_shorter_parts_and_gets_them():
    A = exactly(np.array([[0.0, 1.0], [-400.0, -1.0]]))
    E, F = exactly(np.array([[0.0], [1.0]])), exactly(np.array([[1.0, 0.0]]))
    assert no_conjugate_point(A, E @ E.T, F.T @ F, 1.0)
    assert not no_conjugate_point(A, E @ E.T, 10_000 * (F.T @ F), 1.0)


def test_units_of_the_states_decide_nothing_about_conjugate_points():
    """cos t twice, the states turned into one another and then counted in units 2^40 apart: singular at pi/2, as before."""
    turned = np.array([[3.0, 4.0], [-4.0, 3.0]])  # turned @ turned.T = 25 I
    S = np.diag([1.0, 2.0**40]) @ turned
    inverse = exactly(turned.T) * fmpq(1, 25) @ exactly(np.diag([1.0, 2.0**-40]))
    zero = exactly(np.zeros((2, 2)))
    EE, FF = exactly(S) @ exactly(S).T, inverse.T @ inverse
    assert no_conjugate_point(zero, EE, FF, 1.57)
    assert not no_conjugate_point(zero, EE, FF, 1.58)
    # A resonator of 2e5 rad/s in SI units, five samples per radian. From w to x'' = alpha w alone the gain over T is
    # alpha T^2 / 1.875^2 (the cantilever's first root): 5e-4 of one at first, 5.1 in the end.
    A = exactly(np.array([[0.0, 1.0], [-4.0e10, -250.0]]))
    E, F = exactly(np.array([[0.0], [1.8e9]])), exactly(np.array([[1.0, 0.0]]))
    assert no_conjugate_point(A, E @ E.T, F.T @ F, 1e-6)
    assert not no_conjugate_point(A, E @ E.T * fmpq(10) ** 8, F.T @ F, 1e-6)


@pytest.mark.parametrize("power", [0, 20, -20, 40, -40])
def test_what_is_lost_in_units_far_apart_has_more_bits(power):
    """A damped oscillator far from a conjugate point, its position and its speed in units up to 2^80 apart."""
    D, inverse = (exactly(np.diag([2.0**k, 2.0**-k])) for k in (power, -power))
    A, EE, FF = (
        exactly(np.array(one)) for one in ([[0, 1.0], [-1, -1]], [[0, 0], [0, 1.0]], [[1 / 16, 0], [0, 0]])
    )
    assert no_conjugate_point(D @ A @ inverse, D @ EE @ D, inverse @ FF @ inverse, 1.0)
    assert not no_conjugate_point(D @ A @ inverse, D @ EE @ D * 2000, inverse @ FF @ inverse, 1.0)


def test_inputs_in_units_that_the_balls_do_not_hold_are_no_proof_and_no_error():
    """Gamma_11 holds B': with u in units of 2^-300 it is not inverted in these balls, though no conjugate point is near."""
    A, one = exactly(np.array([[0.0, 1.0], [0.0, -1.0]])), exactly(np.eye(2))
    near, far = (exactly(np.array([[0.0], [2.0**k]])) for k in (10, 300))
    assert lifted_if_regular(A, near, one, one, 0.1) is not None
    with pytest.raises(ZeroDivisionError):
        lift(A, far, one, one, 0.1)
    assert lifted_if_regular(A, far, one, one, 0.1) is None
