"""The interior-point method of large cones: programs whose answer is known, and Clarabel's answer to random ones."""

import cvxpy as cp
import numpy as np
import pytest

from lockstep.lmi.analysis.certificate_sdp import solve_sdp
from lockstep.lmi.analysis.dense_sdp import run_dense


def test_the_largest_eigenvalue_is_the_least_bound():
    A = np.diag([1.0, -2.0, 3.0])
    t = cp.Variable()
    assert run_dense(cp.Problem(cp.Minimize(t), [t * np.eye(3) - A >> 0]))
    assert t.value == pytest.approx(3.0, abs=1e-6)


def test_a_lyapunov_inequality_has_a_solution_where_the_loop_is_stable_alone():
    """P > 0 with A'P + P A < 0 and trace 2: the largest room is positive exactly for a stable A."""
    for pole, stable in ((-0.1, True), (0.1, False)):
        A = np.array([[pole, 1.0], [0.0, -1.0]])
        P, s = cp.Variable((2, 2), symmetric=True), cp.Variable()
        F = A.T @ P + P @ A
        conditions = [P >> s * np.eye(2), -(F + F.T) / 2 >> s * np.eye(2), cp.trace(P) == 2, s <= 1]
        assert run_dense(cp.Problem(cp.Maximize(s), conditions))
        assert (s.value > 1e-6) == stable
        assert np.trace(P.value) == pytest.approx(2.0)


@pytest.mark.parametrize("seed", range(6))
def test_random_programs_have_the_value_that_another_solver_finds(seed):
    rng = np.random.default_rng(seed)
    X, y = cp.Variable((5, 5), symmetric=True), cp.Variable(3)
    C, G = (M + M.T for M in rng.normal(size=(2, 5, 5)))
    E = [M @ M.T for M in rng.normal(size=(3, 5, 2))]
    F = cp.bmat([[X, np.eye(5)], [np.eye(5), X + sum(y[k] * E[k] for k in range(3))]])
    conditions = [(F + F.T) / 2 >> 0, cp.trace(C @ C @ X) + cp.sum(y) == 4 * np.trace(C @ C), y >= -1, y <= 2]
    problem = cp.Problem(cp.Minimize(cp.trace(G @ G @ X) + rng.normal(size=3) @ y), conditions)
    assert run_dense(problem)
    found = problem.objective.value
    assert np.linalg.eigvalsh(F.value)[0] > -1e-6
    assert solve_sdp(problem, decompose=False)
    assert found == pytest.approx(problem.objective.value, rel=1e-5)


def test_programs_without_a_solution_have_none():
    t = cp.Variable()
    cone = np.array([[1.0, 0.0], [0.0, -1.0]])
    for goal, conditions in (
        (cp.Minimize(t), [t * cone >> np.eye(2)]),  # t >= 1 and -t >= 1
        (cp.Minimize(t), [t <= 1, t * np.array([[-1.0]]) >> -np.eye(1)]),  # unbounded below
    ):
        assert not run_dense(cp.Problem(goal, conditions))
