"""The expression language: what it accepts means what Python means, and all else is refused by name."""

import contextlib
import math

import casadi as ca
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lockstep.check.errors import ProblemError
from lockstep.check.expression.text import FUNCTIONS
from lockstep.model.expression import parse_expression

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


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "empty"),
        ("   ", "empty"),
        ("z", "unknown symbol `z` at column 1"),
        ("2*yy", "did you mean `y`?"),
        ("x + sine(x)", "unknown function `sine` at column 5"),
        ("x^2", "use **"),
        ("x = 2", "`=` is not part"),
        ("x == 2", "`=` is not part"),
        ("x.real", "`.` is not part"),
        ("x.__class__", "`.` is not part"),
        ("__import__('os')", "`__import__` is not part"),
        ("__import__(x)", "`__import__` is not part"),
        ("_x", "`_x` is not part"),
        ("x._y", "`.` is not part"),
        ("eval(x)", "unknown function `eval`"),
        ("open(x)", "unknown function `open`"),
        ('"x"', "is not part"),
        ("lambda x: x", "`lambda` is not part"),
        ("x if x else y", "use if_else"),
        ("x and y", "nest if_else"),
        ("True", "`True` is not part"),
        ("None", "`None` is not part"),
        ("[x]", "`[` is not part"),
        ("x[0]", "`[` is not part"),
        ("{x}", "`{` is not part"),
        ("x % 2", "`%` is not part"),
        ("x // 2", "`x // 2` is not part"),
        ("x << 2", "`x << 2` is not part"),
        ("x @ y", "`@` is not part"),
        ("x; y", "`;` is not part"),
        ("x\ny", "on one line"),
        ("x\r", "on one line"),
        ("x\0", r"`\x00` is not part"),
        ("x # y", "comment"),
        ("x \\", "is not part"),
        ("(x := 1)", "`:` is not part"),
        ("1j", "an operator is missing"),
        ("2x", "write * to multiply"),
        ("2 x", "write * to multiply"),
        ("2(x)", "write * to multiply"),
        ("(x)(y)", "write * to multiply"),
        ("x y", "write * to multiply"),
        ("0x10", "an operator is missing"),
        ("1_000", "`_000` is not part"),
        ("1..2", "an operator is missing"),
        ("007", "starts with a zero"),
        ("1e999", "too large"),
        ("9" * 400, "too large"),
        ("9" * 9000, "too large"),
        ("٣ + x", "is not part"),
        ("θ", r"`\u03b8` is not part"),
        ("ﬁ", "is not part"),
        ("x +", "cannot be read"),
        ("* x", "cannot be read"),
        ("x + * y", "cannot be read"),
        ("(x", "1 `(` not closed"),
        ("x)", "closes nothing"),
        (")x(", "closes nothing"),
        ("x) + (y", "closes nothing"),
        ("()", "a list of values"),
        ("x, y", "a list of values"),
        ("0,5", "a list of values"),
        ("sin", "write sin(...)"),
        ("sin()", "`sin` with 0 arguments"),
        ("sin(x, y)", "`sin` with 2 arguments"),
        ("atan2(x)", "expected 2"),
        ("min(x)", "expected 2 or more"),
        ("if_else(x < 1, 2)", "`if_else` with 2 arguments"),
        ("if_else(x, 1, 2)", "not a condition"),
        ("if_else(0 < x < 1, 1, 2)", "nest if_else"),
        ("x < 1", "a comparison"),
        ("sin(x < 1)", "a comparison"),
        ("if_else((x < 1) < 2, 1, 2)", "a comparison"),
        ("x(t)", "`x` is a symbol, not a function"),
        ("pi(x)", "`pi` is a symbol, not a function"),
        ("sin(*x)", "is not part"),
        ("sin(**x)", "is not part"),
        ("sin(x)(y)", "an operator is missing"),
        ("x/0", "division by zero"),
        ("1/(x - x)", "division by zero"),
        ("0/0", "division by zero"),
        ("log(0)", "`log(0)` is -inf"),
        ("log(-1)", "is nan"),
        ("x*sqrt(-1)", "is nan"),
        ("(-8)**0.5", "is nan"),
        ("0**-1", "is inf"),
        ("1e308*10", "is inf"),
        ("1e308*x*10", "multiply to inf"),
        ("x + " * 2500 + "x", "characters"),
        ("x+" * 1200 + "x", "numbers, names and operators"),
        ("(" * 200 + "x" + ")" * 200, "nested too deeply"),
        ("-" * 1500 + "x", "nested too deeply"),
        ("2**" * 900 + "x", "nested too deeply"),
        ("sin(" * 99 + "-" * 5 + "x" + ")" * 99, "nested too deeply"),
    ],
)
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
