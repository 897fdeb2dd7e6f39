"""Sampled gains against SciPy, against the rules' definitions, and where they do not exist."""

from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.signal

from lockstep.check.errors import ProblemError
from lockstep.check.sampled.discretise import discretise

SCIPY = {"tustin": "bilinear", "zoh": "zoh", "euler": "euler"}


def gains(n, q=2, m=1, seed=0):
    random = np.random.default_rng([seed, n])
    return tuple(random.normal(size=shape) for shape in ((n, n), (n, q), (m, n), (m, q)))


def blocks(A, B, C, D, period, method):
    """The blocks of the table that `discretise` returns."""
    table, n = discretise(A, B, C, D, period, method), len(A)
    return SimpleNamespace(A=table[:n, :n], B=table[:n, n:], C=table[n:, :n], D=table[n:, n:])


@pytest.mark.parametrize("method", SCIPY)
@pytest.mark.parametrize("n", [1, 2, 5, 12])
def test_agrees_with_scipy_to_its_rounding(method, n):
    found = blocks(*gains(n), 0.05, method)
    expected = scipy.signal.cont2discrete(gains(n), 0.05, SCIPY[method])
    for ours, theirs in zip((found.A, found.B, found.C, found.D), expected, strict=False):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-14)  # SciPy rounds at each step, about n eps


@pytest.mark.parametrize("n", [1, 3])
def test_tustin_is_the_continuous_response_at_the_mapped_frequency(n):
    """H_d(z) = H_c(2/T (z - 1)/(z + 1)) holds for every z: the definition of the rule, D_d included."""
    A, B, C, D = gains(n)
    T = 0.1
    g = blocks(A, B, C, D, T, "tustin")
    for z in (0.3 + 0.9j, -0.5 + 0.1j, 1.5):
        s = 2 / T * (z - 1) / (z + 1)
        continuous = C @ np.linalg.solve(s * np.eye(n) - A, B) + D
        sampled = g.C @ np.linalg.solve(z * np.eye(n) - g.A, g.B) + g.D
        np.testing.assert_allclose(sampled, continuous, rtol=1e-11)
    assert not np.allclose(g.D, D)


def test_tustin_is_correctly_rounded():
    """A scalar case by hand over the rationals: a = -0.3, T = 0.1, each value rounded once."""
    one = np.ones((1, 1))
    a, T = Fraction(-0.3), Fraction(0.1)
    g = blocks(-0.3 * one, one, one, one, 0.1, "tustin")
    assert g.A[0, 0] == float((1 + a * T / 2) / (1 - a * T / 2))
    assert g.B[0, 0] == float(T / (1 - a * T / 2))
    assert g.C[0, 0] == float(1 / (1 - a * T / 2))
    assert g.D[0, 0] == float(1 + T / 2 / (1 - a * T / 2))


def test_zoh_of_an_integrator_and_a_nilpotent_matrix_is_exact():
    A = np.array([[1.0, -1.0], [1.0, -1.0]])  # A A = 0, so e^(A T) = I + A T
    g = blocks(A, np.zeros((2, 1)), np.eye(2), np.zeros((2, 1)), 0.25, "zoh")
    assert g.A.tolist() == [[1.25, -0.25], [0.25, 0.75]]
    assert g.B.tolist() == [[0.0], [0.0]]


def test_zoh_steps_compose():
    """Two steps of T are one of 2 T while r is held: an identity that euler and tustin do not have."""
    A, B, C, D = gains(3)
    once, twice = blocks(A, B, C, D, 0.2, "zoh"), blocks(A, B, C, D, 0.4, "zoh")
    np.testing.assert_allclose(once.A @ once.A, twice.A, atol=1e-15)
    np.testing.assert_allclose(once.A @ once.B + once.B, twice.B, atol=1e-15)
    euler = blocks(A, B, C, D, 0.2, "euler")
    assert abs(euler.A @ euler.A - twice.A).max() > 1e-3


@pytest.mark.parametrize("method", SCIPY)
def test_order_0_keeps_d(method):
    D = np.array([[0.1, -0.7]])
    g = discretise(np.zeros((0, 0)), np.zeros((0, 2)), np.zeros((1, 0)), D, 0.1, method)
    assert g.tolist() == D.tolist()


def test_tustin_refuses_a_pole_at_2_over_T_and_takes_one_beside_it():
    one = np.ones((1, 1))
    for T in (0.005, 0.25):  # 0.005 is not exact in binary: I - A T/2 is 1e-17, not 0
        with pytest.raises(ProblemError, match="singular"):
            discretise(2 / T * one, one, one, one, T, "tustin")
        assert np.isfinite(discretise(2.1 / T * one, one, one, one, T, "tustin")).all()


def test_refuses_what_float64_cannot_hold():
    one = np.ones((1, 1))
    with pytest.raises(ProblemError, match="not representable"):
        discretise(1e6 * one, one, one, one, 1.0, "zoh")
    with pytest.raises(ProblemError, match="not representable"):
        discretise(1e300 * one, one, one, one, 1e300, "euler")
