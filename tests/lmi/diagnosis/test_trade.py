"""The curve of rho against alpha, where it is known in closed form."""

import json

import pytest
from lmi_cases import DOUBLE_INTEGRATOR, problem

from lockstep.check.errors import ProblemError
from lockstep.lmi.design import design
from lockstep.lmi.document import Stored, design_file_of, parse
from lockstep.lmi.trade_off.rho_against_alpha import as_csv, curve


def stored(dynamics: dict[str, str], outputs: dict[str, str], D: list[float]) -> Stored:
    gains = "\n".join(f"[[design.gains]]\nD = [{D}]" for _ in range(2))
    posed = problem(
        dynamics=dynamics,
        outputs=outputs,
        agent="centre = false",
        network='agents = 2\ntopology = "path"',
        design=f'method = "given"\n{gains}',
    )
    return parse(json.loads(json.dumps(design_file_of(design(posed)).document())), "memory")


def test_the_curve_of_the_scalar_loop_is_1_over_4_minus_alpha() -> None:
    """x_d' = -4 x_d + phi_d + xi_d: rho = 1 / (4 - alpha), and alpha = 4 is out of reach."""
    found = curve(stored({"x": "sin(x) + u"}, {"y": "x"}, [-2.0]), points=4)
    assert found[0][0] == 0.0
    assert found[-1][0] == pytest.approx(4.0, rel=5e-3)
    for alpha, rho in found[:-1]:
        assert rho == pytest.approx(1 / (4 - alpha), rel=1e-3)
    text = as_csv(found).splitlines()
    assert text[0] == "alpha,rho"
    assert text[1] == "0,0.25"
    assert len(text) == 5


def test_there_is_no_curve_of_a_linear_agent_or_of_one_point() -> None:
    linear = stored(DOUBLE_INTEGRATOR, {"y1": "p", "y2": "v"}, [-1.0, -1.0])
    with pytest.raises(ProblemError, match="linear"):
        curve(linear)
    with pytest.raises(ProblemError, match="points"):
        curve(linear, points=1)
