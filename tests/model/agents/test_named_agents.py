"""The agents the project names, as a user writes them: each bound against the slopes that function values alone show."""

import math

import numpy as np
import pytest

from lockstep.check.errors import BoundNotProved, ProblemError
from lockstep.model.agents.agent import Agent
from lockstep.model.assembly import bound_of

AGENTS = {
    "arm": {
        "dynamics": {
            "theta_m": "omega_m",
            "omega_m": "-48.6*theta_m - 1.25*omega_m + 48.6*theta_l + 21.6*u",
            "theta_l": "omega_l",
            "omega_l": "19.5*theta_m - 19.5*theta_l - 3.33*sin(theta_l)",
        },
        "alpha": 3.33,
    },
    "chua": {
        "dynamics": {
            "x": "10*(y - x + 5/7*x + 3/14*(abs(x + 1) - abs(x - 1))) + u",
            "y": "x - y + z",
            "z": "-14.87*y",
        },
        "alpha": 30 / 7,  # the linear 5/7 x belongs to A; what is left has slopes 0 and 10 * 3/7
    },
    "actuator": {
        "dynamics": {"p": "v", "v": "-0.4*v + 7.5*min(max(a, -1), 1)", "a": "20*(u - a)"},
        "alpha": 7.5,
    },
    "pendulum": {
        "dynamics": {"angle": "rate", "rate": "-9.81*sin(angle) - 0.3*tanh(40*rate) - 0.1*rate + u"},
        "alpha": math.hypot(9.81, 12.0),
    },
    "kinematics": {
        "dynamics": {
            "roll": "p + q*sin(roll)*tan(pitch)",
            "pitch": "q*cos(roll)",
            "p": "u",
            "q": "0.62*p*2 + v",
        },
        "inputs": ["u", "v"],
        "domain": {"roll": (-0.7, 0.7), "pitch": (-0.7, 0.7), "q": (-3.0, 3.0)},
        "gap": 1.02,  # two components: scales that keep G and H exact may cost 2 % (`assembly.ALLOWED_GAP`)
    },
    "attitude": {
        "dynamics": {
            "roll": "p",
            "pitch": "q",
            "p": "u",
            "q": "0.62*p*r + 2.4*sin(pitch)*cos(roll) + v",
            "r": "w",
        },
        "inputs": ["u", "v", "w"],
        "domain": {"roll": (-0.7, 0.7), "pitch": (-0.7, 0.7), "p": (-3.0, 3.0), "r": (-3.0, 3.0)},
    },
    "van_der_pol": {
        "dynamics": {"x": "y", "y": "(1 - x**2)*y - x + u"},
        "domain": {"x": (-2.0, 2.0), "y": (-3.0, 3.0)},
        "alpha": math.hypot(12.0, 3.0),  # a product is one term: the slopes of (1 - x^2) y
    },
}


def agent(name, *, centre=False):
    given = AGENTS[name]
    states = list(given["dynamics"])
    return Agent.from_expressions(
        name,
        states=states,
        inputs=given.get("inputs", ["u"]),
        dynamics=given["dynamics"],
        outputs={f"y{k}": state for k, state in enumerate(states)},
        domain=given.get("domain", {}),
        centre=centre,
    )


def sampled(plant, bound, count=60_000):
    """The largest |D_w^-1 J D_v| over random points and corners, J from central differences of phi's values."""
    phi, box = plant.lure.phi, plant.argument_box
    generator = np.random.default_rng(0)
    lower, upper = (np.clip(side, -8.0, 8.0)[:, None] for side in (np.array(box.lower), np.array(box.upper)))
    step = 1e-5
    v = lower + (upper - lower) * generator.random((box.size, count))
    v[:, : count // 4] *= 1e-2  # where smooth functions are steepest, and kinks are
    ends = np.where(generator.random(v.shape) < 0.5, lower, upper)
    v[:, -count // 4 :] = np.where(
        generator.random(v[:, -count // 4 :].shape) < 0.8, ends[:, -count // 4 :], v[:, -count // 4 :]
    )
    v = np.clip(v, lower + step, upper - step)
    f = phi.map(count)
    columns = [
        (np.asarray(f(v + step * e[:, None], 0.0)) - np.asarray(f(v - step * e[:, None], 0.0))) / (2 * step)
        for e in np.eye(box.size)
    ]
    J = np.stack(columns, axis=-1).transpose(1, 0, 2)
    scaled = J / np.array(bound.output_scale)[:, None] * np.array(bound.input_scale)
    return float(np.linalg.norm(scaled, ord=2, axis=(1, 2)).max())


@pytest.mark.parametrize("centre", [False, True])
@pytest.mark.parametrize("name", AGENTS)
def test_a_named_agent_has_a_bound_that_samples_nearly_reach(name, centre):
    plant = agent(name, centre=centre)
    bound = bound_of(plant)
    seen = sampled(plant, bound)
    assert bound.proved
    # 1e-8: central differences with a step of 1e-5 of values of about ten.
    assert seen * (1 - 1e-8) <= bound.alpha <= AGENTS[name].get("gap", 1.01) * seen
    if "alpha" in AGENTS[name] and not centre:
        assert bound.alpha == pytest.approx(AGENTS[name]["alpha"], rel=1e-5)
        with pytest.raises(BoundNotProved):
            bound_of(plant, alpha=AGENTS[name]["alpha"] * 0.99)


def test_the_arms_to_a_billionth_and_at_once():
    arm = agent("arm")
    bound = bound_of(arm)
    assert abs(bound.alpha - 3.33) <= 1e-9 * 3.33
    assert bound.boxes <= 16
    with pytest.raises(BoundNotProved, match=r"a slope of 3\.33 is reached, above 3\.32") as refused:
        bound_of(arm, alpha=3.32)
    assert 3.33 * abs(math.cos(refused.value.figures["witness"][0])) > 3.32


def test_the_cube_everywhere_is_refused_in_the_names_of_the_file():
    cube = Agent.from_expressions(
        "cube", states=["p"], inputs=["u"], dynamics={"p": "u - p**3"}, outputs={"y": "p"}
    )
    with pytest.raises(ProblemError, match="grows without bound towards infinity") as refused:
        bound_of(cube)
    assert refused.value.where == "[agent.dynamics] p"
    assert "p -> " in refused.value.found
    assert "v1" not in str(refused.value)
    assert "p = [-1.0, 1.0]" in refused.value.remedy
