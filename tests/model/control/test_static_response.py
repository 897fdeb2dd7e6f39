"""What a load that stays does, beside what it does without controllers: by hand."""

from dataclasses import replace

import numpy as np
import pytest

from lockstep.check.system.disagreement import disagreement
from lockstep.check.system.graph import Digraph
from lockstep.check.system.loop import Gains, Plant, build_loop
from lockstep.model.control.static_response import softest, static_response


def loop_of(A: list[list[float]], order: int = 0):
    """Two agents that hear each other, the last state driven by u, the first measured."""
    n = len(A)
    B, C = np.eye(n)[:, -1:], np.eye(n)[:1]
    graph = Digraph(np.array([[0.0, 1.0], [1.0, 0.0]]))
    return build_loop(
        Plant(np.array(A), (B, B), C, np.zeros((n, 0)), np.zeros((0, n))), disagreement(graph), order
    )


MEASURED = np.array([[1.0, 0.0]])


def static(D: float) -> Gains:
    return Gains(*((np.zeros(shape),) * 2 for shape in ((0, 0), (0, 1), (1, 0))), (np.array([[D]]),) * 2)


@pytest.mark.parametrize(("D", "times"), [(1.0, 2.0), (0.0, 1.0), (-2.0, 0.5)])
def test_a_spring_that_controllers_make_softer_or_stiffer(D, times):
    """v' = -4 p - v + D r + xi, and r = 2 p of the difference: p_d = xi_d / (4 - 2 D), and xi_d / 4 for u = 0.

    No load enters p' = v.
    """
    found = static_response(loop_of([[0.0, 1.0], [-4.0, -1.0]]), static(D), MEASURED)
    assert found == pytest.approx(np.array([[np.nan, times]]), rel=1e-12, nan_ok=True)


def test_a_load_on_what_is_measured_itself_counts():
    """x' = -4 x + D r + xi, r = 2 x_d; and a speed with a current that pushes it: v' = -v + 2 i + xi, i' = -3 i + u."""
    assert static_response(loop_of([[-4.0]]), static(1.0), np.eye(1)) == pytest.approx(2.0, rel=1e-12)
    speed = static_response(loop_of([[-1.0, 2.0], [0.0, -3.0]]), static(-1.5), MEASURED)
    assert speed[0, 0] == pytest.approx(1 / 3, rel=1e-12)  # 3 i_d = -3 v_d, so v_d = xi_d / (1 + 2)


def test_an_output_that_weighs_states_is_moved_as_they_are():
    """x' = -x, p' = -4 p + D r beside it, and y = x + p: D = 0 leaves both, whatever is weighed."""
    found = static_response(loop_of([[-1.0, 0.0], [0.0, -4.0]]), static(0.0), np.array([[1.0, 1.0]]))
    assert found == pytest.approx(1.0, rel=1e-12)


def test_agents_that_do_not_settle_by_themselves_have_nothing_to_compare_with():
    assert np.isnan(static_response(loop_of([[0.0, 1.0], [0.0, -1.0]]), static(-2.0), MEASURED)).all()


def test_a_mode_at_zero_that_doubles_take_for_stable_has_nothing_to_compare_with(monkeypatch):
    """An angle that nothing holds has an eigenvalue 0, in doubles of either sign, by the processor."""
    monkeypatch.setattr(np.linalg, "eigvals", lambda M: np.full(len(M), -1e-17))
    assert np.isnan(static_response(loop_of([[0.0, 1.0], [0.0, -1.0]]), static(-2.0), MEASURED)).all()


@pytest.mark.parametrize("leak", [0.01, 1.0])
def test_a_controller_that_nearly_integrates_leaves_little_of_a_load(leak):
    """x_C' = -leak x_C + r, u = -x_C - r: D = -1 - 1/leak in the end."""
    one = [np.array([[value]]) for value in (-leak, 1.0, -1.0, -1.0)]
    response = static_response(
        loop_of([[0.0, 1.0], [-4.0, -1.0]], 1), Gains(*((block,) * 2 for block in one)), MEASURED
    )
    assert response[0, 1] == pytest.approx(4 / (4 + 2 + 2 / leak), rel=1e-12)


def test_controllers_that_keep_a_sum_for_ever_have_no_response():
    """Both integrate, of two that hear each other: what x_C sums up to stays, and A_cl is singular."""
    one = [np.array([[value]]) for value in (0.0, 1.0, -1.0, -1.0)]
    loop = loop_of([[0.0, 1.0], [-4.0, -1.0]], 1)
    assert np.isnan(static_response(loop, Gains(*((block,) * 2 for block in one)), MEASURED)).all()


def test_what_moves_nothing_without_controllers_has_no_response(monkeypatch):
    """An effect that follows a concentration moves none: some processors leave 1e-19 of it, and 7e16 was told."""
    A = [
        [-0.759, 0.067, 0.0, 0.0],
        [0.375, -0.067, 0.0, 0.0],
        [0.456, 0.0, -0.456, 0.0],
        [0.0, 0.0, -53.1875, -1 / 0.3],
    ]
    true = np.linalg.inv
    monkeypatch.setattr(np.linalg, "inv", lambda M: true(M) + 1e-16 * (np.abs(true(M)) < 1e-12))
    response = static_response(loop_of(A), static(-1e-3), np.eye(4))
    assert np.isnan(response[:3, 3]).all()
    assert np.isnan(response[:2, 2]).all()
    assert response[3, :3] == pytest.approx(1.0, rel=0.05)


MOTOR = [[-1.0, 2.0], [-1.0, -3.0]]
"""v' = -v + 2 i + xi, i' = -3 i - v + u: for u = 0 a load on v moves v 3/5 and i 1/5 as far, one on i 2/5 and 1/5."""
EVERY = np.ones(2, dtype=bool)


@pytest.mark.parametrize(("D", "times"), [(-1.5, 5 / 11), (1.0, 5.0)])
def test_of_a_load_the_output_that_moves_least_is_told(D, times):
    """u = 2 D v_d, so 3 i_d = (2 D - 1) v_d, and a load on v moves v 3 / (5 - 4 D) and 3/5 for u = 0: 5 / (5 - 4 D) times."""
    found = softest(loop_of(MOTOR), static(D), ("speed",), ("v", "i"), np.array([True, False]))
    assert found is not None
    assert (found["of"], found["moves"]) == ("v", "speed")
    assert found["times"] == pytest.approx(times, rel=1e-12)


def test_a_load_that_is_held_exactly_is_held_whatever_carries_it(monkeypatch):
    """0 is a response, and no output that the load does not reach: v stays, and i moves for it."""
    held = np.array([[0.0, np.nan], [7.0, np.nan]])
    monkeypatch.setattr("lockstep.model.control.static_response.static_response", lambda *_: held)
    found = softest(loop_of(MOTOR), static(0.0), ("speed", "current"), ("v", "i"), EVERY)
    assert found == {"of": "v", "moves": "speed", "times": 0.0}


def test_where_no_load_reaches_an_output_states_are_told_and_where_none_is_meant_nothing():
    """The rate of a spring is measured, which rests wherever it is pushed to."""
    spring, gains = loop_of([[-4.0, 0.0], [0.0, -1.0]]), static(0.0)
    blind = replace(spring, plant=replace(spring.plant, C=np.zeros((1, 2))))
    assert softest(blind, gains, ("y",), ("p", "v"), EVERY) == {"of": "p", "moves": "p", "times": 1.0}
    assert softest(blind, gains, ("y",), ("p", "v"), ~EVERY) is None
