"""The power mean of a response against the eigenvalues it stands for, with modes and without."""

import numpy as np
import pytest

from lockstep.lmi.analysis.response import Poles, power_mean

POINTS = np.exp(1j * np.linspace(0, np.pi, 40))
S, Q = np.array([[2.0, 0.5], [0.5, 1.0]]), np.diag([1.0, 0.0, 3.0])
WITH_MODES = np.array([[0.5, 0.3, 0.0], [-0.3, 0.5, 0.2], [0.1, 0.0, -0.8]])
WITHOUT = 0.9 * np.eye(3) + 0.05 * np.eye(3, k=1)


def mean_of_eigenvalues(p: int, **given) -> float:
    """1/p log( mean_s sum_k lambda_k^p ) as the docstring of `response` defines it, one point at a time."""
    N, S, Q = given["N"], given["S"], given["Q"]
    Phi = [np.linalg.inv(s * np.eye(3) - N)[:, :2] for s in POINTS]
    # those of J' Phi* Q Phi J S, which are those of X: S = L L'
    values = np.array([np.linalg.eigvals(one.conj().T @ Q @ one @ S).real for one in Phi])
    return float(np.log(values.max()) + np.log(((values / values.max()) ** p).sum(axis=1).mean()) / p)


@pytest.mark.parametrize("N", [WITH_MODES, WITHOUT], ids=["modes", "no modes"])
@pytest.mark.parametrize("p", [2, 4, 48, 200])
def test_it_is_the_mean_of_the_eigenvalues_and_so_are_its_slopes(N, p):
    given = {"N": N, "S": S, "Q": Q}
    mean = power_mean(Poles(N, continuous=False), S, Q, POINTS, p)
    # what is left out adds 1e-13 of the sum at most; the rest is rounding: the largest resolvent has the norm 15
    assert mean.value == pytest.approx(mean_of_eigenvalues(p, **given), abs=1e-12)
    h, rng = 1e-6, np.random.default_rng(p)
    for name in given:
        turn = rng.standard_normal(given[name].shape)
        turn = turn if name == "N" else turn + turn.T
        up, down = (
            mean_of_eigenvalues(p, **given | {name: given[name] + h * turn * sign}) for sign in (1, -1)
        )
        # the rounding of a value, 1e-15 to 1e-14, over 2 h is at most 5e-9
        assert (getattr(mean, name) * turn).sum() == pytest.approx((up - down) / (2 * h), rel=1e-7, abs=1e-8)


def test_modes_are_not_used_where_they_are_nearly_one():
    assert Poles(WITHOUT, continuous=False)._eig[2] is None
    assert Poles(WITH_MODES, continuous=False)._eig[2] is not None
