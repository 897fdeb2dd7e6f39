"""Functions on lanes against NumPy and CasADi."""

import ctypes
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from lockstep.campaign.compiled import library
from lockstep.campaign.compiled.lanes import LANES, lanes_header
from lockstep.campaign.compiled.statements import lane_function
from lockstep.check.errors import ProblemError
from lockstep.verification.machines.shared_library import build_library
from lockstep.verification.toolchain import first_compiler

TRY = """
#include "campaign-lanes.h"
{function}
void try_it(const double *in, double *out);
void try_it(const double *in, double *out)
{{
    v x[{n}], y[{m}];
    memcpy(x, in, sizeof x);
    f(x, y);
    memcpy(out, y, sizeof y);
}}
"""


def by_lanes(x: ca.SX, y: ca.SX, values: np.ndarray, directory: Path) -> np.ndarray:
    """Evaluate y(x) on lanes: values (any, LANES, n) to (any, LANES, m)."""
    f = lane_function("f", [x], [y], "x y")
    body = "\n".join(["static void f(" + f.signature + ")", "{", *f.lines, "}"])
    (directory / "campaign-lanes.h").write_text(lanes_header())
    (directory / "try.c").write_text(TRY.format(function=body, n=x.numel(), m=y.numel()))
    flags = [flag for flag in library.FLAGS if not flag.startswith("-W")]
    built = build_library(first_compiler("the lanes"), flags, ["try.c"], directory, "functions on lanes")
    try_it = ctypes.CDLL(str(built)).try_it
    found = np.empty((len(values), y.numel(), LANES))
    for out, row in zip(found, values, strict=True):
        given = np.ascontiguousarray(row.T)
        try_it(given.ctypes.data_as(ctypes.c_void_p), out.ctypes.data_as(ctypes.c_void_p))
    return found.transpose(0, 2, 1)


def test_sine_and_cosine(tmp_path):
    x = ca.SX.sym("x", 25)
    random, shape = np.random.default_rng(0), (20, LANES, 25)
    values = random.uniform(-4, 4, shape)
    values[5:15] = (
        np.pi / 2 * random.integers(-1000, 1000, (10, LANES, 25)) + random.normal(size=(10, LANES, 25)) * 1e-8
    )
    values[15:] = random.uniform(-2e6, 2e6, (5, LANES, 25))
    values[0, 0, :4], values[0, 1, 0] = [np.inf, -np.inf, np.nan, -0.0], 1e300
    found = by_lanes(x, ca.vertcat(ca.sin(x), ca.cos(x)), values, tmp_path)
    with np.errstate(invalid="ignore"):
        expected = np.concatenate([np.sin(values), np.cos(values)], axis=2)
    # One rounding of the result, one of the reduced angle, and NumPy's own: each half an ulp of 1, a little more.
    assert np.allclose(found, expected, rtol=0, atol=3 * 2.0**-53, equal_nan=True)
    assert not np.isfinite(found[0, 0, :3]).any()
    assert np.isfinite(found[1:]).all()


def test_every_function_that_a_problem_may_hold(tmp_path):
    x = ca.SX.sym("x", 3)
    a, b, c = ca.vertsplit(x)
    u = ca.tanh(a) * 0.9
    y = ca.vertcat(
        *(ca.tan(a), ca.asin(u), ca.acos(u), ca.atan(b), ca.atan2(a, b), ca.sinh(a), ca.cosh(b), ca.tanh(c)),
        *(
            ca.exp(a),
            ca.log(ca.fabs(b)),
            ca.sqrt(ca.fabs(c)),
            ca.fmin(a, b),
            ca.fmax(a, b),
            ca.sign(a),
            ca.sign(0 * a),
        ),
        *(ca.if_else(a < b, c, -c), ca.if_else(ca.logic_and(a <= b, b >= c), a, b), ca.if_else(a == a, 1, 2)),
        *(
            ca.fabs(a) ** 1.7,
            ca.fabs(a) ** b,
            a**2,
            a**3,
            1 / b,
            a / c,
            ca.floor(a),
            ca.ceil(a),
            ca.fmod(a, 0.3),
        ),
        *(
            ca.logic_or(a > 0, b > 0),
            ca.logic_not(a > 0),
            a != b,
            ca.erf(a),
            ca.copysign(a, b),
            2.5 - a,
            -a,
            a + a,
        ),
        *(ca.asinh(a), ca.acosh(1 + b * b), ca.atanh(u), ca.log1p(b * b), ca.expm1(a), ca.hypot(a, b)),
    )
    values = np.random.default_rng(1).normal(size=(LANES, 3)) * 2
    expected = np.array([np.array(ca.Function("f", [x], [y])(row)).ravel() for row in values])
    assert np.isfinite(expected).all()
    # The same operations from the same C library, but for sin and cos.
    assert by_lanes(x, y, values[None], tmp_path)[0] == pytest.approx(expected, rel=1e-14, abs=1e-15)
    with pytest.raises(ProblemError, match="operation"):
        lane_function(
            "f", [x], [ca.SX.remainder(a, b) if hasattr(ca.SX, "remainder") else ca.remainder(a, b)], "x y"
        )
