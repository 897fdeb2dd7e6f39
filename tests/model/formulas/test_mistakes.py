"""Mistakes people make in problem files: each leaves with status 2 and one message, that says all four things."""

import json

import pytest
from typer.testing import CliRunner

from lockstep.cli.main import app

ARMS = "flexible_joint_arms.toml"

# old text, new text, where it is, what was found, what was expected, what to do.
MISTAKES = {
    "a misspelt key": (
        'inputs = ["u"]', 'input = ["u"]', "[agent]", "unknown key `input`", "inputs", "did you mean `inputs`?"
    ),
    "a misspelt state": (
        'theta_m = "omega_m"', 'theta_m = "omega_n"',
        "[agent.dynamics] theta_m", "unknown symbol `omega_n` at column 1", "theta_m, omega_m", "did you mean `omega_m`?",
    ),
    "an equation for a state that is none": (
        'omega_l = "19.5', 'omega_L = "19.5',
        "[agent.dynamics]", "no equation for the state `omega_l`", "time derivative", "did you mean `omega_L`?",
    ),
    "a weight of the wrong shape": (
        "order = 2", "order = 2\nweights = { state = [[1.0, 0.0], [0.0, 1.0]] }",
        "[design.weights] state", "a 2 x 2 matrix for 4 states", "a symmetric 4 x 4 matrix", "",
    ),
    "an unknown function": (
        "sin(theta_l)", "sine(theta_l)",
        "[agent.dynamics] omega_l", "unknown function `sine` at column 39", "sin, cos, tan", "did you mean `sin`?",
    ),
    "a cube": (
        "sin(theta_l)", "theta_l**3",
        "[agent.dynamics] omega_l", "grows without bound towards infinity (where theta_l ->", "sin or tanh",
        "theta_l = [-1.0, 1.0]",
    ),
    "a jump": (
        "sin(theta_l)", "sign(theta_l)",
        "[agent.dynamics] omega_l", "`sign` jumps", "a nonlinearity whose slope is bounded", "leave that point out",
    ),
    "a logarithm of anything": (
        "sin(theta_l)", "log(theta_l)",
        "[agent.dynamics] omega_l", "`log` needs a positive argument, which is not proved (where theta_l near",
        "or a domain where it is", "give a box in [agent.domain], such as theta_l = [0.1, 1.0] (in rad)",
    ),
    "NaN": ("gravity = 3.33", "gravity = nan", "[agent.parameters] gravity", "`gravity` is nan", "a finite number", ""),
    "NaN in a formula": (
        "gravity*sin", "nan*sin", "[agent.dynamics] omega_l", "`nan` is no number", "a finite number", ""
    ),
    "1e400": (
        "gravity = 3.33", "gravity = 1e400",
        "[agent.parameters] gravity", "a number too large for a double", "a finite number", "",
    ),
    "1e400 in a formula": (
        "48.6*theta_m", "1e400*theta_m", "[agent.dynamics] omega_m", "`1e400` is too large", "1.79e308", ""
    ),
    "a state twice": (
        'states = ["theta_m", "omega_m"', 'states = ["theta_m", "theta_m"',
        "[agent] states", "`theta_m` is twice", "names that differ", "",
    ),
    "an agent that is not there": (
        "[3, 1]]", "[3, 4]]",
        "[network] edges", "edge 3, [3, 4], is out of range", "agents from 1 to 3", "`agents` is 3",
    ),
    "agents counted from 0": (
        "[[1, 2], [2, 3], [3, 1]]", "[[0, 1], [1, 2], [2, 0]]",
        "[network] edges", "edge 1, [0, 1], is out of range", "agents from 1 to 3", "count from 1",
    ),
    "an A of its own": (
        "[design]\n", "parameters = [{ stiffness = 50.0 }, {}, {}]\n[design]\n",
        "[network] parameters, entry 1", "d/dt omega_m has -48.6*theta_m, and -50.0*theta_m here",
        "agents that differ in B only", "multiplies inputs only",
    ),
    "an h of its own": (
        "[design]\n", "parameters = [{}, { gravity = 3.4 }, {}]\n[design]\n",
        "[network] parameters, entry 2", "h differs in d/dt omega_l: `(-3.33*sin(theta_l))`",
        "one h for all, or agreement does not last", "multiplies inputs only",
    ),
    "an output that is not linear": (
        'y1 = "theta_m"', 'y1 = "theta_m**2"',
        "[agent.outputs] y1", "`theta_m**2` is not linear", "coefficients, y = C x", "measure the states",
    ),
    "a domain upside down": (
        "[agent.units]", "[agent.domain]\ntheta_l = [1.0, -1.0]\n[agent.units]",
        "[agent.domain] theta_l", "from 1.0 to -1.0", "a lower bound below the upper bound", "",
    ),
}  # fmt: skip


def written(examples, place, old, new):
    text = (examples / ARMS).read_text()
    if "stiffness" in new:
        text = text.replace("gravity = 3.33", "gravity = 3.33, stiffness = 48.6")
        text = text.replace("-48.6*theta_m", "-stiffness*theta_m")
    assert old in text
    (place / "problem.toml").write_text(text.replace(old, new, 1))


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_explained(name, examples, tmp_path, monkeypatch):
    old, new, where, found, expected, remedy = MISTAKES[name]
    monkeypatch.chdir(tmp_path)
    written(examples, tmp_path, old, new)
    result = CliRunner().invoke(app, ["check", "problem.toml", "--json"])
    assert result.exit_code == 2
    error = json.loads(result.stdout)["error"]
    assert error["where"] == f"problem.toml, {where}"
    assert found in error["found"]
    assert expected in error["expected"]
    assert remedy in error["remedy"]
    assert bool(remedy) == bool(error["remedy"])
    assert len(result.stderr.strip().splitlines()) == 1
    assert len(result.stderr) < 500, "a message is read, not searched"


def test_without_a_mistake_there_is_no_message(examples, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    written(examples, tmp_path, "gravity = 3.33", "gravity = 3.4")
    assert CliRunner().invoke(app, ["check", "problem.toml", "--json"]).exit_code == 0
