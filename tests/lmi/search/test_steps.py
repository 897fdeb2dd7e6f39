"""The steps of the search, one by one: stabilise, the nonlinear program, one start, the search."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lmi_cases import DOUBLE_INTEGRATOR, arms, problem

from lockstep.check.continuous.inequality import Claim
from lockstep.check.system.loop import Loop
from lockstep.lmi.analysis.certificate_sdp import least_rho
from lockstep.lmi.analysis.rounding import short_gains
from lockstep.lmi.proposal import claim_of, proved_bound
from lockstep.lmi.quasi_newton import descend
from lockstep.lmi.search import GainSearch, search_gains
from lockstep.lmi.search.barrier import BarrierPoint, InteriorProgram, NewtonLimits
from lockstep.lmi.search.random_start import homotopy, run_start
from lockstep.lmi.search.smoothed_norm import Descended
from lockstep.lmi.search.stabilise import abscissa, real_part, stabilise
from lockstep.model.assembly import network_of

PENDULUM = {"a": "b", "b": "-a - sin(a) + u"}


def pendulums(design: str = "order = 1\ngain_limit = 10.0", **options: str) -> tuple[Loop, Claim]:
    """Two pendulums that measure angle and rate."""
    made = problem(
        dynamics=PENDULUM,
        outputs={"y1": "a", "y2": "b"},
        network=options.get("network", 'agents = 2\ntopology = "path"'),
        design=design,
    )
    bound = proved_bound(made)
    return network_of(made, bound).loop(made.order), claim_of(made, bound)


@settings(max_examples=20)
@given(st.integers(0, 2**32), st.sampled_from([0, 1, 2]))
def test_the_slope_of_the_abscissa_is_its_finite_difference(seed: int, order: int) -> None:
    generator = np.random.default_rng(seed)
    loop = arms().loop(order)
    K = generator.standard_normal((3, order + 1, order + 2))
    values = np.linalg.eigvals(loop.A_cl(K))
    worst = values[np.argmax(values.real)]
    rest = values[np.abs(values - worst) > 1e-12]
    if np.abs(rest[np.abs(rest - worst.conj()) > 1e-12].real - worst.real).min(initial=1.0) < 1e-3:
        return  # near a kink, where it has no slope
    step = generator.standard_normal(K.shape)
    h = 1e-6
    difference = (abscissa(loop, K + h * step)[0] - abscissa(loop, K - h * step)[0]) / (2 * h)
    value, slope = abscissa(loop, K)
    assert value == pytest.approx(values.real.max())
    assert float((slope * step).sum()) == pytest.approx(difference, rel=1e-3, abs=1e-3)


def test_descend_finds_a_kink() -> None:
    """|x| + 0.1 x^2 in two dimensions, at 0: nonsmooth, where a plain gradient step would jump across for ever."""

    def objective(x: np.ndarray) -> tuple[float, np.ndarray]:
        return float(np.abs(x[0]) + 10 * np.abs(x[1]) + 0.1 * (x @ x)), np.sign(x) * [1, 10] + 0.2 * x

    end = descend(objective, np.array([3.0, -7.0]), 200)
    assert objective(end)[0] < 1e-3


def test_stabilise_stabilises_the_arms_and_never_raises_the_abscissa() -> None:
    loop = arms().loop(2)
    for seed in range(3):
        K = np.random.default_rng(seed).standard_normal((3, 3, 4))
        found, value = stabilise(loop, K)
        assert value == abscissa(loop, found)[0] < 0
        # The weight on the gains may trade a little abscissa for them, not more than it weighs.
        assert value <= abscissa(loop, K)[0] + 1e-3 * float(np.mean(K**2))


def test_stabilise_cannot_do_the_impossible() -> None:
    """Position alone and no dynamics: x'' = -d (x_i - x_j) has undamped modes whatever d is."""
    made = problem(dynamics=DOUBLE_INTEGRATOR, outputs={"y": "p"}, design="order = 0")
    loop = network_of(made, proved_bound(made)).loop(0)
    assert stabilise(loop, np.random.default_rng(0).standard_normal((3, 1, 1)))[1] >= -1e-6


def test_the_nonlinear_program_improves_and_keeps_to_the_gain_limit() -> None:
    loop, weights = pendulums()
    K = np.array([[[-3.0, 0.1, 0.2], [0.3, -1.0, -1.0]], [[-2.0, 0.2, 0.1], [0.2, -1.0, -2.0]]])
    start = least_rho(loop, K, weights)
    assert start is not None
    better = InteriorProgram(loop, weights, 6.0).improve(BarrierPoint(K, start), "rho", NewtonLimits(100))
    found = least_rho(loop, better.K, weights)
    assert found is not None
    assert found.rho < 0.9 * start.rho
    assert max(np.linalg.norm(block, 2) for block in better.K) <= 6.0 * (1 + 1e-6)


def test_one_start_is_a_function_of_its_seed() -> None:
    search = GainSearch.of(*pendulums("order = 0\ngain_limit = 10.0"), 10.0)
    first, again, other = (run_start(search, None, 3, index) for index in (1, 1, 2))
    np.testing.assert_array_equal(first.at.K, again.at.K)
    assert first.rank == again.rank
    assert not np.array_equal(first.at.K, other.at.K)


def test_every_other_start_has_equal_gains() -> None:
    """The descent on the abscissa may part them again, where the graph is not symmetric: here it is."""
    search = GainSearch.of(*pendulums("order = 0\ngain_limit = 10.0"), 10.0)
    K = run_start(search, None, 0, 1).at.K
    np.testing.assert_allclose(K[0], K[1], rtol=1e-6)


@pytest.mark.slow  # two processes take seconds to come up
def test_the_search_does_not_depend_on_the_number_of_processes() -> None:
    search = GainSearch.of(*pendulums("order = 0\ngain_limit = 10.0"), 10.0)
    one, two = (search_gains(search, starts=2, seed=0, jobs=jobs).outcomes[0] for jobs in (1, 2))
    assert one.index == two.index
    np.testing.assert_array_equal(one.K, two.K)
    told: list[float] = []
    search_gains(search, starts=2, seed=0, jobs=1, tell=told.append)
    assert told == sorted(told)
    assert told[-1] == 1.0


@pytest.mark.slow
def test_what_comes_first_ships_best() -> None:
    """With a score that prefers the larger rho, the order of the outcomes is turned around."""
    search = GainSearch.of(*pendulums("order = 0\ngain_limit = 10.0"), 10.0)
    by_rho = search_gains(search, starts=3, seed=0, jobs=1).outcomes
    assert [one.rho for one in by_rho] == sorted(one.rho for one in by_rho)
    away = search_gains(
        search, starts=3, seed=0, jobs=1, score=lambda K, _m: 1e3 - float(np.abs(K).max())
    ).outcomes
    assert [one.sampled for one in away] == sorted(one.sampled for one in away)


@pytest.mark.slow
def test_a_history_never_rises() -> None:
    search = GainSearch.of(*pendulums(), 10.0)
    for one in search_gains(search, starts=2, seed=0, jobs=1).outcomes:
        assert all(b <= a * (1 + 1e-9) for a, b in zip(one.history[:-1], one.history[1:], strict=True))


def test_every_start_of_an_easy_problem_leads_somewhere() -> None:
    """Two pendulums are stabilised by D = [-1, -1]."""
    search = GainSearch.of(*pendulums(), 10.0)
    assert all(np.isfinite(run_start(search, None, 0, index).at.rho) for index in range(4))


def at_rest(K: np.ndarray) -> Descended:
    """Gains that no descent has moved, with no rho known."""
    return Descended(K, np.ones(0), np.inf, np.inf)


def test_a_climb_tells_how_far_it_came() -> None:
    """Static gains on two pendulums that measure the angle alone: agreement needs the rate."""
    search = GainSearch.of(*pendulums(), 10.0)
    K = np.array([[[-3.0, 0.1, 0.2], [0.3, -1.0, -1.0]], [[-2.0, 0.2, 0.1], [0.2, -1.0, -2.0]]])
    whole = homotopy(search, at_rest(K))
    assert whole is not None
    assert whole.certified == whole.claimed == 1.0
    assert homotopy(search, at_rest(-K)) is None  # not stable: no part of the claim is carried


def test_short_gains_stay_within_the_limit() -> None:
    for seed in range(50):
        K = np.random.default_rng(seed).standard_normal((2, 2, 3))
        K *= 1.5 / np.linalg.norm(K[0], 2)
        assert max(np.linalg.norm(block, 2) for block in short_gains(K, 1.0)) <= 1.0


def test_short_gains_are_short_and_near() -> None:
    K = np.random.default_rng(0).standard_normal((2, 2, 3))
    short = short_gains(K, 50.0)
    np.testing.assert_allclose(short, K, rtol=5e-6)
    assert all(len(f"{abs(x):g}".replace(".", "").lstrip("0")) <= 6 for x in short.ravel())


@pytest.mark.parametrize(("apart", "equal"), [(4e-6, True), (9e-5, True), (2e-4, False)])
def test_gains_that_a_search_leaves_next_to_equal_are_made_equal(apart: float, equal: bool) -> None:
    """Each entry counts by its own size: equal controllers do not move what all agents share, ones that nearly are do."""
    one = np.array([[-50.0, 1e-3], [0.4, 0.0]])
    K = np.stack([one, one * (1 + apart * np.array([[0.0, 1.0], [0.0, 0.0]])), one])
    assert (short_gains(K, 1e3) == one).all() == equal


def test_small_gains_beside_large_ones_keep_their_digits() -> None:
    """A fast controller of a stiff plant: C_C is a thousandth of A_C, and a hundredth of it decides about stability."""
    K = np.array([[[-2059.468, 1216.885], [-0.5904321, 0.35012345]]])
    np.testing.assert_allclose(short_gains(K, 5000.0), K, rtol=5e-6)
    assert short_gains(np.array([[[1e3, 1e-12]]]), 5000.0).tolist() == [[[1e3, 0.0]]]


def test_a_defective_eigenvalue_has_a_slope_that_is_a_number() -> None:
    """A_cl = [0, 1; 0, 0] has one eigenvector, left and right at right angles: the slope of the abscissa is infinite."""
    A, B = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])
    value, slope = real_part(A, [B], [np.eye(2)])
    assert value == 0.0
    assert np.isfinite(slope).all()
    assert np.linalg.norm(slope) > 1e6
