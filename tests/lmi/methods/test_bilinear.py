"""The barrier of matrices that are bilinear: its slopes by differences, its optimum by hand, and gains with one P by it."""

import numpy as np
import pytest

from lockstep.check.continuous.inequality import Claim
from lockstep.check.continuous.modes import Modes, mode_matrix
from lockstep.check.system.loop import Plant
from lockstep.lmi.analysis.semidefinite import symmetric_basis
from lockstep.lmi.methods.bilinear_barrier import Bilinear, BilinearCondition, BilinearProgram
from lockstep.lmi.methods.modal_newton import Together


def small():
    """x_2 in [1, 4]; x_0 x_1 > 1, x_0 < x_2, x_1 < 2: the least log x_0 is log(1/2)."""
    one = np.ones((1, 1))

    def linear(**at):
        return np.array([at.get(name, 0.0) * one for name in "abc"])

    both = Bilinear(slice(0, 1), slice(1, 2), np.ones((1, 1, 1, 1)))
    rest = [
        BilinearCondition(-one, linear(c=1.0)),
        BilinearCondition(4 * one, linear(c=-1.0)),
        BilinearCondition(0 * one, linear(a=-1.0, c=1.0)),
    ]
    return BilinearProgram(
        [BilinearCondition(-one, linear(), both), BilinearCondition(2 * one, linear(b=-1.0)), *rest], 0
    )


def test_the_least_is_found():
    x = np.array([1.5, 1.0, 3.0])
    for mu in (0.3, 0.03, 3e-3, 3e-4):
        x = small().improved(x, mu, 200)
    assert x[0] == pytest.approx(0.5, rel=1e-2) and x[0] > 0.5


def together(W=0.3):
    random = np.random.default_rng(5)
    n, m, q, n_C = 3, 2, 2, 2
    A, B, C, G, H = (random.standard_normal(s) for s in ((n, n), (n, m), (q, n), (n, 1), (1, n)))
    weight = W * np.eye(m) if W else np.zeros((0, 0))
    noise = np.array([0.2, 0.5]) if W else np.zeros(0)
    claim = Claim(0.7, np.eye(n), np.eye(n_C), np.zeros((2, 4)), (), weight, np.ones(n), noise)
    modes = Modes(Plant(A, (B, B), C, G, H), n_C)
    base = np.linalg.cholesky(np.eye(5) + 0.1 * np.ones((5, 5)))
    return Together(modes, claim, (1.0, 4.0), 10.0, 0.1, (4, 4), base), random


@pytest.mark.parametrize("W", [0.3, 0.0])
def test_the_condition_of_a_mode_is_the_matrix_that_is_proved(W):
    """By a Schur complement; in the coordinates of the base."""
    at, random = together(W)
    x = random.standard_normal(at.size)
    P = np.tensordot(x[at.places["P"]], symmetric_basis(5), 1)
    for condition, value in zip(at.program.conditions[:2], at.ends, strict=True):
        M = condition.at(x)
        f = len(M) - len(at.claim.W)
        found = M[:f, :f] - M[:f, f:] @ M[f:, :f]
        D = np.eye(f)
        D[:5, :5] = np.linalg.inv(at.base)
        mu, sigma = x[at.places["mu"]], x[at.places["sigma"]][0]
        F = mode_matrix(at.modes, at.K(x), at.claim, value, at.base @ P @ at.base.T, mu, sigma)
        np.testing.assert_allclose(found, -D @ F @ D.T, atol=1e-9 * np.abs(F).max())


def test_the_curvature_is_that_of_the_barrier():
    at, random = together()
    x = 0.05 * random.standard_normal(at.size)
    lifted = [
        BilinearCondition(one.constant + 50 * np.eye(len(one.constant)), one.linear, one.bilinear)
        for one in at.program.conditions
    ]
    program = BilinearProgram(lifted, at.program.goal)
    x[program.goal] = 1.0
    v, h = random.standard_normal(at.size), 1e-4

    def value(t):
        return program.value(x + t * v, 1.0) - np.log(x[program.goal] + t * v[program.goal])

    slope, square, rest = program._curvature(x)
    assert slope @ v == pytest.approx((value(h) - value(-h)) / (2 * h), rel=1e-5)
    assert v @ (square + rest) @ v == pytest.approx((value(h) - 2 * value(0) + value(-h)) / h**2, rel=1e-3)
