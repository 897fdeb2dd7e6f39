"""The doubling for the dissipation inequality, held against SciPy's solver of the same equation, and without a solution."""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from lockstep.lmi.sampled import riccati
from lockstep.lmi.sampled.riccati import smallest_storage


def _example(seed, share):
    """A stable A, and S = b b', Q = c' c for which the gain of c (z - A)^-1 b is a share of 1."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 6))
    A = rng.standard_normal((n, n))
    A *= rng.uniform(0.5, 0.99) / np.abs(np.linalg.eigvals(A)).max()
    b, c = rng.standard_normal((n, 1)), rng.standard_normal((1, n))
    points = np.exp(1j * np.linspace(0, np.pi, 20001))
    gain = max(abs((c @ np.linalg.solve(z * np.eye(n) - A, b)).item()) for z in points)
    return A, b @ b.T * share / gain, c.T @ c * share / gain, b * np.sqrt(share / gain)


@pytest.mark.parametrize("seed", range(12))
def test_the_storage_is_that_of_the_bounded_real_lemma(seed):
    """P = A' P A + Q + A' P b (1 - b' P b)^-1 b' P A, which SciPy solves as a Riccati equation with R = -1."""
    A, S, Q, b = _example(seed, 0.9)
    P = smallest_storage(A, S, Q)
    np.testing.assert_allclose(P, solve_discrete_are(A, b, Q, -np.eye(1)), rtol=1e-6)


@pytest.mark.parametrize("seed", range(12))
def test_a_gain_above_one_has_none_and_is_told_early(seed, monkeypatch):
    """The gain is 1.2: a step that is not positive semidefinite ends it long before the doublings do."""
    A, S, Q, _ = _example(seed, 1.2)
    solved, solve = [], np.linalg.solve

    def counted(*given):
        solved.append(given)
        return solve(*given)

    monkeypatch.setattr(riccati.np.linalg, "solve", counted)
    assert smallest_storage(A, S, Q) is None
    assert len(solved) <= riccati.DOUBLINGS // 3
