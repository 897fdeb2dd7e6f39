"""Problem files: the examples, one change per bad file, and the document that goes into a design file."""

import contextlib
import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lockstep.model import Problem, ProblemError, load_problem, parse_problem

EXAMPLES = Path(__file__).parents[2] / "examples"
ARMS = (EXAMPLES / "flexible_joint_arms.toml").read_text(encoding="utf-8")

SMALL = """
title = "small"
[agent]
name = "cart"
states = ["p", "v"]
inputs = ["f"]
parameters = { k = 2.0, b = 3.0, c = 1.0 }
[agent.dynamics]
p = "v"
v = "-k*p - sin(p) + b*f"
[agent.outputs]
y1 = "c*p"
[network]
agents = 3
edges = [[1, 2], [2, 3], [3, 1]]
[design]
order = 1
[controller]
period = 0.01
[simulation]
horizon = 5
"""

GIVEN = SMALL.replace("order = 1", 'method = "given"')
GAINS = """
[[design.gains]]
A = [[-1.0, 0.5], [0.0, -2.0]]
B = [[1.0], [2.0]]
C = [[3.0, 4.0]]
D = [[5.0]]
"""


def changed(old: str, new: str, text: str = SMALL) -> str:
    assert text.count(old) == 1, f"{old!r} is there {text.count(old)} times"
    return text.replace(old, new)


def test_the_worked_example_is_the_paper_s() -> None:
    """(38), (39), R = I, Q = 2 I."""
    problem = load_problem(EXAMPLES / "flexible_joint_arms.toml")
    problem.validate()
    lure = problem.agent().lure
    np.testing.assert_array_equal(
        lure.A, [[0, 1, 0, 0], [-48.6, -1.25, 48.6, 0], [0, 0, 0, 1], [19.5, 0, -19.5, 0]]
    )
    np.testing.assert_array_equal(lure.B, [[0], [21.6], [0], [0]])
    np.testing.assert_array_equal(problem.graph().laplacian, [[1, -1, 0], [0, 1, -1], [-1, 0, 1]])
    np.testing.assert_array_equal(problem.state_weight(4), np.eye(4))
    np.testing.assert_array_equal(problem.controller_weight(2), 2 * np.eye(2))
    assert (problem.order, problem.design.gain_limit, problem.controller.period) == (2, 50.0, 0.005)
    assert problem.fragility == {"A": 0.0, "B": 0.0, "C": 0.0, "D": 0.0}
    assert problem.gains is None
    assert problem.agent() is problem.agent()
    assert problem.initial_states().shape == (3, 4)


def test_table_1_is_the_paper_s() -> None:
    """Table 1, case (II), agent 3 and the factor 1e-3 of C_C."""
    problem = load_problem(EXAMPLES / "table_1.toml")
    problem.validate()
    assert problem.design.method == "given"
    assert problem.order == 2
    assert problem.gains is not None
    np.testing.assert_array_equal(problem.gains[2].A, [[-1.8184, -0.0103], [-0.0104, -1.8174]])
    np.testing.assert_array_equal(problem.gains[2].B, [[0.0012, 0.0044], [0.0015, 0.0059]])
    np.testing.assert_array_equal(problem.gains[0].C, [[0.508e-3, 0.639e-3]])
    np.testing.assert_array_equal(problem.gains[1].D, [[-0.741, -0.853]])


@pytest.mark.parametrize(
    "text",
    [
        ARMS,
        SMALL,
        GIVEN + 3 * GAINS,
        changed("agents = 3\n", "", SMALL).replace(
            "edges = [[1, 2], [2, 3], [3, 1]]", "laplacian = [[1, -1], [-0.5, 0.5]]"
        ),
        SMALL + '[agent.domain]\np = [-inf, 1]\nv = [0, 2]\n[agent.units]\np = "m"\n',
    ],
)
def test_the_document_is_the_problem(text: str) -> None:
    problem = parse_problem(text)
    document = json.loads(json.dumps(problem.document(), sort_keys=True, allow_nan=False))
    again = Problem.from_document(document)
    assert again.document() == problem.document()
    assert again.agent().outputs == problem.agent().outputs
    np.testing.assert_array_equal(again.agent().box, problem.agent().box)
    np.testing.assert_array_equal(again.graph().adjacency, problem.graph().adjacency)


def test_the_order_of_the_outputs_outlives_sorted_keys() -> None:
    problem = parse_problem(changed('y1 = "c*p"', 'z = "v"\na = "p"'))
    assert problem.agent().outputs == ("z", "a")
    again = Problem.from_document(json.loads(json.dumps(problem.document(), sort_keys=True)))
    np.testing.assert_array_equal(again.agent().lure.C, [[0, 1], [1, 0]])


def test_agents_may_differ_in_B() -> None:
    text = changed("edges", "parameters = [{ b = 4.0 }, {}, { b = 5 }]\nedges")
    problem = parse_problem(text)
    assert [B[1, 0] for B in problem.agents_B()] == [4.0, 3.0, 5.0]
    problem.validate()


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ("[{ k = 9.0 }, {}, {}]", ["entry 1", "A differs: d/dt v has -2.0*p", "-9.0*p here", "one A"]),
        ("[{}, { c = 2.0 }, {}]", ["entry 2", "C differs: output 1 has"]),
        ("[{}, {}]", ["2 tables for 3 agents"]),
        ("[{}, {}, { kk = 1 }]", ["entry 3", "`kk` is no parameter", "did you mean `k`?"]),
        ("[{}, {}, { b = nan }]", ["nan", "finite"]),
        ("[{}, {}, { b = true }]", ["true", "entry 3"]),
        ("[{}, {}, { b = 0.0 }]", ["not controllable", "(A, B_3)"]),
    ],
)
def test_agents_may_differ_in_nothing_else(given: str, says: list) -> None:
    with pytest.raises(ProblemError) as caught:
        parse_problem(changed("edges", f"parameters = {given}\nedges")).validate()
    for part in says:
        assert part in str(caught.value)


@pytest.mark.parametrize(
    ("nonlinearity", "parameter"),
    [("g*sin(p)", "g = 2.0"), ("sin(g*p)", "g = 2.0"), ("sin(p) + g", "g = 2.0")],
)
def test_agents_may_not_differ_in_h(nonlinearity: str, parameter: str) -> None:
    text = changed("sin(p)", nonlinearity).replace("k = 2.0", "k = 2.0, g = 1.0")
    with_own = text.replace("edges", f"parameters = [{{}}, {{ {parameter} }}, {{}}]\nedges")
    parse_problem(with_own.replace("g = 2.0", "g = 1.0"))
    with pytest.raises(ProblemError, match=r"entry 2: h differs in d/dt v: .* one h for all"):
        parse_problem(with_own)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("[agent]\n", "[agent]\nstats = 1\n", ["[agent]", "unknown key `stats`", "did you mean `states`?"]),
        ('states = ["p", "v"]', 'stats = ["p", "v"]', ["`stats`", "did you mean `states`?", "missing"]),
        ('title = "small"', 'titel = "small"', ["unknown key `titel`", "did you mean `title`?"]),
        ('title = "small"', "title = 3", ["`title` is 3", "expected text"]),
        ('title = "small"', "period = 1", ["unknown key `period`", "belongs in [controller]"]),
        ('title = "small"', "", []),
        ("[design]\n", "[design]\ngainlimit = 3\n", ["[design]", "did you mean `gain_limit`?"]),
        ("[design]\n", "[design]\nperiod = 3\n", ["[design]", "belongs in [controller]"]),
        ("[design]\n", "[desing]\n", ["unknown key `desing`", "did you mean `design`?"]),
        ("[design]\n", "[design]\nweights = { stat = 1 }\n", ["[design.weights]", "did you mean `state`?"]),
        (
            "[design]\n",
            "[design]\nfragility = { E = 1 }\n",
            ["[design.fragility]", "unknown key `E`", "A, B, C, D"],
        ),
        ('states = ["p", "v"]\n', "", ["[agent]", "the key `states` is missing"]),
        ('inputs = ["f"]\n', "", ["[agent]", "`inputs` is missing"]),
        ('[agent.outputs]\ny1 = "c*p"\n', "", ["[agent]", "`outputs` is missing"]),
        ('v = "-k*p - sin(p) + b*f"\n', "", ["[agent.dynamics]", "no equation for the state `v`"]),
        ('v = "-k*p', 'w = "0"\nv = "-k*p', ["[agent.dynamics]", "`w` is unknown"]),
        ("sin(p)", "sine(p)", ["[agent.dynamics] v", "`sine`", "did you mean `sin`?"]),
        ("sin(p)", "q", ["[agent.dynamics] v", "unknown symbol `q`"]),
        ("sin(p)", "__import__('os')", ["[agent.dynamics] v", "`__import__` is not part"]),
        ("b*f", "b*f**2", ["[agent.dynamics] v", "`f`", "linearly"]),
        ('v = "-k*p - sin(p) + b*f"', "v = 0", ["[agent.dynamics] v", "`v` is 0", "formula as text"]),
        ('y1 = "c*p"', 'y1 = "c*p + 1"', ["[agent.outputs] y1", "constant 1"]),
        ('y1 = "c*p"', "y1 = 1", ["[agent.outputs] y1", "`y1` is 1", "formula as text"]),
        ('name = "cart"', 'name = "my cart"', ["[agent] name", "C identifier"]),
        ('name = "cart"', "name = 3", ["[agent] name", "`name` is 3"]),
        ('states = ["p", "v"]', 'states = "p"', ["[agent] states", '`states` is "p"', "list of names"]),
        ('states = ["p", "v"]', 'states = ["p", 3]', ["[agent] states, entry 2", "found 3"]),
        ("k = 2.0,", 'k = "2.0",', ["[agent.parameters] k", '`k` is "2.0"', "finite number"]),
        ("k = 2.0,", "k = true,", ["[agent.parameters] k", "`k` is true"]),
        ("k = 2.0,", "k = nan,", ["[agent.parameters] k", "`k` is nan"]),
        ("k = 2.0,", "k = inf,", ["[agent.parameters] k", "`k` is inf"]),
        ("k = 2.0,", "k = 1979-05-27,", ["[agent.parameters] k", "1979-05-27"]),
        ("k = 2.0,", "k = [1],", ["[agent.parameters] k", "a list"]),
        ("k = 2.0,", f"k = {'9' * 400},", ["[agent.parameters] k", "too large for a double"]),
        (
            "[agent.outputs]",
            "[agent.domain]\np = [1, 0]\n[agent.outputs]",
            ["[agent.domain] p", "from 1.0 to 0.0"],
        ),
        ("[agent.outputs]", "[agent.domain]\np = [nan, 0]\n[agent.outputs]", ["[agent.domain] p", "nan"]),
        ("[agent.outputs]", "[agent.domain]\np = [inf, inf]\n[agent.outputs]", ["[agent.domain] p", "inf"]),
        ("[agent.outputs]", "[agent.domain]\np = [0]\n[agent.outputs]", ["[agent.domain] p", "two numbers"]),
        ("[agent.outputs]", "[agent.domain]\np = 3\n[agent.outputs]", ["[agent.domain] p", "two numbers"]),
        ("[agent.outputs]", '[agent.domain]\np = ["0", 1]\n[agent.outputs]', ["[agent.domain] p", '"0"']),
        (
            "[agent.outputs]",
            "[agent.domain]\nq = [0, 1]\n[agent.outputs]",
            ["[agent.domain]", "`q` is unknown"],
        ),
        ("[agent.outputs]", '[agent.units]\nq = "m"\n[agent.outputs]', ["[agent.units]", "`q` is unknown"]),
        ("agents = 3\n", "", ["[network]", "`agents` is missing"]),
        ("agents = 3", "agents = 3.0", ["[network] agents", "`agents` is 3.0", "whole number"]),
        ("agents = 3", "agents = true", ["[network] agents", "`agents` is true"]),
        ("agents = 3", "agents = 1", ["[network] agents", "`agents` is 1"]),
        ("agents = 3", "agents = 2", ["[network] edges", "edge 2", "out of range"]),
        ("edges = [[1, 2], [2, 3], [3, 1]]", "", ["[network]", "no graph", "exactly one"]),
        ("edges", 'topology = "cycle"\nedges', ["[network]", "`edges` and `topology` are given"]),
        (
            "edges = [[1, 2], [2, 3], [3, 1]]",
            'topology = "torus"',
            ["[network] topology", '"torus"', '"cycle"'],
        ),
        (
            "edges = [[1, 2], [2, 3], [3, 1]]",
            "laplacian = [[1, -1], [-1, 1]]",
            ["[network] agents", "2 rows"],
        ),
        ("edges = [[1, 2], [2, 3], [3, 1]]", "laplacian = [[1, -1, 0], [-1, 1]]", ["laplacian", "square"]),
        ("edges = [[1, 2], [2, 3], [3, 1]]", "laplacian = []", ["laplacian", "square"]),
        ("edges = [[1, 2], [2, 3], [3, 1]]", "edges = [1, 2]", ["[network] edges", "found 1"]),
        ("[1, 2]", '["1", 2]', ["[network] edges, row 1, column 1", '"1"']),
        ("[1, 2]", "[1, 1]", ["edge 1", "self loop"]),
        ("[1, 2]", "[1, 2, nan]", ["edges, row 1, column 3", "nan"]),
        ("[1, 2]", "[2, 3]", ["there twice"]),
        ("order = 1", "order = -1", ["[design] order", "`order` is -1", "0 (static"]),
        ("order = 1", "order = 1.0", ["[design] order", "`order` is 1.0", "whole number"]),
        ("order = 1", "order = true", ["[design] order", "`order` is true"]),
        ("order = 1", 'order = "1"', ["[design] order", '`order` is "1"']),
        ("order = 1", "order = 65", ["[design] order", "65"]),
        ("order = 1", 'method = "magic"', ["[design] method", '"magic"', '"certified"']),
        ("order = 1", 'method = "given"', ["[design]", "no gains"]),
        ("order = 1", "gain_limit = 0", ["[design] gain_limit", "`gain_limit` is 0", "above 0"]),
        ("order = 1", "gain_limit = inf", ["[design] gain_limit", "inf"]),
        ("order = 1", "alpha = -1", ["[design] alpha", "-1"]),
        ("order = 1", "alpha = nan", ["[design] alpha", "nan"]),
        ("order = 1", 'objective = "alpha"', ["[design]", "`rho` is missing"]),
        ("order = 1", "rho = 3", ["[design] rho", "minimised"]),
        ("order = 1", 'coordinates = "mine"', ["[design] coordinates", '"orthonormal"']),
        ("order = 1", "starts = 0", ["[design] starts", "`starts` is 0"]),
        ("order = 1", "seed = -1", ["[design] seed", "`seed` is -1"]),
        ("order = 1", "fragility = { A = -0.1 }", ["[design.fragility] A", "`A` is -0.1"]),
        ("order = 1", "fragility = 0.1", ["[design] fragility", "a table"]),
        ("order = 1", "weights = 3", ["[design] weights", "a table"]),
        ("order = 1", 'weights = { state = "1" }', ["[design.weights] state", '"1"', "symmetric"]),
        ("order = 1", "weights = { state = true }", ["[design.weights] state", "true"]),
        ("order = 1", "weights = { state = nan }", ["[design.weights] state", "finite"]),
        ("order = 1", "weights = { state = [1, nan] }", ["[design.weights] state", "finite"]),
        ("order = 1", "weights = { state = 0 }", ["[design.weights] state", "smallest eigenvalue is 0"]),
        (
            "order = 1",
            "weights = { state = [1, 2, 3] }",
            ["[design.weights] state", "3 numbers for 2 states"],
        ),
        ("order = 1", "weights = { state = [[1, 0], [0, 1], [0, 0]] }", ["[design.weights] state", "3 x 2"]),
        ("order = 1", "weights = { state = [[1, 0], [0]] }", ["[design.weights] state", "different lengths"]),
        ("order = 1", "weights = { state = [[1, 0], 1] }", ["[design.weights] state", "a list"]),
        ("order = 1", "weights = { state = [] }", ["[design.weights] state", "a list"]),
        (
            "order = 1",
            "weights = { state = [[1, 0.1], [0.2, 1]] }",
            ["[design.weights] state", "0.1", "0.2", "symmetric"],
        ),
        (
            "order = 1",
            "weights = { state = [[1, 2], [2, 1]] }",
            ["[design.weights] state", "smallest eigenvalue is -1"],
        ),
        (
            "order = 1",
            "weights = { controller = [1] }",
            ["[design.weights] controller", "1 numbers for 2 controller states"],
        ),
        ("order = 1", "[[design.gains]]\nD = [[1.0]]", ["[[design.gains]]", '`method` is "certified"']),
        ("period = 0.01", "period = 0", ["[controller] period", "`period` is 0", "above 0"]),
        ("period = 0.01", "period = -0.0", ["[controller] period", "`period` is -0.0"]),
        ("period = 0.01", "period = nan", ["[controller] period", "nan"]),
        ("period = 0.01", "period = inf", ["[controller] period", "inf"]),
        ("period = 0.01", 'period = "5 ms"', ["[controller] period", '"5 ms"', "seconds"]),
        ("period = 0.01", 'discretization = "rk4"', ["[controller] discretization", '"tustin"']),
        ("period = 0.01", 'real = "float16"', ["[controller] real", '"float16"', '"float32"']),
        ("period = 0.01", "delay = 2", ["[controller] delay", "`delay` is 2"]),
        ("horizon = 5", "horizon = 0", ["[simulation] horizon", "`horizon` is 0"]),
        ("horizon = 5", 'initial = "zero"', ["[simulation] initial", '"zero"', "random"]),
        ("horizon = 5", "initial = [[1, 2], [1, 2]]", ["[simulation] initial", "2 rows for 3 agents"]),
        ("horizon = 5", "initial = [[1, 2], [1], [2, 3]]", ["[simulation] initial", "row 2 has 1 numbers"]),
        ("horizon = 5", "initial = [[1, nan], [1, 0], [2, 3]]", ["[simulation] initial", "nan"]),
        ("horizon = 5", 'disturbance = { kind = "chaos" }', ["[simulation.disturbance] kind", '"noise"']),
        ("[network]", "[network", ["not TOML", "line 13, column"]),
        ("agents = 3", "agents = 3\nagents = 4", ["not TOML", "line 15"]),
        ("agents = 3", "agents = ", ["not TOML", "line 14"]),
    ],
)
def test_bad_files_are_refused(old: str, new: str, says: list) -> None:
    text = changed(old, new)
    if not says:
        parse_problem(text)
        return
    with pytest.raises(ProblemError) as caught:
        parse_problem(text, "small.toml")
    message = str(caught.value)
    assert message.startswith("small.toml")
    assert "\n" not in message
    assert "pydantic" not in message.lower()
    for part in says:
        assert part in message, message


def test_several_errors_are_one_message() -> None:
    text = (
        changed("order = 1", "order = -1")
        .replace("period = 0.01", "period = 0")
        .replace("k = 2.0", "k = nan")
    )
    with pytest.raises(ProblemError) as caught:
        parse_problem(text)
    message = str(caught.value)
    assert message.count("also ") == 2
    for part in ("[agent.parameters] k", "[design] order", "[controller] period"):
        assert part in message


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("B = [[1.0], [2.0]]", "B = [[1.0], [2.0], [3.0]]", "`B` is 3 x 1; expected `A` is 2 x 2"),
        ("B = [[1.0], [2.0]]", "B = [[1.0, 2.0]]", "`B` is 1 x 2"),
        ("B = [[1.0], [2.0]]", "B = [[1.0], [2.0, 3.0]]", "rows of 1 and of 2"),
        ("B = [[1.0], [2.0]]", "", "`B` is missing or empty"),
        ("A = [[-1.0, 0.5], [0.0, -2.0]]", "A = [[-1.0, 0.5]]", "`A` is 1 x 2"),
        (
            "A = [[-1.0, 0.5], [0.0, -2.0]]",
            "A = [[nan, 0.5], [0.0, -2.0]]",
            "2, A, row 1, column 1: found nan",
        ),
        (
            "A = [[-1.0, 0.5], [0.0, -2.0]]",
            "A = [[true, 0.5], [0.0, -2.0]]",
            "2, A, row 1, column 1: found true",
        ),
        ("A = [[-1.0, 0.5], [0.0, -2.0]]", "A = 3", "2, A: `A` is 3"),
        ("C = [[3.0, 4.0]]", "C = [[3.0], [4.0]]", "`C` is 2 x 1"),
        ("D = [[5.0]]", "D = [[5.0, 6.0]]", "`D` is 1 x 2"),
        ("D = [[5.0]]", "", "[[design.gains]] 2: the key `D` is missing"),
        ("D = [[5.0]]", "D = [[5.0]]\nE = 1", "[[design.gains]] 2: unknown key `E`"),
    ],
)
def test_bad_gains_are_refused(old: str, new: str, says: str) -> None:
    assert parse_problem(GIVEN + 3 * GAINS).order == 2
    with pytest.raises(ProblemError) as caught:
        parse_problem(GIVEN + GAINS + changed(old, new, GAINS) + GAINS)
    assert says in str(caught.value)
    assert "[[design.gains]] 2" in str(caught.value)


def test_gains_of_different_orders_and_numbers_are_refused() -> None:
    first_order = "[[design.gains]]\nA = [[-1.0]]\nB = [[1.0]]\nC = [[3.0]]\nD = [[5.0]]\n"
    with pytest.raises(ProblemError, match="controllers of one order"):
        parse_problem(GIVEN + 2 * GAINS + first_order)
    with pytest.raises(ProblemError, match="2 tables of gains for 3 agents"):
        parse_problem(GIVEN + 2 * GAINS)
    with pytest.raises(ProblemError, match="`order` is 1, but the gains"):
        parse_problem(GIVEN.replace("[design]", "[design]\norder = 1") + 3 * GAINS)
    assert parse_problem(GIVEN.replace("[design]", "[design]\norder = 2") + 3 * GAINS).order == 2


@pytest.mark.parametrize("rest", ["", "A = []\nB = []\nC = []\n", "C = [[]]\n"])
def test_static_gains_need_D_only(rest: str) -> None:
    problem = parse_problem(GIVEN + 3 * f"[[design.gains]]\n{rest}D = [[5.0]]\n")
    assert problem.order == 0
    assert problem.gains is not None
    assert [M.shape for M in vars(problem.gains[0]).values()] == [(0, 0), (0, 1), (1, 0), (1, 1)]
    assert problem.controller_weight(0).shape == (0, 0)
    with pytest.raises(ProblemError, match="`B` is 1 x 1"):
        parse_problem(GIVEN + 3 * f"[[design.gains]]\n{rest.replace('B = []', '')}B = [[1.0]]\nD = [[5.0]]\n")


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("[3, 1]", "[1, 3]", None),
        ("[2, 3], [3, 1]", "[2, 1]", "agents 1, 2 and agent 3 hear nothing from each other"),
        ("[1, 2], [2, 3], [3, 1]", "", "no spanning tree"),
        (
            "+ b*f",
            "",
            "(A, B) is not controllable: no input moves the mode at the eigenvalue 0 +- 1.41421i of A",
        ),
        ('p = "v"', 'p = "-p"', "(A, C) is not observable"),
        ('v = "-k*p - sin(p) + b*f"', 'v = "-v + b*p"', "(A, B) is not controllable"),
        (
            'p = "v"\n',
            'p = "-p + f"\n',
            "the eigenvalue 0 of A does not decay by itself (the pair is not detectable",
        ),
        ('"-k*p - sin(p) + b*f"', '"-v + f"', None),
    ],
)
def test_a_network_that_cannot_agree_is_refused(old: str, new: str, says: str | None) -> None:
    problem = parse_problem(changed(old, new))
    if says is None:
        problem.validate()
        return
    with pytest.raises(ProblemError) as caught:
        problem.validate()
    assert says in str(caught.value)


def test_a_lost_mode_that_decays_is_told_apart() -> None:
    problem = parse_problem(changed('p = "v"', 'p = "f - p"').replace("-k*p - sin(p) + b*f", "-3*v"))
    with pytest.raises(
        ProblemError, match=r"eigenvalue -3 of A, which decays by itself \(the pair is detectable\)"
    ):
        problem.validate()


def test_random_states_are_the_seed_s() -> None:
    first, second = parse_problem(SMALL), parse_problem(changed("horizon = 5", "horizon = 5\nseed = 1"))
    np.testing.assert_array_equal(first.initial_states(), parse_problem(SMALL).initial_states())
    assert (first.initial_states() != second.initial_states()).all()
    assert np.abs(first.initial_states()).max() <= 1


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(ProblemError, match="there is no such file"):
        load_problem(tmp_path / "none.toml")
    with pytest.raises(ProblemError, match="a directory"):
        load_problem(tmp_path)
    with pytest.raises(ProblemError, match="no regular file"):
        load_problem("/dev/zero")
    with pytest.raises(ProblemError, match="there is no such file"):
        load_problem("a\0b")
    (tmp_path / "latin.toml").write_bytes('title = "caf\xe9"'.encode("latin-1"))
    with pytest.raises(ProblemError, match=r"latin.toml: byte 13 is not UTF-8"):
        load_problem(tmp_path / "latin.toml")
    (tmp_path / "nul.toml").write_bytes(SMALL.encode() + b"\0")
    with pytest.raises(ProblemError, match="not TOML"):
        load_problem(tmp_path / "nul.toml")
    (tmp_path / "large.toml").write_bytes(b"#" * 10_000_001)
    with pytest.raises(ProblemError, match="10000001 bytes"):
        load_problem(tmp_path / "large.toml")
    (tmp_path / "empty.toml").write_bytes(b"")
    with pytest.raises(ProblemError, match="`agent` is missing"):
        load_problem(tmp_path / "empty.toml")
    (tmp_path / "deep.toml").write_text("a = " + "[" * 100_000, encoding="utf-8")
    with pytest.raises(ProblemError, match="not TOML"):
        load_problem(tmp_path / "deep.toml")
    (tmp_path / "digits.toml").write_text("a = " + "9" * 100_000, encoding="utf-8")
    with pytest.raises(ProblemError, match="not TOML"):
        load_problem(tmp_path / "digits.toml")
    (tmp_path / "bom.toml").write_text(SMALL, encoding="utf-8-sig")
    load_problem(tmp_path / "bom.toml")


_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)


def _places(tree: object, place: tuple = ()) -> list[tuple]:
    here = [place] if place else []
    items = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    return here + [inner for key, value in items for inner in _places(value, (*place, key))]


PLACES = _places(parse_problem(GIVEN + 3 * GAINS).document())


@given(st.sampled_from(PLACES), _JSON)
@settings(max_examples=250, deadline=None)
def test_any_value_anywhere_is_a_problem_or_a_problem_error(place: tuple, value: object) -> None:
    document = parse_problem(GIVEN + 3 * GAINS).document()
    inner = document
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = value
    with contextlib.suppress(ProblemError):
        json.dumps(Problem.from_document(document).document(), allow_nan=False)


@pytest.mark.parametrize("document", [None, 3, [], "x", {"agent": 3}, {3: 4}])
def test_documents_that_are_no_tables(document: object) -> None:
    with pytest.raises(ProblemError):
        Problem.from_document(document)
