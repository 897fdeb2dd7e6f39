"""Periods that are long against a fast mode: what doubles make of them, what the checker decides, in any unit of time."""

import flint
import numpy as np
import pytest
from lmi_cases import PATH_2, problem
from scipy.linalg import expm

from lockstep.check.numbers import as_floats, exactly
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


@pytest.mark.parametrize("T", [0.001, 0.1, 1.0, 3.0])
def test_a_period_made_of_parts_is_the_one_that_many_digits_give(T):
    """A stiff agent with a nonlinearity: 2000 bits lose nothing that matters in e^(2 |A| T_s)."""
    A = np.array([[-0.2, 0.3, 0.0], [0.0, -80.0, 0.0], [40.0, 0.0, -40.0]])
    B, G, H = np.array([[0.0], [80.0], [0.0]]), np.array([[1.0], [0.0], [0.0]]), np.array([[0.1, 0.0, 0.0]])
    made = lift(A, B, G @ G.T, H.T @ H, T, expm)
    with working_precision(2000):
        true = lift(*(exactly(one) for one in (A, B, G @ G.T, H.T @ H)), T)
        true = [midpoints(one) for one in (true.A_d, true.BB_d, true.CC_d)]
    for one, other in zip((made.A_d, made.BB_d, made.CC_d), true, strict=True):
        # Some hundred roundings, beside the largest entry.
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-12 * np.abs(other).max())


def test_the_checker_has_the_digits_that_a_long_period_takes():
    A, B, none = (exactly(np.array(one)) for one in ([[-200.0]], [[200.0]], [[0.0]]))
    one = exactly(np.array([[1.0]]))
    for period in (0.1, 1.0, 1.4):
        with working_precision():
            found, linear = (lifted_if_regular(A, B, one, out, period) for out in (one, none))
        assert found is not None
        assert linear is not None
        # w = x feeds back: x' = -200 x + w is 1 / 400 of what w is, so that A_d is e^(-200 T) and x goes to u.
        assert as_floats(np.array([[found.A_d[0, 1].mid()]])) == pytest.approx(1.0, rel=1e-4)
        assert flint.arb(found.BB_d[0, 0]).rel_accuracy_bits() > 100


def test_what_is_proved_of_a_long_period_knows_no_unit_of_time():
    """In s and in ms; neither was certified where only rounding was left of the exponential."""
    of_s, of_ms = (as_shipped(design_file_of(design(oven(unit)))).claims.sampled for unit in (1.0, 1e-3))
    assert of_s.certified
    assert of_ms.certified
    # The edge is the same, and how far before it a proof is tried goes in steps, the longest of which is from 0.95 to 0.85.
    assert of_ms.max_period == pytest.approx(1e3 * of_s.max_period, rel=0.15)
