"""What domain is named for a nonlinearity without a bound: ranges of states that play a part, in which it is defined."""

import re

import numpy as np
import pytest

from lockstep.model import ProblemError
from lockstep.model.agents.agent import Agent
from lockstep.model.assembly import bound_of


def jack(formula: str, **domain: tuple[float, float]) -> Agent:
    return Agent.from_expressions(
        "jack",
        states=["p", "q"],
        inputs=["u"],
        outputs={"y": "p"},
        dynamics={"p": "q", "q": formula},
        domain=domain,
        units={"q": "bar"},
    )


def remedy(agent: Agent) -> str:
    with pytest.raises(ProblemError, match="no finite bound") as raised:
        bound_of(agent)
    return raised.value.remedy


@pytest.mark.parametrize(
    ("formula", "box"),
    [
        ("u - sqrt(100 + q) - 15*tanh(p)", "q = [-50.0, 50.0] (in bar)"),
        ("u - sqrt(100 - 50*p)", "p = [-0.5, 0.5]"),
        ("u - log(q)", "q = [0.1, 1.0] (in bar)"),
        ("u - 1/(q - 3)", "q = [-1.0, 1.0] (in bar)"),
        ("u - sqrt(-3 - q)", "q = [-100.0, -10.0] (in bar)"),
        ("u - sqrt(1 + p*q)", "p = [-0.5, 0.5], q = [-0.5, 0.5] (in bar)"),
        ("u - tanh(p) - q**3", "q = [-1.0, 1.0] (in bar)"),
    ],
)
def test_who_takes_the_range_that_is_named_has_a_bound(formula, box):
    said = remedy(jack(formula))
    assert said == f"give a box in [agent.domain], such as {box}: the certificate is then local"
    named = re.findall(r"(\w+) = \[(\S+), (\S+)\]", box)
    obeyed = jack(formula, **{state: (float(low), float(high)) for state, low, high in named})
    assert bound_of(obeyed, boxes=2000).proved


def test_a_range_of_the_file_that_is_too_wide_is_told_a_narrower_one():
    assert "such as q = [-50.0, 50.0]" in remedy(jack("u - sqrt(100 + q)", q=(-200.0, 200.0)))


def test_a_range_of_the_file_loses_the_end_that_does_not_do():
    gap = jack("u - 1/p**2", p=(0.0, 20.0))
    assert "such as p = [1.0, 20.0]: " in remedy(gap)
    assert "such as p = [-20.0, -1.0]: " in remedy(jack("u - 1/p**2", p=(-20.0, 0.0)))
    both = remedy(jack("u - sqrt(p)/q", p=(0.0, 2.0), q=(0.0, 4.0)))
    assert "such as q = [0.2, 4.0] (in bar): " in both


def test_a_root_without_a_value_is_no_jump_of_its_sign():
    valve = "u + q*sqrt(210 - sign(q)*p)"
    said = remedy(jack(valve, p=(0.0, 250.0), q=(-60.0, 60.0)))
    box = "p = [0.0, 100.0], q = [-60.0, 60.0] (in bar)"
    assert said == f"give a box in [agent.domain], such as {box}: the certificate is then local"
    with pytest.raises(ProblemError, match=r"on its domain: `sqrt` needs an argument from 0 up"):
        bound_of(jack(valve, p=(0.0, 250.0), q=(-60.0, 60.0)))
    assert np.isfinite(bound_of(jack(valve, p=(0.0, 100.0), q=(-60.0, 60.0)), boxes=3000).alpha)


@pytest.mark.parametrize("root", ["sqrt(q*q - 2*q + 1.5)", "log(q*q - 2*q + 1.5)"])
def test_a_jump_beside_a_value_that_one_interval_does_not_prove_is_a_jump(root):
    """q^2 - 2 q + 1.5 = (q - 1)^2 + 0.5."""
    with pytest.raises(ProblemError, match=r"on its domain: `sign` jumps"):
        bound_of(jack(f"u + sign(p) + {root}", q=(-1.0, 5.0)))


@pytest.mark.parametrize(
    ("formula", "domain", "box"),
    [
        (
            "u - p*log(p*q)",
            {"p": (0.0, 3.0), "q": (999.6, 1000.4)},
            "p = [0.15, 3.0], q = [999.64, 1000.4] (in bar)",
        ),
        ("u - tan(q)", {"q": (2.0, 5.0)}, "q = [2.0, 4.25] (in bar)"),
        ("u - sqrt(q)", {"q": (0.0, 0.6)}, "q = [0.03, 0.6] (in bar)"),
        ("u - sqrt(abs(q))", {}, "q = [0.1, 1.0] (in bar)"),
        ("u - log(q)", {"q": (-1.0, 0.05)}, "q = [0.001, 0.01] (in bar)"),
    ],
)
def test_a_box_keeps_to_the_ranges_of_the_file(formula, domain, box):
    assert f"such as {box}: " in remedy(jack(formula, **domain))
    named = re.findall(r"(\w+) = \[(\S+), (\S+)\]", box)
    obeyed = jack(formula, **{state: (float(low), float(high)) for state, low, high in named})
    assert np.isfinite(bound_of(obeyed, boxes=2000).alpha)


def test_a_range_of_the_file_in_which_nothing_grows_is_not_named():
    assert "such as q = " in remedy(jack("u - p*q", p=(-1.0, 1.0)))


@pytest.mark.parametrize("formula", ["u - sign(q)", "u - sqrt(p + t)"])
def test_where_no_range_is_known_none_is_named(formula):
    assert remedy(jack(formula)).startswith("leave that point out")


def test_no_box_leaves_out_a_time():
    """[agent.domain] refuses `t`, and a slope that is bounded from 0 on is not before."""
    assert remedy(jack("u - exp(-t)*q")).startswith("t is any time, those before 0 too: write a term")
