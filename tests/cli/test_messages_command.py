"""`lockstep check --messages`, and `[network.messages]` in `design` and `certify`: answers and exit statuses."""

import json

import pytest
from typer.testing import CliRunner

from lockstep.cli.main import app

PROBLEM = """
[agent]
states = ["x"]
inputs = ["u"]
dynamics = { x = "u - sin(x)" }
outputs = { y = "x" }
[network]
agents = 2
topology = "complete"
messages = { TABLE }
[design]
method = "given"
gains = [{ D = [[-4.0]] }, { D = [[-4.0]] }]
[controller]
period = 0.05
"""


def run(*words):
    result = CliRunner().invoke(app, [*map(str, words), "--json"])
    return result.exit_code, json.loads(result.stdout)


@pytest.fixture
def designed(tmp_path):
    def made(table):
        problem, output = tmp_path / "problem.toml", tmp_path / "design.json"
        problem.write_text(PROBLEM.replace("TABLE", table))
        return output, *run("design", problem, "-o", output)

    return made


def test_what_is_carried_exits_with_0_and_what_is_not_with_1(designed):
    output, status, said = designed("loss = 0.1")
    assert (status, said["messages"]["certified"], said["messages"]["loss"]) == (0, True, 0.1)
    status, said = run("certify", output)
    assert (status, said["messages"]["certified"]) == (0, True)
    output, status, said = designed("burst = 50")
    assert (status, said["messages"]["certified"]) == (1, False)
    assert said["messages"]["certified_up_to"]["burst"] < 50
    status, said = run("certify", output)
    assert (status, said["ok"], said["messages"]["certified"]) == (1, False, False)


def test_a_table_that_cannot_be_exits_with_2(designed):
    for table in ("loss = 1.5", "lost = 0.1", "delay = [2, 1]", "burst = true"):
        output, status, _ = designed(table)
        assert status == 2
        assert not output.exists()


@pytest.mark.slow
def test_check_tells_the_limits_of_each_fault(designed):
    output, _, _ = designed("loss = 0.1")
    status, said = run("check", output, "--messages")
    assert status == 0
    assert set(said["messages"]) == {"loss", "burst", "delay", "jitter"}
    for one in said["messages"].values():
        assert one["breaks"] is None or one["certified"] < one["breaks"]
    assert run("check", output.parent / "problem.toml", "--messages")[0] == 2
