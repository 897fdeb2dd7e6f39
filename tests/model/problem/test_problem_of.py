"""An agent built with CasADi becomes a problem, and the problem a file: the same agent each time."""

import json
import tomllib

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from problem_cases import ARMS, GAINS, GIVEN, SMALL

from lockstep.check.file_limits import hidden
from lockstep.model import Agent, Graph, Problem, ProblemError, bound_of, parse_problem

RING = Graph.topology("ring", 4)
MATRICES = "ABCGH"


def agent(name: str, rhs, y=lambda x, _: x[0], **options) -> Agent:
    """An agent with states x_0, x_1 and the input u: rhs(x, u, t)."""
    x, u, t = ca.SX.sym("x", 2), ca.SX.sym("u"), ca.SX.sym("t")
    return Agent(name=name, x=x, u=u, t=t, rhs=rhs(x, u, t), y=y(x, t), **options)


def chua() -> Agent:
    x, u = ca.SX.sym("x", 3), ca.SX.sym("u")
    kinks = -5 / 7 * x[0] + 0.5 * (-8 / 7 + 5 / 7) * (ca.fabs(x[0] + 1) - ca.fabs(x[0] - 1))
    rhs = ca.vertcat(9 * (x[1] - x[0] - kinks), x[0] - x[1] + x[2] + u, -100 / 7 * x[1])
    return Agent(name="chua", x=x, u=u, rhs=rhs, y=ca.vertcat(x[0], x[2]), centre=True)


def friction(x: ca.SX, u: ca.SX, _: ca.SX) -> ca.SX:
    return ca.vertcat(x[1], -9.81 * ca.sin(x[0]) - 0.5 * ca.tanh(10 * x[1]) + u)


def oscillator(x: ca.SX, u: ca.SX, _: ca.SX) -> ca.SX:
    return ca.vertcat(x[1], 0.8 * (1 - x[0] ** 2) * x[1] - x[0] + u)


def driven(x: ca.SX, u: ca.SX, t: ca.SX) -> ca.SX:
    return ca.vertcat(x[1], ca.cos(t) * ca.sin(x[0]) - 0.1 * x[1] + u + 0.3 * ca.sin(2 * t))


def saturated(x: ca.SX, u: ca.SX, _: ca.SX) -> ca.SX:
    return ca.vertcat(x[1] - x[0], ca.fmax(-1, ca.fmin(1, 3 * x[0])) + ca.if_else(x[1] > 2, x[1] - 2, 0) + u)


def two(x: ca.SX, u: ca.SX, _: ca.SX) -> ca.SX:
    return ca.vertcat(ca.atan(x[0] - x[1]) + x[1], ca.sqrt(1 + x[1] ** 2) + 2 * u)


def interpolated(x: ca.SX, u: ca.SX, _: ca.SX) -> ca.SX:
    return ca.vertcat(x[1], u - ca.pw_lin(x[0], [0.0, 1.0, 2.0], [1.0, 2.0, 2.5]))


BOX = {"x_0": (-2.0, 2.0), "x_1": (-3.0, 3.0)}
AGENTS = {
    "friction": lambda: agent("pendulum", friction),
    "box": lambda: agent("oscillator", oscillator, domain=BOX, centre=True),
    "half a box": lambda: agent("oscillator", oscillator, domain={**BOX, "x_1": (-3, 3)}, split="jacobian"),
    "driven": lambda: agent("driven", driven),
    "saturated": lambda: agent("saturated", saturated),
    "two": lambda: agent("two", two, y=lambda x, _: ca.vertcat(0.1 * x[0] + 0.2 * x[0], x[1] - x[0])),
    "interpolated": lambda: agent("interpolated", interpolated),
    "chua": chua,
    "named": lambda: agent(
        "named",
        friction,
        states=("angle", "rate"),
        inputs=("torque",),
        outputs=("angle",),
        units={"angle": "rad", "torque": "N m"},
        domain={"angle": (-np.inf, 2.0)},
    ),
}


@pytest.mark.parametrize("name", AGENTS)
def test_the_problem_has_the_agent_it_was_made_of(name: str) -> None:
    mine = AGENTS[name]()
    problem = Problem.of(mine, RING, title="four of them", design={"order": 1})
    theirs = problem.agent()
    for letter in MATRICES:
        np.testing.assert_array_equal(getattr(theirs.lure, letter), getattr(mine.lure, letter), letter)
    assert (theirs.name, theirs.states, theirs.inputs, theirs.outputs) == (
        mine.name,
        mine.states,
        mine.inputs,
        mine.outputs,
    )
    assert (theirs.domain, theirs.units, theirs.split, theirs.centre) == (
        mine.domain,
        mine.units,
        mine.split,
        mine.centre,
    )
    for seed in range(20):
        generator = np.random.default_rng(seed)
        point = (generator.normal(0, 2, mine.n), generator.normal(size=mine.m), generator.uniform(0, 10))
        assert mine.dynamics(*point).elements() == theirs.dynamics(*point).elements()
    bound = bound_of(mine)
    assert bound.proved
    assert (bound_of(theirs).alpha, bound_of(theirs).output_scale) == (bound.alpha, bound.output_scale)
    np.testing.assert_array_equal(problem.graph().adjacency, RING.adjacency)


@pytest.mark.parametrize("name", AGENTS)
def test_the_file_is_the_problem(name: str) -> None:
    problem = Problem.of(AGENTS[name](), Graph.from_edges(3, [[1, 2], [2, 3, 0.25], [3, 1]]), title='"\\ é')
    document = json.loads(json.dumps(problem.document(), sort_keys=True, allow_nan=False))
    assert Problem.from_document(document).document() == problem.document()
    assert parse_problem(problem.toml()).document() == problem.document()
    assert parse_problem(problem.toml()).toml() == problem.toml()


def test_the_file_is_one_a_person_would_write() -> None:
    problem = Problem.of(
        AGENTS["named"](),
        Graph.from_edges(2, [[1, 2]]),
        title="Two pendulums",
        design={"order": 1, "weights": {"state": np.array([1.0, 0.5])}},
        simulation={"initial": np.array([[0.1, 0.0], [-0.2, 0.0]])},
    )
    assert (
        problem.toml()
        == """title = "Two pendulums"

[agent]
name = "named"
states = ["angle", "rate"]
inputs = ["torque"]
centre = false

[agent.dynamics]
angle = "rate"
rate = "-9.81*sin(angle) - 0.5*tanh(10*rate) + torque"

[agent.outputs]
angle = "angle"

[agent.domain]
angle = [-inf, 2.0]

[agent.units]
angle = "rad"
torque = "N m"

[network]
agents = 2
edges = [[1, 2]]

[design]
order = 1

[design.weights]
state = [1.0, 0.5]

[simulation]
initial = [[0.1, 0.0], [-0.2, 0.0]]
"""
    )


@pytest.mark.parametrize(
    "text",
    [
        ARMS,
        SMALL,
        GIVEN + 3 * GAINS,
        SMALL.replace("horizon = 5", "initial = [" + 3 * "[0.123456789012345, -9.87654321098765e-5]," + "]"),
        SMALL.replace("[design]", "parameters = [{ b = 1.5 }, {}, { b = -1e-7 }]\n[design]\nfragility = {}"),
        SMALL + "perturbation = {}\nchannel = { drop = 0.1, bits = 8 }\ndisturbance = { kind = 'sine' }",
        SMALL + '[agent.domain]\np = [-inf, 1]\nv = [0, inf]\n[agent.units]\np = "m"\n',
    ],
)
def test_any_file_can_be_written_again(text: str) -> None:
    problem = parse_problem(text)
    again = parse_problem(problem.toml())
    assert again.document() == problem.document()
    assert again.agent().outputs == problem.agent().outputs
    assert max(map(len, problem.toml().splitlines())) < 126


@pytest.mark.slow
@given(
    # Every title that is legal: on one line, without characters that move or hide others.
    st.text(max_size=200).filter(lambda title: not hidden(title) and not set(title) & set("\t\r\n")),
    st.lists(st.floats(1e-3, 1e3), min_size=2, max_size=2),
    st.lists(
        st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=2, max_size=2),
        min_size=3,
        max_size=3,
    ),
    st.integers(0, 2**63 - 1),
)
@settings(max_examples=100)
def test_every_text_and_every_double_survives(title, weights, initial, seed) -> None:
    problem = parse_problem(SMALL)
    document = problem.document() | {"title": title}
    document["design"] |= {"weights": {"state": weights, "controller": 1.0}, "seed": seed}
    document["simulation"] |= {"initial": initial}
    problem = Problem.from_document(document)
    assert repr(tomllib.loads(problem.toml())["simulation"]["initial"]) == repr(initial)
    assert parse_problem(problem.toml()).document() == problem.document()


def test_each_agent_may_have_an_input_matrix_of_its_own() -> None:
    def rhs(x, u, _):
        return ca.vertcat(x[1], 3 * (ca.sin(x[0]) + 0.1 * u) - x[1])

    mine = agent("pendulum", rhs)
    B = [np.array([[0.0], [b]]) for b in (mine.lure.B[1, 0], 1.0, -0.7)] + [np.array([[0.5], [1.0]])]
    problem = Problem.of(mine, RING, B=B)
    assert problem.file.agent.parameters == {"B_1_1": 0.0, "B_2_1": mine.lure.B[1, 0]}
    assert problem.file.agent.dynamics["x_1"] == "3*sin(x_0) - x_1 + B_2_1*u"
    given = parse_problem(problem.toml())
    assert given.file.network.parameters == (
        {},
        {"B_2_1": 1.0},
        {"B_2_1": -0.7},
        {"B_1_1": 0.5, "B_2_1": 1.0},
    )
    for one, two in zip(given.agents_B(), B, strict=True):
        np.testing.assert_array_equal(one, two)
    for letter in MATRICES:
        np.testing.assert_array_equal(getattr(given.agent().lure, letter), getattr(mine.lure, letter))
    assert Problem.of(mine, RING, B=[mine.lure.B] * 4).document() == Problem.of(mine, RING).document()


def test_the_name_of_an_entry_is_a_new_one() -> None:
    mine = agent("pendulum", friction, inputs=("B_2_1",))
    problem = Problem.of(mine, RING, B=[k * mine.lure.B for k in range(1, 5)])
    assert problem.file.agent.dynamics["x_1"].endswith("B_2_1_*B_2_1")
    assert [B[1, 0] for B in problem.agents_B()] == [1, 2, 3, 4]


ONES = [np.array([[0.0], [1.0]])] * 3


@pytest.mark.parametrize(
    ("B", "told"),
    [
        (ONES, "B: 3 input matrices for 4 agents; expected one B per agent"),
        ([*ONES, np.ones((1, 2))], "agent 4: `B` is 1 x 2; expected 2 x 1"),
        ([*ONES, np.array([[np.nan], [1.0]])], r"(?s)agent 4: `B` is array.*nan.*; expected finite numbers"),
    ],
)
def test_input_matrices_that_do_not_fit_are_refused(B, told: str) -> None:
    with pytest.raises(ProblemError, match=told):
        Problem.of(agent("pendulum", friction), RING, B=B)


def test_inputs_that_cannot_be_taken_out_exactly_are_refused() -> None:
    """0.1*(0.3*x + u) is (0.1 times 0.3)*x + 0.1 u exactly; without u CasADi multiplies the two in doubles."""
    mine = agent("pendulum", lambda x, u, _: ca.vertcat(x[1], 0.1 * (0.3 * x[0] + u)))
    assert Problem.of(mine, RING).agent().lure.A[1, 0] == mine.lure.A[1, 0]
    with pytest.raises(
        ProblemError, match=r"\[agent.dynamics\] x_1: the inputs are among constants .* f\(x, t\)"
    ):
        Problem.of(mine, RING, B=[*ONES, 2 * ONES[0]])
    plainer = agent("pendulum", lambda x, u, _: ca.vertcat(x[1], 0.1 * 0.3 * x[0] + 0.1 * u))
    assert [B[1, 0] for B in Problem.of(plainer, RING, B=[*ONES, 2 * ONES[0]]).agents_B()] == [1, 1, 1, 2]


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (dict(rhs=ca.erf), r"\[agent.dynamics\] x_0, .*: the operation `erf`"),
        (dict(rhs=ca.asinh), r"\[agent.dynamics\] x_0, .*write log\(x \+ sqrt\(x\*\*2 \+ 1\)\)"),
        (dict(design={"ordr": 1}), r"\[design\]: unknown key `ordr`.*did you mean `order`"),
        (dict(design={"order": -1}), r"\[design\] order: `order` is -1"),
        (dict(controller={"period": np.float64(-1)}), r"\[controller\] period"),
        (dict(simulation={"initial": np.zeros((3, 2))}), r"\[simulation\] initial: row 1 has 2 numbers"),
    ],
)
def test_what_no_file_may_say_is_refused(change: dict, told: str) -> None:
    x, u = ca.SX.sym("x_0"), ca.SX.sym("u")
    rhs = change.pop("rhs", ca.sin)(x) + u
    with pytest.raises(ProblemError, match=told):
        Problem.of(Agent(name="one", x=x, u=u, rhs=rhs, y=x), RING, **change)


def test_a_graph_that_cannot_agree_is_written_and_not_designed_for() -> None:
    apart = Graph.from_edges(3, [])
    problem = Problem.of(AGENTS["friction"](), apart)
    assert parse_problem(problem.toml()).graph().edges == []
    with pytest.raises(ProblemError, match="spanning tree"):
        problem.validate()
    Problem.of(AGENTS["friction"](), RING).validate()
