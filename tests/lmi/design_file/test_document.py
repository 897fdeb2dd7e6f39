"""Design files: round trip, and every kind of damage is bad input with a message, never a traceback."""

import json
import math
from collections.abc import Iterator
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lmi_cases import problem

from lockstep.check.errors import ClaimError, ProblemError
from lockstep.check.json_text import load_json
from lockstep.lmi.design import design
from lockstep.lmi.design_verdict import ClaimDecisions, certify
from lockstep.lmi.document import design_file_of, parse, read

GAINS = "\n".join(
    "[[design.gains]]\nA = [[-1.0]]\nB = [[0.0, 0.0]]\nC = [[0.0]]\nD = [[-1.5, -2.0]]" for _ in range(2)
)


def made() -> dict[str, Any]:
    """A small design file: two agents, order 1, nonlinear, a delta, a half-open domain, weights as a list."""
    posed = problem(
        dynamics={"a": "b", "b": "-a - sin(a) + k*u"},
        outputs={"y1": "a", "y2": "b"},
        agent="parameters = { k = 1.0 }\ndomain = { a = [-1.0, inf] }",
        network='agents = 2\ntopology = "path"\nparameters = [{ k = 1.0 }, { k = 1.5 }]',
        design=f'method = "given"\nweights = {{ state = [1.0, 0.5] }}\nfragility = {{ D = 0.05 }}\n{GAINS}',
    )
    return json.loads(json.dumps(design_file_of(design(posed)).document()))


FILE = made()
REQUIRED = ("format", "gains", "problem", "claims", "proofs", "info")


def places(node: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the path of every value in a JSON document."""
    yield path
    items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, value in items:
        yield from places(value, (*path, key))


PLACES = [path for path in places(FILE) if path and path[0] != "info"]
BAD: list[Any] = [
    None, True, "", "x", "1.0", [], {}, [[]], [1.0], {"x": 1}, -1, 0, 1e308, -1e308, 5e-324,
    math.nan, math.inf, -math.inf, 10**400, -(10**400), 1 << 70, 2.5, "\ud800", "\x00", [None], [[math.nan]], "a" * 10_000,
]  # fmt: skip


def opened(path: tuple[Any, ...]) -> tuple[dict[str, Any], Any]:
    """The file, and in it the table or list that holds the last key of a path."""
    file = deepcopy(FILE)
    node: Any = file
    for key in path[:-1]:
        node = node[key]
    return file, node


def replaced(path: tuple[Any, ...], value: Any) -> dict[str, Any]:
    file, node = opened(path)
    node[path[-1]] = value
    return file


def without(path: tuple[Any, ...]) -> dict[str, Any]:
    file, node = opened(path)
    del node[path[-1]]
    return file


def judged(file: Any) -> ClaimDecisions | None:
    """Parse and certify; bad input and refused claims are answers, anything else that is raised is a failure."""
    try:
        return certify(parse(file, "memory"))
    except (ProblemError, ClaimError):
        return None


def test_the_file_itself_is_certified() -> None:
    verdict = judged(FILE)
    assert verdict is not None
    assert verdict.certified


def test_the_round_trip_keeps_everything() -> None:
    stored = parse(FILE, "memory")
    again = parse(json.loads(json.dumps(FILE)), "memory")
    asked = {**FILE["problem"], "design": {**FILE["problem"]["design"], "gains": FILE["gains"]}}
    assert stored.problem.document() == again.problem.document() == asked
    assert stored.problem.document()["agent"]["domain"] == {"a": [-1.0, None]}
    assert stored.claims.alpha == FILE["claims"]["alpha"]
    assert dict(stored.claims.fragility) == FILE["claims"]["fragility"]
    assert stored.proofs.certificate is not None
    np.testing.assert_array_equal(stored.proofs.certificate.P, FILE["proofs"]["certificate"]["P"])
    for i in range(2):
        for letter in "ABCD":
            np.testing.assert_array_equal(getattr(stored.gains, letter)[i], FILE["gains"][i][letter])


@pytest.mark.parametrize("key", REQUIRED)
def test_a_missing_key_is_bad_input(key: str) -> None:
    file = deepcopy(FILE)
    del file[key]
    with pytest.raises(ProblemError) as error:
        parse(file, "here.json")
    assert "here.json" in str(error.value)


@pytest.mark.parametrize(
    "path",
    [
        ("proofs", "certificate", "P"),
        ("proofs", "certificate", "m"),
        ("proofs", "certificate", "t"),
        ("gains", 0, "A"),
        ("gains", 1, "D"),
        ("claims", "fragility", "B"),
    ],
)
def test_a_missing_part_is_bad_input(path: tuple[Any, ...]) -> None:
    with pytest.raises(ProblemError, match=f"`?{path[-1]}`?"):
        parse(without(path), "here.json")


def test_a_file_without_a_certificate_is_read_and_not_certified() -> None:
    for file in (replaced(("proofs", "certificate"), None), without(("proofs", "certificate"))):
        verdict = judged(file)
        assert verdict is not None
        assert not verdict.certified
        assert "no certificate" in verdict.reason


@settings(max_examples=80)
@given(st.sampled_from(PLACES), st.sampled_from(BAD))
def test_any_value_anywhere_is_an_answer_and_never_another_exception(
    path: tuple[Any, ...], value: Any
) -> None:
    judged(replaced(path, value))


@pytest.mark.slow
def test_every_value_everywhere() -> None:
    for path in PLACES:
        for value in BAD:
            judged(replaced(path, value))


@settings(max_examples=40)
@given(st.sampled_from(PLACES))
def test_anything_left_out_is_an_answer(path: tuple[Any, ...]) -> None:
    judged(without(path))


@pytest.mark.parametrize(
    "place",
    [
        ("claims", "alpha"),
        ("claims", "rho"),
        ("proofs", "certificate", "P", 0, 0),
        ("proofs", "certificate", "m", 0),
        ("gains", 0, "D", 0, 1),
    ],
)
@pytest.mark.parametrize("value", [math.nan, math.inf, 10**400, True, "1.0", None, [1.0]])
def test_what_is_no_finite_number_is_bad_input(place: tuple[Any, ...], value: Any) -> None:
    with pytest.raises(ProblemError, match="finite number"):
        parse(replaced(place, value), "here.json")


def test_a_certificate_that_is_not_symmetric_is_bad_input() -> None:
    with pytest.raises(ProblemError, match="not symmetric"):
        parse(replaced(("proofs", "certificate", "P", 0, 1), 1e-30), "here.json")


def test_shapes_are_those_of_the_problem() -> None:
    for path in (
        ("proofs", "certificate", "P"),
        ("proofs", "certificate", "m"),
        ("proofs", "certificate", "t"),
        ("gains",),
        ("gains", 0, "B", 0),
    ):
        node = FILE
        for key in path:
            node = node[key]
        for wrong in (node + node[:1], node[:-1]):
            with pytest.raises(ProblemError):
                parse(replaced(path, wrong), "here.json")


@pytest.mark.parametrize(
    "content", [None, [], "text", 3.0, {}, {"format": "lockstep-design/3"}, {"format": ["lockstep-design/1"]}]
)
def test_what_is_no_design_file_is_bad_input(content: Any) -> None:
    with pytest.raises(
        ProblemError, match="format" if isinstance(content, dict) else "not an object"
    ) as caught:
        parse(content, "here.json")
    assert "written by `lockstep design`" in str(caught.value)


def test_a_binary_file_is_bad_input(tmp_path: Path) -> None:
    path = tmp_path / "here.json"
    path.write_bytes(b"{\xff\x00}")
    with pytest.raises(ProblemError, match=r"here\.json: byte 2 is not UTF-8 \(0xff\); expected a file"):
        load_json(path)


@pytest.mark.parametrize(
    "text", ["", "{", "[" * 100_000, '{"format": "lockstep-design/1"', "\ufeff{}", "nonsense", '{"a": 1e}'],
)  # fmt: skip
def test_what_is_not_json_is_bad_input(tmp_path: Path, text: str) -> None:
    path = tmp_path / "design.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ProblemError, match=r"design\.json"):
        read(path)


def test_files_that_cannot_be_read_are_bad_input(tmp_path: Path) -> None:
    (tmp_path / "binary.json").write_bytes(b"\xff\xfe\x00")
    for path in (tmp_path / "absent.json", tmp_path, tmp_path / "binary.json"):
        with pytest.raises(ProblemError):
            read(path)


def test_json_s_strangers_are_no_numbers(tmp_path: Path) -> None:
    path = tmp_path / "design.json"
    text = json.dumps(FILE)
    for word in ("NaN", "Infinity", "-Infinity", "1e999"):
        path.write_text(
            text.replace(f'"alpha": {FILE["claims"]["alpha"]}', f'"alpha": {word}', 1), encoding="utf-8"
        )
        with pytest.raises(ProblemError, match="alpha"):
            read(path)
    path.write_text(text, encoding="utf-8")
    assert read(path).claims.alpha == FILE["claims"]["alpha"]


def test_an_integer_of_five_thousand_digits_is_bad_input(tmp_path: Path) -> None:
    path = tmp_path / "design.json"
    path.write_text('{"format": ' + "1" * 5000 + "}", encoding="utf-8")
    with pytest.raises(ProblemError):
        load_json(path)


def test_a_weight_beyond_the_doubles_is_bad_input() -> None:
    with pytest.raises(ProblemError):
        parse(replaced(("problem", "design", "weights", "state"), 10**400), "here.json")


def test_a_key_given_twice_is_bad_input(tmp_path: Path) -> None:
    path = tmp_path / "design.json"
    path.write_text(json.dumps(FILE)[:-1] + ', "rho": 1e9}', encoding="utf-8")
    with pytest.raises(ProblemError, match="rho"):
        read(path)


def test_a_domain_far_from_0_has_the_slopes_of_any_other() -> None:
    """cos takes every value in [-1, 1] on a >= 2^70, where the next double is 2^18 away: alpha = 1, not 0.06."""
    verdict = judged(replaced(("problem", "agent", "domain", "a", 0), 2.0**70))
    assert verdict is not None
    assert verdict.certified
