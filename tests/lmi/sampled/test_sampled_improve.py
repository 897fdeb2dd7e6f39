"""Design for the period: what comes out is better where it ships, and survives periods the start does not."""

from dataclasses import replace

import numpy as np
import pytest
from sampled_cases import brute_force_radius, controllers, network

from lockstep.check.continuous.inequality import Performance
from lockstep.lmi.analysis.gain_limit import limit_barrier
from lockstep.lmi.sampled import certify_sampled, sampled_rho
from lockstep.lmi.sampled.l2_gain import least_rho
from lockstep.lmi.sampled.messages.descent import AgedObjective
from lockstep.lmi.sampled.synthesis.descent import ITERATIONS, STAGES, Descent, DescentPoint
from lockstep.lmi.sampled.synthesis.gains_for_period import (
    AtPeriod,
    StartingGains,
    in_search_units,
    redesigned,
    sampled_rho_of,
)
from lockstep.lmi.sampled.synthesis.tustin import pulled_back, tustin
from lockstep.lmi.sampled.witnesses import in_doubles
from lockstep.lmi.search.stopping import Deadline

EDGES = [(1, 2, 1.0), (2, 1, 1.0)]
ORDER, GAIN_LIMIT = 1, 20.0
WEIGHTS = Performance(np.eye(2), np.eye(1))
K = np.array([[[-1.0, 0.1, 0.1], [0.0, -4.0, -3.0]]] * 2)
"""Two pendulums that are pulled together: the gains of a fast loop, good at short periods."""

START = StartingGains(K, np.ones(1), 3.0)


WEIGHED = Performance(
    np.eye(2), np.eye(1), W=np.array([[0.05]]), states=np.array([1.0, 0.5]), outputs=np.array([0.3, 0.0])
)
"""What u weighs and the noise of one output count as well, and the disturbances have scales."""


def pendulums(period, alpha=1.0, delay=0, weights=WEIGHTS):
    A, B, H = [[0.0, 1.0], [-2.0, -0.5]], [[0.0], [1.0]], [[1.0, 0.0]]
    net = network(A, B, np.eye(2), B, H, EDGES, N=2, alpha=alpha, period=period, delay=delay)
    return AtPeriod(net, EDGES, weights, ORDER, GAIN_LIMIT)


def proved(at, found):
    ones = controllers(tustin(found.K, ORDER, at.network.period), ORDER, EDGES)
    verdict = certify_sampled(at.network, ones)
    return verdict, sampled_rho(at.network, ones, at.weights, found.m)


@pytest.mark.slow
def test_a_design_for_the_period_has_a_smaller_rho_and_is_proved():
    at = pendulums(0.2)
    before, told = sampled_rho_of(at, K, np.ones(1)), list[float]()
    found = redesigned(at, [START], tell=told.append)
    assert told == sorted(told), "each stage is told, so that the time left is known"
    assert len(told) > 3
    assert told[-1] < 1
    verdict, after = proved(at, found)
    assert verdict.certified
    assert after.rho < 0.9 * before.rho
    assert after.rho == pytest.approx(found.rho, rel=0.02)
    assert np.linalg.norm(found.K, 2, axis=(1, 2)).max() <= GAIN_LIMIT


@pytest.mark.slow
def test_the_decay_that_is_asked_for_is_kept():
    """The start decays at 1 1/s; a descent that does not know it ends with a slow mode of a controller, at 0.11 1/s."""
    at = replace(pendulums(0.2), decay=0.5)
    found = redesigned(at, [START])
    A_cl = pendulums(0.2).objective().continuous.A_cl(found.K)
    assert np.linalg.eigvals(A_cl).real.max() < -0.5
    assert proved(at, found)[1].rho < 0.9 * sampled_rho_of(at, K, np.ones(1)).rho


def test_a_descent_ends_where_only_rounding_is_left_to_gain(monkeypatch):
    """Two static gains: some ten steps each power lead there; line searches at the end of what doubles tell took 3 200."""
    A, B, H = [[0.0, 1.0], [-1.0, -0.5]], [[0.0], [1.0]], [[1.0, 0.0]]
    net = network(A, B, [[1.0, 0.0]], B, H, EDGES, N=2, alpha=1.0, period=0.005)
    weights = Performance(np.eye(2), np.zeros((0, 0)), states=np.array([0.0, 0.5]))
    objective = AtPeriod(net, EDGES, weights, 0, 5.0).objective()
    evaluate, asked = objective.sampled, list[float]()

    def counted(K, *others):
        asked.append(float(K[0, 0, 0]))
        return evaluate(K, *others)

    monkeypatch.setattr(type(objective), "sampled", lambda _self, K, *others: counted(K, *others))
    descent = Descent(objective, 5.0, 4.3)
    points = list(descent.stages(DescentPoint(np.full((2, 1, 1), -4.5), np.zeros(1), np.zeros(1))))
    assert len(points) == len(STAGES)
    assert len(asked) < len(STAGES) * ITERATIONS, "not even one for each step that is granted"


def test_where_the_time_is_over_one_stage_of_one_start_is_what_there_is():
    told = list[float]()
    at = replace(pendulums(0.2), deadline=Deadline(at=0.0))
    found = redesigned(at, [START, START], tell=told.append)
    assert len(told) == 2, "a start that is begun, and its first stage"
    assert found.rho <= sampled_rho_of(at, K, np.ones(1)).rho


@pytest.mark.slow
def test_noise_and_inputs_count_in_the_descent_for_the_period():
    """Where they were left to the judge, buck converters with a constant power load ended 13 % above other starts."""
    at = pendulums(0.2, weights=WEIGHED)
    before = sampled_rho_of(at, K, np.ones(1))
    without = redesigned(pendulums(0.2), [START])
    assert sampled_rho_of(at, without.K, without.m).rho > before.rho, (
        "what is best without noise is worse than the start with it"
    )
    assert redesigned(at, [START]).rho < 0.9 * before.rho


@pytest.mark.slow
def test_the_best_of_several_starts_is_kept_and_a_start_is_never_made_worse():
    at = pendulums(0.2)
    once = redesigned(at, [START])
    again = redesigned(at, [replace(START, K=once.K, m=once.m), START])
    assert again.rho <= once.rho


@pytest.mark.slow
def test_a_period_that_the_start_does_not_survive_is_reached():
    at = pendulums(0.5)
    assert brute_force_radius(at.network, at.controllers(tustin(K, ORDER, 0.5))) > 1
    assert sampled_rho_of(at, K, np.ones(1)) is None
    found = redesigned(at, [START])
    verdict, after = proved(at, found)
    assert verdict.certified
    assert after is not None
    assert brute_force_radius(at.network, at.controllers(tustin(found.K, ORDER, 0.5))) < 1


@pytest.mark.parametrize("c", [2.0**-20, 2.0**12])
def test_units_of_the_file_make_no_difference(c):
    """The same pendulums with time counted in units of c, their speeds in 1/c: a descent sees the same numbers."""
    base, (A, B) = pendulums(0.2), ([[0.0, 1.0], [-2.0 / c**2, -0.5 / c]], [[0.0], [1 / c**2]])
    net = network(A, B, np.eye(2), B, [[1.0, 0.0]], EDGES, N=2, alpha=1.0, period=0.2 * c, delay=0)
    weights = Performance(np.diag([1.0, c**2]), np.eye(1), states=np.array([1 / c, 1 / c**2]))
    at, gains = AtPeriod(net, EDGES, weights, ORDER, GAIN_LIMIT), K * [[1 / c, 1 / c, 1.0], [1.0, 1.0, c]]
    inside, units = in_search_units(base, K)
    there, others = in_search_units(at, gains)
    assert there.network.period == inside.network.period
    for name in ("A", "C", "G", "H"):
        assert getattr(there.network.plant, name).tolist() == getattr(inside.network.plant, name).tolist()
    assert (gains / others.gains == K / units.gains).all()
    least = units.rho * sampled_rho_of(inside, K / units.gains, np.ones(1) / units.pair_weight).rho
    assert least == pytest.approx(
        sampled_rho_of(base, K, np.ones(1)).rho, rel=1e-3
    )  # as far as rho is bisected
    scaled = sampled_rho_of(there, gains / others.gains, np.ones(1) / others.pair_weight).rho
    assert others.rho * scaled == pytest.approx(least, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("m", [np.zeros(0), np.zeros(1)])
def test_linear_agents_are_designed_for_their_period_too(m):
    """Their multiplier is idle, and their continuous certificate states none, or 0."""
    at = pendulums(0.5, alpha=0.0)
    assert sampled_rho_of(at, K, m) is None
    found = redesigned(at, [replace(START, m=m)])
    verdict, after = proved(at, found)
    assert verdict.certified
    assert after.rho == pytest.approx(found.rho, rel=0.01)
    # The gain at rest of one pendulum against the other is at least 1 / 2 in its angle, whatever the controllers do not
    # see: with both states measured nothing smaller than a few tenths is possible.
    assert after.rho > 0.1


@pytest.mark.slow
def test_what_no_gains_survive_is_refused():
    """Agents that are unstable: a held input cannot reach them for e^(3 T) = 160 000 times their distance."""
    net = network([[3.0]], [[1.0]], [[1.0]], [[1.0]], [[1.0]], EDGES, N=2, alpha=1.0, period=4.0)
    at = AtPeriod(net, EDGES, Performance(np.eye(1), np.zeros((0, 0))), 0, 10.0)
    start = StartingGains(np.array([[[-4.0]]] * 2), np.ones(1), 3.0)
    assert sampled_rho_of(at.at(0.05), start.K, start.m) is not None
    assert redesigned(at, [start]) is None


@pytest.mark.parametrize(
    ("delay", "alpha", "weights"),
    [(0, 1.0, WEIGHTS), (1, 1.0, WEIGHTS), (0, 0.0, WEIGHTS), (0, 1.0, WEIGHED), (1, 1.0, WEIGHED)],
)
def test_the_slopes_are_those_of_differences(delay, alpha, weights):
    at = pendulums(0.05, alpha, delay, weights)
    loops, rng, h = at.objective(), np.random.default_rng(1), 1e-5
    logs = np.array([0.3]) if alpha else np.zeros(0)
    # Agents that differ: those that are alike have poles that are double, and no slope.
    at_K, step = K + 0.1 * rng.standard_normal(K.shape), rng.standard_normal(K.shape)
    points, frequencies = loops.angles(at_K), loops.frequencies(at_K)

    def sampled(K, logs, log_rho):
        return loops.sampled(K, logs, log_rho, points, 6)

    def continuous(K, logs, log_rho):
        return loops.in_continuous_time(K, logs, log_rho, frequencies, 6, 0.1)

    for log_rho, f in ((1.5, sampled), (-1.0, continuous)):
        here = f(at_K, logs, log_rho)
        up, down = f(at_K + h * step, logs, log_rho), f(at_K - h * step, logs, log_rho)
        assert (here.K * step).sum() == pytest.approx((up.value - down.value) / (2 * h), rel=1e-5)
        up, down = f(at_K, logs, log_rho + h), f(at_K, logs, log_rho - h)
        assert here.log_rho == pytest.approx((up.value - down.value) / (2 * h), rel=1e-5)
        if alpha:
            up, down = f(at_K, logs + h, log_rho), f(at_K, logs - h, log_rho)
            assert here.logs[0] == pytest.approx((up.value - down.value) / (2 * h), rel=1e-5)
    for f in (loops.edge, loops.growth):
        (up, _), (down, _) = f(at_K + h * step), f(at_K - h * step)
        assert (f(at_K)[1] * step).sum() == pytest.approx((up - down) / (2 * h), rel=1e-5)
    (up, _), (down, _) = limit_barrier(at_K + h * step, 20.0), limit_barrier(at_K - h * step, 20.0)
    assert (limit_barrier(at_K, 20.0)[1] * step).sum() == pytest.approx((up - down) / (2 * h), rel=1e-5)


@pytest.mark.parametrize("weights", [WEIGHTS, WEIGHED])
def test_the_slopes_with_late_messages_are_those_of_differences(weights):
    at, rng, h = pendulums(0.05, weights=weights), np.random.default_rng(2), 1e-5
    zero = np.zeros((2, ORDER + 1, ORDER + 2))
    loops = AgedObjective(in_doubles(at.network, at.controllers(zero)), weights, ORDER, 1.0)
    at_K = K + 0.1 * rng.standard_normal(K.shape)
    logs = loops.packed(np.ones(1), np.tile(np.eye(2), (2, 1)))
    step, turn, points = rng.standard_normal(K.shape), rng.standard_normal(logs.shape), loops.angles(at_K)

    def value(K, logs, log_rho):
        return loops.sampled(K, logs, log_rho, points, 6)

    here = value(at_K, logs, 1.5)
    for slope, up, down in (
        ((here.K * step).sum(), (at_K + h * step, logs, 1.5), (at_K - h * step, logs, 1.5)),
        (here.logs @ turn, (at_K, logs + h * turn, 1.5), (at_K, logs - h * turn, 1.5)),
        (here.log_rho, (at_K, logs, 1.5 + h), (at_K, logs, 1.5 - h)),
    ):
        assert slope == pytest.approx((value(*up).value - value(*down).value) / (2 * h), rel=1e-5)


@pytest.mark.parametrize("delay", [0, 1])
@pytest.mark.parametrize("weights", [WEIGHTS, WEIGHED])
def test_a_large_power_mean_crosses_zero_where_rho_is(weights, delay):
    """`least_rho` finds it by a Riccati equation and shares no formula with the response."""
    at = pendulums(0.1, delay=delay, weights=weights)
    loops = at.objective()
    rho = sampled_rho_of(at, K, np.ones(1), (1.0,)).rho
    points = loops.angles(K)
    assert loops.sampled(K, np.zeros(1), np.log(1.02 * rho), points, 2000).value < 0
    assert loops.sampled(K, np.zeros(1), np.log(0.97 * rho), points, 2000).value > 0


def test_a_start_outside_the_gain_limit_is_brought_inside():
    at = pendulums(0.1)
    ends = list(Descent(at.objective(), 4.0, 9.0).stages(DescentPoint(K, np.zeros(1), np.zeros(1))))
    assert ends
    assert all(np.linalg.norm(end.K, 2, axis=(1, 2)).max() < 4.0 for end in ends)


def test_tustin_is_the_one_of_the_layer_that_prints():
    from lockstep.check.sampled.discretise import discretise

    rng = np.random.default_rng(0)
    block, slope, step = rng.standard_normal((3, 1, 3, 4))
    exact = discretise(block[0, :2, :2], block[0, :2, 2:], block[0, 2:, :2], block[0, 2:, 2:], 0.3, "tustin")
    np.testing.assert_allclose(tustin(block, 2, 0.3)[0], exact, rtol=1e-13, atol=1e-15)
    across = (tustin(block + 1e-6 * step, 2, 0.3) - tustin(block - 1e-6 * step, 2, 0.3)) / 2e-6
    assert (pulled_back(block, slope, 2, 0.3) * step).sum() == pytest.approx((slope * across).sum(), rel=1e-7)


FOLLOWS = [(2, 1, 1.0)]
LOCKED = Performance(np.eye(2), np.zeros((0, 0)))


def locked(gain=-4.22):
    """A phase-locked loop, x' = v, v' = -0.92 v - phi + u, that follows another with a gain that its period nearly breaks."""
    net = network(
        [[0.0, 1.0], [0.0, -0.92]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]], FOLLOWS,
        N=2, alpha=1.164, period=0.131,
    )  # fmt: skip
    return AtPeriod(net, FOLLOWS, LOCKED, 0, 9.0), np.array([[[0.0]], [[gain]]])


def test_weights_in_a_scale_that_is_another_loops_are_taken_to_their_own():
    """Over a scan of one weight the least rho is 39.4, at 18; at 200 it is 99, and at 20, a decade below, 1 % above it.

    15 % is what the worst phase of a decade would cost here: 45, at 10 and at 32.
    """
    at, gain = locked()
    ones = controllers(tustin(gain, 0, at.network.period), 0, FOLLOWS)
    loop = in_doubles(at.network, ones)
    scan = [least_rho(loop, LOCKED, np.array([m])) for m in np.geomspace(5, 500, 41)]
    assert sampled_rho(at.network, ones, LOCKED, np.array([200.0])).rho < 1.15 * min(r for r in scan if r)


@pytest.mark.parametrize("weight", [0.01, 0.3, 5.0])
def test_a_descent_starts_from_weights_that_hold_nothing(weight):
    """Below 5.6 no rho is held at all. What each power of the mean leads to may hold nothing for the next, a larger one.

    The one gain is measured at three places: a descent that is stuck at its start ends at 44 to 53, beyond the 10 %.
    """
    at, gain = locked()
    assert sampled_rho_of(at, gain, np.array([weight]), scales=(1.0,)) is None
    least = min(sampled_rho_of(locked(D)[0], locked(D)[1], np.array([16.0])).rho for D in (-4.22, -4.0, -3.7))
    assert redesigned(at, [StartingGains(gain, np.array([weight]), 20.0)]).rho < 1.1 * least
