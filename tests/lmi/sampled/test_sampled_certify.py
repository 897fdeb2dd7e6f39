"""The sampled certificate against brute force, and against everything that should break it."""

import json
from dataclasses import replace

import numpy as np
import pytest
from sampled_cases import (
    alpha_that_breaks,
    brute_force_radius,
    controllers,
    disagreement_radius,
    network,
    one_period,
    random_problem,
    with_alpha,
)

import lockstep
from lockstep.check.continuous.inequality import Performance
from lockstep.check.design_file.proofs import sampled_witness_of
from lockstep.check.numbers import as_floats
from lockstep.check.sampled.inequality import metric
from lockstep.check.sampled.l2_gain import proves_rho
from lockstep.check.sampled.loop import sampled_loop
from lockstep.check.system.disagreement import disagreement
from lockstep.lmi.design_json import witness_document
from lockstep.lmi.sampled import SampledVerdict, certify_sampled, max_period, sampled_rho, storage
from lockstep.lmi.sampled.loop_gain import spectral_radius
from lockstep.lmi.sampled.witnesses import in_doubles, period_in_doubles
from lockstep.model.graphs.graph import Graph

EDGES = [(1, 2, 1.0), (2, 3, 1.0), (3, 1, 1.0)]


def oscillators(period=0.1, alpha=1.0, delay=0):
    """Three pendulums that damp their relative velocity: one state each in the controllers."""
    A, B, H = [[0.0, 1.0], [-2.0, -0.5]], [[0.0], [1.0]], [[1.0, 0.0]]
    net = network(A, B, np.eye(2), B, H, EDGES, alpha=alpha, period=period, delay=delay)
    table = [[0.9, 0.01, 0.02], [0.1, -1.0, -2.0]]
    return net, controllers([table] * 3, 1, EDGES)


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 6, 9])
def test_the_linear_loop_is_the_one_of_plain_exponentials(seed):
    net, ones = random_problem(seed)
    loop = in_doubles(net, ones)
    radius = spectral_radius(loop, period_in_doubles(in_doubles(with_alpha(net, 1e-12), ones)))
    plain = disagreement_radius(net, one_period(net, ones, 0.0))
    assert radius == pytest.approx(plain, rel=1e-6)
    found = certify_sampled(net, ones, thorough=False).figures["spectral_radius"]
    assert found == pytest.approx(plain, rel=1e-9), (
        "the figure is of the linear loop, however large the slopes are"
    )


@pytest.mark.parametrize("delay", [0, 1])
def test_pendulums_agree_and_the_proof_is_in_balls(delay):
    net, ones = oscillators(delay=delay)
    verdict = certify_sampled(net, ones, thorough=False)
    assert verdict.certified
    assert brute_force_radius(net, ones) < verdict.decay**0.5, (
        "V decays by `decay`, so the state by its root at least"
    )


def test_a_sign_flipped_is_refused():
    net, ones = oscillators()
    table = ones[1].table.copy()
    table[1, 2] *= -3
    verdict = certify_sampled(net, (ones[0], replace(ones[1], table=table), ones[2]))
    assert not verdict.certified
    assert brute_force_radius(net, (ones[0], replace(ones[1], table=table), ones[2])) > 1


def test_a_period_twenty_times_longer_is_refused():
    net, ones = oscillators()
    assert not certify_sampled(replace(net, period=20 * net.period), ones).certified
    assert brute_force_radius(replace(net, period=20 * net.period), ones) > 1


def test_a_steeper_nonlinearity_is_refused_where_brute_force_breaks():
    net, ones = oscillators()
    edge = alpha_that_breaks(net, ones)
    assert not certify_sampled(with_alpha(net, 1.01 * edge), ones).certified
    assert certify_sampled(with_alpha(net, 0.5 * edge), ones, thorough=False).certified


def test_a_witness_is_proved_again_and_a_spoiled_one_is_not():
    net, ones = oscillators()
    first = certify_sampled(net, ones, thorough=False)
    witness = sampled_witness_of(witness_document(first.witness), "memory")
    again = certify_sampled(net, ones, witness=witness)
    assert again.certified
    assert "spectral_radius" not in again.figures, "nothing was searched for"
    unstable = replace(net, period=20 * net.period)
    for spoiled in (
        replace(witness, decay=0.5),
        replace(witness, kappa=0.0),
        replace(witness, ratio=witness.ratio / 2),
        replace(witness, m=-witness.m),
        replace(witness, P=-witness.P),
    ):
        assert "spectral_radius" in certify_sampled(net, ones, witness=spoiled, thorough=False).figures
    assert not certify_sampled(unstable, ones, witness=witness).certified


@pytest.mark.slow
def test_rounding_counts():
    """A controller of three bits is off by far more than the loop stands; one of float32 is not."""
    net, ones = oscillators()
    coarse = tuple(replace(one, precision=one.precision._replace(u=2.0**-4)) for one in ones)
    assert certify_sampled(net, ones, thorough=False).certified
    assert not certify_sampled(net, coarse).certified


@pytest.mark.slow
def test_the_noise_bound_holds_in_a_simulation():
    """Messages off by at most e in the worst direction of the moment: the distance ends below what is claimed."""
    net, ones = oscillators()
    verdict = certify_sampled(net, ones)
    step, rng, e = one_period(net, ones, -net.alpha), np.random.default_rng(0), 1e-3
    # y_i = x_i here: a message that is off acts as a state that is off, but through the controllers only.
    silent = tuple(replace(one, table=np.zeros_like(one.table)) for one in ones)
    measured = step - one_period(net, silent, -net.alpha)
    x, far, total = np.zeros(len(step)), 0.0, 0.0
    n_x = 6
    quiet = np.linalg.matrix_power(step, 40)
    for k in range(2000):
        noise = np.zeros(len(step))
        noise[:n_x] = e * np.sign(rng.standard_normal(n_x) + (quiet[0, :n_x] > 0) * np.sin(0.15 * k))
        x = step @ x + measured @ noise
        states = x[:n_x].reshape(3, 2)
        distance = np.linalg.norm(states - states.mean(axis=0))
        far, total = max(far, distance), total + distance**2
    assert 0 < far <= verdict.residual_per_message_error * e
    assert np.sqrt(total / 2000) <= verdict.residual_rms_per_message_error * e


@pytest.mark.slow
@pytest.mark.parametrize("delay", [0, 1])
def test_noise_of_messages_is_bounded_tightly(delay):
    """The gain from nu at constant slopes exists, so no bound lies below it; a bound far above would say nothing."""
    net, ones = oscillators(delay=delay)
    verdict = certify_sampled(net, ones)
    exists = max(_message_gain(net, ones, slope * net.alpha) for slope in (-1.0, 0.0, 1.0))
    # Nonlinearities that vary may do more than constant slopes: 1.6 and 1.9 times is what is proved here.
    assert exists <= min(verdict.witness.rms, verdict.witness.ultimate) <= 2.2 * exists
    # A peak may exceed a root mean square, and the smallest ellipsoid the peak.
    assert exists <= verdict.witness.ultimate <= 5 * exists


@pytest.mark.slow
def test_the_distance_from_consensus_is_the_same_in_the_paper_s_coordinates():
    """Rows of L with small weights: |T x| is then a part of the distance, and a bound of it none of the distance."""
    edges = [(i, j, 0.25) for i, j, _ in EDGES]
    net, _ = oscillators(alpha=0.2)
    table = [[0.9, 0.01, 0.02], [0.1, -1.0, -2.0]]
    ones = controllers([table] * 3, 1, edges)
    rows = disagreement(Graph.from_edges(3, edges), "laplacian_rows", exact_arithmetic=True)
    paper = replace(net, d=rows)
    verdicts = [certify_sampled(one, ones) for one in (net, paper)]
    assert all(verdict.certified for verdict in verdicts)
    exists = max(_message_gain(net, ones, slope * net.alpha) for slope in (-1.0, 0.0, 1.0))
    for verdict in verdicts:
        assert exists <= verdict.witness.rms
        assert exists <= verdict.witness.ultimate
    assert verdicts[1].residual_per_message_error == pytest.approx(
        verdicts[0].residual_per_message_error, rel=0.05
    )
    assert verdicts[1].residual_rms_per_message_error == pytest.approx(
        verdicts[0].residual_rms_per_message_error, rel=0.05
    )
    x = np.random.default_rng(3).standard_normal((3, 2))
    x_d = np.kron(as_floats(rows.T), np.eye(2)) @ x.ravel()
    form = as_floats(metric(sampled_loop(paper, ones)))
    assert x_d @ form @ x_d == pytest.approx(np.sum((x - x.mean(axis=0)) ** 2), rel=1e-9)


def test_the_noise_bound_does_not_depend_on_units_of_the_controllers_states():
    """x_C in 2^20 of its unit: powers of two, so the same loop, and nothing that is told of it has a unit of x_C."""
    net, _ = oscillators(alpha=0.2)
    far = []
    for unit in (1.0, 2.0**20):
        table = [[0.9, 0.01 / unit, 0.02 / unit], [0.1 * unit, -1.0, -2.0]]
        verdict = certify_sampled(net, controllers([table] * 3, 1, EDGES))
        far.append(verdict.residual_per_message_error)
    assert far[1] == pytest.approx(far[0], rel=0.02)


def test_a_storage_without_an_end_is_none_and_no_crash(monkeypatch):
    """An X that Cholesky just takes for definite may still be singular to the inverse."""
    unit = np.eye(2)
    problem = storage.StorageProblem(0 * unit, np.diag([1.0, 1e-36]), 0 * unit)
    np.testing.assert_allclose(problem.largest(0.9), np.diag([1.0, 1e36]))
    monkeypatch.setattr(storage, "smallest_storage", lambda *_given: np.ones((2, 2)))
    assert problem.largest(0.9) is None


def _message_gain(net, ones, slope):
    """From the errors of all differences to the distance from consensus at the samples, on a grid of frequencies."""
    step, n = one_period(net, ones, slope), 2
    size, N = len(step), len(ones)
    into = np.zeros((size, 2 * N))
    for i, one in enumerate(ones):
        # What agent i computes from nu_i alone: the step from states at rest with the controllers' tables.
        into[N * n + i, 2 * i : 2 * i + 2] = one.table[0, 1:]
        into[N * n + N + i, 2 * i : 2 * i + 2] = one.table[1, 1:]
    if not net.delay:
        # u acts at once: the flow with u held, then u itself is no state any more.
        flow = _flow(net, slope)
        into[: N * n] = flow @ into[N * n + N :]
    project = np.kron(np.eye(N) - np.ones((N, N)) / N, np.eye(n))
    worst = 0.0
    for w in np.concatenate([np.geomspace(1e-3, np.pi, 2000), _angles(step)]):
        # On the quotient by consensus: the states' mean does not come into the differences.
        x = np.linalg.lstsq(np.exp(1j * w) * np.eye(size) - step, into.astype(complex), rcond=None)[0]
        worst = max(worst, np.linalg.norm(project @ x[: N * n], 2))
    return worst


def _flow(net, slope):
    from scipy.linalg import expm

    A = np.array([[0.0, 1.0], [-2.0 + slope, -0.5]])
    B = np.array([[0.0], [1.0]])
    held = expm(net.period * np.block([[A, B], [np.zeros((1, 3))]]))[:2, 2:]
    return np.kron(np.eye(3), held)


def _angles(step):
    poles = np.linalg.eigvals(step)
    return np.abs(np.angle(poles[np.abs(poles) > 1e-6]))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 3, 4, 5, 7, 10, 12, 14, 16, 17])
def test_never_certifies_what_brute_force_breaks(seed):
    net, ones = random_problem(seed)
    edge = alpha_that_breaks(net, ones)
    assert not certify_sampled(with_alpha(net, 1.001 * edge), ones).certified
    # Tight enough to be of use: constant slopes break at the edge, and arbitrary ones may break well before it.
    inside = certify_sampled(with_alpha(net, 0.6 * edge), ones, thorough=False)
    assert inside.certified
    rng = np.random.default_rng(seed)
    assert brute_force_radius(with_alpha(net, 0.6 * edge), ones, rng, switching=20) < 1


@pytest.mark.parametrize("seed", range(10))
def test_what_is_certified_survives_slopes_that_switch(seed):
    net, ones = random_problem(seed)
    verdict = certify_sampled(net, ones, thorough=False)
    radius = brute_force_radius(net, ones, np.random.default_rng(seed), switching=5)
    assert radius < 1 or not verdict.certified
    assert verdict.certified == (seed not in (0, 6, 8, 9)), "both answers occur"


def test_slopes_that_overflow_are_refused():
    net, ones = oscillators()
    verdict = certify_sampled(replace(net, alpha=1e300), ones)
    assert not verdict.certified
    assert "overflows in doubles" in verdict.reason


def test_the_largest_period_is_confirmed_from_both_sides():
    net, ones = oscillators()
    longest = max_period(net, lambda _period: ones)
    assert longest.certified
    assert certify_sampled(replace(net, period=0.98 * longest.period), ones, thorough=False).certified
    assert not certify_sampled(replace(net, period=1.01 * longest.period), ones, thorough=False).certified
    assert brute_force_radius(replace(net, period=1.5 * longest.period), ones) > 1


def test_where_the_edge_is_not_proved_a_shorter_period_is(monkeypatch):
    """A proof may need far more room than doubles see: the longest period is then a shorter one, not none."""
    net, ones = oscillators()
    edge = max_period(net, lambda _period: ones).period

    def proved_below(network, *_given, **_named):
        return SampledVerdict(network.period < 0.5 * edge, "as far as this goes", network.period, 0)

    monkeypatch.setattr("lockstep.lmi.sampled.period.certify_sampled", proved_below)
    assert 0.3 * edge < max_period(net, lambda _period: ones).period < 0.5 * edge


@pytest.mark.slow
def test_rho_is_above_the_gain_of_the_frequency_response_and_near_it():
    """A disturbance held over each period, at a constant slope, has a gain that no rho can lie below."""
    net, ones = oscillators(period=0.01, alpha=0.2)
    found = sampled_rho(net, ones, Performance(np.eye(2), np.zeros((1, 1))))
    assert found is not None
    # xi held over each period, at the slope that is worst of those tried: a gain that exists, so no rho lies below it.
    below = max(_held_gain(net, ones, slope * net.alpha) for slope in (-1.0, 0.0, 1.0))
    assert below <= found.rho <= 1.5 * below
    written = sampled_witness_of(
        json.loads(json.dumps(witness_document(found.witness), allow_nan=False)), "memory"
    )
    assert proves_rho(sampled_loop(net, ones), Performance(np.eye(2), np.zeros((1, 1))), found.rho, written)
    loop = sampled_loop(net, ones)
    assert proves_rho(loop, Performance(np.eye(2), np.zeros((1, 1))), *found)
    assert not proves_rho(loop, Performance(np.eye(2), np.zeros((1, 1))), 0.9 * below, found.witness)


@pytest.mark.slow
@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_rho_needs_no_pair_weights_in_the_right_scale(scale):
    """R times scale^2 is z times scale, so rho times scale; the weights that prove it grow with R."""
    net, ones = oscillators(period=0.01, alpha=0.2)
    least = sampled_rho(net, ones, Performance(np.eye(2), np.zeros((1, 1)))).rho
    scaled = sampled_rho(net, ones, Performance(scale**2 * np.eye(2), np.zeros((1, 1))))
    # The scale is searched to 0.01 decades about a flat minimum, and rho is rounded to four digits.
    assert scaled is not None and scaled.rho == pytest.approx(scale * least, rel=0.02)


@pytest.mark.slow
def test_rho_is_found_where_the_weights_at_hand_prove_nothing():
    """A millionth of what holds the nonlinearity: no rho goes with these, and others are looked for."""
    net, ones = oscillators(period=0.01, alpha=0.2)
    weights = Performance(np.eye(2), np.zeros((1, 1)))
    least = sampled_rho(net, ones, weights).rho
    assert sampled_rho(net, ones, weights, np.full(3, 1e-6)).rho == pytest.approx(least, rel=0.02)


def _held_gain(net, ones, slope):
    """From held disturbances to the states at the start of each period, on a grid of frequencies: below the gain."""
    from scipy.linalg import expm

    step = one_period(net, ones, slope)
    n = 2
    A = np.array([[0.0, 1.0], [-2.0 + slope, -0.5]])
    held = expm(net.period * np.block([[A, np.eye(n)], [np.zeros((n, 2 * n))]]))[:n, n:]
    into = np.zeros((len(step), 3 * n))
    into[: 3 * n] = np.kron(np.eye(3), held)
    project = np.kron(np.eye(3) - np.ones((3, 3)) / 3, np.eye(n))
    worst = 0.0
    for w in np.geomspace(0.02, 20, 300):
        z = np.exp(1j * w * net.period)
        x = np.linalg.solve(z * np.eye(len(step)) - step, into @ project)[: 3 * n]
        worst = max(worst, np.linalg.norm(project @ x, 2))
    return worst


LOOP = [[0.0, 1.0], [-2.0, -0.5]], [[0.0], [1.0]], [[1.0, 0.0]]
"""A, B and H of an agent that a proportional-derivative gain of its angle and its speed brings to agreement."""


@pytest.mark.slow
@pytest.mark.parametrize("unit", [1.0, 2.0**-20, 2.0**33])
@pytest.mark.parametrize("delay", [0, 1])
def test_units_of_outputs_and_inputs_are_no_matter_of_rounding(unit, delay):
    """The speed in other units, and two inputs that add up in other units, with powers of two: the same loop to the bit."""
    A, B, H = LOOP
    edges, verdicts = [(1, 2, 1.0), (2, 1, 1.0)], []
    for outputs, inputs in ((1.0, 1.0), (unit, unit)):
        C, second = np.diag([1.0, 1 / outputs]), np.array([0.0, 1 / inputs])
        net = network(A, np.c_[B, second].tolist(), C, B, H, edges, N=2, alpha=1.0, period=0.05)
        D = np.array([[-1.0, -0.5 * outputs], [-1.0 * inputs, -0.5 * outputs * inputs]])
        verdicts.append(certify_sampled(replace(net, delay=delay), controllers([D] * 2, 0, edges)))
    plain, scaled = verdicts
    assert plain.certified
    assert scaled.certified, scaled.reason


@pytest.mark.slow
def test_a_certificate_that_rounding_alone_takes_says_so():
    """Two sensors of one angle whose gains cancel but for -2: float32 rounds each by some 2^-23 of 2^20, which is 1/8."""
    A, B, H = LOOP
    edges, C = [(1, 2, 1.0), (2, 1, 1.0)], [[1.0, 0.0], [0.0, 1.0], [1.0, 0.0]]
    net = network(A, B, C, B, H, edges, N=2, alpha=1.0, period=0.05)
    for large, certified in ((1.0, True), (2.0**20, False)):
        gains = np.array([[-2.0 - large, -1.0, large]])
        verdict = certify_sampled(net, controllers([gains] * 2, 0, edges))
        assert verdict.certified is certified
    assert "without rounding there is one" in verdict.reason
    assert "gain_limit" in verdict.reason


@pytest.mark.slow
@pytest.mark.parametrize(
    ("weight", "u", "xi"),
    [
        (0.01, 1e5, 1.0),
        (0.01, 1e-5, 1.0),
        (0.01, 1.0, 1e-8),
        (0.01, 1.0, 1e8),
        (0.0, 1e5, 1.0),
        (0.0, 1e-5, 1.0),
    ],
)
def test_the_sampled_rho_knows_no_units(weight: float, u: float, xi: float) -> None:
    """x'' = b v - sin x, v one period late: with v in units of 1/u, or disturbances in units of 1/xi, it is the same loop,
    whose rho is xi times as large."""

    def rho(u: float, xi: float) -> float:
        posed = lockstep.Problem.parse(f"""
            agent.name = "unit"
            agent.states = ["x", "v"]
            agent.inputs = ["w"]
            agent.dynamics = {{ x = "v", v = "{1 / u!r}*w - 0.2*sin(x) - v" }}
            agent.outputs = {{ y = "x" }}
            network = {{ agents = 2, topology = "path" }}
            controller = {{ period = 0.05, delay = 1 }}
            [design]
            method = "given"
            order = 0
            weights = {{ state = 1.0, input = {weight / u**2!r} }}
            disturbances = {{ states = {xi!r}, outputs = 0.0 }}
            gains = [{{ D = [[{-u!r}]] }}, {{ D = [[{-u!r}]] }}]
        """)
        return lockstep.design(posed).sampled["rho"]

    assert rho(u, xi) / xi == pytest.approx(rho(1.0, 1.0), rel=0.01), (
        "SLACKS leave 0.1 % or 0.2 % to rounding"
    )
