"""Zeros: known ones are found with their multiplicity, none are invented, units do not matter."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import tf2ss

from lockstep.model.control.zeros import zeros_of

ARM_A = np.array([[0, 1, 0, 0], [-48.6, -1.25, 48.6, 0], [0, 0, 0, 1], [19.5, 0, -19.5, 0]])
ARM_B = np.array([[0], [21.6], [0], [0]])


def realised(zeros: list[complex], poles: list[float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A realisation of prod (s - z) / prod (s - p), rotated so that nothing is zero by its place."""
    A, B, C, _ = tf2ss(np.real(np.poly(zeros)) if zeros else [1.0], np.poly(poles))
    Q = np.linalg.qr(np.random.default_rng(5).normal(size=A.shape))[0]
    return Q.T @ A @ Q, Q.T @ B, C @ Q


@pytest.mark.parametrize(
    ("zeros", "right"),
    [
        ([], 0),
        ([-1.5], 0),
        ([2.0], 1),
        ([2.0, -3.0, 0.5], 2),
        ([1 + 2j, 1 - 2j], 2),
        ([-1 + 2j, -1 - 2j], 0),
    ],
)
def test_zeros_of_a_transfer_function_are_found(zeros: list[complex], right: int) -> None:
    found = zeros_of(*realised(zeros, [-1.0, -2.0, -3.0, -4.0]))
    np.testing.assert_allclose(
        np.sort_complex(found.values), np.sort_complex(np.array(zeros, complex)), atol=1e-9
    )
    assert len(found.right_half_plane) == right
    assert found.residual < 1e-12


def test_a_double_zero_counts_twice() -> None:
    found = zeros_of(*realised([2.0, 2.0], [-1.0, -2.0, -3.0, -4.0]))
    # The square root of the rounding error is what a double zero is known to.
    np.testing.assert_allclose(found.values, [2.0, 2.0], atol=1e-6)


def test_the_arm_s_zeros_are_the_link_s_swing() -> None:
    """With the motor held at rest theta_l'' = -19.5 theta_l, whether one output is measured or two."""
    for C in (np.eye(4)[:2], np.eye(4)[:1]):
        found = zeros_of(ARM_A, ARM_B, C)
        np.testing.assert_allclose(
            np.sort(np.imag(found.values)), [-np.sqrt(19.5), np.sqrt(19.5)], rtol=1e-12
        )
        assert len(found.imaginary_axis) == 2
        assert not found.right_half_plane


def test_all_outputs_together_leave_no_zero() -> None:
    assert zeros_of(ARM_A, ARM_B, np.eye(4)).values == ()


def test_a_zero_that_outputs_share_is_one_and_others_are_none() -> None:
    """y1 = (s - 2)(s + 1)/p, y2 = (s - 2)/p: the zero at 2 only."""
    A, B, C1 = realised([2.0, -1.0], [-1.5, -2.0, -3.0])
    C2 = realised([2.0], [-1.5, -2.0, -3.0])[2]
    tall = np.vstack([C1, C2])
    np.testing.assert_allclose(zeros_of(A, B, tall).values, [2.0], atol=1e-10)
    np.testing.assert_allclose(zeros_of(A.T, tall.T, B.T).values, [2.0], atol=1e-10)
    apart = np.vstack([C1, realised([-7.0], [-1.5, -2.0, -3.0])[2]])
    assert zeros_of(A, B, apart).values == ()


def test_a_mode_that_is_neither_reached_nor_seen_is_an_invariant_zero() -> None:
    np.testing.assert_allclose(
        zeros_of(np.diag([1.0, -2.0]), np.array([[0.0], [1.0]]), np.array([[0.0, 1.0]])).values, [1.0]
    )


def test_nothing_connected_has_every_mode_as_zero() -> None:
    found = zeros_of(np.diag([1.0, -2.0]), np.zeros((2, 1)), np.zeros((1, 2)))
    np.testing.assert_allclose(found.values, [1.0, -2.0])


def test_units_do_not_matter() -> None:
    A, B, C = realised([2.0, -3.0], [-1.0, -2.0, -3.5, -4.0])
    scale = np.diag([1e-4, 1.0, 1e3, 10.0])
    found = zeros_of(scale @ A @ np.linalg.inv(scale) * 1e3, scale @ B * 1e6, C @ np.linalg.inv(scale) * 1e-5)
    np.testing.assert_allclose(found.values, [2000.0, -3000.0], rtol=1e-8)


@settings(max_examples=40)
@given(n=st.integers(0, 6), m=st.integers(1, 3), q=st.integers(1, 3), seed=st.integers(0, 10_000))
def test_the_rank_drops_at_every_zero_of_a_random_system(n: int, m: int, q: int, seed: int) -> None:
    """A generic system has n - m zeros if it is square (C B is invertible), and none if it is not."""
    n += max(m, q)
    generator = np.random.default_rng(seed)
    A, B, C = generator.normal(size=(n, n)), generator.normal(size=(n, m)), generator.normal(size=(q, n))
    found = zeros_of(A, B, C)
    assert len(found.values) == (n - m if m == q else 0)
    for s in found.values:
        pencil = np.block([[A - s * np.eye(n), B], [C, np.zeros((q, m))]])
        values = np.linalg.svd(pencil, compute_uv=False)
        assert values[-1] < 1e-9 * max(values[0], 1.0)


def test_a_rate_of_a_subnormal_number_is_no_mode_and_no_error():
    from lockstep.model.control.pbh import controllability

    found = controllability(np.array([[1e-320]]), np.array([[1.0]]))
    assert found.controllable
