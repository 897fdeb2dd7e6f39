"""Claims say what they count and on what they rest: scales of disturbances, the rows of L, messages in time, a domain."""

import pytest

import lockstep
from lockstep.codegen.from_design import specification
from lockstep.workflow.explain import explain

CELLS = """
[agent]
name = "cell"
states = ["x"]
inputs = ["u"]
dynamics = {{ x = "u - 0.3*x + 0.5*tanh(x)" }}
outputs = {{ y = "x" }}
domain = {{ x = [-4.0, 4.0] }}
limits = {{ u = [-20.0, 20.0] }}
{agent}
[network]
agents = 2
topology = "leader_path"
{network}
[design]
method = "given"
gains = [{{ D = [[-1.5]] }}, {{ D = [[-1.5]] }}]
{design}
[controller]
period = 0.01
"""


def designed(**more: str) -> lockstep.Design:
    parts = dict.fromkeys(("agent", "network", "design"), "") | more
    return lockstep.design(lockstep.Problem.parse(CELLS.format(**parts)))


def claimed(design: lockstep.Design) -> dict[str, str]:
    return {key: str(value) for key, value in specification(design.stored).certificate.items()}


def test_of_plain_disturbances_it_is_said_that_they_are():
    """A header that named the noise of outputs alone had its rho read as the gain from noise."""
    found = claimed(designed())
    assert found["disturbances"] == (
        "each state's counted in its scale, in its unit per second: x 1; as differences from the mean of all agents"
    )
    assert "in L2, counted as `disturbances` says" in found["limits_gain"]


@pytest.mark.parametrize(
    ("design", "said"),
    [
        ("disturbances = { states = { x = 0.02 }, outputs = { y = 0.001 } }", "its unit per second: x 0.02"),
        ('coordinates = "laplacian_rows"', "as differences from each other, by the rows of L"),
    ],
)
def test_the_scales_and_coordinates_of_disturbances_are_told(design, said):
    """x is moved by 0.02 of what is counted as 1: who reads |xi| in the units of x is told 50 times too much."""
    made = designed(design=design)
    found = claimed(made)
    assert said in found["disturbances"]
    assert "in L2, counted as `disturbances` says" in found["limits_gain"]
    (explained,) = (one.meaning for one in explain(made).proved if one.name == "rho")
    assert ("its scale 0.02" in explained) == ("x 0.02" in said)


@pytest.mark.parametrize(
    ("weights", "said"),
    [
        ("{}", None),
        ("{ state = 2.0, input = 0.5 }", "x 2, u 0.5"),
        ("{ input = 1.0 }", "each state 1, u 1"),  # plain is not to weigh u at all
        ("{ state = [[3.0]] }", "x 3"),
    ],
)
def test_what_rho_weighs_and_the_noise_it_counts_are_told(weights, said):
    """rho of a header is a number of no meaning without them: whoever holds the C holds the header."""
    found = claimed(
        designed(design=f"weights = {weights}\ndisturbances = {{ states = 1.0, outputs = {{ y = 0.001 }} }}")
    )
    assert "noise on each output in its scale, in its unit: y 0.001" in found["disturbances"]
    assert "its unit per second: x 1;" in found["disturbances"]
    assert found.get("weighed") == (None if said is None else f"squares by these weights: {said}")


def test_only_the_line_of_messages_is_of_messages_that_are_late():
    found = claimed(designed(network="messages = { delay = [0, 2] }"))
    assert "every message arrives in time (of those that do not, `messages` alone" in found["assumes"]
    assert "with every message in time" in found["leader"]


@pytest.mark.slow
def test_integers_are_claimed_to_agree_in_the_domain_only(tmp_path):
    made = designed(agent="output_range = { y = [-10.0, 10.0] }")
    lockstep.generate(made, tmp_path / "c", exports=["fixed"])
    header = (tmp_path / "c" / "fixed" / "cell2_fixed.h").read_text(encoding="utf-8")
    proved = header.partition("PROVED")[2].partition("NEIGHBOURS")[0]
    assert "every agent stays in its domain (-4 <= x <= 4)" in proved
    assert "every message arrives in time" in proved


@pytest.mark.slow
@pytest.mark.parametrize(
    ("weight", "said"), [(1.0, None), (2.0, "each state 1, each state of a controller 2")]
)
def test_what_rho_weighs_of_controllers_is_told(weight, said):
    """Whoever compares two rho has to know that the states of the controllers are counted, and how much."""
    one = "{ A = [[-2.0]], B = [[0.1]], C = [[0.1]], D = [[-1.5]] }"
    text = CELLS.format(agent="", network="", design=f"order = 1\nweights = {{ controller = {weight} }}")
    text = text.replace("{ D = [[-1.5]] }", one)
    found = claimed(lockstep.design(lockstep.Problem.parse(text)))
    assert found.get("weighed") == (None if said is None else f"squares by these weights: {said}")
