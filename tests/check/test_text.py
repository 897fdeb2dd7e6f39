"""Texts read as exact nodes: what they mean, what they need, and what is refused."""

import contextlib
import re
from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from text_cases import BAD

from lockstep.check.errors import ProblemError
from lockstep.check.expression.exact import LONGEST_CONSTANT, Exact, Value
from lockstep.check.expression.node import ONE, ZERO, add, linear, multiply, number, power, variable
from lockstep.check.expression.text import parse

X, Y, T = (variable(k) for k in range(3))
SYMBOLS = {"x": Value(X), "y": Value(Y), "t": Value(T), "k": 2.5}


def read(text: str) -> Value:
    return parse(text, SYMBOLS, Exact(2), where="[agent.dynamics] x")


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("0.1", Fraction(0.1)),
        ("0.1 + 0.2", Fraction(0.1) + Fraction(0.2)),
        ("1/3", Fraction(1, 3)),
        ("(1/3)*3", Fraction(1)),
        ("k*k - 6.25", Fraction(0)),
        ("2**-2", Fraction(1, 4)),
        ("-2**2", Fraction(-4)),
        ("2**3**2", Fraction(512)),
        ("sqrt(9/16)", Fraction(3, 4)),
        ("4**1.5", Fraction(8)),
        ("cos(0) + exp(0) - log(1)", Fraction(2)),
        ("max(1, 5, 3) - min(2, 1/3)", Fraction(14, 3)),
        ("abs(-1/3) + sign(-2)", Fraction(-2, 3)),
        ("if_else(1/3 < 0.3333333333333333, 1, 2)", Fraction(2)),
        ("if_else(2 >= 2, 1, 1/(k - k + 1))", Fraction(1)),
        ("x - x + 0*y + 7", Fraction(7)),
        ("max(1, 2,)", Fraction(2)),
        ("(1 + 1e-30) - 1", Fraction(1e-30)),
    ],
)
def test_arithmetic_on_constants_is_exact(text, value):
    assert number(read(text).node) == value


@pytest.mark.parametrize(
    ("text", "digits"),
    [
        # Digits of the true values: DLMF and OEIS A002193, A001113, A002392, A049469, A003881, A073229.
        ("sqrt(2)", "1.41421356237309504880168872420969807856967"),
        ("2**0.5", "1.41421356237309504880168872420969807856967"),
        ("exp(1)", "2.71828182845904523536028747135266249775724"),
        ("log(10)", "2.30258509299404568401799145468436420760110"),
        ("sin(1)", "0.84147098480789650665250232163029899962256"),
        ("atan(1)", "0.78539816339744830961566084581987572104929"),
        ("atan2(1, 1)", "0.78539816339744830961566084581987572104929"),
        ("pi", "3.14159265358979323846264338327950288419716"),
        ("2**1.5", "2.82842712474619009760337744841939615713934"),
        ("exp(-1000)", "0"),
        ("tanh(1e308)", "1"),
    ],
)
def test_a_function_of_a_constant_is_the_double_nearest_to_it(text, digits):
    assert number(read(text).node) == Fraction(float(digits))


def test_a_sine_of_a_large_number_is_reduced_with_all_of_pi():
    # sin(10^22) = -0.8522008497671888017727... (Muller, Elementary Functions, section 11.1)
    assert number(read("sin(1e22)").node) == Fraction(-0.8522008497671888)


@pytest.mark.parametrize(
    ("text", "node"),
    [
        ("x", X),
        ("+x", X),
        ("--x", X),
        ("x + x - 2*x", ZERO),
        ("3*(x - 2*(y + 1))", linear(-6, [(3, X), (-6, Y)])),
        ("(2*x)*(3*y)", multiply(linear(0, [(6, X)]), Y)),
        ("x/y/t", multiply(X, power(Y, -1), power(T, -1))),
        ("-x**2", linear(0, [(-1, power(X, 2))])),
        ("x**0", ONE),
        ("sin(x)*y - y*sin(x)", ZERO),
        ("(x + y)*t", multiply(add(X, Y), T)),
    ],
)
def test_equal_expressions_are_one_node(text, node):
    assert read(text).node is node


@pytest.mark.parametrize(
    ("text", "needs"),
    [
        ("sin(x)", []),
        ("1/x", ["nonzero"]),
        ("1/exp(x)", []),
        ("x**-2", ["nonzero"]),
        ("log(x)", ["positive"]),
        ("sqrt(x)", ["not negative"]),
        ("tan(x)", ["no pole"]),
        ("asin(x)", ["within one"]),
        ("atan2(x, y)", ["off the cut"]),
        ("x**y", ["positive"]),
        ("sign(x)", ["decided", "decided"]),
        ("if_else(x < 1, x, y)", ["decided"]),
        ("if_else(t < 1, x, y)", []),
        ("0*log(x)", []),
        ("log(x) + log(x)", ["positive"]),
    ],
)
def test_what_an_expression_needs_is_noted(text, needs):
    assert [c.kind for c in read(text).conditions] == needs


def test_a_branch_needs_what_it_needs_only_where_it_is_taken():
    value = read("if_else(x < 1, log(x), 1/x)")
    guards = {c.kind: c.guard for c in value.conditions}
    below = read("if_else(x < 1, 1, 0)").node.args[0]
    assert guards["positive"] is below
    assert guards["nonzero"].op == "not" and guards["nonzero"].args[0] is below
    assert [c.kind for c in read("if_else(1 < 2, x, 1/x)").conditions] == []
    assert [c.kind for c in read("if_else(1 < 2, 1/x, x)").conditions] == ["nonzero"]


@pytest.mark.parametrize("text", [text for text, _ in BAD])
def test_bad_text_is_refused(text):
    """With its place and what was expected; what a mistake looks like is told by `lockstep.model.formulas.mistakes`."""
    with pytest.raises(ProblemError) as caught:
        read(text)
    assert re.search(r" at column [0-9]+ of `|characters|multiply to inf", str(caught.value))
    assert "; expected " in str(caught.value) or "division by zero" in str(caught.value)
    assert str(caught.value).startswith("[agent.dynamics] x: ")
    assert len(str(caught.value)) < 600


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("0**-0.5", "`0**-0.5` is inf"),
        ("0**-0.3", "is inf"),
        ("exp(1000)", "`exp(1000)` is inf"),
        ("-exp(1e308)", "`exp(1e308)` is inf"),
        ("asin(2)", "is nan"),
        ("((1/3)**1000)**1000", "binary digits"),
        ("((3*x)**1000)**1000", "binary digits"),
    ],
)
def test_a_constant_that_no_double_is_near_to_is_refused(text, says):
    with pytest.raises(ProblemError, match="finite number") as caught:
        read(text)
    assert says in str(caught.value)


@pytest.mark.parametrize(
    ("text", "column"),
    [
        ("x^2", 2),
        ("x // 2", 4),
        ("x, y", 2),
        ("x + sin(y", 10),
        ("2x", 2),
        ("_x", 1),
        ("x\ty\n", 4),
        ("sin", 1),
        ("()", 2),
    ],
)
def test_the_column_is_that_of_what_cannot_be_read(text, column):
    with pytest.raises(ProblemError, match=f" at column {column} of `"):
        read(text)


def test_long_numbers_are_not_computed():
    assert LONGEST_CONSTANT <= 1 << 16
    text = "*".join(["(1/3)**999"] * 200)
    with pytest.raises(ProblemError, match="binary digits"):
        read(text)


def test_long_sums_and_nesting_up_to_the_limit_are_fine():
    assert read("x+" * 999 + "x").node is linear(0, [(1000, X)])
    assert read("(" * 90 + "x" + ")" * 90).node is X


@given(st.text(alphabet="xykt0159.e+-*/(), <>=sincoif_lmn", max_size=24))
@settings(max_examples=500)
def test_any_nearly_right_text_is_a_value_or_a_problem(text):
    with contextlib.suppress(ProblemError):
        read(text)


def test_the_order_of_terms_does_not_depend_on_what_was_read_before():
    def terms(*before: str) -> list[str]:
        alive = [read(text) for text in before]
        names = [node.op for node in read("sin(x) + exp(y) + cos(x) + tanh(x*y)").node.args]
        assert len(alive) == len(before)
        return names

    assert terms() == terms("tanh(x*y)", "cos(x)") == terms("exp(y)", "tanh(x*y)")
