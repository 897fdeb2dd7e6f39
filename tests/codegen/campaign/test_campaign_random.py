"""What is random in a campaign: noise and lost messages, each of its seed."""

import numpy as np
import pytest
from campaign_cases import HORIZON, SAME_MESSAGES

import lockstep
from lockstep.campaign import compute
from lockstep.campaign.compiled.engine import Batch
from lockstep.campaign.compute import columns_of
from lockstep.campaign.disturbance import DROPS, NOISE, gaussians, random_unit
from lockstep.campaign.draw import FAMILIES, draw
from lockstep.workflow.runs.campaign import CampaignOptions, planned

PUSHED = """
[agent]
name = "pendulum"
states = ["angle", "rate"]
inputs = ["u"]
dynamics = { angle = "rate", rate = "-sin(angle) - 0.5*rate + u" }
outputs = { y = "angle" }
[network]
agents = 2
topology = "path"
[design]
order = 0
gain_limit = 5.0
disturbances = { states = { rate = 0.5 } }
"""


def test_noise_is_of_its_seed(sampled):
    layout, periods = sampled.layout, sampled.layout.periods(HORIZON)
    seeds = np.array([7, 7, 8], np.uint64)
    noisy = sampled.run(Batch.at_rest(layout, 3, seeds=seeds, sigma=0.3), HORIZON)
    assert noisy.table[0].tobytes() == noisy.table[1].tobytes()
    assert noisy.states[0] != pytest.approx(noisy.states[2], rel=1e-2)
    given = 0.3 * gaussians(7, periods, 12)[None]
    told = sampled.run(Batch.at_rest(layout, 1, sequences=given), HORIZON)
    # NumPy's and C's logarithm may differ in the last bit.
    assert noisy.states[0] == pytest.approx(told.states[0], rel=SAME_MESSAGES)
    assert noisy["w_squared"][0] == pytest.approx(told["w_squared"][0], rel=1e-12)


def test_the_noise_is_white_and_gaussian():
    found = gaussians(3, 20_000, 5)
    count = found.size
    # Six standard errors: mean 1, variance 2, third moment 15, fourth 96 per sample.
    assert abs(found.mean()) < 6 / np.sqrt(count)
    assert abs(found.var() - 1) < 6 * np.sqrt(2 / count)
    assert abs((found**3).mean()) < 6 * np.sqrt(15 / count)
    assert abs((found**4).mean() - 3) < 6 * np.sqrt(96 / count)
    correlation = np.corrcoef(np.hstack([found[:-1], found[1:]]).T) - np.eye(10)
    assert np.abs(correlation).max() < 6 / np.sqrt(len(found))
    place = np.arange(1000, dtype=np.uint64)
    assert abs(np.corrcoef(random_unit(1, NOISE, place), random_unit(1, DROPS, place))[0, 1]) < 6 / np.sqrt(
        1000
    )


def test_messages_that_do_not_arrive(sampled):
    random = np.random.default_rng(2)
    start = random.normal(size=12)
    rates = [0.0, 0.0, 0.5, 0.5, 1.0]
    seeds = np.array([1, 2, 1, 2, 1], np.uint64)
    found = sampled.run(Batch.at_rest(sampled.layout, 5, x=start, seeds=seeds, drop=np.array(rates)), HORIZON)
    assert found.table[0].tobytes() == found.table[1].tobytes(), "nothing is drawn of nothing"
    assert found["disagreement_final"][2] != found["disagreement_final"][3]
    # Nobody is ever heard: r = 0, and the controllers, which start at zero, do nothing.
    assert found["effort_peak"][4] == 0
    assert found["effort_peak"][0] > 0


@pytest.mark.slow
def test_only_the_states_that_rho_is_a_gain_from_are_disturbed(tmp_path):
    """A force disturbs a rate; nothing moves an angle but its rate, and rho says nothing of what would."""
    (tmp_path / "pushed.toml").write_text(PUSHED)
    lockstep.design(tmp_path / "pushed.toml", output=tmp_path / "design.json")
    plan, _ = planned(tmp_path / "design.json", CampaignOptions("continuous", horizon=20.0, seed=1))
    drawn = draw(plan, 0, 256)
    places = plan.source.layout.places
    for name in ("cosine", "sine", "sigma"):
        angle, rate = np.moveaxis(drawn.batch.rows[:, places[name]].reshape(256, 2, 2), 2, 0)
        assert not angle.any() and rate.any()
    found = dict(zip(columns_of(plan), compute(plan, 0, 256).T, strict=True))
    assert found["covered"].all() and (found["ratio"] <= 1 + 1e-6).all()  # Runge-Kutta's own error
    peak = found["ratio"][drawn.family == FAMILIES.index("peak")]
    assert peak.max() > 0.3, "the scale of 0.5 is counted: a ratio by 1 would be half"
