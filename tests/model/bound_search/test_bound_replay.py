"""What the search proposes for a problem, the checker decides with the boxes that the search says, and with no box less."""

from dataclasses import replace
from pathlib import Path

import pytest

from lockstep.check.bound.decide import decide_bound
from lockstep.check.verdict import Verdict
from lockstep.model.agents.agent import Agent
from lockstep.model.assembly import bound_of, bound_with_scales
from lockstep.model.bound_search import Bound
from lockstep.model.problem import load_problem

ROOT = Path(__file__).parents[3]
NAMES = [
    "examples/flexible_joint_arms",
    "examples/quadrotors",
    "examples/literature/chua",
    *(
        f"benchmarks/designs/{name}"
        for name in ("lorenz", "predator_prey", "repressilators", "satellites", "tanks", "reactors")
    ),
]


def decided(agent: Agent, bound: Bound, boxes: int) -> Verdict:
    scales = bound.output_scale, bound.input_scale
    return decide_bound(agent.exact.phi, agent.argument_box, bound.alpha, *scales, bound.entries, boxes=boxes)


@pytest.mark.parametrize("name", NAMES)
def test_a_replay_needs_exactly_the_boxes_of_the_bound(name: str) -> None:
    agent = load_problem(ROOT / f"{name}.toml").agent()
    bound = bound_of(agent)
    assert bound.replay > 0
    assert decided(agent, bound, bound.replay).proved
    assert decided(agent, bound, bound.replay - 1).status == "undecided"
    smaller = replace(bound, alpha=0.99 * bound.lower, lower=0.0)
    assert not decided(agent, smaller, bound.replay).proved
    again = bound_with_scales(agent, bound.alpha, (bound.output_scale, bound.input_scale), bound.entries)
    assert again.replay == bound.replay
