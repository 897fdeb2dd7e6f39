"""Slopes of several arguments have a multiplier each: what is certified does not depend on the units of the file."""

import pytest

from lockstep.lmi.design import design
from lockstep.model.problem import Problem

JACK = """
[agent]
name = "jack"
states = ["x", "v", "q"]
inputs = ["u"]
parameters = { parameters }
dynamics = {{ x = "v", v = "{v}", q = "{q}" }}
outputs = {{ y1 = "x", y2 = "q" }}
domain = {{ q = [-{domain}, {domain}] }}
[network]
agents = 2
topology = "complete"
[design]
method = "given"
gains = [{{ D = [[{D}]] }}, {{ D = [[{D}]] }}]
weights = {{ state = [{R}], input = 0.04 }}
disturbances = {{ states = {{ {scales} }}, outputs = {{ y1 = {noise_x}, y2 = {noise_q} }} }}
[controller]
period = 0.002
"""

MM_BAR = {
    "v": "1000/2000*(196.3*q - 8*v - 600*tanh(v/10))",
    "q": "0.012*(66700*u - 1963*v - 100*q - 632.5*(sqrt(100 + q) - 10))",
    "domain": "50.0",
    "D": "-0.1, -0.02",
    "R": "1.0, 0.03, 0.4",
    "scales": "x = 1.0, v = 6.0, q = 2.0",
    "noise_x": "0.005",
    "noise_q": "0.008",
}
"""A jack of 2 t: friction with a slope of 30 1/s at rest, and the flow through an orifice, in mm, bar and V."""
SI = {
    "v": "(1.963e-3*q - 8000*v - 600*tanh(v/0.01))/2000",
    "q": "1.2e12*(6.67e-5*u - 1.963e-3*v - 1e-12*q - 2.0001406e-9*(sqrt(1e7 + q) - sqrt(1e7)))",
    "domain": "50.0e5",
    "D": "-100.0, -0.02e-5",
    "R": "1.0e6, 0.03e6, 0.4e-10",
    "scales": "x = 0.001, v = 0.006, q = 2.0e5",
    "noise_x": "5.0e-6",
    "noise_q": "800.0",
}
"""The same in m, Pa and V; 632.5 mm^3/s per root of a bar are 2.0001406e-9 m^3/s per root of a Pa."""


def rho_of(part: dict[str, str]) -> float:
    found = design(Problem.parse(JACK.replace("parameters = { parameters }\n", "").format(**part)))
    assert found.certificate is not None
    return found.certificate.rho


def test_the_same_jack_has_the_same_rho_in_mm_and_bar_as_in_SI():
    """2 %: rho is what the solver finds, rounded up; one alpha for both slopes has no certificate in SI at all."""
    assert rho_of(SI) == pytest.approx(rho_of(MM_BAR), rel=0.02)


@pytest.mark.slow
def test_a_cascade_that_one_alpha_loses_is_certified(root):
    """Elowitz and Leibler's repressilator: with alpha alone no controllers of any order are certified."""
    text = (root / "benchmarks" / "designs" / "repressilators.toml").read_text(encoding="utf-8")
    assert design(Problem.parse(text), jobs=1).certified
