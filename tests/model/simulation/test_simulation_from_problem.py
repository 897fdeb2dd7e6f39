"""[simulation] of a problem file as a scenario."""

import numpy as np
import pytest

from lockstep.check.errors import ProblemError
from lockstep.model.problem import parse_problem
from lockstep.model.simulation.disturbance import Samples, Sines, Steps
from lockstep.model.simulation.from_problem import Changes, scenario_of
from lockstep.model.simulation.perturbation import PaperPerturbation

HEAD = """
[agent]
states = ["p", "v"]
inputs = ["f"]
dynamics = { p = "v", v = "f - tanh(v)" }
outputs = { y = "p" }
[network]
agents = 3
topology = "cycle"
[controller]
period = 0.02
"""


def scenario(text="", *, sampled=False, **changes):
    return scenario_of(parse_problem(HEAD + text), Changes(**changes), sampled=sampled)


def test_the_record_divides_the_period():
    assert scenario().step == pytest.approx(0.005)
    assert scenario().horizon == 20.0


def test_a_long_run_is_recorded_as_finely_as_the_agent_moves():
    text = HEAD.replace("0.02", "60.0").replace("f - tanh(v)", "0.001*(f - v)")

    def step(more="", text=text, **changes):
        return scenario_of(
            parse_problem(text + more), Changes(**{"horizon": 86400.0} | changes), sampled=True
        ).step

    assert step() == pytest.approx(60.0)  # 0.1 s / 0.001 is longer
    assert step(text=text.replace("0.001", "0.01")) == pytest.approx(10.0)
    assert step(horizon=400.0) == pytest.approx(0.005)
    assert step(disturbance="noise") == pytest.approx(60.0)
    with pytest.raises(ProblemError, match=r"steps of 0\.005 s.*shorten the horizon"):
        step(disturbance="sine")
    with pytest.raises(ProblemError, match=r"steps of 0\.005 s"):
        scenario_of(parse_problem(text), Changes(horizon=86400.0), sampled=False)


def test_random_states_go_with_the_seed():
    file = scenario("[simulation]\nseed = 4\nspread = 0.1")
    assert np.array_equal(file.start, scenario("[simulation]\nspread = 0.1", seed=4).start)
    assert not np.array_equal(file.start, scenario("[simulation]\nspread = 0.1", seed=5).start)
    assert np.abs(file.start).max() <= 0.1


def test_random_states_are_well_within_a_domain():
    """4 <= p <= 8 has its middle at 6 and half of the way to its sides is 1, of -0.2 to 1 it is 0.1 about 0.

    0 on a side leaves no room about it; of 0.5 and more, or 0, what is 1 above and half of that around it is well within.
    """
    cases = (
        ("4.0, 8.0", 6.0, 1.0),
        ("-0.2, 1.0", 0.0, 0.1),
        ("-9.0, 9.0", 0.0, 1.0),
        ("0.0, 2.0", 1.0, 0.5),
        ("-2.0, 0.0", -1.0, 0.5),
        ("0.5, inf", 1.5, 0.5),
        ("0.0, inf", 1.0, 0.5),
        ("-inf, 0.0", -1.0, 0.5),
        ("-1.0, inf", 0.0, 0.5),
        ("-1e-9, inf", 1.0, 0.5),
        ("-1e-9, 10.0", 5.0, 1.0),
        ("-inf, inf", 0.0, 1.0),
    )
    for sides, middle, most in cases:
        domain = f"[agent.domain]\np = [{sides}]\n"
        drawn = np.array([scenario(domain, seed=seed).start[:, 0] for seed in range(40)]) - middle
        assert 0.9 * most < np.abs(drawn).max() <= most
        if "inf" in sides:
            continue
        drawn = np.array(
            [scenario(f"{domain}[simulation]\nspread = 0.05", seed=k).start[:, 0] for k in range(40)]
        )
        assert 0.045 < np.abs(drawn - middle).max() <= 0.05


def test_given_states_stay():
    text = "[simulation]\ninitial = [[1.0, 0.0], [2.0, 0.0], [3.0, 0.0]]"
    assert scenario(text, seed=9).start[:, 0].tolist() == [1, 2, 3]


def test_noise_is_held_for_a_period_within_its_times():
    text = '[simulation]\ndisturbance = { kind = "noise", intensity = 0.02, start = 5.0, stop = 10.0 }'
    shaking = scenario(text).disturbance
    assert isinstance(shaking, Samples)
    assert shaking.interval == 0.02
    assert not shaking.values[:250].any()
    assert not shaking.values[500:].any()
    # intensity 0.02 over 0.02 s: sigma = 1; 1500 numbers, 10 % is more than five sigma of their spread
    assert shaking.values[250:500].std() == pytest.approx(1.0, rel=0.1)


def test_sines_and_steps_are_not_the_same_for_all_agents():
    sines = scenario("", disturbance="sine").disturbance
    steps = scenario("", disturbance="step", seed=1).disturbance
    assert isinstance(sines, Sines)
    assert np.ptp(sines.phases, axis=0).min() > 0
    assert isinstance(steps, Steps)
    assert set(np.unique(steps.values)) == {-1.0, 1.0}


LOAD = '[simulation.disturbance]\nkind = "KIND"\namplitude = { v = -1.5 }\nagents = [2]\nstart = 1.0\n'


def test_a_load_on_one_agent_has_its_sign_and_touches_no_other():
    t = np.array([0.0, 0.999, 1.0, 2.0])
    load = scenario(LOAD.replace("KIND", "step")).disturbance.at(t, t)
    assert load[:, 1, 1].tolist() == [0.0, 0.0, -1.5, -1.5]
    assert np.count_nonzero(load) == 2
    waves = scenario(LOAD.replace("KIND", "sine")).disturbance
    assert np.argwhere(waves.values).tolist() == [[1, 1]]
    shaken = scenario(LOAD.replace("KIND", "noise")).disturbance.values
    assert sorted({tuple(one) for one in np.argwhere(shaken)[:, 1:].tolist()}) == [(1, 1)]
    assert shaken[:, 1, 1].std() == pytest.approx(1.5, rel=0.1)  # of 950 samples: 0.034 is one sigma of it


def test_an_intensity_is_of_noise_alone():
    """sigma = (0.08 / 0.02)^1/2 = 2 of the state that is named; a step in its place has the amplitude."""
    text = LOAD.replace("KIND", "noise") + "intensity = 0.08\n"
    shaken = scenario(text).disturbance.values
    assert shaken[:, 1, 1].std() == pytest.approx(2.0, rel=0.1)
    t = np.array([2.0])
    assert scenario(text, disturbance="step").disturbance.at(t, t)[0, 1, 1] == -1.5
    every = scenario('[simulation.disturbance]\nkind = "noise"\namplitude = 0.0\nintensity = 0.08\n')
    assert every.disturbance.values.std() == pytest.approx(2.0, rel=0.1)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("[2]", "[]", "agents"),
        (
            "{ v = -1.5 }",
            "-1.5",
            r"amplitude: `amplitude` is -1.5; expected a finite number, 0 or more[^;]*$",
        ),
        ("v = -1.5", "w = -1.5", r"amplitude: `w` is no state; expected one of `p`, `v`"),
        ("[2]", "[0]", r"agents: agent 0; expected numbers from 1 to 3"),
        ("[2]", "[2, 4]", r"agents: agent 4; expected numbers from 1 to 3"),
    ],
)
def test_a_load_on_what_there_is_not_is_refused_when_the_file_is_read(old, new, said):
    with pytest.raises(ProblemError, match=said):
        parse_problem(HEAD + LOAD.replace("KIND", "step").replace(old, new))


def test_gain_errors_by_name():
    paper = scenario('[simulation.perturbation]\nkind = "paper_scaled"').perturbation
    assert paper == PaperPerturbation(3, 1, scaled=True)
    text = '[design.fragility]\nA = 0.5\n[simulation.perturbation]\nkind = "random"\ninterval = 1.0'
    assert scenario(text).perturbation.values.shape == (20, 3, 3, 3)
    assert scenario("[simulation.perturbation]").perturbation is None


@pytest.mark.parametrize(
    ("text", "sampled", "said"),
    [
        ('[simulation.perturbation]\nkind = "random"', False, "without bounds"),
        ('[simulation.perturbation]\nkind = "paper"', True, "sampled"),
        ('[design]\norder = 1\n[simulation.perturbation]\nkind = "paper"', False, "order 1"),
        ("[simulation.channel]\ndrop = 0.1", False, "continuous"),
        ('[simulation]\ndisturbance = { kind = "worst" }', False, "search"),
        ('[simulation]\ndisturbance = { kind = "sine", intensity = 1.0 }', False, "intensity"),
        ("[simulation.channel]\ndrop = 1.5", True, "drop"),
        ("[simulation.channel]\ndelays = 1", True, "delay"),
    ],
)
def test_what_does_not_fit_is_refused(text, sampled, said):
    with pytest.raises(ProblemError, match=said):
        scenario(text, sampled=sampled)


def test_a_channel_is_for_sampled_controllers():
    channel = scenario("[simulation.channel]\ndrop = 0.1\ndelay = 2\nbits = 12", sampled=True, seed=3).channel
    assert (channel.drop, channel.delay, channel.bits, channel.seed) == (0.1, 2, 12, 3)


def test_files_made_before_these_tables_read_and_write_as_they_did():
    document = parse_problem(HEAD).document()
    assert set(document["simulation"]) == {"initial", "spread", "horizon", "seed", "disturbance"}
    assert "intensity" not in document["simulation"]["disturbance"]
