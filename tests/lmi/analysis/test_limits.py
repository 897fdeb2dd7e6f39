"""What no controller can do: known exactly for these, said before any search, and never of a problem that has a solution."""

import numpy as np
import pytest
from floor_cases import plain
from lmi_cases import DOUBLE_INTEGRATOR, arms, problem

from lockstep.check.errors import Infeasible
from lockstep.lmi.analysis.fundamental_limits import (
    largest_alpha_of_any_controller,
    static_gains_cannot_stabilise,
)
from lockstep.lmi.design import design
from lockstep.lmi.floor.bisection import largest_floor, proves_that_none_carries
from lockstep.lmi.proposal import proved_bound
from lockstep.model.assembly import network_of
from lockstep.model.network import Network
from lockstep.model.problem import Problem


def network(posed: Problem) -> Network:
    return network_of(posed, proved_bound(posed))


def non_minimum_phase(k: float) -> Problem:
    """From u to a - b there is the zero s = 1: (1/(s + 1) - 1.5/(s + 2)) = (1 - s) / (2 (s + 1) (s + 2)).

    Whatever u does, the transfer from w to a - b at s = 1 is that without u, 1/(1 + 1): its norm is 1/2 at least, and
    k sin(a - b) with k above 2 cannot be carried by any controller.
    """
    return problem(
        dynamics={"a": f"-a + u + {k}*sin(a - b)", "b": "-2*b + 1.5*u"},
        outputs={"y1": "a", "y2": "b"},
        network='agents = 2\ntopology = "path"',
        design="order = 1\nstarts = 1",
        agent="centre = false",
    )


def test_the_largest_alpha_is_the_one_a_zero_on_the_right_leaves() -> None:
    most = largest_alpha_of_any_controller(network(non_minimum_phase(1.9)))
    assert most == pytest.approx(2.0, rel=1e-3)


def test_an_alpha_beyond_it_is_refused_without_a_search_and_one_below_is_not() -> None:
    said: list[str] = []
    with pytest.raises(Infeasible, match="no controllers of any order") as error:
        design(non_minimum_phase(2.1), jobs=1, progress=lambda what, _part: said.append(what))
    assert error.value.figures["reachable_alpha"] == pytest.approx(2.0, rel=1e-3)
    assert said
    assert not any("searching" in what for what in said)
    below, above = network(non_minimum_phase(1.9)), network(non_minimum_phase(2.1))
    assert proves_that_none_carries(above.matrices, plain(above.N, 2.1, np.eye(2)))
    assert not proves_that_none_carries(below.matrices, plain(below.N, 1.9, np.eye(2)))
    unbounded = largest_floor(above.matrices, plain(above.N, 2.1, np.eye(2)))
    assert unbounded is not None
    assert unbounded.rho > 1e4


def test_no_limit_is_seen_where_there_is_none() -> None:
    """x' = sin x + u has none; nor have the arms, by gains beyond all measure."""
    scalar = problem(
        dynamics={"x": "sin(x) + u"}, outputs={"y": "x"}, design="order = 1", agent="centre = false"
    )
    assert largest_alpha_of_any_controller(network(scalar)) == np.inf
    assert largest_alpha_of_any_controller(arms()) == np.inf
    linear = problem(dynamics=DOUBLE_INTEGRATOR, outputs={"y": "p"}, design="order = 1")
    assert largest_alpha_of_any_controller(network(linear)) == np.inf


@pytest.mark.parametrize(
    ("dynamics", "outputs", "stuck"),
    [
        (DOUBLE_INTEGRATOR, {"y": "p"}, True),
        (DOUBLE_INTEGRATOR, {"y1": "p", "y2": "v"}, False),
        ({"p": "v", "v": "-0.1*v + u"}, {"y": "p"}, False),  # the trace is -0.1: not shown
        ({"p": "v", "v": "0.1*v + u"}, {"y": "p"}, True),
    ],
)
def test_static_gains_that_move_no_trace(
    dynamics: dict[str, str], outputs: dict[str, str], stuck: bool
) -> None:
    posed = problem(dynamics=dynamics, outputs=outputs, design="order = 0")
    assert static_gains_cannot_stabilise(network(posed)) is stuck


def test_an_input_of_one_agent_that_moves_the_trace_counts() -> None:
    """C B_1 = 0, C B_2 = k: agent 2 moves the trace, unless it is a leader without incoming edges."""
    shared = dict(dynamics={"p": "v + k*u", "v": "u"}, outputs={"y": "p"}, design="order = 0")
    each = "parameters = [{ k = 0.0 }, { k = 1.0 }]"
    agent = "parameters = { k = 0.0 }"
    both = problem(**shared, agent=agent, network=f"agents = 2\nedges = [[1, 2], [2, 1]]\n{each}")
    led = problem(**shared, agent=agent, network=f"agents = 2\nedges = [[1, 2]]\n{each}")
    assert not static_gains_cannot_stabilise(network(both))
    assert static_gains_cannot_stabilise(network(led))
