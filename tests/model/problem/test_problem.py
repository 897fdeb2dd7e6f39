"""Problem files that are read: the examples, random initial states, agents that differ."""

from pathlib import Path

import numpy as np
import pytest
from problem_cases import SMALL, changed

from lockstep.model import ProblemError, load_problem, parse_problem


def test_the_worked_example_is_the_paper_s(examples: Path) -> None:
    """(38), (39), R = I; its weights and its gain limit are the defaults' business."""
    problem = load_problem(examples / "flexible_joint_arms.toml")
    assert problem.has_defaults
    assert not {"weights", "gain_limit"} & set(problem.document()["design"])
    problem.validate()
    lure = problem.agent().lure
    np.testing.assert_array_equal(
        lure.A, [[0, 1, 0, 0], [-48.6, -1.25, 48.6, 0], [0, 0, 0, 1], [19.5, 0, -19.5, 0]]
    )
    np.testing.assert_array_equal(lure.B, [[0], [21.6], [0], [0]])
    np.testing.assert_array_equal(problem.graph().laplacian, [[1, -1, 0], [0, 1, -1], [-1, 0, 1]])
    np.testing.assert_array_equal(problem.state_weight(4), np.eye(4))
    assert (problem.order, problem.controller.period) == (2, 0.005)
    assert problem.fragility == {"A": 0.0, "B": 0.0, "C": 0.0, "D": 0.0}
    assert problem.gains is None
    assert problem.agent() is problem.agent()
    assert problem.initial_states().shape == (3, 4)


def test_table_1_is_the_paper_s(examples: Path) -> None:
    """Table 1, case (II), agent 3 and the factor 1e-3 of C_C."""
    problem = load_problem(examples / "table_1.toml")
    problem.validate()
    assert problem.design.method == "given"
    assert problem.order == 2
    assert problem.gains is not None
    np.testing.assert_array_equal(problem.gains[2].A, [[-1.8184, -0.0103], [-0.0104, -1.8174]])
    np.testing.assert_array_equal(problem.gains[2].B, [[0.0012, 0.0044], [0.0015, 0.0059]])
    np.testing.assert_array_equal(problem.gains[0].C, [[0.508e-3, 0.639e-3]])
    np.testing.assert_array_equal(problem.gains[1].D, [[-0.741, -0.853]])


def test_random_states_are_the_seed_s() -> None:
    first, second = parse_problem(SMALL), parse_problem(changed("horizon = 5", "horizon = 5\nseed = 1"))
    np.testing.assert_array_equal(first.initial_states(), parse_problem(SMALL).initial_states())
    assert (first.initial_states() != second.initial_states()).all()
    assert np.abs(first.initial_states()).max() <= 1


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
        ("[{}, {}, { b = 0.0 }]", ["(A, B_3) is not stabilisable"]),
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


def test_units_of_gains_scale_the_limit_entry_by_entry(examples: Path) -> None:
    """x_C' = A x_C + B r, u = C x_C + D r: A in 1/s, B in 1/s per y, C in u, D in u per y."""
    text = (examples / "flexible_joint_arms.toml").read_text()
    named = "[design]\ngain_limit = 3.0\ngain_units = { time = 0.5, inputs = 10.0, outputs = { y1 = 0.02 } }"
    problem = parse_problem(text.replace("[design]", named, 1))
    A, B1, B2, C, D1, D2 = 1 / 0.5, 1 / 0.5 / 0.02, 1 / 0.5, 10.0, 10.0 / 0.02, 10.0
    np.testing.assert_allclose(
        problem.gain_limit, 3 * np.array([[A, A, B1, B2], [A, A, B1, B2], [C, C, D1, D2]])
    )
    assert not problem.has_defaults
    one = np.zeros((2, 3, 4))
    one[0, 0, 0], one[1, 2, 2] = A, 2 * D1
    assert problem.gain_norms(one) == pytest.approx([1.0, 2.0])
    again = parse_problem(problem.toml())
    np.testing.assert_array_equal(again.gain_limit, problem.gain_limit)
    assert parse_problem(text.replace("[design]", "[design]\ngain_limit = 3.0", 1)).gain_limit == 3.0
