"""Periods that are long against a fast mode: what doubles make of them, what the checker decides, in any unit of time."""

import flint
import numpy as np
import pytest
from lmi_cases import PATH_2, problem
from scipy.linalg import expm

from lockstep.check.numbers import exactly
from lockstep.check.sampled import lifting
from lockstep.check.sampled.balls import midpoints, working_precision
from lockstep.check.sampled.conjugate_points import lifted_if_regular
from lockstep.check.sampled.lifting import lift
from lockstep.codegen.period_redesign import as_shipped
from lockstep.lmi.design import design
from lockstep.lmi.document import design_file_of


def oven(unit: float, period: float = 0.5):
    """A slow oven, an amplifier and a sensor with lags of 2 and 20 ms, heard every half second: |A| T_s is some 250.

    unit: of time, in s.
    """
    return problem(
        dynamics={
            "T": f"{unit}*(0.2*(j - T) + 0.1*sin(T))",
            "j": f"{500 * unit}*(u - j)",
            "y": f"{50 * unit}*(T - y)",
        },
        outputs={"m": "y"},
        network=PATH_2,
        design='method = "given"\ngains = [{ D = [[-0.5]] }, { D = [[-0.5]] }]\n'
        f"[controller]\nperiod = {period / unit}",
    )


@pytest.mark.parametrize("unit", [1.0, 2.0**30])
@pytest.mark.parametrize("T", [0.001, 0.1, 1.0, 3.0])
def test_a_period_made_of_parts_is_the_one_that_many_digits_give(T, unit, monkeypatch):
    """A stiff agent with a nonlinearity, its first state in units of its own, beside one exponential in 4000 bits."""
    D = np.array([unit, 1.0, 1.0])
    A = np.array([[-0.2, 0.3, 0.0], [0.0, -80.0, 0.0], [40.0, 0.0, -40.0]]) * np.outer(D, 1 / D)
    B, G = np.array([[0.0], [80.0], [0.0]]), np.array([[unit], [0.0], [0.0]])
    H = np.array([[0.1 / unit, 0.0, 0.0]])
    made = lift(A, B, G @ G.T, H.T @ H, T, expm)
    monkeypatch.setattr(lifting, "FAST", 1e9)
    with working_precision(4000):
        true = lift(*(exactly(one) for one in (A, B, G @ G.T, H.T @ H)), T)
        true = [midpoints(one) for one in (true.A_d, true.BB_d, true.CC_d)]
    z = np.append(D, 1.0)
    units = np.outer(1 / D, z), np.outer(1 / D, 1 / D), np.outer(z, z)
    for one, other, in_units in zip((made.A_d, made.BB_d, made.CC_d), true, units, strict=True):
        # Some hundred roundings, and those of e^(2 * 4), beside the largest entry in balanced units.
        size = np.abs(other * in_units).max()
        np.testing.assert_allclose(one * in_units, other * in_units, rtol=0, atol=1e-12 * size)


@pytest.mark.parametrize("T", [0.1, 1.0, 1.4])
def test_the_checker_decides_long_periods(T):
    """x' = -200 x + w, z = x: S' = -400 S + 1 + S^2 ends in its smaller root, 200 - (200^2 - 1)^1/2, by e^(-400 T) of it."""
    A, B, one = (exactly(np.array(value)) for value in ([[-200.0]], [[200.0]], [[1.0]]))
    with working_precision():
        found = lifted_if_regular(A, B, one, one, T)
    assert found is not None
    root = 200 - flint.arb(200**2 - 1).sqrt()
    assert float(found.BB_d[0, 0].mid()) == pytest.approx(float(root.mid()), rel=1e-12)
    assert found.BB_d[0, 0].rel_accuracy_bits() > 100


@pytest.mark.slow
def test_a_fast_lag_beside_a_long_period_is_certified_in_any_unit_of_time():
    """Neither was certified where only rounding was left of the exponential."""
    for unit in (1.0, 1e-3):
        assert as_shipped(design_file_of(design(oven(unit)))).claims.sampled.certified
