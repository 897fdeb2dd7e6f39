"""The checker's network gives the same loop in both kinds of number."""

from dataclasses import replace

import numpy as np
import pytest

from lockstep.check.errors import ProblemError
from lockstep.check.numbers import as_floats
from lockstep.check.system.graph import Digraph
from lockstep.check.system.graph_family import SpectrumRange
from lockstep.check.system.loop import Plant
from lockstep.check.system.network import ExactNetwork

GRAPH = Digraph.from_edges(2, [[1, 2, 0.5], [2, 1]])
PLANT = Plant(
    np.array([[0.0, 1.0], [0.1, -1.0]]),
    (np.array([[0.0], [1.0]]), np.array([[0.0], [2.0]])),
    np.eye(2),
    np.array([[0.0], [1.0]]),
    np.array([[1.0, 0.0]]),
)


@pytest.mark.parametrize("coordinates", ["orthonormal", "laplacian_rows"])
def test_the_loop_is_the_same_in_doubles_and_in_rationals(coordinates):
    network = ExactNetwork(PLANT, GRAPH, coordinates)
    doubles, rationals = (network.loop(1, exact_arithmetic=exact) for exact in (False, True))
    assert rationals.exact
    assert not doubles.exact
    assert as_floats(rationals.A_0).tolist() == doubles.A_0.tolist()
    assert rationals is network.loop(1, exact_arithmetic=True)


def test_a_plant_of_rationals_is_taken_as_it_is():
    exact = ExactNetwork(PLANT.in_numbers(True), GRAPH)
    assert (
        exact.loop(1, exact_arithmetic=True).A_0
        == ExactNetwork(PLANT, GRAPH).loop(1, exact_arithmetic=True).A_0
    ).all()
    assert not exact.loop(1, exact_arithmetic=False).exact


def test_a_graph_without_a_spanning_tree_is_refused():
    with pytest.raises(ProblemError, match="no spanning tree"):
        ExactNetwork(replace(PLANT, B=PLANT.B * 2), Digraph.from_edges(4, [[1, 2], [2, 1], [3, 4], [4, 3]]))


@pytest.mark.parametrize("value", [[1.0, 10**400], [1.0, float("nan")], [True, 4.0], ["1", 4.0]])
def test_a_spectrum_of_no_two_doubles_is_refused(value):
    with pytest.raises(ProblemError, match=r"\[network\] spectrum: .*expected a finite number"):
        SpectrumRange.of({"spectrum": value})
