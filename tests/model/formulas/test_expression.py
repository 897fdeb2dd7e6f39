"""The expression language: what it accepts means what Python means, and all else is refused by name."""

import contextlib
import math

import casadi as ca
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from text_cases import BAD

from lockstep.check.errors import ProblemError
from lockstep.check.expression.text import FUNCTIONS
from lockstep.model.formulas.expression import parse_expression

X, Y, T = ca.SX.sym("x"), ca.SX.sym("y"), ca.SX.sym("t")
SYMBOLS = {"x": X, "y": Y, "t": T, "k": 2.5}

PYTHON = {
    **{name: getattr(math, name) for name in FUNCTIONS if hasattr(math, name)},
    "abs": abs,
    "min": min,
    "max": max,
    "sign": lambda a: float((a > 0) - (a < 0)),
    "if_else": lambda condition, a, b: a if condition else b,
    "pi": math.pi,
    "k": 2.5,
}


def value(text: str, x: float = 0.7, y: float = -1.3, t: float = 0.25) -> float:
    parsed = parse_expression(text, SYMBOLS)
    return float(ca.Function("f", [X, Y, T], [parsed])(x, y, t))


@pytest.mark.parametrize(
    "text",
    [
        "1",
        ".5",
        "5.",
        "1e-3",
        "2.5E+2",
        "x",
        "-x",
        "+x",
        "--x",
        "pi*t",
        "k*x",
        " x\t+ y ",
        "-x**2",
        "2**-x",
        "x**2**y",
        "-2**2",
        "x - y - t",
        "x/y/t",
        "x - (y - t)",
        "2*(x + sin(x))",
        "atan2(x, y)",
        "min(x, y, t)",
        "max(x, 0)",
        "abs(y)",
        "fabs(y)",
        "sign(y)",
        "if_else(x < y, x, y)",
        "if_else(x >= 0.7, 1, 2)",
        "if_else(x + y <= 0, if_else(t > 1, 1, 2), 3)",
        "asin(x)+acos(x)+atan(x)",
        "sinh(x)+cosh(x)+tanh(x)",
        "log(x)*sqrt(x)*exp(y)*tan(t)*cos(x)",
        "x**0.5",
    ],
)
def test_means_what_python_means(text: str) -> None:
    names = {**PYTHON, "x": 0.7, "y": -1.3, "t": 0.25}
    assert value(text) == pytest.approx(eval(text.strip(), {"__builtins__": {}}, names), rel=1e-14)


def _texts() -> st.SearchStrategy[str]:
    numbers = st.floats(0.01, 100.0).map(repr) | st.integers(0, 50).map(str)
    leaves = numbers | st.sampled_from(["x", "y", "t", "pi", "k"])
    one = st.sampled_from(["sin", "cos", "tanh", "atan", "abs", "sign", "-", "+", ""])

    def grow(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
        return st.one_of(
            st.builds("{} {} {}".format, inner, st.sampled_from(["+", "-", "*"]), inner),
            st.builds("{}({})".format, one, inner),
            st.builds("({}) / (1.5 + abs({}))".format, inner, inner),
            st.builds("({})**{}".format, inner, st.sampled_from(["2", "3", "0"])),
            st.builds("{}({}, {})".format, st.sampled_from(["min", "max", "atan2"]), inner, inner),
            st.builds(
                "if_else({} {} {}, {}, {})".format,
                inner,
                st.sampled_from(["<", "<=", ">", ">="]),
                inner,
                inner,
                inner,
            ),
        )

    return st.recursive(leaves, grow, max_leaves=12)


@given(_texts(), st.floats(-3, 3), st.floats(-3, 3))
@settings(max_examples=200)
def test_random_expressions_mean_what_python_means(text: str, x: float, y: float) -> None:
    names = {**PYTHON, "x": x, "y": y, "t": 0.25}
    expected = float(eval(text, {"__builtins__": {}}, names))
    # CasADi folds constants and reorders products: the values may differ by rounding, which a function of a
    # large argument or a comparison of nearly equal numbers turns into more. Such cases show by moving the
    # inputs a little.
    moved = float(
        eval(
            text,
            {"__builtins__": {}},
            {
                **names,
                "x": x + 1e-12,
                "y": y - 1e-12,
                "k": 2.5 + 1e-12,
                "t": 0.25 + 1e-12,
                "pi": math.pi + 1e-12,
            },
        )
    )
    if abs(moved - expected) <= 1e-8 * (1 + abs(expected)):
        assert value(text, x, y) == pytest.approx(expected, rel=1e-8, abs=1e-8)


@pytest.mark.parametrize(("text", "says"), BAD)
def test_bad_text_is_refused(text: str, says: str) -> None:
    with pytest.raises(ProblemError) as caught:
        parse_expression(text, SYMBOLS, where="[agent.dynamics] x")
    assert says in str(caught.value)
    assert str(caught.value).startswith("[agent.dynamics] x: ")
    assert len(str(caught.value)) < 600


def test_a_long_sum_is_fine() -> None:
    assert value("x+" * 999 + "x", x=1.0) == 1000.0


def test_nesting_up_to_the_limit_is_fine() -> None:
    assert value("(" * 90 + "x" + ")" * 90) == 0.7


def test_a_deep_caller_gets_the_same_answer() -> None:
    def deep(levels: int) -> float:
        return value("x+" * 999 + "x", x=1.0) if levels == 0 else deep(levels - 1)

    assert deep(300) == 1000.0


@given(st.text(max_size=40))
@settings(max_examples=300)
def test_any_text_parses_or_is_a_problem(text: str) -> None:
    try:
        parsed = parse_expression(text, SYMBOLS)
    except ProblemError:
        return
    assert parsed.shape == (1, 1)


@given(st.text(alphabet="xykt0159.e+-*/(), <>=sincoif_lmn", max_size=24))
@settings(max_examples=500)
def test_any_nearly_right_text_parses_or_is_a_problem(text: str) -> None:
    with contextlib.suppress(ProblemError):
        parse_expression(text, SYMBOLS)
