"""Noise of the sensors: what runs show is what the linear loop computes, and by hand for a pair."""

import dataclasses

import numpy as np
import pytest
from sampled_cases import controllers, network

import lockstep
from lockstep.codegen.sampled_design import sampled_network
from lockstep.codegen.sampled_modes import sampled_controllers
from lockstep.lmi.sampled.sensor_noise import noise_to_inputs
from lockstep.model.problem import Problem
from lockstep.model.simulation.from_problem import scenario_of

BOTH = [(1, 2, 1.0), (2, 1, 1.0)]


def test_noise_of_a_pair_by_hand():
    """x' = u, u_i = -k (y_i - y_j): d+ = (1 - 2 k T) d - 2 k T w, w = nu_1 - nu_2, u_1 = -k (d + w), var w = 2."""
    k, T = 1.5, 0.1
    net = network([[0.0]], [[1.0]], [[1.0]], [[0.0]], [[0.0]], BOTH, N=2, alpha=0.0, period=T, delay=0)
    ones = controllers([[[-k]], [[-k]]], 0, BOTH)
    r = 1 - 2 * k * T
    variance = (2 * k * T) ** 2 * 2 / (1 - r**2)
    found = noise_to_inputs(net, ones)
    assert found == pytest.approx(np.array([[k * (variance + 2) ** 0.5]]), rel=1e-6)
    fast = controllers([[[-11.0]], [[-11.0]]], 0, BOTH)
    assert noise_to_inputs(net, fast) is None, "d+ = -1.2 d"


@pytest.mark.slow
@pytest.mark.parametrize("output", [0, 1])
def test_noise_of_the_arms_in_a_run(root, output):
    """Within 15 %: the slowest pole, 0.24 1/s, leaves of 40 s some twenty independent parts of what is not white."""
    design = lockstep.load(root / "generated" / "flexible_joint_arms")
    document = design.problem.document()
    names = [name for name, _ in document["agent"]["outputs"]]
    channel = {"noise": {names[output]: 0.01}}
    rest = {"initial": [[0.0] * 4] * 3, "horizon": 40.0, "seed": 3, "channel": channel}
    problem = Problem.from_document({**document, "simulation": rest})
    noisy = dataclasses.replace(design, stored=dataclasses.replace(design.stored, problem=problem))
    run = lockstep.simulate(noisy)
    assert not run.measured.covered
    assert "as they were sent" in run.measured.reason
    stored = design.stored
    found = noise_to_inputs(sampled_network(stored), sampled_controllers(stored, problem.controller.period))
    u = run.trajectory.u[len(run.trajectory.t) // 4 :]
    largest = float(np.sqrt((u**2).mean(axis=0)).max())
    assert largest == pytest.approx(0.01 * found[0, output], rel=0.15)


def test_a_channel_with_noise(root):
    """An output that is not named has none, and a name that is no output is told."""
    document = lockstep.load(root / "generated" / "flexible_joint_arms").problem.document()

    def problem(noise):
        return Problem.from_document({**document, "simulation": {"channel": {"noise": noise}}})

    names = [name for name, _ in document["agent"]["outputs"]]
    assert problem({names[1]: 0.5}).sensor_noise.tolist() == [0.0, 0.5]
    assert problem(0.25).sensor_noise.tolist() == [0.25, 0.25]
    assert scenario_of(problem(0.0), sampled=True).channel.is_ideal
    assert not scenario_of(problem(0.25), sampled=True).channel.is_ideal
    with pytest.raises(lockstep.ProblemError, match=r"`z` is no output"):
        problem({"z": 1.0})
    with pytest.raises(lockstep.ProblemError, match="noise"):
        problem(-1.0)


@pytest.mark.slow
def test_the_seed_fixes_the_noise(root):
    design = lockstep.load(root / "generated" / "flexible_joint_arms")
    rest = {"initial": [[0.0] * 4] * 3, "horizon": 0.05, "channel": {"noise": 0.01}}
    problem = Problem.from_document({**design.problem.document(), "simulation": rest})
    noisy = dataclasses.replace(design, stored=dataclasses.replace(design.stored, problem=problem))
    first, again, other = (lockstep.simulate(noisy, seed=seed).trajectory.u for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert (first[1:] != other[1:]).all()
