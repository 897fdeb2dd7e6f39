"""Disturbances, gain errors and channels by themselves."""

import numpy as np
import pytest
from simulation_cases import ARMS

from amini.claims.fragility import errors as ledger_errors
from lockstep.check.errors import ProblemError
from lockstep.model.simulation import Scenario, noise
from lockstep.model.simulation.disturbance import Samples, Sines, Steps, Sum
from lockstep.model.simulation.message_channel import MessageChannel
from lockstep.model.simulation.perturbation import (
    PAPER_DELTA,
    PaperPerturbation,
    check_sizes,
    norms,
    random_perturbation,
)

DELTA = {"A": 0.5, "B": 0.2, "C": 0.1, "D": 0.3}


def test_the_intensity_is_the_variance_of_the_integral_over_one_second():
    """100 samples held for 10 ms each: their integral over 1 s has the variance 100 sigma^2 T^2 = S."""
    S = 0.04
    integrals = [
        noise(50, 40, interval=0.01, horizon=1.0, seed=k, intensity=S).values.sum(axis=0) * 0.01
        for k in range(4)
    ]
    # 8000 integrals: their variance is off by sqrt(2 / 8000) = 1.6 % in the mean, three times that at most.
    assert np.var(integrals) == pytest.approx(S, rel=0.05)


def test_a_seed_fixes_the_noise():
    def draw(seed):
        return noise(2, 3, interval=0.1, horizon=1.0, seed=seed, sigma=1.0).values

    assert np.array_equal(draw(7), draw(7))
    assert not np.array_equal(draw(7), draw(8))


@pytest.mark.parametrize("size", [{}, {"sigma": 1.0, "intensity": 1.0}])
def test_noise_has_one_size(size):
    with pytest.raises(ProblemError):
        noise(2, 1, interval=0.1, horizon=1.0, seed=0, **size)


def test_samples_are_held_and_end():
    held = Samples(np.arange(3.0)[:, None, None] + 1, 0.1)
    # 0.1 * 3 > 0.3 in doubles: an instant is where it is meant to be.
    since = np.array([0.0, 0.05, 0.1, 0.1 + 0.1, 0.30000000000000004, 5.0])
    assert held.at(since, since).ravel().tolist() == [1, 1, 2, 3, 0, 0]


def test_a_sample_shorter_than_a_step_is_refused():
    shaking = Samples(np.ones((10, 3, 4)), 0.005)
    Scenario(np.zeros((3, 4)), 1.0, 0.005, shaking)
    with pytest.raises(ProblemError, match="interval over `step`"):
        Scenario(np.zeros((3, 4)), 1.0, 0.01, shaking)


def test_steps_and_sines_are_on_for_whole_steps():
    on = Steps(np.ones((1, 1)), 0.3, 0.6)
    since = np.arange(10) * 0.1
    assert on.at(since, since).ravel().tolist() == [0, 0, 0, 1, 1, 1, 0, 0, 0, 0]
    sine = Sines(np.ones((1, 1)), np.zeros((1, 1)), 1.0, 0.3, 0.6)
    # at the end of the step before, the stage of an integrator at t + h still belongs to a step that is off
    assert sine.at(np.array([0.3, 0.55]), np.array([0.2, 0.5])).ravel()[0] == 0
    assert sine.at(np.array([0.55]), np.array([0.5])).item() == pytest.approx(np.sin(2 * np.pi * 0.25))


def test_a_sum_is_smooth_if_a_part_is():
    held, smooth = Steps(np.ones((1, 1))), Sines(np.ones((1, 1)), np.ones((1, 1)), 1.0)
    assert Sum((held, held)).hold == "held"
    both, t = Sum((held, smooth)), np.array([0.2])
    assert both.hold == "smooth"
    assert both.at(t, t) == held.at(t, t) + smooth.at(t, t)


def test_the_papers_errors_are_those_of_the_ledger():
    """Written down twice, in the ledger and in the simulation, from the same page."""
    mine = PaperPerturbation(3, 2)
    for t in np.linspace(0, 7, 50):
        assert np.allclose(mine.at(np.array([t]), np.array([t]))[0], ledger_errors(t), rtol=0, atol=1e-15)


def test_as_printed_they_exceed_their_bounds_and_scaled_they_reach_them():
    t = np.linspace(0, 2 * np.pi, 20_001)
    printed, scaled = (norms(PaperPerturbation(3, 2, scaled=s).at(t, t), 2) for s in (False, True))
    for letter, delta in PAPER_DELTA.items():
        assert printed[letter] > 1.2 * delta
        assert scaled[letter] == pytest.approx(delta, rel=1e-12)


def test_scaling_leaves_alone_what_is_within_its_bounds():
    """At t = 0: |Delta A| = 0.5 |[0 0; 0 1]| = 0.5, |Delta D| = 0."""
    t = np.zeros(1)
    printed, scaled = (PaperPerturbation(3, 2, scaled=s).at(t, t)[0, 0] for s in (False, True))
    assert np.array_equal(printed[:2, :2], scaled[:2, :2])
    assert not np.allclose(printed[:2, 2:], scaled[:2, 2:]), "0.2 sqrt 2 is beyond 0.2"


@pytest.mark.parametrize("sizes", [(2, 1, 2), (3, 2, 2), (0, 2, 3)])
def test_random_errors_are_at_the_bound(sizes):
    found = random_perturbation(3, sizes, DELTA, seed=0, interval=0.1, horizon=2.0)
    n_C, m, q = sizes
    assert found.values.shape == (20, 3, n_C + m, n_C + q)
    there = {letter: (letter == "D" or n_C > 0) * delta for letter, delta in DELTA.items()}
    assert norms(found.values, n_C) == pytest.approx(there)
    smallest = np.linalg.svd(found.values[0, 0, n_C:, n_C:])[1].min()
    assert smallest == pytest.approx(DELTA["D"]), (
        "an extreme point of the ball: all singular values are delta"
    )


def test_errors_for_other_controllers_are_refused():
    check_sizes(PaperPerturbation(3, 2), 3, (3, 4))
    with pytest.raises(ProblemError):
        check_sizes(PaperPerturbation(3, 1), 3, (3, 4))


def test_a_converter_rounds_and_clips():
    y = np.array([[0.1, 0.24, 1.9, -5.0, 5.0]])
    # 3 bits to 2.0: multiples of 0.5 from -2 to 1.5
    assert MessageChannel(bits=3, full_scale=2.0).quantised(y).tolist() == [[0.0, 0.0, 1.5, -2.0, 1.5]]
    assert MessageChannel().quantised(y) is y
    single = MessageChannel(real="float32").quantised(np.array([[0.1]]))
    assert single.item() == float(np.float32(0.1)) != 0.1


def test_losses_have_their_probability_and_their_seed():
    lost = ~MessageChannel(drop=0.3, seed=1).arrivals(20_000, 3)
    # 60 000 messages: 0.3 to within 4 sigma = 0.0075
    assert abs(lost.mean() - 0.3) < 0.0075
    assert np.array_equal(lost, ~MessageChannel(drop=0.3, seed=1).arrivals(20_000, 3))
    assert MessageChannel(drop=0.0).arrivals(5, 3).all()
    assert not MessageChannel(drop=1.0).arrivals(5, 3).any()


@pytest.mark.parametrize("bad", [{"delay": -1}, {"drop": 1.5}, {"bits": 1}, {"full_scale": 0.0}])
def test_a_channel_that_means_nothing_is_refused(bad):
    with pytest.raises(ProblemError):
        MessageChannel(**bad)


def test_the_arms_are_the_papers():
    """What the other tests rest on."""
    assert ARMS.graph.laplacian.tolist() == [[1, -1, 0], [0, 1, -1], [-1, 0, 1]]


def test_noise_without_end_is_refused_before_it_is_drawn():
    for horizon in (1e300, 1e9):
        with pytest.raises(ProblemError, match="shorten the horizon"):
            noise(3, 1, interval=1e-3, horizon=horizon, seed=0, sigma=1.0)
