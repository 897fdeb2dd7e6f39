"""The barrier of the larger loops: its F against the trusted one, its slopes against differences, what a run gains."""

from dataclasses import replace

import numpy as np
import pytest
from lmi_cases import ALPHA, DOUBLE_INTEGRATOR, arms, claim, problem, published

from lockstep.check.continuous.inequality import F_matrix
from lockstep.lmi.analysis.certificate_sdp import least_rho
from lockstep.lmi.analysis.unit_scaling import claim_at
from lockstep.lmi.proposal import claim_of, proved_bound
from lockstep.lmi.search import GainSearch, search_gains
from lockstep.lmi.search.barrier import BarrierPoint, InteriorProgram, NewtonLimits
from lockstep.lmi.search.logdet import BalancedF
from lockstep.lmi.search.random_start import run_start
from lockstep.lmi.search.stopping import Deadline
from lockstep.model.assembly import network_of
from lockstep.model.bound_search import Entry

DELTAS = [(0.0,) * 4, (0.3, 0.2, 0.1, 0.2)]

ASKED = [
    {},
    {"W": np.array([[0.003]]), "states": np.array([0.0, 1.0, 0.0, 0.5]), "outputs": np.array([0.01, 0.0])},
]
"""The paper's rho, and one with u weighed, some states disturbed and one output noisy."""


def somewhere(
    delta: tuple[float, ...], entries: int = 0, seed: int = 0, asked: dict[str, np.ndarray] | None = None
) -> tuple[BalancedF, np.ndarray, np.random.Generator]:
    """Return F of the arms and a point near their published gains; F < 0 need not hold there.

    Entries of its one slope make no sense for the arm, and for F they are entries as any others.
    """
    network, gains, generator = arms(), published(), np.random.default_rng(seed)
    loop, weights = network.loop(2), claim(network, 2, ALPHA, delta=delta)
    weights = replace(
        weights, **asked or {}, entries=tuple(Entry(0, 0, ALPHA * (k + 1)) for k in range(entries))
    )
    found = least_rho(loop, gains.blocks, claim_at(weights, fraction_of_delta=0.0))
    assert found is not None
    F = BalancedF(loop, weights, np.linalg.cholesky(found.P))
    x = F.pack(gains.blocks, found, 0.8, 0.6)
    return F, x + 1e-3 * generator.standard_normal(F.size), generator


@pytest.mark.parametrize("asked", ASKED)
@pytest.mark.parametrize("entries", [0, 2])
@pytest.mark.parametrize("delta", DELTAS)
def test_F_is_the_one_that_is_proved_in_other_coordinates(
    delta: tuple[float, ...], entries: int, asked: dict[str, np.ndarray]
) -> None:
    """With u weighed, by the Schur complement of the rows of u."""
    F, x, _ = somewhere(delta, entries, asked=asked)
    at_full = x.copy()
    at_full[F.place["f_a"]] = at_full[F.place["f_d"]] = 1.0
    trusted = F_matrix(F.loop, F.K(at_full), F.claim, F.certificate(at_full))
    D = np.eye(len(trusted))
    n_x = F.loop.n_x
    D[:n_x, :n_x] = np.linalg.inv(F.root)
    whole, n_F = F.F(at_full), len(trusted)
    found = whole[:n_F, :n_F] - whole[:n_F, n_F:] @ np.linalg.inv(whole[n_F:, n_F:]) @ whole[n_F:, :n_F]
    np.testing.assert_allclose(found, D @ trusted @ D.T, atol=1e-9 * np.abs(trusted).max())
    assert not np.allclose(F.F(x), F.F(at_full))


def inside(F: BalancedF, x: np.ndarray) -> np.ndarray:
    """Return the point with as much rho and multipliers, and as little of the claim, as makes F negative."""
    x = x.copy()
    x[F.place["f_a"]], x[F.place["f_d"]], x[F.place["t"]] = 0.01, 1e-6, 1e4
    if len(F.claim.W):
        x[F.place["f_d"]], x[F.place["t"]] = 1e-7, 1e5
    for name in ("P", "m", "r2"):
        x[F.place[name]] *= 3.0
    x[F.place["m"]] = np.abs(x[F.place["m"]]) + 0.1
    assert np.linalg.eigvalsh(F.F(x))[-1] < 0
    return x


@pytest.mark.parametrize("asked", ASKED)
@pytest.mark.parametrize("entries", [0, 2])
@pytest.mark.parametrize("delta", DELTAS)
def test_slope_and_curvature_are_those_of_differences(
    delta: tuple[float, ...], entries: int, asked: dict[str, np.ndarray]
) -> None:
    F, x, generator = somewhere(delta, entries, asked=asked)
    x = inside(F, x)
    value = lambda at: -np.linalg.slogdet(-F.F(at))[1]  # noqa: E731
    slope, square, rest = F.slopes(x)
    assert np.linalg.eigvalsh(square)[0] > -1e-9 * np.abs(square).max()
    # 1e-6 of the ellipsoid of the barrier's Hessian: differences of a self-concordant function are off by the square of that,
    # and by a rounding over it (at 1e-8 the rounding was 1.3e-5 of some kernels).
    h = 1e-4
    for place in F.place.values():
        if not square[place, place].any():
            continue  # no multipliers t, or no delta for f_d to scale
        step = np.zeros(F.size)
        step[place] = generator.standard_normal(place.stop - place.start)
        step *= 1e-2 / np.sqrt(step @ square @ step)
        forth, back = x + h * step, x - h * step
        assert slope @ step == pytest.approx((value(forth) - value(back)) / (2 * h), rel=1e-5, abs=1e-7)
        difference = (F.slopes(forth)[0] - F.slopes(back)[0]) / (2 * h)
        expected = (square + rest) @ step
        np.testing.assert_allclose(difference, expected, atol=1e-5 * np.abs(expected).max())


def test_a_run_lowers_rho_keeps_to_the_limit_and_brings_its_witness() -> None:
    network = arms()
    loop, weights, K = network.loop(2), claim(network, 2, ALPHA), published().blocks
    start = least_rho(loop, K, weights)
    assert start is not None
    better = InteriorProgram(loop, weights, 50.0).improve(BarrierPoint(K, start), "rho", NewtonLimits(20))
    assert better.certificate.rho < 0.8 * start.rho
    assert max(np.linalg.norm(block, 2) for block in better.K) < 50.0
    F = F_matrix(loop, better.K, weights, better.certificate)
    assert np.linalg.eigvalsh((F + F.T) / 2)[-1] < 0
    assert np.linalg.eigvalsh(better.certificate.P)[0] > 0


def test_a_run_climbs_to_the_whole_claim_delta_included() -> None:
    network = arms()
    loop, weights = network.loop(2), claim(network, 2, ALPHA, delta=(0.02, 0.0, 0.0, 0.02))
    K = published().blocks
    start = least_rho(loop, K, claim_at(weights, alpha=0.1 * ALPHA, fraction_of_delta=0.1))
    assert start is not None
    climbed = InteriorProgram(loop, weights, 50.0).improve(
        BarrierPoint(K, start, 0.01, 0.01), "claim", NewtonLimits(100, 10 * start.rho)
    )
    assert climbed.alpha_fraction == climbed.delta_fraction == 1.0
    assert least_rho(loop, climbed.K, weights) is not None


def test_what_cannot_be_got_inside_comes_back_as_it_was() -> None:
    """Gains of a loop that is not stable have no witness; whatever is given as one leads nowhere."""
    network = arms()
    loop, weights, K = network.loop(2), claim(network, 2, ALPHA), -10 * published().blocks
    good = least_rho(loop, published().blocks, weights)
    assert good is not None
    start = BarrierPoint(K, good)
    assert InteriorProgram(loop, weights, 50.0).improve(start, "rho") is start


def eight_carts() -> tuple:
    posed = problem(
        dynamics=DOUBLE_INTEGRATOR,
        outputs={"y1": "p", "y2": "v"},
        network='agents = 8\ntopology = "cycle"',
        design="order = 1\ngain_limit = 10.0",
    )
    bound = proved_bound(posed)
    return network_of(posed, bound).loop(1), claim_of(posed, bound)


@pytest.mark.slow
def test_a_large_search_does_not_depend_on_the_number_of_processes() -> None:
    search = GainSearch.of(*eight_carts(), 10.0)
    one, two = (search_gains(search, starts=2, seed=0, jobs=jobs).outcomes[0] for jobs in (1, 2))
    np.testing.assert_array_equal(one.K, two.K)
    assert one.history == two.history


def test_a_start_whose_time_is_over_says_so() -> None:
    search = GainSearch.of(*eight_carts(), 10.0)
    cut = run_start(search, None, 0, 0, deadline=Deadline(at=float("-inf")))
    assert not np.isfinite(cut.at.rho)
    assert search_gains(search, starts=1, seed=0, jobs=1, deadline=Deadline(at=float("-inf"))).cut
