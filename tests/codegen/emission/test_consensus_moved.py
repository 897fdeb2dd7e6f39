"""What a header says of the consensus: whether the controllers move it, held against runs."""

import contextlib
from dataclasses import replace

import numpy as np
import pytest

import lockstep
from lockstep.check.system.loop import Gains
from lockstep.codegen.from_design import ALONE, EQUAL, MOVED, WHERE, specification
from lockstep.model.simulation import Scenario, simulate
from lockstep.verification.closed_loop.measured_gain import network_of_design
from lockstep.workflow.design_file import load

OWN = """
[agent]
states = ["x"]
inputs = ["u"]
dynamics = {{ x = "u - x" }}
outputs = {{ y = "x" }}
limits = {{ u = [-1.0, 1.0] }}
units = {{ u = "1" }}
[network]
agents = 3
topology = "{topology}"
[design]
method = "given"
order = 0
gains = [{{ D = [[-0.5]] }}, {{ D = [[-1.0]] }}, {{ D = [[-0.7]] }}]
[controller]
period = 0.01
"""
START = np.array([[1.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 0.0], [-0.5, 0.0, -0.5, 0.0]])


@pytest.mark.parametrize("same", [True, False])
def test_inputs_cancel_where_gains_are_equal_and_the_header_says_where_they_do_not(root, same):
    """The arms on a cycle, every one heard as much as the others: 1'L = 0, so that the plain sum of inputs counts."""
    stored = load(root / "generated" / "flexible_joint_arms").stored
    if same:
        stored = replace(stored, gains=Gains.from_blocks(np.tile(stored.gains.blocks[:1], (3, 1, 1)), 2))
    run = simulate(network_of_design(stored), stored.gains, Scenario(START, 1.0, 0.005))
    total, largest = np.abs(run.u.sum(axis=1)).max(), np.abs(run.u).max()
    assert total <= 1e-12 * largest if same else total > 0.01 * largest
    assert specification(stored).certificate["where"] == (WHERE if same else WHERE + MOVED)


def test_a_leader_is_moved_by_none(root):
    stored = load(root / "docs" / "gallery" / "designs" / "carts.json").stored
    assert len(stored.problem.graph().roots) == 1
    assert specification(stored).certificate["where"] == WHERE


def test_agents_that_run_away_together_are_said_to():
    """Cylinders with a wrong sign came to agree, and blew up: neither README nor headers said a word of it."""
    text = OWN.format(topology="ring").replace("u - x", "u + x/10")
    said = specification(lockstep.design(lockstep.Problem.parse(text)).stored).certificate
    assert said["where"].startswith(WHERE + ALONE)


@pytest.mark.slow
@pytest.mark.parametrize(("topology", "undirected"), [("cycle", False), ("ring", True)])
def test_method_modal_is_named_where_it_takes_the_graph(topology, undirected):
    """A design on a cycle was told of `method = "modal"`, which then refused its graph."""
    text = OWN.format(topology=topology)
    found = specification(lockstep.design(lockstep.Problem.parse(text)).stored)
    assert found.agents[0].inputs[0].unit == "", "1 is no unit to be read in a header"
    said = found.certificate
    assert said["where"] == WHERE + MOVED + EQUAL * undirected
    assert "|u| < 1 for ever" in said["limits"], "the unit 1 is none"
    modal = "\n".join(line for line in text.splitlines() if "gains" not in line).replace('"given"', '"modal"')
    refused = pytest.raises(lockstep.ProblemError, match="undirected")
    with contextlib.nullcontext() if undirected else refused:
        lockstep.design(lockstep.Problem.parse(modal))
