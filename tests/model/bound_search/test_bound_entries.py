"""Bounds of single slopes: against slopes known in closed form, and what is refused."""

import math

import casadi as ca
import numpy as np
import pytest
from bound_cases import entry_bounds

from lockstep.check.bound.decide import Budget, decide_entries
from lockstep.check.bound.slopes import SlopeProblem
from lockstep.check.errors import ProblemError
from lockstep.model.bound_search import Box, Entry, read


def phi(*terms: object, v: ca.SX, t: ca.SX | None = None) -> ca.Function:
    return ca.Function("phi", [v, ca.SX.sym("t") if t is None else t], [ca.vertcat(*terms)])


def thrust() -> tuple[ca.Function, Box]:
    """T cos(theta) and T sin(theta), |theta| <= 0.4, 8 <= T <= 16."""
    v = ca.SX.sym("v", 2)
    return phi(v[1] * ca.cos(v[0]), v[1] * ca.sin(v[0]), v=v), Box((-0.4, 8.0), (0.4, 16.0))


def entries_hold(function: ca.Function, box: Box, entries: list[Entry]) -> bool:
    return decide_entries(SlopeProblem.of(read(function), box), entries, Budget(10_000)).proved


EXPECTED = {(0, 0): 16 * math.sin(0.4), (0, 1): 1.0, (1, 0): 16.0, (1, 1): math.sin(0.4)}


def test_each_slope_has_its_own_bound() -> None:
    found = {(one.component, one.argument): one.bound for one in entry_bounds(*thrust())}
    assert found.keys() == EXPECTED.keys()
    for place, slope in EXPECTED.items():
        assert slope <= found[place] <= slope * (1 + 1e-5)


def test_scales_are_those_of_the_bound() -> None:
    """|d phi_k / d v_l| D_v,l / D_w,k: with D_w = (2, 4) and D_v = (8, 16) the four factors differ."""
    found = entry_bounds(*thrust(), input_scale=(8.0, 16.0), output_scale=(2.0, 4.0))
    factors = [4.0, 8.0, 2.0, 4.0]
    for one, factor in zip(found, factors, strict=True):
        assert one.bound == pytest.approx(factor * EXPECTED[one.component, one.argument], rel=1e-5)


@pytest.mark.parametrize("place", sorted(EXPECTED))
@pytest.mark.parametrize(("share", "holds"), [(1.001, True), (0.999, False)])
def test_stated_bounds_hold_or_not(place: tuple[int, int], share: float, holds: bool) -> None:
    entries = [Entry(*one, slope * (share if one == place else 1.001)) for one, slope in EXPECTED.items()]
    assert entries_hold(*thrust(), entries) is holds


def test_a_missing_entry_is_refused() -> None:
    entries = [Entry(*one, 100.0) for one in EXPECTED]
    assert entries_hold(*thrust(), entries)
    for k in range(4):
        assert not entries_hold(*thrust(), entries[:k] + entries[k + 1 :])


@pytest.mark.parametrize("wrong", [[Entry(2, 0, 1.0)], [Entry(0, 2, 1.0)], [Entry(0, 0, 99.0)] * 2])
def test_entries_that_phi_does_not_have_are_refused(wrong: list[Entry]) -> None:
    with pytest.raises(ProblemError, match="entries for the slopes"):
        entries_hold(*thrust(), wrong)


def test_where_there_is_one_slope_alpha_says_it_all() -> None:
    v = ca.SX.sym("v", 2)
    assert entry_bounds(phi(ca.sin(v[0]), v=v), Box.everywhere(2)) == ()
    two = entry_bounds(phi(ca.sin(v[0]), ca.tanh(v[1]), v=v), Box.everywhere(2))
    assert [(one.component, one.argument, one.bound) for one in two] == [(0, 0, 1.0), (1, 1, 1.0)]
    assert len(entry_bounds(phi(ca.sin(v[0]) + ca.tanh(v[1]), v=v), Box.everywhere(2))) == 2


def test_a_slope_without_a_bound_leaves_alpha_alone() -> None:
    v = ca.SX.sym("v", 2)
    assert entry_bounds(phi(v[0] * v[1], v=v), Box((-1.0, -math.inf), (1.0, math.inf))) == ()


def test_the_mean_value_theorem_holds_with_them() -> None:
    """|phi_k(a) - phi_k(b)| <= sum_l r_kl |a_l - b_l| at random pairs, nearly reached, and not with 2 % less."""
    function, box = thrust()
    generator, R = np.random.default_rng(1), np.zeros((2, 2))
    for one in entry_bounds(function, box):
        R[one.component, one.argument] = one.bound
    a = generator.uniform(box.lower, box.upper, (4000, 2))
    b = np.clip(a + 0.02 * generator.standard_normal(a.shape), box.lower, box.upper)
    a[:2000, 0], b[:2000, 0] = 0.4, 0.4  # along T alone, where the slope is sin(0.4) all the way
    steps = np.array(function(a.T, 0)) - np.array(function(b.T, 0))
    ratio = np.abs(steps.T) / np.maximum(np.abs(a - b) @ R.T, 1e-300)
    assert ratio.max() <= 1 + 1e-9
    assert ratio[:, 1].max() > 0.98
