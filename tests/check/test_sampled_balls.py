"""Positive definiteness of ball matrices: proved where it is so, never where it is not."""

import numpy as np
import pytest
from flint import arb, fmpq

from lockstep.check.numbers import exactly
from lockstep.check.sampled.balls import is_positive_definite, product, working_precision


def with_least_eigenvalue(value: fmpq, n: int = 6) -> np.ndarray:
    """L D L' with unit triangular L: positive definite if and only if the last pivot is positive."""
    rng = np.random.default_rng(1)
    L = exactly(np.tril(rng.integers(-3, 4, (n, n)), -1) + np.eye(n))
    D = exactly(np.diag([1.0] * n))
    D[n - 1, n - 1] = value
    return L @ D @ L.T


def test_the_edge_is_told_apart():
    with working_precision():
        assert is_positive_definite(with_least_eigenvalue(fmpq(1, 10**60)))
        assert not is_positive_definite(with_least_eigenvalue(fmpq(0)))
        assert not is_positive_definite(with_least_eigenvalue(fmpq(-1, 10**60)))


def test_wide_balls_prove_nothing():
    narrow, wide = (np.array([[arb(1, radius)]], dtype=object) for radius in (0.5, 1.5))
    assert is_positive_definite(narrow)
    assert not is_positive_definite(wide)


@pytest.mark.parametrize("shape", [(2, 0), (0, 3)])
def test_empty_products(shape):
    empty = np.zeros(shape, dtype=object)
    result = product(empty, np.zeros((shape[1], 4), dtype=object))
    assert result.shape == (shape[0], 4)
