"""Whatever stands in a file, only errors of ours come out of the library: texts and documents with parts of others in them.

Examples are few and always the same.
"""

import copy
import json
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lockstep.check.c_source.reader import read_controller
from lockstep.check.errors import LockstepError
from lockstep.check.json_text import parse_json
from lockstep.codegen.from_design import fingerprint, specification
from lockstep.lmi.document import parse
from lockstep.model.problem import Problem, parse_problem

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "generated" / "flexible_joint_arms"
TOML = (ROOT / "examples" / "flexible_joint_arms.toml").read_text(encoding="utf-8")
DESIGN = json.loads((FOLDER / "design.json").read_text(encoding="utf-8"))
HEADER, SOURCE = ((FOLDER / path).read_text(encoding="utf-8") for path in ("include/arm1.h", "src/arm1.c"))
FORMULA = "19.5*theta_m - if_else(theta_m < 1, 2, abs(theta_l)**2) - gravity*sin(theta_l)"

FEW = settings(max_examples=60, derandomize=True, deadline=None, database=None)
PIECES = st.one_of(
    st.sampled_from(
        ['"', "[", "]", "{", "}", "=", ".", "\n", "1e999", "nan", "-0", "\\u0000", '"""', "1e-320"]
    ),
    st.sampled_from(
        ["(", ")", "**", "if_else(", "sin", "x", ",", "/", "<", "t", "#", "\x1b", "*/", "/*", "0x1p3"]
    ),
    st.text(max_size=3),
)
VALUES = st.sampled_from(
    [None, True, -1, 1e308, 5e-324, 10**30, 10**400, "", "x", "\ud800", "\0", [], {}, [[]], [[1]], [{}], [[1e308] * 3] * 3]
)  # fmt: skip


@st.composite
def edited(draw: st.DrawFn, text: str) -> str:
    """A text with one to three cuts, each filled with something else or a part of itself."""
    for _ in range(draw(st.integers(1, 3))):
        start, length = draw(st.integers(0, len(text))), draw(st.integers(0, 12))
        other = draw(st.integers(0, len(text)))
        piece = draw(st.one_of(PIECES, st.just(text[other : other + 30])))
        text = text[:start] + piece + text[start + length :]
    return text


def places(value: Any, place: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [place, *(one for key, item in items for one in places(item, (*place, key)))]


# Deep numbers are many, keys few: half of the draws are near the top.
DEEP = places(DESIGN)[1:]
PLACES = st.one_of(st.sampled_from(DEEP), st.sampled_from([place for place in DEEP if len(place) <= 3]))


@given(edited(TOML))
@FEW
def test_a_problem_text(text: str) -> None:
    with suppress(LockstepError):
        parse_problem(text).document()


@given(edited(FORMULA))
@FEW
def test_an_expression(formula: str) -> None:
    table = copy.deepcopy(DESIGN["problem"])
    table["agent"]["dynamics"]["omega_l"] = formula
    with suppress(LockstepError):
        Problem.from_document(table)


@given(PLACES, VALUES)
@FEW
def test_a_design(place: tuple[Any, ...], value: Any) -> None:
    content = copy.deepcopy(DESIGN)
    part = content
    for key in place[:-1]:
        part = part[key]
    part[place[-1]] = value
    with suppress(LockstepError):
        read = parse_json(json.dumps(content), "design.json")
        stated = parse(read, "design.json")
        specification(stated)
        fingerprint(stated)


@pytest.mark.parametrize("which", ["header", "source"])
@given(data=st.data())
@FEW
def test_the_reader_of_c(which: str, data: st.DataObject) -> None:
    header = data.draw(edited(HEADER)) if which == "header" else HEADER
    source = data.draw(edited(SOURCE)) if which == "source" else SOURCE
    with suppress(LockstepError):
        read_controller("arm1", header, source, ["arm1", "arm2", "arm3"])
