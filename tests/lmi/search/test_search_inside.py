"""Loops whose poles are far apart, and loops too fast for their period: what the search has against either."""

import numpy as np
import pytest
from lmi_cases import ALPHA, DOUBLE_INTEGRATOR, arms, claim, problem, published

from lockstep.check.continuous.inequality import Certificate, F_matrix
from lockstep.lmi.analysis.certificate_sdp import AffineF, least_rho, tight_certificate
from lockstep.lmi.analysis.rounding import prove
from lockstep.lmi.analysis.strict_feasibility import strictly_feasible_point
from lockstep.lmi.proposal import claim_of, proved_bound
from lockstep.lmi.search import GainSearch
from lockstep.lmi.search.hold_delay import for_delay, with_input_delay
from lockstep.lmi.search.random_start import StartResult, run_start
from lockstep.model.assembly import network_of
from lockstep.model.problem import parse_problem

NEURONS = """
[agent]
name = "neuron"
states = ["x", "y", "z"]
inputs = ["u"]
[agent.dynamics]
x = "y - x**3 + 3*x**2 - z + 3.25 + u"
y = "1 - 5*x**2 - y"
z = "0.005*(4*(x + 1.6) - z)"
[agent.outputs]
v = "x"
[agent.domain]
x = [-1.8, 2.1]
[network]
agents = 3
edges = [[1, 2, 1.0], [2, 1, 1.0], [2, 3, 0.5], [3, 2, 0.5]]
[design]
order = 0
gain_limit = 1000.0
"""
"""Poles from 1/200 to a few hundred 1/s once the gains are large; z alone makes rho near 1/0.005 = 200."""


def test_the_solver_is_helped_where_the_poles_are_far_apart() -> None:
    problem = parse_problem(NEURONS)
    bound = proved_bound(problem)
    network, claim = network_of(problem, bound), claim_of(problem, bound)
    what = GainSearch.of(network.loop(0), claim, 1000.0)
    start = run_start(what, None, 0, 0)
    assert start.at.rho * what.units.rho == pytest.approx(200, rel=0.02)
    none = np.zeros((what.loop.n_x, what.loop.n_x))
    known = AffineF(what.loop, start.at.K, what.claim).certificate(
        none, np.append(start.at.w, start.at.rho**2)
    )
    found = least_rho(what.loop, start.at.K, what.claim, known)
    assert found is not None
    assert found.rho <= start.at.rho * (1 + 1e-3)
    assert np.linalg.eigvalsh(F_matrix(what.loop, start.at.K, what.claim, found)).max() <= 1e-6 * found.rho**2


def test_a_point_inside_is_inside_and_there_is_none_below_the_least_rho() -> None:
    loop, weights, K = arms().loop(2), claim(arms(), 2, ALPHA), published().blocks
    least = least_rho(loop, K, weights)
    assert least is not None
    form = AffineF(loop, K, weights)

    def at(rho: float) -> object:
        return strictly_feasible_point(form.Z, form.constant, form.slopes, np.array([*least.m, rho**2]))

    found = at(1.01 * least.rho)
    assert found is not None
    P, w, F = found
    assert np.linalg.eigvalsh(P)[0] > 0 > np.linalg.eigvalsh(F)[-1]
    stated = Certificate(float(np.sqrt(w[-1])), P, w[:-1], np.zeros(0))
    assert np.allclose(F, F_matrix(loop, K, weights, stated))
    assert at(0.1 * least.rho) is None
    near = least_rho(loop, K, weights, least)
    assert near is not None
    assert near.rho == pytest.approx(least.rho, rel=1e-3)
    assert tight_certificate(loop, K, weights, 1.01 * least.rho, least) is not None
    assert tight_certificate(loop, K, weights, 0.9 * least.rho, least) is None


ROOMS = {
    "air": "(200*(wall - air) - 20*air - 1.2*tanh(air) + 1000*u)/2e5",
    "wall": "200*(air - wall)/4e6",
}


def test_a_slow_plant_is_proved_at_the_rho_of_the_units_that_serve() -> None:
    """Time constants of hours in seconds: in those units the solver's own rho is too small by orders of magnitude."""
    from lockstep.check.system.loop import Gains

    posed = problem(dynamics=ROOMS, outputs={"y": "air"}, design="order = 0")
    bound = proved_bound(posed)
    network, asked = network_of(posed, bound), claim_of(posed, bound)
    gains = Gains.from_blocks(np.full((3, 1, 1), -1.0), 0)
    scaled = GainSearch.of(network.loop(0), asked, 50.0)
    least = least_rho(scaled.loop, gains.blocks, scaled.claim)
    assert least is not None
    proved = prove(network, gains, asked, near=scaled.units.certificate(least))
    assert proved.rho == pytest.approx(least.rho * scaled.units.rho, rel=0.02)


def test_a_late_loop_is_the_loop_through_a_pade_approximant() -> None:
    """(2/tau - s) / (2/tau + s) at the inputs; at s = 0 it is 1, and without gains only its poles are added."""
    lag, what = 0.05, GainSearch.of(arms().loop(2), claim(arms(), 2, ALPHA), 50.0)
    slow, weights = with_input_delay(what.loop, what.claim, lag)
    K, n_d, N = published().blocks, what.loop.E.shape[1], what.loop.d.N
    assert np.trace(weights.R) == np.trace(what.claim.R)
    s = 0.7j
    plain = what.loop
    # L(s) = Y_i (sI - A_0)^-1 U_j of inputs: the late one is the plain one times the approximant.
    factor = (2 / lag - s) / (2 / lag + s)
    order = plain.order
    for i in range(N):
        for j in range(N):
            own = plain.Y[i][order:] @ np.linalg.solve(
                s * np.eye(plain.n_x) - plain.A_0, plain.U[j][:, order:]
            )
            held = slow.Y[i][order:] @ np.linalg.solve(s * np.eye(slow.n_x) - slow.A_0, slow.U[j][:, order:])
            assert np.allclose(held, factor * own)
    assert np.linalg.matrix_rank(slow.E) == n_d
    nearly, _ = with_input_delay(what.loop, what.claim, 1e-7)
    assert np.linalg.eigvals(nearly.A_cl(K)).real.max() == pytest.approx(
        np.linalg.eigvals(plain.A_cl(K)).real.max(), abs=1e-4
    )


INTEGRATORS = """
[agent]
name = "integrator"
states = ["x"]
inputs = ["u"]
[agent.dynamics]
x = "u + 0.1*sin(x)"
[agent.outputs]
y = "x"
[network]
agents = 2
topology = "path"
[design]
order = 0
gain_limit = 1000.0
[controller]
period = 0.1
"""


def test_gains_too_fast_for_their_period_are_made_slower() -> None:
    """x_d' = 2 D x_d held over 0.1 s is unstable below D = -10; with the hold's lag of 0.05 s, D is above -20."""
    from lockstep.lmi.sampled.synthesis.score import SampledScore

    problem = parse_problem(INTEGRATORS)
    bound = proved_bound(problem)
    network, asked = network_of(problem, bound), claim_of(problem, bound)
    what, score = (
        GainSearch.of(network.loop(0), asked, 1000.0, 0.05),
        SampledScore.of(problem, network, asked),
    )
    first: StartResult = run_start(what, score, 0, 0)
    assert not np.isfinite(first.sampled)
    held, late = for_delay(what, score, first)
    assert np.isfinite(held.sampled)
    assert late is None
    assert held.sampled < 2.0  # D = -5 on both has rho of about 0.1 in continuous time
    assert for_delay(what, score, held)[0].sampled <= held.sampled


def test_gains_made_for_the_lag_are_a_start_where_no_lag_leaves_a_sampled_certificate() -> None:
    """A score that nothing survives: the start comes back as it is, and beside it gains that know of the period."""
    problem = parse_problem(INTEGRATORS)
    bound = proved_bound(problem)
    network, asked = network_of(problem, bound), claim_of(problem, bound)
    what = GainSearch.of(network.loop(0), asked, 1000.0, 0.05)
    first: StartResult = run_start(what, lambda _K, _weights: np.inf, 0, 0)
    found, late = for_delay(what, lambda _K, _weights: np.inf, first)
    assert found is first
    assert late is not None
    # Held over 0.1 s, x_d' = (D_1 + D_2) x_d is stable above -20; 0.99 of the limit are far below.
    assert -20 < late.at.K.sum() < 0
    assert first.at.K.sum() < -20


def test_a_linear_loop_has_no_pair_weights_to_look_for() -> None:
    """Its certificates have zeros in their place, which are no unknowns: a search from one of them is one all the same."""
    posed = problem(
        dynamics=DOUBLE_INTEGRATOR,
        outputs={"y1": "p", "y2": "v"},
        network='agents = 3\ntopology = "complete"',
        design="order = 0\ngain_limit = 10.0",
    )
    bound = proved_bound(posed)
    network, claim_ = network_of(posed, bound), claim_of(posed, bound)
    loop, K = network.loop(0), np.tile([[[-1.0, -2.0]]], (3, 1, 1))
    least = least_rho(loop, K, claim_)
    assert least is not None
    assert len(least.pair_weights) == 3 and not least.pair_weights.any()
    again = least_rho(loop, K, claim_, least)
    assert again is not None
    assert again.rho <= least.rho * (1 + 1e-3)
