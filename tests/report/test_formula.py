"""Formulas as MathML: what is typeset means what the text means."""

import re
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lockstep.report.formula import equation, inline, symbol

ATOMS = st.sampled_from(["a", "b", "2.5", "theta_m", "3"])
VALUES = {"a": 1.3, "b": -0.7, "theta_m": 0.4}


def grown(inner):
    binary = st.tuples(inner, st.sampled_from(["+", "-", "*", "/"]), inner).map(
        lambda p: f"({p[0]}){p[1]}({p[2]})"
    )
    bare = st.tuples(ATOMS, st.sampled_from(["+", "-", "*", "/"]), inner).map("".join)
    raised = inner.map(lambda x: f"({x})**2")
    minus = inner.map(lambda x: f"-{x}")
    called = inner.map(lambda x: f"cos({x})")
    return st.one_of(binary, bare, raised, minus, called)


FORMULAS = st.recursive(ATOMS, grown, max_leaves=8)


def meaning(markup: str) -> str:
    """Read MathML back, as a reader does: what is side by side is multiplied, a fraction is a quotient."""
    root = ElementTree.fromstring(f"<r>{markup}</r>")
    return "".join(map(_read, root))


def _read(node) -> str:
    parts = [_read(child) for child in node]
    match node.tag:
        case "mo":
            return {"−": "-", "·": "*", "\u2062": "*", "\u2061": "", "|": "|"}.get(node.text, node.text)
        case "mspace":
            return ""
        case "msub":
            return {"θm": "theta_m"}["".join(child.text for child in node)]
        case "msup":
            return f"(({parts[0]})**({parts[1]}))"
        case "mfrac":
            return f"(({parts[0]})/({parts[1]}))"
        case "mi" | "mn":
            return node.text
    return "".join(parts)


@given(FORMULAS)
def test_what_is_typeset_means_what_is_written(text):
    from math import cos

    def value(formula):
        try:
            return eval(formula, {"cos": cos, "__builtins__": {}}, VALUES)
        except (ZeroDivisionError, OverflowError):
            return None

    written = value(text)
    typeset = value(meaning(equation(symbol("a"), text)).partition("=")[2])
    assert (written is None) == (typeset is None)
    if written is not None:
        # the same operations, but for signs taken out of products and sums taken apart: some roundings differ
        scale = max(1.0, abs(written))
        assert typeset == pytest.approx(written, rel=1e-6, abs=1e-9 * scale)


def test_a_lost_bracket_would_be_seen():
    assert meaning(equation(symbol("a"), "2*(a - b)")) == "a=2*(a-b)"
    assert meaning(equation(symbol("a"), "2*a - b")) == "a=2*a-b"


def test_a_sum_breaks_before_each_term():
    text = "-48.6*theta_m - 1.25*a + 48.6*b"
    assert equation(symbol("a"), text).count("<math>") == 4


@pytest.mark.parametrize(
    ("text", "seen"),
    [
        ("sqrt(a)", "msqrt"),
        ("fabs(a)", '<mo stretchy="false">|</mo>'),
        ("1e-7*a", "<msup><mn>10</mn><mn>−7</mn></msup>"),
        ("2*pi*a", "<mi>π</mi>"),
        ("if_else(a < b, a, b)", "&lt;"),
        ("atan2(a, b)", "<mo>,</mo>"),
    ],
)
def test_what_else_the_language_has(text, seen):
    assert seen in equation(symbol("a"), text)


def test_what_the_language_has_not_is_refused():
    with pytest.raises(ValueError, match="not a formula"):
        equation(symbol("a"), "a % b")


def test_every_formula_of_the_examples_is_typeset(examples):
    from lockstep.model.problem import load_problem

    for path in sorted(examples.glob("*.toml")):
        for text in load_problem(path).file.agent.dynamics.values():
            assert ElementTree.fromstring(f"<r>{equation(symbol('a'), text)}</r>") is not None


def test_names():
    assert re.sub("<[^>]*>", "", inline("omega_l")) == "ωl"
    assert re.sub("<[^>]*>", "", inline("lambda2")) == "λ2"
    assert "<script>" not in inline("<script>")
