"""The units of the search: the scaled loop is the same loop, bit for bit, and its numbers are near one."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lmi_cases import ALPHA, EXAMPLES, arms, claim, problem, published

from lockstep.check.continuous.inequality import Certificate, F_matrix
from lockstep.check.system.loop import Gains
from lockstep.lmi.analysis.certificate_sdp import least_rho
from lockstep.lmi.analysis.rounding import prove, short_gains
from lockstep.lmi.analysis.unit_scaling import scaled
from lockstep.lmi.proposal import claim_of, proved_bound
from lockstep.lmi.search import GainSearch
from lockstep.lmi.search.random_start import run_start
from lockstep.model.assembly import network_of
from lockstep.model.problem import load_problem

ROOMS = {"T": "-2e-5*T - 1e-5*sin(T) + 3e-8*u"}
"""A room's temperature over hours, in K and W."""


@settings(deadline=None)
@given(st.integers(0, 2**31), st.sampled_from([0, 1, 2]))
def test_a_certificate_of_the_scaled_loop_is_one_of_the_loop(seed: int, order: int) -> None:
    """F of the two are congruent, with powers of two on the diagonal: F^ = c D F D."""
    generator, network = np.random.default_rng(seed), arms()
    loop, weights = network.loop(order), claim(network, order, ALPHA, delta=(0.2, 0.0, 0.1, 0.3))
    new, scaled_claim, units = scaled(loop, weights)
    K = generator.standard_normal((3, order + 1, order + 2))
    P = generator.standard_normal((loop.n_x, loop.n_x))
    ways = len([d for d, present in zip((0.2, 0.1, 0.3), (order, order, 1), strict=True) if present]) * 3
    found = Certificate(2.5, P + P.T, generator.uniform(0.5, 2, 3), generator.uniform(0.5, 2, ways))
    F, F_scaled = F_matrix(loop, K, weights, units.certificate(found)), F_matrix(new, K, scaled_claim, found)
    n_phi, n_d = 2 * loop.plant.G.shape[1], loop.E.shape[1]
    g, size = np.sqrt(units.multiplier), loop.n_x + n_d + n_phi
    D = np.concatenate([1 / units.state, np.full(n_d, 1 / units.disturbance), np.full(n_phi, 1 / g)])
    D = np.concatenate([D, np.ones(len(F) - size)]) / np.sqrt(units.cost)
    np.testing.assert_allclose(F_scaled, D[:, None] * F * D, rtol=1e-12, atol=1e-12)


def test_every_scale_is_a_power_of_two_so_that_no_bit_of_the_loop_changes() -> None:
    network = arms()
    loop, weights = network.loop(2), claim(network, 2, ALPHA)
    new, _, units = scaled(loop, weights)
    for scales in (units.gains, units.state, units.time, units.multiplier, units.cost, units.disturbance):
        np.testing.assert_array_equal(np.frexp(np.asarray(scales))[0], 0.5)
    K = published().blocks
    back = new.A_cl(K) * units.state / units.state[:, None] / units.time
    np.testing.assert_array_equal(np.frexp(back)[1] * 0, 0)
    np.testing.assert_allclose(back, loop.A_cl(K), rtol=1e-15, atol=1e-15)


def test_rho_and_the_multipliers_come_back_in_the_units_of_the_file() -> None:
    network, K = arms(), published().blocks
    loop, weights = network.loop(2), claim(network, 2, ALPHA)
    new, scaled_claim, units = scaled(loop, weights)
    here, there = least_rho(loop, K, weights), least_rho(new, K, scaled_claim)
    assert here is not None
    assert there is not None
    assert units.certificate(there).rho == pytest.approx(here.rho, rel=1e-4)
    F = F_matrix(loop, K, weights, units.certificate(there))
    assert np.linalg.eigvalsh((F + F.T) / 2)[-1] < 1e-6 * np.abs(F).max()


def test_a_plant_with_time_constants_of_hours_is_scaled_to_numbers_near_one() -> None:
    posed = problem(dynamics=ROOMS, outputs={"y": "T"}, design="order = 1")
    bound = proved_bound(posed)
    loop, weights = network_of(posed, bound).loop(1), claim_of(posed, bound)
    new, _, units = scaled(loop, weights)
    assert np.abs(loop.plant.A).max() < 1e-4
    gained = new.A_cl(np.stack([units.gains] * loop.d.N))
    sizes = np.abs(gained[np.abs(gained) > 0])
    assert 0.1 < sizes.min() <= sizes.max() < 10
    assert units.time > 1e4  # seconds


def test_the_proof_finds_the_rho_of_numbers_that_are_far_from_one() -> None:
    """Currents and voltages at tens of kHz: asked in SI units, the solver stopped at nearly four times this rho."""
    posed = load_problem(EXAMPLES.parent / "benchmarks" / "designs" / "converters.toml")
    bound = proved_bound(posed)
    network, weights = network_of(posed, bound), claim_of(posed, bound)
    search = GainSearch.of(network.loop(posed.order), weights, posed.design.gain_limit)
    start = run_start(search, None, 0, 0)
    gains = Gains.from_blocks(short_gains(start.at.K, posed.design.gain_limit), posed.order)
    # The response at the frequencies, for multipliers that the certificate may better: no storage function in it.
    assert prove(network, gains, weights).rho < 1.02 * search.units.rho * start.at.rho


def least_start(hour: float) -> float:
    """rho, in hours, of the better of two starts for three chemostats whose controllers are to forget (Monod; 0.48 1/h)."""
    posed = problem(
        dynamics={
            "S": f"(0.2*(20 + f - S) - 1.2*S/(1.2 + S)*X)/{hour}",
            "X": f"(0.48*S/(1.2 + S)*X - 0.2*X)/{hour}",
        },
        inputs=["f"],
        outputs={"od": "X"},
        network='agents = 3\ntopology = "leader_path"',
        design="order = 2",
        agent="domain = { S = [0.3, 4.0], X = [5.0, 8.0] }",
    )
    bound = proved_bound(posed)
    loop, weights = network_of(posed, bound).loop(2), claim_of(posed, bound)
    search = GainSearch.of(loop, weights, 6.4, rate=0.6 / hour)
    found = [run_start(search, None, 0, index) for index in range(2)]
    assert all(start.abscissa < 0 for start in found)
    return min(search.units.rho * start.at.rho for start in found) / hour


@pytest.mark.slow
def test_controllers_that_forget_are_found_in_seconds_as_in_hours() -> None:
    """What each A_C has to have by itself counts in the unit of time of the loop: in seconds it had counted for nothing."""
    assert least_start(3600.0) < 1.5 * least_start(1.0)


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_rho_is_proportional_to_the_scale_of_disturbances(scale: float) -> None:
    """xi' = scale xi is the same loop, whose rho is scale times as large; of what is proved 0.1 % is left to rounding."""
    network, gains = arms(), published()
    plain = claim(network, gains.order, ALPHA)
    scaled_claim = replace(plain, states=np.full(network.agent.n, scale))
    rho = prove(network, gains, scaled_claim).rho
    assert rho / scale == pytest.approx(prove(network, gains, plain).rho, rel=5e-3)
