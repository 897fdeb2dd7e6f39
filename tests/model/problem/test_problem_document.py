"""The document that goes into a design file: it is the problem, and with anything in any place a `ProblemError`."""

import contextlib
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from problem_cases import ARMS, GAINS, GIVEN, SMALL, changed

from lockstep.model import Problem, ProblemError, parse_problem


@pytest.mark.parametrize(
    "text",
    [
        ARMS,
        SMALL,
        GIVEN + 3 * GAINS,
        changed("agents = 3\n", "", SMALL).replace(
            "edges = [[1, 2], [2, 3], [3, 1]]", "laplacian = [[1, -1], [-0.5, 0.5]]"
        ),
        SMALL + '[agent.domain]\np = [-inf, 1]\nv = [0, 2]\n[agent.units]\np = "m"\n',
    ],
)
def test_the_document_is_the_problem(text: str) -> None:
    problem = parse_problem(text)
    document = json.loads(json.dumps(problem.document(), sort_keys=True, allow_nan=False))
    again = Problem.from_document(document)
    assert again.document() == problem.document()
    assert again.agent().outputs == problem.agent().outputs
    np.testing.assert_array_equal(again.agent().box, problem.agent().box)
    np.testing.assert_array_equal(again.graph().adjacency, problem.graph().adjacency)


def test_the_order_of_the_outputs_outlives_sorted_keys() -> None:
    problem = parse_problem(changed('y1 = "c*p"', 'z = "v"\na = "p"'))
    assert problem.agent().outputs == ("z", "a")
    again = Problem.from_document(json.loads(json.dumps(problem.document(), sort_keys=True)))
    np.testing.assert_array_equal(again.agent().lure.C, [[0, 1], [1, 0]])


_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)


def _places(tree: object, place: tuple = ()) -> list[tuple]:
    here = [place] if place else []
    items = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    return here + [inner for key, value in items for inner in _places(value, (*place, key))]


PLACES = _places(parse_problem(GIVEN + 3 * GAINS).document())


@pytest.mark.slow
@given(st.sampled_from(PLACES), _JSON)
@settings(max_examples=250)
def test_any_value_anywhere_is_a_problem_or_a_problem_error(place: tuple, value: object) -> None:
    document = parse_problem(GIVEN + 3 * GAINS).document()
    inner = document
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = value
    with contextlib.suppress(ProblemError):
        json.dumps(Problem.from_document(document).document(), allow_nan=False)


@pytest.mark.parametrize("document", [None, 3, [], "x", {"agent": 3}, {3: 4}])
def test_documents_that_are_no_tables(document: object) -> None:
    with pytest.raises(ProblemError):
        Problem.from_document(document)
