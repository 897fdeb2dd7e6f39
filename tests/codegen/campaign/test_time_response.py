"""Runs of the compiled loop as python-control and pandas have them: the data of input_output_response, column by column."""

import sys
from pathlib import Path

import control
import numpy as np
import pytest

import lockstep
from lockstep.check.errors import ProblemError
from lockstep.model.simulation.results.exchange import to_pandas, to_time_response

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def arms() -> lockstep.Design:
    return lockstep.load(ROOT / "generated" / "flexible_joint_arms")


START = np.linspace(-0.8, 0.9, 12).reshape(3, 4)


def theirs(arms, t, xi):
    options = {"rtol": 1e-10, "atol": 1e-12, "max_step": 0.005}
    state = np.concatenate([START.ravel(), np.zeros(6)])
    return control.input_output_response(arms.to_control(), t, xi, state, solve_ivp_kwargs=options)


@pytest.mark.parametrize("size", [0.0, 0.4])
def test_the_compiled_response_is_that_of_input_output_response(arms, size):
    xi = size * np.linspace(-1, 1, 12).reshape(3, 4)
    ours = arms.response(1.0, START, xi)
    assert isinstance(ours, control.TimeResponseData)
    other = theirs(arms, ours.time, np.repeat(xi.reshape(12, 1), len(ours.time), axis=1))
    for what in ("input_labels", "output_labels", "state_labels"):
        assert getattr(ours, what) == getattr(other, what)
    np.testing.assert_allclose(ours.outputs, other.outputs, atol=1e-6)
    np.testing.assert_allclose(ours.states, other.states, atol=1e-6)
    np.testing.assert_allclose(ours.inputs, other.inputs)


def test_a_disturbance_given_period_by_period_is_held(arms):
    xi = np.zeros((200, 12))
    xi[100:, 1] = 2.0
    ours = arms.response(1.0, START, xi)
    quiet = arms.response(1.0, START)
    before, after = ours.time <= 0.5 + 1e-9, ours.time > 0.6
    np.testing.assert_allclose(ours.outputs[:, before], quiet.outputs[:, before], atol=1e-12)
    assert np.abs(ours.outputs[:, after] - quiet.outputs[:, after]).max() > 0.01
    assert ours.inputs[1, -1] == 2.0


def test_what_cannot_be_run_is_said(arms):
    with pytest.raises(ProblemError, match="3 x 4"):
        arms.response(1.0, np.zeros(5))
    with pytest.raises(ProblemError, match="xi"):
        arms.response(1.0, None, np.zeros((7, 12)))


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("a",), "horizon"),
        ((np.nan,), "horizon"),
        ((-1.0,), "both above 0"),
        ((1e9,), "at most"),
        ((1.0, "x"), "start"),
        ((1.0, np.full((3, 4), np.inf)), "start"),
        ((1.0, None, abs), "xi"),
    ],
)
def test_what_is_no_run_is_refused(arms, arguments, said):
    with pytest.raises(ProblemError, match=said):
        arms.response(*arguments)
    with pytest.raises(ProblemError, match="both above 0"):
        arms.response(1.0, step=0.0)


def test_a_simulation_as_a_table_and_as_a_response(arms):
    pandas = pytest.importorskip("pandas")
    run = lockstep.simulate(arms, horizon=0.5)
    frame, response = run.to_pandas(), run.to_control()
    assert isinstance(frame, pandas.DataFrame)
    np.testing.assert_array_equal(frame["arm2_theta_l"], run.trajectory.x[:, 1, 2])
    np.testing.assert_array_equal(frame.index, run.trajectory.t)
    k = response.output_labels.index("arm3_u")
    np.testing.assert_array_equal(response.outputs[k], frame["arm3_u"])
    assert to_time_response(run.trajectory).to_pandas().shape[0] == len(frame)


def test_without_pandas_it_says_what_to_install(arms, monkeypatch):
    run = lockstep.simulate(arms, horizon=0.1)
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ProblemError, match="notebook"):
        to_pandas(run.trajectory)
