"""What is written is what was meant: the text, read back, gives the same bits, and the same text."""

import math
import struct

import casadi as ca
import pytest
from hypothesis import HealthCheck, given, reject, settings
from hypothesis import strategies as st

from lockstep.check.errors import ProblemError
from lockstep.model.formulas.expression import parse_expression
from lockstep.model.formulas.expression_text import expression_text

X, Y, T = ca.SX.sym("x"), ca.SX.sym("y"), ca.SX.sym("t")
SYMBOLS = {"x": X, "y": Y, "t": T}
NOT = ca.logic_not


def unary(op: int, a: ca.SX) -> ca.SX:
    return ca.SX.unary(op, a)


WRITTEN = [
    (X, "x"),
    (ca.SX(0), "0"),
    (ca.SX(-2.5), "-2.5"),
    (ca.SX(1e22), "1e+22"),
    (ca.SX(5e-324) * X, "5e-324*x"),
    (0.1 + X, "0.1 + x"),
    (X - 2, "x - 2"),
    (X + (-2), "x + -2"),
    (X - (Y - T), "x - (y - t)"),
    ((X - Y) - T, "x - y - t"),
    (X + (Y + T), "x + (y + t)"),
    (X / (Y / T), "x/(y/t)"),
    (X * Y / T, "x*y/t"),
    (X / (Y * T), "x/(y*t)"),
    (2 * (X * Y), "2*(x*y)"),
    ((X + Y) * (X - Y), "(x + y)*(x - y)"),
    (X + X, "2*x"),
    (-(2 * X), "-(2*x)"),
    (-2 * X, "-2*x"),
    (-(X * Y), "-x*y"),
    (-(X - Y), "-(x - y)"),
    (-(X**2), "-x**2"),
    (-(2**X * Y), "-(2**x*y)"),
    ((-X) ** 3, "-x**3"),
    (X**2, "x**2"),
    (X**3, "x**3"),
    (X**97, "x**97"),
    (X**100, "x**100"),
    (X**101, "x**101"),
    (X**-3, "1/x**3"),
    (X**1.5, "x**1.5"),
    (X**0.5, "sqrt(x)"),
    (X ** (-Y), "x**-y"),
    (2 ** (X**Y), "2**x**y"),
    ((2**X) ** Y, "(2**x)**y"),
    ((-2) ** X, "(-2)**x"),
    ((X + Y) ** 3, "(x + y)**3"),
    (X * X * X, "x**2*x"),
    (1 / X, "1/x"),
    (Y * (1 / X), "y/x"),
    (1 / (-X), "1/-x"),
    (-(1 / X), "-(1/x)"),
    (ca.fmin(X, ca.fmax(Y, 1)), "min(x, max(y, 1))"),
    (ca.fabs(ca.sign(X)), "abs(sign(x))"),
    (ca.atan2(X, 2 * Y), "atan2(x, 2*y)"),
    (ca.if_else(X < Y, X, -Y), "if_else(x < y, x, -y)"),
    (ca.if_else(X >= 1, 1, Y), "if_else(1 <= x, 1, y)"),
    (ca.if_else(X < 2, Y, 0), "if_else(x < 2, y, 0)"),
    (ca.if_else(X < 2, 0, Y), "if_else(x < 2, 0, y)"),
    (ca.if_else(NOT(X < 1), Y, T), "if_else(x < 1, t, y)"),
    (ca.if_else(X < 1, ca.if_else(Y < 2, 1, X), 0), "if_else(x < 1, if_else(y < 2, 1, x), 0)"),
    (2 * ca.if_else(X < 2, Y, 0), "if_else(x < 2, 2*y, 0)"),
    (unary(ca.OP_SQ, ca.if_else(X < 2, Y, 0)), "if_else(x < 2, y**2, 0)"),
    (unary(ca.OP_TWICE, ca.if_else(X < 2, 0, Y)), "if_else(x < 2, 0, 2*y)"),
    ((X < 1) * Y, "if_else(x < 1, y, 0)"),
    (NOT(X < 1), "if_else(x < 1, 0, 1)"),
    ((X < 1) < 0.5, "if_else(if_else(x < 1, 1, 0) < 0.5, 1, 0)"),
]


@pytest.mark.parametrize(("value", "text"), WRITTEN, ids=[text for _, text in WRITTEN])
def test_is_written_as_a_person_would(value: ca.SX, text: str) -> None:
    assert expression_text(value, SYMBOLS) == text
    assert expression_text(parse_expression(text, SYMBOLS), SYMBOLS) == text


ONE = [
    ca.OP_NEG,
    ca.OP_INV,
    ca.OP_SQ,
    ca.OP_TWICE,
    *(
        ca.OP_SIN,
        ca.OP_COS,
        ca.OP_TAN,
        ca.OP_ASIN,
        ca.OP_ACOS,
        ca.OP_ATAN,
        ca.OP_SINH,
        ca.OP_COSH,
        ca.OP_TANH,
    ),
    *(ca.OP_EXP, ca.OP_LOG, ca.OP_SQRT, ca.OP_SIGN, ca.OP_FABS),
]
TWO = [
    ca.OP_ADD,
    ca.OP_SUB,
    ca.OP_MUL,
    ca.OP_DIV,
    ca.OP_POW,
    ca.OP_ATAN2,
    ca.OP_FMIN,
    ca.OP_FMAX,
]
NUMBERS = st.sampled_from([-1.0, 0.0, 0.1, 0.5, 1.0, 2.0, 3.0, -2.0, 1 / 3]) | st.floats(-1e6, 1e6)


@st.composite
def expressions(draw: st.DrawFn, *, truths: bool = False) -> ca.SX:
    """A graph of up to twelve operations whose parts may be used again and again.

    With `truths`, comparisons are numbers too.
    """
    parts: list[ca.SX] = [X, Y, T]
    pick = st.integers(0, 50)

    def part() -> ca.SX:
        k = draw(pick)
        return ca.SX(draw(NUMBERS)) if k < 8 else parts[-1 - k % min(len(parts), 5)]

    kinds = st.sampled_from(["one", "two", "two", "if", "half", "power", *(["truth"] if truths else [])])
    for kind in draw(st.lists(kinds, min_size=1, max_size=12)):
        condition = draw(st.sampled_from([lambda a, b: a < b, lambda a, b: a >= b]))
        match kind:
            case "one":
                new = unary(draw(st.sampled_from(ONE)), part())
            case "two":
                new = ca.SX.binary(draw(st.sampled_from(TWO)), part(), part())
            case "power":
                new = part() ** draw(st.integers(-5, 12) | st.sampled_from([0.5, 1.5, -0.25, 101]))
            case "if":
                new = ca.if_else(condition(part(), part()), part(), part())
            case "half":
                test = condition(part(), part())
                new = ca.if_else(NOT(test) if draw(st.booleans()) else test, part(), 0)
            case _:
                new = condition(part(), part())
        parts.append(new)
    return parts[-1]


POINTS = st.tuples(*[st.floats(-3, 3) | st.sampled_from([0.0, -0.0, 1.0, 0.5])] * 3)
SLOW_STARTS = settings(suppress_health_check=[HealthCheck.filter_too_much, HealthCheck.too_slow])


def text_of(value: ca.SX) -> str:
    """The text; expressions with a constant such as log(-1), and some that grow too long, have none."""
    try:
        return expression_text(value, SYMBOLS)
    except ProblemError as error:
        if not error.found.startswith(
            ("the constant nan", "the constant inf", "the constant -inf", "as text, ")
        ):
            raise
        return reject()


def values(value: ca.SX, points: list[tuple[float, ...]]) -> list[float]:
    function = ca.Function("f", [X, Y, T], [value])
    return [float(function(*point)) for point in points]


def both_finite(f: ca.SX, g: ca.SX, points: list[tuple[float, ...]]) -> list[tuple[float, float]]:
    pairs = zip(values(f, points), values(g, points), strict=True)
    return [(a, b) for a, b in pairs if math.isfinite(a) and math.isfinite(b)]


@pytest.mark.slow
@given(expressions(), st.lists(POINTS, min_size=5, max_size=5))
@settings(SLOW_STARTS, max_examples=200)
def test_the_text_gives_the_same_bits_and_the_same_text(f: ca.SX, points: list[tuple[float, ...]]) -> None:
    text = text_of(f)
    again = parse_expression(text, SYMBOLS)
    assert expression_text(again, SYMBOLS) == text
    for a, b in both_finite(f, again, points):
        assert struct.pack("d", a) == struct.pack("d", b), (str(f), text)


@given(expressions(truths=True), st.lists(POINTS, min_size=5, max_size=5))
@settings(SLOW_STARTS, max_examples=100)
def test_comparisons_as_numbers_give_the_same_values(f: ca.SX, points: list[tuple[float, ...]]) -> None:
    """Equal as numbers: the zero of a branch that is not taken may have the other sign, and 1/0 with it."""
    text = text_of(f)
    again = parse_expression(text, SYMBOLS)
    assert expression_text(again, SYMBOLS) == text
    for a, b in both_finite(f, again, points):
        assert a == b, (str(f), text)


@pytest.mark.parametrize(
    ("value", "told"),
    [
        (ca.erf(X), "the operation `erf`"),
        (ca.log1p(X), "the operation `log1p` .* write log\\(1 \\+ x\\)"),
        (ca.fmod(X, Y), "the operation `fmod`"),
        (X + ca.floor(Y), "the operation `floor`"),
        (ca.if_else(ca.logic_and(X < 1, Y < 1), X, Y), "the operation `and` .* nest if_else"),
        (ca.if_else(X == Y, 1, 2), "the operation `eq`"),
        (ca.if_else(X, 1, Y), "the condition `x` is no comparison"),
        (X / 0, "the constant inf"),
        (ca.SX.sym("z") + X, "the symbol `z` has no name here; expected x, y, t"),
        (ca.vertcat(X, Y), "an expression of 2 x 1; expected a scalar"),
    ],
)
def test_what_the_language_lacks_is_refused_by_name(value: ca.SX, told: str) -> None:
    with pytest.raises(ProblemError, match=rf"^\[agent.dynamics\] x: {told}"):
        expression_text(value, SYMBOLS, where="[agent.dynamics] x")


def repeated(levels: int) -> ca.SX:
    """z = sin(z)*cos(z) again and again: twice as long as text each time, two operations more as a graph."""
    z = X
    for _ in range(levels):
        z = ca.sin(z) * ca.cos(z)
    return z


def chain(terms: int) -> ca.SX:
    value = X
    for k in range(terms - 1):
        value = value + (Y if k % 2 else T)
    return value


def nested(levels: int) -> ca.SX:
    value = X
    for _ in range(levels):
        value = ca.sin(value)
    return value


@pytest.mark.parametrize(
    ("longest", "too_long", "told"),
    [
        (repeated(7), repeated(8), "as text, .*2000; a part that is used twice is written twice"),
        (repeated(7), repeated(200), "as text, it has more than 10000 characters"),
        (chain(1000), chain(1001), "as text, an expression of 2001 numbers, names and operators"),
        (nested(100), nested(101), "as text, the expression is nested too deeply"),
    ],
    ids=["doubled", "doubled often", "chained", "nested"],
)
def test_a_text_beyond_the_limits_of_the_language_is_refused(
    longest: ca.SX, too_long: ca.SX, told: str
) -> None:
    text = expression_text(longest, SYMBOLS)
    assert values(parse_expression(text, SYMBOLS), [(0.3, 0.5, 0.7)]) == values(longest, [(0.3, 0.5, 0.7)])
    with pytest.raises(ProblemError, match=told):
        expression_text(too_long, SYMBOLS)


@pytest.mark.parametrize("make", [lambda: (X - Y) + Y, lambda: X**3, lambda: ca.sin(X) * 2 * 3])
def test_what_casadi_would_build_otherwise_is_refused(make) -> None:
    """Without its simplifications CasADi keeps (x - y) + y, which is not x to the bit, and pow(x, 3)."""
    ca.GlobalOptions.setSimplificationOnTheFly(False)
    try:
        value = make()
    finally:
        ca.GlobalOptions.setSimplificationOnTheFly(True)
    with pytest.raises(
        ProblemError, match=r"CasADi builds .* expected an expression made with CasADi's simpl"
    ):
        expression_text(value, SYMBOLS)
    assert expression_text(make(), SYMBOLS)
