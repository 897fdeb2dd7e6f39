"""Every interval operation encloses exact values: dense random points, checked in 200-bit ball arithmetic."""

import flint
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lockstep.check.bound import functions, intervals
from lockstep.check.bound.intervals import INF

POINTS = 60
FLOATS = st.floats(allow_nan=False, allow_infinity=False)


def sample_intervals(generator, count, low, high):
    """Wide, narrow, thin and huge intervals in (low, high)."""
    middle = generator.uniform(max(low, -50), min(high, 50), count)
    middle = np.where(generator.random(count) < 0.2, np.clip(middle * 1e6, low, high), middle)
    width = 10.0 ** generator.uniform(-16, 2, count) * (generator.random(count) < 0.9)
    return np.clip(middle - width, low, high), np.clip(middle + width, low, high)


def inside(generator, x):
    """Points of each interval, its ends among them."""
    share = generator.random((POINTS, x[0].size))
    share[0], share[1] = 0.0, 1.0
    return np.clip(x[0] + share * (x[1] - x[0]), x[0], x[1])


def assert_encloses(result, values):
    """No exact value is certainly outside."""
    for column, (low, high) in enumerate(zip(*result, strict=True)):
        for row in values:
            value = row[column]
            if value.is_finite():
                assert not value < flint.arb(low), (low, high, value)
                assert not value > flint.arb(high), (low, high, value)


EXACT = {
    "exp": flint.arb.exp,
    "log": flint.arb.log,
    "sin": flint.arb.sin,
    "cos": flint.arb.cos,
    "tan": flint.arb.tan,
    "asin": flint.arb.asin,
    "acos": flint.arb.acos,
    "atan": flint.arb.atan,
    "sinh": flint.arb.sinh,
    "cosh": flint.arb.cosh,
    "tanh": flint.arb.tanh,
    "sech2": lambda x: 1 / x.cosh() ** 2,
}
DOMAIN = {
    "log": (1e-300, INF),
    "asin": (-1.0, 1.0),
    "acos": (-1.0, 1.0),
}


@pytest.mark.parametrize("name", sorted(EXACT))
def test_a_function_is_enclosed(name):
    generator = np.random.default_rng(3)
    x = sample_intervals(generator, 40, *DOMAIN.get(name, (-INF, INF)))
    evaluate = getattr(functions, name, None) or (lambda x: functions.increasing(name, x))
    with np.errstate(all="ignore"):
        result = evaluate(x)
    with flint.ctx.workprec(200):
        assert_encloses(
            result, [[EXACT[name](flint.arb(float(v))) for v in row] for row in inside(generator, x)]
        )


@pytest.mark.parametrize("name", sorted(set(EXACT) - {"tan", "exp", "sinh", "cosh", "log"}))
def test_a_thin_argument_gives_a_thin_value(name):
    """The enclosure is not vacuous: a few units in the last place at a point."""
    low, high = DOMAIN.get(name, (-3.0, 3.0))
    x = np.linspace(max(low, -3.0) + 0.01, min(high, 3.0) - 0.01, 50)
    evaluate = getattr(functions, name, None) or (lambda x: functions.increasing(name, x))
    lower, upper = evaluate((x, x))
    assert np.all(upper - lower <= 4 * np.spacing(np.abs(lower)) + 1e-300)


@pytest.mark.parametrize("name", ["add", "subtract", "multiply", "hypot", "direction", "atan2", "divide"])
def test_a_binary_operation_is_enclosed(name):
    generator = np.random.default_rng(4)
    x, y = sample_intervals(generator, 60, -INF, INF), sample_intervals(generator, 60, -INF, INF)
    evaluate = {
        "add": intervals.add,
        "subtract": intervals.subtract,
        "multiply": intervals.multiply,
        "hypot": functions.hypot,
        "direction": functions.direction,
        "atan2": functions.atan2,
        "divide": lambda a, b: intervals.multiply(a, intervals.inverse(b)),
    }[name]
    exact = {
        "add": lambda a, b: a + b,
        "subtract": lambda a, b: a - b,
        "multiply": lambda a, b: a * b,
        "hypot": lambda a, b: (a * a + b * b).sqrt(),
        "direction": lambda a, b: a / (a * a + b * b).sqrt(),
        "atan2": flint.arb.atan2,
        "divide": lambda a, b: a / b,
    }[name]
    with np.errstate(all="ignore"):
        result = evaluate(x, y)
    rows = zip(inside(generator, x), generator.permutation(inside(generator, y)), strict=True)
    with flint.ctx.workprec(200):
        assert_encloses(
            result,
            [
                [exact(flint.arb(float(a)), flint.arb(float(b))) for a, b in zip(*row, strict=True)]
                for row in rows
            ],
        )


@pytest.mark.parametrize("exponent", [-3, -2, -1, 1, 2, 3, 4, 7])
def test_a_whole_power_is_enclosed(exponent):
    generator = np.random.default_rng(5)
    x = sample_intervals(generator, 60, -INF, INF)
    with np.errstate(all="ignore"):
        result = intervals.power(x, exponent)
    with flint.ctx.workprec(200):
        assert_encloses(
            result, [[flint.arb(float(v)) ** exponent for v in row] for row in inside(generator, x)]
        )


@settings(max_examples=300)
@given(FLOATS, FLOATS, FLOATS, FLOATS)
def test_sums_and_products_of_any_doubles_are_enclosed(a, b, c, d):
    x, y = np.array(sorted((a, b))), np.array(sorted((c, d)))
    X, Y = (x[:1], x[1:]), (y[:1], y[1:])
    with np.errstate(all="ignore"):
        total, product = intervals.add(X, Y), intervals.multiply(X, Y)
    for p in x:
        for q in y:
            exact_sum, exact_product = (
                flint.fmpq(*float(p).as_integer_ratio()),
                flint.fmpq(*float(q).as_integer_ratio()),
            )
            exact_sum, exact_product = exact_sum + exact_product, exact_sum * exact_product
            for (low, high), value in ((total, exact_sum), (product, exact_product)):
                assert low[0] == -INF or flint.fmpq(*float(low[0]).as_integer_ratio()) <= value
                assert high[0] == INF or flint.fmpq(*float(high[0]).as_integer_ratio()) >= value


def test_exact_operations_stay_exact():
    one, wave = (np.array([3.33]), np.array([3.33])), (np.array([-1.0]), np.array([1.0]))
    assert intervals.multiply(one, wave) == (-3.33, 3.33)
    assert intervals.add((np.array([0.5]),) * 2, (np.array([0.25]),) * 2) == (0.75, 0.75)


def test_what_cannot_be_said_is_everything():
    hole, ray = (np.array([-1.0]), np.array([1.0])), (np.array([0.0]), np.array([INF]))
    with np.errstate(all="ignore"):
        assert intervals.inverse(hole) == (-INF, INF)
        assert functions.tan((np.array([1.0]), np.array([2.0]))) == (-INF, INF)
        assert intervals.subtract(ray, ray) == (-INF, INF)
        assert functions.increasing("log", (np.array([-2.0]), np.array([-1.0]))) == (-INF, INF)
        assert intervals.root((np.array([-2.0]), np.array([-1.0]))) == (-INF, INF)
        low, high = functions.increasing("exp", (np.array([800.0]), np.array([801.0])))
    assert low == intervals.LARGEST
    assert high == INF
