"""The exact split of an agent: it adds up, it is small, it moves slopes, and it refuses what (2) does not have."""

import tomllib
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from flint import fmpq
from text_cases import plant

from lockstep.check.errors import ProblemError
from lockstep.check.expression.exact import Exact, Value
from lockstep.check.expression.node import Node, linear, variable
from lockstep.check.expression.text import parse
from lockstep.check.expression.traversal import expand, substitute
from lockstep.check.system.agent import ExactAgent, Move

ROOT = Path(__file__).parents[2]
FILES = sorted([*ROOT.glob("examples/*.toml"), *ROOT.glob("benchmarks/designs/*.toml")])


def values(dynamics: dict, symbols: list[str], parameters: dict) -> list[Node]:
    """Each right-hand side as the exact node of its text, over (x, u, t)."""
    known: dict[str, Value | float] = {key: Value(variable(k)) for k, key in enumerate(symbols)}
    known |= parameters
    return [parse(text, known, Exact(len(symbols) - 1)).node for text in dynamics.values()]


def added_up(agent: ExactAgent) -> list[Node]:
    """A x + B u + G phi(H x, t) + offset(t), over (x, u, t)."""
    n, m = len(agent.states), len(agent.inputs)
    x, u, t = [variable(k) for k in range(n)], [variable(n + k) for k in range(m)], variable(n + m)
    fraction = np.vectorize(lambda a: Fraction(int(a.p), int(a.q)), otypes=[object])

    def rows(matrix: np.ndarray, vector: list[Node]) -> list[Node]:
        if not matrix.size:
            return [linear(0, [])] * matrix.shape[0]
        return [linear(0, zip(row, vector, strict=True)) for row in fraction(matrix)]

    v = rows(agent.H, x)
    values = {variable(j): node for j, node in enumerate([*v, t])}
    w, c = (substitute(nodes, values) for nodes in (agent.phi.outputs, agent.offset))
    parts = [rows(agent.A, x), rows(agent.B, u), rows(agent.G, list(w)), c]
    return [linear(0, [(1, part[i]) for part in parts]) for i in range(n)]


def check_adds_up(agent: ExactAgent, dynamics: dict, parameters: dict) -> None:
    symbols = [*agent.states, *agent.inputs, "t"]
    texts = {state: dynamics[state] for state in agent.states}
    for mine, theirs in zip(added_up(agent), values(texts, symbols, parameters), strict=True):
        assert expand(linear(0, [(1, mine), (-1, theirs)])) is linear(0, [])


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_the_split_of_every_example_is_the_agent_exactly(path):
    table = tomllib.loads(path.read_text(encoding="utf-8"))["agent"]
    parameters = {key: float(value) for key, value in table.get("parameters", {}).items()}
    agent = ExactAgent.from_texts(
        table["name"],
        states=table["states"],
        inputs=table["inputs"],
        dynamics=table["dynamics"],
        outputs=table["outputs"],
        parameters=parameters,
    )
    check_adds_up(agent, table["dynamics"], parameters)
    n, m, q = len(agent.states), len(agent.inputs), len(agent.outputs)
    r, v = len(agent.phi.outputs), agent.phi.inputs
    shapes = [getattr(agent, letter).shape for letter in "ABCGH"]
    assert shapes == [(n, n), (n, m), (q, n), (n, r), (v, n)]
    wrong = {
        **table["dynamics"],
        agent.states[-1]: f"{table['dynamics'][agent.states[-1]]} + 1e-9*{agent.states[0]}",
    }
    with pytest.raises(AssertionError):
        check_adds_up(agent, wrong, parameters)


def test_the_arms_are_those_of_the_paper():
    # (38): the matrices as printed, with the spring of the load
    table = tomllib.loads((ROOT / "examples" / "flexible_joint_arms.toml").read_text(encoding="utf-8"))[
        "agent"
    ]
    kept = ("states", "inputs", "dynamics", "outputs", "parameters")
    agent = ExactAgent.from_texts("arm", **{key: table[key] for key in kept})
    A = [
        ["0", "1", "0", "0"],
        ["-48.6", "-1.25", "48.6", "0"],
        ["0", "0", "0", "1"],
        ["19.5", "0", "-19.5", "0"],
    ]
    assert agent.A.tolist() == [[fmpq(*float(a).as_integer_ratio()) for a in row] for row in A]
    assert agent.G.tolist() == [[0], [0], [0], [1]]
    assert agent.H.tolist() == [[0, 0, 1, 0]]


@pytest.mark.parametrize(
    ("dynamics", "G", "H"),
    [
        (("y", "u - sin(x - y)"), [[0], [1]], [[1, -1]]),
        (("y", "u - sin(y - x)"), [[0], [1]], [[-1, 1]]),
        (("y", "u - sin(2*x - 2*y)"), [[0], [1]], [[1, -1]]),
        (("y", "u - sin((x - y)/3)"), [[0], [1]], [[1, -1]]),
        (("3*(x - y)**3 + u", "-7*(x - y)**3"), [[3], [-7]], [[1, -1]]),
        (("sin(x) + sin(y) + u", "sin(x) - sin(y)"), [[1, 1], [1, -1]], [[1, 0], [0, 1]]),
        (("sin(x) + sin(y) + u", "sin(x) + cos(y)"), [[1, 0], [0, 1]], [[1, 0], [0, 1]]),
        (("sin(x - y) + u", "sin(y - z)", "sin(x - z)"), np.eye(3, dtype=int), [[1, -1, 0], [1, 0, -1]]),
        (("y + u + sin(t)", "-x + 3"), np.zeros((2, 0)), np.zeros((0, 2))),
        (("sin(t)*x + u", "-x"), [[1], [0]], [[1, 0]]),
    ],
)
def test_the_structure_is_as_small_as_the_terms_show(dynamics, G, H):
    agent = plant(*dynamics)
    assert agent.G.shape == np.shape(G) and (agent.G == G).all()
    assert agent.H.shape == np.shape(H) and (agent.H == H).all()


def test_coefficients_are_rational():
    agent = plant("x/3 + 0.1*0.1*x + u/7", "-2*tanh(x)/3")
    assert agent.A[0, 0] == fmpq(1, 3) + fmpq(*(0.1).as_integer_ratio()) ** 2
    assert agent.B[0, 0] == fmpq(1, 7)
    with pytest.raises(ValueError, match="read-only"):
        agent.A[0, 0] = fmpq(0)


def test_conditions_are_those_of_phi_in_its_own_arguments():
    agent = plant("y + 1/t", "u - 1/(x - y) + sqrt(x - y + 3)")
    v = variable(0)
    assert [(c.kind, c.args) for c in agent.phi.conditions] == [
        ("nonzero", (v,)),
        ("not negative", (linear(3, [(1, v)]),)),
    ]


def test_a_condition_of_terms_that_cancel_is_kept_or_refused():
    agent = plant("x*y/y + sin(x)", "u")
    assert agent.H.tolist() == [[1, 0], [0, 1]]  # phi = sin(v1), and v2 must not be 0
    assert [c.args for c in agent.phi.conditions] == [(variable(1),)]
    with pytest.raises(ProblemError, match=r"nonlinear terms cancel, .* and the division among them"):
        plant("x*y/y", "u")


@pytest.mark.parametrize(
    "moves", [[(0, 0, Fraction(1, 2))], [(0, 0, Fraction(1, 3)), (1, 1, Fraction(-5, 7))]]
)
def test_a_moved_slope_changes_no_agent(moves):
    dynamics = {"x": "y + tanh(x)/3 + u", "y": "-x - 0.3*y**3"}
    agent = plant(*dynamics.values())
    moved = agent.moved([Move(*move) for move in moves])
    assert (moved.A != agent.A).any()
    check_adds_up(moved, dynamics, {})
    k, j, amount = moves[0]
    assert (
        moved.A[0, 0] - agent.A[0, 0]
        == fmpq(amount.numerator, amount.denominator) * agent.G[0, k] * agent.H[j, 0]
    )


@pytest.mark.parametrize("move", [(1, 0), (0, 1), (-1, 0), (0, -1)])
def test_a_move_of_what_phi_does_not_have_is_refused(move):
    with pytest.raises(ProblemError, match=r"expected components 1 to 1 and arguments 1 to 1"):
        plant("u - tanh(x)").moved([Move(*move, Fraction(1))])


@pytest.mark.parametrize(
    ("dynamics", "says"),
    [
        (("u*x",), "the input `u` enters through a term"),
        (("u**2",), "the input `u` enters through a term"),
        (("sin(u)",), "the input `u` enters"),
        (("u*t",), "the input `u` enters"),
        (("u*u/u",), "the input `u` enters"),
        (("if_else(u < 1, x, 2*x)",), "the input `u` enters"),
    ],
)
def test_an_input_that_is_not_linear_is_refused(dynamics, says):
    with pytest.raises(ProblemError, match=r"\[agent.dynamics\] x: .* with constant coefficients") as caught:
        plant(*dynamics)
    assert says in str(caught.value)


@pytest.mark.parametrize(
    ("output", "says"),
    [
        ("x**2", "a term is not linear in the states"),
        ("x + t", "a term is not linear in the states"),
        ("x*x/x", "a term is not linear in the states"),
        ("x + 1", "the output has the constant 1"),
        ("x - x", "the output depends on no state"),
        ("x + u", "the input `u` is in an output"),
    ],
)
def test_an_output_that_is_not_linear_is_refused(output, says):
    with pytest.raises(ProblemError) as caught:
        plant("u", outputs={"y1": output})
    assert str(caught.value).startswith("[agent.outputs] y1: ") and says in str(caught.value)


@pytest.mark.parametrize(
    ("names", "says"),
    [
        ({"states": ["x", "x"]}, "`x`; expected at least one of each, all different"),
        ({"states": ["sin"]}, "`sin`; expected"),
        ({"inputs": ["x"]}, "`x`; expected"),
        ({"dynamics": {}}, "`x`; expected one equation per state"),
        ({"dynamics": {"x": "u", "xx": "1"}}, "`xx`; expected one equation per state"),
        ({"parameters": {"k": float("inf")}}, "expected a finite number"),
        ({"name": "a-b"}, "`a-b`; expected"),
        ({"outputs": {}}, "no outputs"),
    ],
)
def test_names_that_could_mean_two_things_are_refused(names, says):
    whole = {
        "name": "p",
        "states": ["x"],
        "inputs": ["u"],
        "dynamics": {"x": "u"},
        "outputs": {"y": "x"},
        **names,
    }
    with pytest.raises(ProblemError) as caught:
        ExactAgent.from_texts(whole.pop("name"), **whole)
    assert says in str(caught.value)


@pytest.mark.parametrize("value", [10**400, -(10**400), float("nan"), float("inf"), True, "1"])
def test_a_parameter_is_a_finite_double(value) -> None:
    with pytest.raises(ProblemError, match="a finite number"):
        plant("k*x + u", parameters={"k": value})
    assert plant("k*x + u", parameters={"k": 1e308}).A[0, 0] == fmpq(int(1e308))
