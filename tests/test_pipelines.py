"""Random problems through the whole pipeline: the first fifty of benchmarks/pipelines.py, by hand as the others."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

from pipelines import draw, run


def test_a_problem_is_drawn_from_its_number_alone():
    assert draw(7) == draw(7) != draw(8)


def test_a_mistake_is_refused():
    assert "network" not in draw(171)
    assert run(171, time_limit=1.0)[1:] == ("refused", "")


@pytest.mark.slow
def test_agents_that_run_away_together_are_held_against_what_float32_leaves_of_their_outputs():
    """Problem 112: x' = 42.6 x, outputs of 7e7 after half a second, which float32 rounds by 4: no rho holds of these."""
    assert run(112, time_limit=10.0)[1:] == ("ships", "")


@pytest.mark.slow
def test_a_run_recorded_once_a_time_constant_is_measured_by_its_rates():
    """Problem 233: noise held for 35 s, where the loop settles in 29 s; trapezoids made 29 % too much of |z|."""
    assert run(233, time_limit=10.0)[1:] == ("ships", "")


@pytest.mark.by_hand
@pytest.mark.slow
@pytest.mark.parametrize("index", range(50))
def test_every_failure_has_a_type_and_no_certified_loop_diverges(index):
    outcome, fault = run(index, time_limit=10.0)[1:]
    assert not fault, f"{outcome}: {fault}"
