"""Doubles as the rationals they are, and back."""

from fractions import Fraction

import numpy as np
import pytest
from flint import fmpq
from hypothesis import given
from hypothesis import strategies as st

from lockstep.check.numbers import as_floats, converter, exact, exactly, eye, inverse, is_exact, zeros

doubles = st.floats(allow_nan=False, allow_infinity=False)


@given(doubles)
def test_a_double_is_taken_exactly(value: float) -> None:
    """`Fraction` is the independent reader of a double's bits."""
    assert Fraction(int(exact(value).p), int(exact(value).q)) == Fraction(value)


def test_decimals_that_are_no_doubles_differ_from_the_double() -> None:
    assert exact(0.1) != fmpq(1, 10)
    assert exact(0.375) == fmpq(3, 8)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_what_is_no_number_has_no_rational(value: float) -> None:
    with pytest.raises((ValueError, OverflowError)):
        exact(value)


@given(st.lists(doubles, min_size=0, max_size=6))
def test_there_and_back(values: list[float]) -> None:
    array = np.array(values).reshape(1, -1)
    there = exactly(array)
    assert there.dtype == object
    assert there.shape == array.shape
    np.testing.assert_array_equal(as_floats(there), array)


@given(st.integers(-(10**40), 10**40), st.integers(1, 10**40))
def test_the_nearest_double(p: int, q: int) -> None:
    """Python's integer division rounds correctly; so does Fraction's conversion, by its own code."""
    assert as_floats(np.array([fmpq(p, q)], dtype=object))[0] == float(Fraction(p, q))


def test_a_rational_beyond_the_doubles_becomes_infinite_with_its_sign() -> None:
    huge = np.array([fmpq(10) ** 400, -(fmpq(10) ** 400), fmpq(10) ** -400], dtype=object)
    np.testing.assert_array_equal(as_floats(huge), [np.inf, -np.inf, 0.0])


@given(st.integers(1, 5), st.integers(0, 2**32))
def test_the_exact_inverse_is_one(n: int, seed: int) -> None:
    half = np.random.default_rng(seed).integers(-3, 4, size=(n, n)).astype(float)
    matrix = exactly(half @ half.T + np.eye(n))
    product = matrix @ inverse(matrix)
    assert (product == exactly(np.eye(n))).all()


def test_the_inverse_of_a_singular_matrix_is_refused() -> None:
    singular = exactly(np.ones((2, 2)))
    with pytest.raises(ZeroDivisionError):
        inverse(singular)


def test_inverse_in_doubles() -> None:
    np.testing.assert_array_equal(inverse(np.array([[2.0, 0.0], [0.0, 4.0]])), [[0.5, 0.0], [0.0, 0.25]])


def test_the_kind_of_number_is_kept() -> None:
    for like in (np.zeros((1, 1)), exactly(np.zeros((1, 1)))):
        for made in (eye(2, like), zeros(2, 3, like)):
            assert is_exact(made) is is_exact(like)
    assert eye(2, exactly(np.zeros((1, 1))))[1, 1] == fmpq(1)
    assert zeros(0, 3, np.zeros((1, 1))).shape == (0, 3)
    assert is_exact(converter(True)(np.ones(2)))
    assert not is_exact(converter(False)(np.ones(2)))
