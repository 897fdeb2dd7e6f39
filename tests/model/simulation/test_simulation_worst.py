"""The search for the worst disturbance, against linear loops, and against what is proved of the published gains."""

import numpy as np
import pytest
from simulation_cases import ARMS, COROLLARY_1, cart_gains, carts, loop_matrix

from lockstep.check.continuous.inequality import Performance
from lockstep.model.simulation import RhoWeights, Scenario, energies, noise, simulate
from lockstep.model.simulation.weakest_agreement import PeakGain, weakest_agreement
from lockstep.model.simulation.worst_disturbance import _Climb, worst_disturbance

CARTS, GAINS = carts(), cart_gains()
CART_WEIGHTS = RhoWeights.of(CARTS.graph, Performance(np.diag([1.0, 2.0]), np.eye(1)))
ARM_WEIGHTS = RhoWeights.of(ARMS.graph, Performance(np.eye(4), 2 * np.eye(2)))

PROVED = 13.24
"""rho of Corollary 1's gains, proved exactly (tests/cli/test_commands.py); its least value is 13.23."""


def lifted_gain(K: int, step: float) -> float:
    """The largest singular value of the lifted map from held xi_d to z at the instants, by matrices alone."""
    A, P = loop_matrix(CARTS, GAINS), np.eye(3) - 1 / 3
    E = np.zeros((9, 6))
    E[:6] = np.eye(6)
    from scipy.linalg import block_diag, expm

    whole = expm(step * np.block([[A, E], [np.zeros((6, 15))]]))
    A_d, B_d = whole[:9, :9], whole[:9, 9:] @ np.kron(P, np.eye(2)) / np.sqrt(step)
    root = block_diag(np.kron(P, np.diag([1.0, np.sqrt(2.0)])), np.eye(3))
    rows = np.zeros(((K + 1) * 9, K * 6))
    power = B_d
    for lag in range(K):
        for k in range(K - lag):
            weight = np.sqrt(step / 2 if k + lag + 1 == K else step)
            rows[(k + lag + 1) * 9 : (k + lag + 2) * 9, k * 6 : k * 6 + 6] = weight * root @ power
        power = A_d @ power
    return float(np.linalg.norm(rows, 2))


def test_on_a_linear_loop_it_is_the_largest_singular_value():
    found = worst_disturbance(
        CARTS, GAINS, CART_WEIGHTS, horizon=8.0, step=0.1, energies=(1e-3,), iterations=300
    )
    exact = lifted_gain(80, 0.1)
    assert found.gain <= exact * (1 + 1e-6), "nothing is worse than the worst"
    assert found.gain >= exact * (1 - 1e-3), "power iteration with the adjoint converges"


def test_it_is_below_the_peak_gain_and_near_it():
    peak = PeakGain(CARTS, GAINS, CART_WEIGHTS)(np.zeros(2))
    found = worst_disturbance(
        CARTS, GAINS, CART_WEIGHTS, horizon=40.0, step=0.1, energies=(1.0,), iterations=60
    )
    measured = energies(simulate(CARTS, GAINS, found.scenario(step=0.05)), CART_WEIGHTS).gain
    assert 0.97 * peak < measured < peak * (1 + 1e-4)
    shaken = noise(3, 2, interval=0.1, horizon=40.0, seed=0, sigma=1.0)
    at_random = energies(
        simulate(CARTS, GAINS, Scenario(np.zeros((3, 2)), 60.0, 0.05, shaken)), CART_WEIGHTS
    ).gain
    assert at_random < 0.9 * measured, "noise finds less"


def test_the_gradient_is_that_of_j():
    climb = _Climb(ARMS, COROLLARY_1, ARM_WEIGHTS, 20, 0.05)
    generator = np.random.default_rng(0)
    w, direction = generator.normal(size=(2, 8, 20))
    a = np.array([0.1, 0.0, 2.0, 0.0])
    _, slope = climb._evaluate(w, a)
    h = 1e-5
    ahead, behind = (climb._evaluate(w + s * h * direction, a)[0] for s in (1, -1))
    assert (ahead - behind) / (2 * h) == pytest.approx(float((slope * direction).sum()), rel=1e-6)


def hamiltonian_norm(A, B, C) -> float:
    """The H-infinity norm by bisection: below it the Hamiltonian has eigenvalues on the imaginary axis."""
    low, high = 0.1, 1e4
    for _ in range(60):
        g = np.sqrt(low * high)
        H = np.block([[A, B @ B.T / g**2], [-C.T @ C, -A.T]])
        on_the_axis = np.abs(np.linalg.eigvals(H).real).min() < 1e-7
        low, high = (g, high) if on_the_axis else (low, g)
    return float(high)


def test_the_peak_gain_is_the_h_infinity_norm():
    """At the hanging and at the upright agreement, against a bisection on python-control's matrices of the loop."""
    peak = PeakGain(ARMS, COROLLARY_1, ARM_WEIGHTS)
    system = ARMS.to_control(COROLLARY_1, linear=True)
    A, B = np.asarray(system.A), np.asarray(system.B)[:, :8]
    C = np.diag([1.0] * 8 + [np.sqrt(2.0)] * 6)
    for angle, slope in ((0.0, -3.33), (np.pi, 3.33)):
        shifted = A.copy()
        shifted[:8, :8] += np.kron(np.eye(2), np.outer([0, 0, 0, 1], [0, 0, 1, 0])) * (
            slope - centre_slope(ARMS)
        )
        assert peak(np.array([angle, 0, angle, 0])) == pytest.approx(
            hamiltonian_norm(shifted, B, C), rel=1e-3
        )


def centre_slope(network) -> float:
    """What of the slope A already holds: the arm is not centred here, so nothing."""
    return float(network.agent.lure.A[3, 2] + 19.5)


def test_the_weakest_agreement_of_the_arms_is_upright():
    a, gain = weakest_agreement(ARMS, COROLLARY_1, ARM_WEIGHTS)
    assert abs(abs(a[2]) - np.pi) < 1e-3
    # 13.22 is what the certificate's least rho leaves no room above: reference figure of the claims' tests.
    assert 13.2 < gain < PROVED


def test_the_published_gains_come_near_their_rho_and_not_above():
    found = worst_disturbance(
        ARMS,
        COROLLARY_1,
        ARM_WEIGHTS,
        horizon=30.0,
        step=0.05,
        common=[np.array([0, 0, np.pi, 0])],
        energies=(1e-3,),
    )
    measured = energies(simulate(ARMS, COROLLARY_1, found.scenario(step=0.01)), ARM_WEIGHTS).gain
    assert measured < PROVED
    assert measured > 0.9 * PROVED, "a rho of 12 would be refuted"


def test_at_large_energies_the_climb_does_not_lose_ground():
    """Each energy starts from the one before; the gain found is of the nonlinear loop, checked by a finer run."""
    found = worst_disturbance(
        ARMS, COROLLARY_1, ARM_WEIGHTS, horizon=10.0, step=0.05, energies=(1e-3, 3.0), iterations=15
    )
    fine = energies(simulate(ARMS, COROLLARY_1, found.scenario(step=0.01, tail=1.0)), ARM_WEIGHTS).gain
    assert fine == pytest.approx(found.gain, rel=0.02)
    assert 3.0 < fine < PROVED
