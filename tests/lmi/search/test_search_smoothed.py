"""The smoothed norm: its slope against differences, its level against what decides, and what a descent reaches."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lmi_cases import ALPHA, arms, claim, problem, published
from scipy.linalg import block_diag, eigh

from lockstep.check.continuous.inequality import Claim
from lockstep.lmi.analysis.certificate_sdp import least_rho
from lockstep.lmi.proposal import claim_of, proved_bound
from lockstep.lmi.search import GainSearch, search_time
from lockstep.lmi.search.smoothed_norm import SmoothedNorm, norm_descent, refined_to_maximum
from lockstep.model.agents.agent import Agent
from lockstep.model.assembly import network_of
from lockstep.model.graphs.graph import Graph
from lockstep.model.network import Network

DELTAS = [(0.0,) * 4, (0.02, 0.0, 0.01, 0.02)]

ASKED: list[dict[str, np.ndarray]] = [
    {},
    {"W": np.array([[0.3]]), "states": np.array([0.0, 1.0, 0.0, 2.0]), "outputs": np.array([0.1, 0.0])},
]
"""The paper's rho, and one with u weighed, some states disturbed and one output noisy."""


def search(delta: tuple[float, ...] = (0.0,) * 4, asked: dict[str, np.ndarray] | None = None) -> GainSearch:
    """The arms with controllers of order 2 and gains up to 50."""
    network = arms()
    whole = replace(claim(network, 2, ALPHA, delta=delta), **asked or {})
    return GainSearch.of(network.loop(2), whole, 50.0, rate=0.1 if asked else None)


def with_multipliers(norm: SmoothedNorm, what: GainSearch) -> np.ndarray:
    """Return x of the published gains, with the multipliers of their least rho and a little more of each."""
    found = least_rho(what.loop, published().blocks, what.claim)
    assert found is not None
    return norm.pack(published().blocks, 1.05 * np.concatenate([found.m, found.t]) + 1e-6)


@settings(max_examples=10, deadline=None)
@given(
    st.integers(0, 2**31),
    st.sampled_from(DELTAS),
    st.sampled_from([None, 30.0]),
    st.sampled_from([5, 13, 61]),
    st.sampled_from(ASKED),
)
def test_the_slope_is_that_of_differences(
    seed: int, delta: tuple[float, ...], rho_0: float | None, p: int, asked: dict[str, np.ndarray]
) -> None:
    what, generator = search(delta, asked), np.random.default_rng(seed)
    norm = what.norm
    x = with_multipliers(norm, what)
    frequencies = norm.frequencies(x)
    value, slope = norm.value(x, rho_0, p, frequencies)
    assert np.isfinite(value)
    step = 1e-6 * generator.standard_normal(len(x))
    forth, back = (norm.value(x + sign * step, rho_0, p, frequencies)[0] for sign in (1, -1))
    assert slope @ step == pytest.approx((forth - back) / 2, rel=1e-3, abs=1e-10)


@pytest.mark.parametrize("delta", DELTAS)
def test_the_slope_of_gains_that_all_share_is_that_of_differences(delta: tuple[float, ...]) -> None:
    """Pair weights are shared and fragility multipliers are not: eight agents with both ended in an error."""
    what, K = search(delta), np.repeat(published().blocks[1:2], 3, axis=0)
    norm, found = what.shared_norm, least_rho(what.loop, K, what.claim)
    assert found is not None
    w = np.concatenate([np.full_like(found.m, 1.2 * found.m.max()), found.t])
    x = norm.pack(K, 1.05 * w + 1e-6)
    assert len(x) == K[0].size + 1 + len(found.t)
    frequencies = norm.frequencies(x)
    value, slope = norm.value(x, None, 13, frequencies)
    assert np.isfinite(value)
    step = 1e-6 * np.random.default_rng(1).standard_normal(len(x))
    forth, back = (norm.value(x + sign * step, None, 13, frequencies)[0] for sign in (1, -1))
    assert slope @ step == pytest.approx((forth - back) / 2, rel=1e-3, abs=1e-10)


def test_how_long_a_search_of_many_linear_agents_is_likely_to_take(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a nonlinearity there is nothing for a multiplier to outweigh: eight such agents ended in an error."""
    one = Agent.from_expressions("a", states=["x"], inputs=["u"], outputs={"y": "x"}, dynamics={"x": "u - x"})
    network = Network(one, Graph.topology("complete", 3))
    asked = Claim(0.0, np.eye(1), np.eye(1), np.zeros((3, 4)))
    linear = GainSearch.of(network.loop(1), asked, 50.0)
    monkeypatch.setattr(search_time, "eliminates_P", lambda _loop: True)
    low, high = search_time.range_of_seconds(linear, 1)
    assert 0 < low < high


def test_how_long_a_search_is_likely_to_take_where_modes_have_no_damping() -> None:
    """Modes of 0.1 and 10 rad/s: the time of the loop's response there was an error of a singular matrix."""
    dynamics = {"x": "v", "v": "u - 100*x", "p": "q", "q": "u - 0.01*p"}
    states = list(dynamics)
    one = Agent.from_expressions(
        "a", states=states, inputs=["u"], outputs={"y": "x", "z": "p"}, dynamics=dynamics
    )
    asked = Claim(0.0, np.eye(4), np.zeros((0, 0)), np.zeros((2, 4)))
    undamped = GainSearch.of(Network(one, Graph.topology("complete", 2)).loop(0), asked, 50.0)
    assert undamped.units.time == 1
    low, high = search_time.range_of_seconds(undamped, 1)
    assert 0 < low < high


@pytest.mark.parametrize(("delta", "asked"), [(DELTAS[0], {}), (DELTAS[1], {}), (DELTAS[0], ASKED[1])])
def test_the_level_is_the_rho_that_the_inequality_has(
    delta: tuple[float, ...], asked: dict[str, np.ndarray]
) -> None:
    """By the Kalman-Yakubovich-Popov lemma, for the same multipliers; the certificate's own are the best ones."""
    what = search(delta, asked)
    norm, found = what.norm, least_rho(what.loop, published().blocks, what.claim)
    assert found is not None
    x = norm.pack(published().blocks, np.concatenate([found.m, found.t]) * (1 + 1e-6))
    frequencies = np.union1d(norm.frequencies(x), np.geomspace(1e-3, 1e3, 4000))
    level = np.sqrt(norm.level(x, None, frequencies))
    assert level == pytest.approx(found.rho, rel=2e-3)
    # The must-fail beside it: a rho_0 below has a gain above one, and one above has a gain below.
    assert norm.level(x, 0.98 * level, frequencies) > 1 > norm.level(x, 1.02 * level, frequencies)


@pytest.mark.parametrize(("delta", "asked"), [(DELTAS[0], {}), (DELTAS[1], {}), (DELTAS[1], ASKED[1])])
def test_the_gain_is_the_largest_of_psi_against_d(
    delta: tuple[float, ...], asked: dict[str, np.ndarray]
) -> None:
    """Gains that may be off are more signals than there are states: a smaller matrix with the same eigenvalues serves."""
    what, rho_0 = search(delta, asked), 30.0
    norm = what.norm
    x = with_multipliers(norm, what)
    K, w = norm.unpack(x)
    frequencies = norm.frequencies(x)
    A, into = what.loop.A_cl(K), norm._into(K)
    X = np.linalg.solve(1j * frequencies[:, None, None] * np.eye(len(A)) - A, into)
    Psi = norm._Psi(K, norm.weight + np.tensordot(w, norm.W, 1), X)
    D = block_diag(np.tensordot(w, norm.D, 1), rho_0**2 * np.eye(into.shape[1] - norm.n_v))
    expected = [eigh(one, D, eigvals_only=True)[-1] for one in Psi]
    assert norm.levels(x, rho_0, frequencies) == pytest.approx(
        np.array(expected), rel=1e-9, abs=1e-12 * max(expected)
    )
    found = norm._response(K, w, rho_0, frequencies)
    assert found is not None
    assert (found.M.shape[1] < len(D)) == any(delta)


@pytest.mark.slow
def test_without_multipliers_the_level_is_the_norm_that_python_control_computes() -> None:
    """A linear loop: the H-infinity norm from xi to (R^1/2 x_d, Q^1/2 x_C) of orthonormal coordinates."""
    import control

    network, K = arms(), published().blocks
    weights = claim(network, 2, 0.0)
    what = GainSearch.of(network.loop(2), weights, 50.0)
    norm = what.norm
    x = norm.pack(K, np.full(len(norm.W), 1e9))
    level = np.sqrt(norm.level(x, None, np.geomspace(1e-4, 1e3, 20000)))
    loop = network.loop(2)
    out, n_d = np.linalg.cholesky(np.kron(loop.d.S, weights.R)), loop.E.shape[1]
    C = np.zeros((loop.n_x, loop.n_x))
    C[:n_d, :n_d] = out.T
    C[n_d:, n_d:] = np.kron(np.eye(3), np.linalg.cholesky(weights.Q).T)
    B = loop.E @ np.linalg.inv(np.linalg.cholesky(np.kron(loop.d.S, np.eye(4)))).T
    system = control.ss(loop.A_cl(K), B, C, np.zeros((loop.n_x, n_d)))
    worst = max(np.linalg.norm(system(1j * w), 2) for w in np.geomspace(1e-4, 1e3, 4000))
    scale = what.units.disturbance * np.sqrt(what.units.cost)
    assert scale * level == pytest.approx(worst, rel=1e-3)


def test_outside_the_norm_is_infinite() -> None:
    """A loop that is not stable, gains beyond the limit, a nonlinearity that the multipliers do not hold."""
    what = search()
    norm = what.norm
    x = with_multipliers(norm, what)
    K, w = norm.unpack(x)
    frequencies = norm.frequencies(x)
    assert np.isfinite(norm.value(x, None, 5, frequencies)[0])
    assert norm.value(norm.pack(-10 * K, w), None, 5, frequencies)[0] == np.inf
    assert norm.value(norm.pack(K * 1e4, w), None, 5, frequencies)[0] == np.inf
    assert norm.value(norm.pack(K, 1e-6 * w), None, 5, frequencies)[0] == np.inf


def test_a_descent_from_the_published_gains_more_than_halves_their_rho() -> None:
    """13.24 is certified for the gains of Corollary 1 (reference: 12.15 in other coordinates)."""
    what = search()
    start = least_rho(what.loop, published().blocks, what.claim)
    assert start is not None
    found = norm_descent(what.norm, published().blocks)
    further = refined_to_maximum(what.norm, found)
    assert further.rho <= found.rho < 0.5 * start.rho
    certified = least_rho(what.loop, further.K, what.claim)
    assert certified is not None
    # The certificate chooses its multipliers itself; the level is what a peak between the frequencies may exceed by 1 %.
    assert certified.rho < 1.01 * further.rho
    assert max(np.linalg.norm(block, 2) for block in further.K) < 50.0


def test_gains_with_a_pole_on_the_axis_have_no_rho() -> None:
    """x'' = u - 0.1 sin x and gains of 0: both poles are 0, which no descent can leave with a finite rho."""
    posed = problem(
        dynamics={"x": "v", "v": "u - 0.1*sin(x)"},
        outputs={"y": "x"},
        network='agents = 2\ntopology = "path"',
        design="order = 0\ngain_limit = 10.0",
        agent="centre = false",
    )
    bound = proved_bound(posed)
    network, asked = network_of(posed, bound), claim_of(posed, bound)
    found = norm_descent(GainSearch.of(network.loop(0), asked, 10.0).norm, np.zeros((2, 1, 1)))
    assert not np.isfinite(found.rho)
