"""Random expressions: no difference of function values, which knows no derivative, beats what is proved."""

import math

import casadi as ca
import numpy as np
from bound_cases import smallest_bound
from hypothesis import HealthCheck, example, given, reject, settings
from hypothesis import strategies as st

from lockstep.check.errors import ProblemError
from lockstep.model.bound_search import Box

SMOOTH = {
    "sin": ca.sin,
    "cos": ca.cos,
    "tanh": ca.tanh,
    "atan": ca.atan,
    "bell": lambda x: ca.exp(-(x**2)),
    "square": lambda x: x**2,
    "rational": lambda x: x / (1 + x**2),
    "log": lambda x: ca.log(2 + x**2),
    "root": lambda x: ca.sqrt(1 + x**2),
    "sinh": lambda x: ca.sinh(ca.tanh(x)),
}
PIECEWISE = {
    "fabs": ca.fabs,
    "cut": lambda x: ca.fmin(ca.fmax(x, -0.5), 0.7),
    "branch": lambda x: ca.if_else(x > 0.5, x**2, x - 0.25),
    "jump": lambda x: ca.if_else(x > 0.5, x, -x),
    "sign": ca.sign,
    "sqrt": ca.sqrt,
    "inverse": lambda x: 1 / x,
}
PAIRS = {
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
    "/": lambda a, b: a / (1 + b**2),
}
MORE_PAIRS = {
    "fmin": ca.fmin,
    "fmax": ca.fmax,
    "hypot": ca.hypot,
    "larger": lambda a, b: ca.if_else(a > b, a, b),
}


def trees(unary, binary, variables):
    leaves = st.one_of(st.sampled_from(range(variables)), st.floats(-3, 3).map(lambda x: round(x, 3)))
    return st.recursive(
        leaves,
        lambda inner: st.one_of(
            st.tuples(st.sampled_from(sorted(unary)), inner),
            st.tuples(inner, st.sampled_from(sorted(binary)), inner),
        ),
        max_leaves=6,
    )


def build(tree, symbols):
    names = {**SMOOTH, **PIECEWISE}
    if isinstance(tree, int):
        return symbols[tree]
    if isinstance(tree, float):
        return ca.SX(tree)
    if len(tree) == 2:
        return names[tree[0]](build(tree[1], symbols))
    return {**PAIRS, **MORE_PAIRS}[tree[1]](build(tree[0], symbols), build(tree[2], symbols))


def largest_secant(phi, size, lower, upper, count=5_000):
    """max |phi(a) - phi(b)|/|a - b| over random pairs, near and far, less the rounding error it may have."""
    generator = np.random.default_rng(0)
    a = generator.uniform(lower, upper, (size, count))
    b = np.clip(
        a + generator.standard_normal((size, count)) * 10 ** generator.uniform(-4, 1, count), lower, upper
    )
    mapped = phi.map(count)
    fa, fb = np.array(mapped(a, 0.0)).ravel(), np.array(mapped(b, 0.0)).ravel()
    distance = np.sqrt(np.square(a - b).sum(axis=0))
    usable = (distance > 1e-7) & np.isfinite(fa) & np.isfinite(fb)
    # Cancellation: 64 units in the last place of the values, over the distance.
    error = 64 * 2.0**-53 * (np.abs(fa) + np.abs(fb) + 1) / np.maximum(distance, 1e-7)
    with np.errstate(invalid="ignore"):  # inf - inf, where a value is none
        slopes = np.abs(fa - fb) / np.maximum(distance, 1e-7) - error
    return float(slopes[usable].max(initial=0.0))


def phi_of(tree, size):
    v, t = ca.SX.sym("v", size), ca.SX.sym("t")
    return ca.Function("phi", [v, t], [build(tree, [v[i] for i in range(size)])])


COMMON = {"suppress_health_check": list(HealthCheck)}


@settings(max_examples=200, **COMMON)
@given(
    trees(SMOOTH, PAIRS, 1),
    st.sampled_from([Box((-2.0,), (1.5,)), Box.everywhere(1), Box((0.5,), (math.inf,))]),
)
def test_no_sample_beats_the_proof_of_a_smooth_scalar(tree, box):
    phi = phi_of(tree, 1)
    bound = smallest_bound(phi, box, boxes=2000, tolerance=1e-6)
    low, high = max(box.lower[0], -20.0), min(box.upper[0], 20.0)
    assert bound.alpha * (1 + 1e-12) >= largest_secant(phi, 1, low, high)
    if bound.converged:
        # Tight: the slope reached is one, by an independent derivative.
        v = ca.SX.sym("v")
        slope = ca.Function("slope", [v], [ca.jacobian(build(tree, [v]), v)])
        assert bound.alpha <= abs(float(slope(bound.witness.v[0]))) * (1 + 2e-6) + 1e-12


@settings(max_examples=100, **COMMON)
@given(trees({**SMOOTH, **PIECEWISE}, {**PAIRS, **MORE_PAIRS}, 2))
@example((1, "fmin", ("sqrt", 1)))  # at a kink one slope is infinite either way
@example((0, "/", ("sqrt", 0)))
def test_no_sample_beats_the_proof_of_a_piecewise_function(tree):
    phi = phi_of(tree, 2)
    try:
        bound = smallest_bound(phi, Box((-1.0, -1.0), (1.5, 1.5)), boxes=1500, tolerance=1e-2)
    except ProblemError:
        reject()  # CasADi itself has folded the square root of a negative constant to NaN
    assert bound.alpha * (1 + 1e-12) >= largest_secant(phi, 2, -1.0, 1.5)
