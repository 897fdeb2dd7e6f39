"""Agents that are unstable alone, held behind a leader that rests; and integrators in gains of one's own."""

import numpy as np
import pytest

import lockstep
from lockstep.check.errors import ClaimError

AGENT = """
[agent]
states = ["x"]
inputs = ["u"]
dynamics = {{ x = "{f}" }}
outputs = {{ y = "x" }}
domain = {{ x = [-1.0, 1.0] }}
[network]
agents = 3
edges = {edges}
[design]
method = "given"
order = {order}
{gains}
[controller]
period = 0.01
[simulation]
horizon = 10.0
initial = [[0.0], [0.2], [-0.1]]
"""
BEHIND, ROUND = "[[2, 1], [3, 1], [3, 2, 0.2]]", "[[2, 1], [3, 2], [1, 3]]"
UNSTABLE = "x - x**3/4 + u"
"""Slopes from 0.25 to 1 on the domain."""


def problem(f: str, edges: str, gains: list[dict[str, float]]) -> lockstep.Problem:
    tables = ("[[design.gains]]\n" + "".join(f"{k} = [[{v}]]\n" for k, v in one.items()) for one in gains)
    return lockstep.Problem.parse(
        AGENT.format(f=f, edges=edges, order=len(gains[0]) // 4, gains="".join(tables))
    )


def test_unstable_agents_come_to_where_a_leader_rests_and_run_away_together_where_they_hear_each_other():
    held = lockstep.design(problem(UNSTABLE, BEHIND, [{"D": 0.0}, {"D": -4.0}, {"D": -4.0}]))
    assert held.certified
    assert held.sampled["certified"]
    assert abs(lockstep.simulate(held).trajectory.x[-1]).max() < 1e-6, "at 0, where agent 1 rests"
    together = lockstep.design(problem(UNSTABLE, ROUND, [{"D": -4.0}] * 3))
    assert together.certified
    x = lockstep.simulate(together, horizon=3.0).trajectory.x[-1]
    assert np.ptp(x) < 1e-2, "they agree"
    assert abs(x).min() > 0.3, (
        "and leave 0: their mean began at 0.033, and below 0.5 grows by e^(0.93 t), 16 times in 3 s"
    )


INTEGRATOR, NONE = {"A": 0.0, "B": 1.0, "C": -1.0, "D": -1.0}, {"A": -1.0, "B": 1.0, "C": -1.0, "D": -1.0}
LEADER = {"A": -1.0, "B": 0.0, "C": 0.0, "D": 0.0}


@pytest.mark.parametrize(
    ("edges", "gains", "carried"),
    [
        (BEHIND, [LEADER, INTEGRATOR, INTEGRATOR], True),
        (BEHIND, [INTEGRATOR] * 3, False),
        (ROUND, [INTEGRATOR] * 3, False),
        (ROUND, [NONE, INTEGRATOR, INTEGRATOR], True),
    ],
)
def test_all_followers_may_integrate_and_all_but_one_of_agents_that_hear_each_other(edges, gains, carried):
    """Of agents in a ring the integrators' sum weighted by w, w'L = 0, has the derivative w'L y = 0: it is a mode at 0."""
    posed = problem("u - x", edges, gains)
    if carried:
        assert lockstep.design(posed).certified
    else:
        with pytest.raises(ClaimError):
            lockstep.design(posed)
