"""Limits of the gains in units of their own: the barriers and their slopes, searches within them, the same in any units."""

from dataclasses import replace

import numpy as np
import pytest
from lmi_cases import ALPHA, DOUBLE_INTEGRATOR, PATH_2, arms, claim, first_wishes, problem, published

from lockstep.check.continuous.modes import Modes
from lockstep.check.errors import Infeasible
from lockstep.lmi.analysis.certificate_sdp import least_rho
from lockstep.lmi.analysis.gain_limit import limit_barrier, limited
from lockstep.lmi.analysis.rounding import short_gains
from lockstep.lmi.design import design
from lockstep.lmi.design_verdict import certify
from lockstep.lmi.document import design_file_of
from lockstep.lmi.methods.modal import design_modes
from lockstep.lmi.methods.modal_newton import Together
from lockstep.lmi.proposal import claim_of, proved_bound
from lockstep.lmi.search.barrier import BarrierPoint, InteriorProgram
from lockstep.lmi.search.common_gains import ModalSearch, stabilised
from lockstep.lmi.search.logdet import BalancedF
from lockstep.lmi.search.smoothed_norm import SmoothedNorm
from lockstep.lmi.search.stabilise import _excess, stabilise
from lockstep.model.assembly import network_of
from lockstep.model.problem import Problem

L = np.array([[30.0, 9.0, 5.0, 40.0], [20.0, 30.0, 8.0, 50.0], [2.0, 3.0, 4.0, 5.0]])
"""Of the arms' gains of order 2, from two outputs: every entry its own."""


def difference(function, x: np.ndarray, direction: np.ndarray, step: float = 1e-6) -> float:
    return float(function(x + step * direction) - function(x - step * direction)) / (2 * step)


def test_the_barrier_is_of_gains_over_their_limits_and_its_slope_that_of_differences() -> None:
    """-log det(I - (K / L)(K / L)') of one gain of half its limit is -log(1 - 1/4)."""
    value, slope = limit_barrier(np.array([[[4.0]]]), np.array([[8.0]])) or (0.0, np.zeros(1))
    assert value == pytest.approx(-np.log(0.75))
    assert slope[0, 0, 0] == pytest.approx(2 * 0.5 / 8.0 / 0.75)
    K, way = published().blocks, np.random.default_rng(0).standard_normal((3, 3, 4))
    found = limit_barrier(K, L)
    assert found is not None
    assert np.sum(found[1] * way) == pytest.approx(
        difference(lambda x: limit_barrier(x, L)[0], K, way), rel=1e-6
    )
    assert limit_barrier(100 * K, L) is None


def test_gains_are_brought_within_and_rounded_within() -> None:
    K = 40 * published().blocks
    norms = [np.linalg.norm(one / L, 2) for one in limited(K, L)]
    assert max(norms) == pytest.approx(1.0)
    assert max(np.linalg.norm(one / L, 2) for one in short_gains(K, L)) <= 1.0
    np.testing.assert_array_equal(limited(K, 1e6), K)


def test_the_excess_over_the_limit_and_its_slope() -> None:
    K, way = 40 * published().blocks, np.random.default_rng(1).standard_normal((3, 3, 4))
    total, slope = _excess(K, L)
    assert total == pytest.approx(sum(max(0.0, np.linalg.norm(one / L, 2) - 1) for one in K))
    assert np.sum(slope * way) == pytest.approx(difference(lambda x: _excess(x, L)[0], K, way), rel=1e-6)


def test_gains_are_made_stable_within_the_limit() -> None:
    """About it: what they exceed it by costs a thousand times as much as the abscissa."""
    found, value = stabilise(arms().loop(2), np.random.default_rng(0).standard_normal((3, 3, 4)), L)
    assert value < 0
    assert max(np.linalg.norm(one / L, 2) for one in found) <= 1.001


def test_equal_gains_keep_to_the_limit_while_they_are_made_stable() -> None:
    network = arms()
    modes, few = Modes(network.plant, 2), claim(network, 2, ALPHA)
    search = ModalSearch.of(modes, few, np.array([1.0, 3.0]), L)
    start = np.random.default_rng(3).standard_normal((3, 4))
    K = stabilised(search, start)
    assert np.linalg.norm(K / L) < 1
    drawn = search.stable(np.random.default_rng(0))
    assert drawn is not None
    assert np.linalg.norm(drawn / L, 2) <= 0.9 + 1e-12


def test_the_slope_of_the_smoothed_norm_holds_the_barrier_of_the_limit() -> None:
    network = arms()
    loop, asked = network.loop(2), claim(network, 2, ALPHA)
    found = least_rho(loop, published().blocks, asked)
    assert found is not None
    norm = SmoothedNorm(loop, asked, L, np.ones((3, 4)))
    x = norm.pack(published().blocks, 1.05 * np.concatenate([found.m, found.t]) + 1e-6)
    frequencies, way = norm.frequencies(x), np.random.default_rng(2).standard_normal(len(x))
    slope = norm.value(x, None, 13, frequencies)[1]
    expected = difference(lambda at: norm.value(at, None, 13, frequencies)[0], x, way)
    assert slope @ way == pytest.approx(expected, rel=1e-3, abs=1e-10)


def test_the_program_of_the_larger_loops_has_slope_and_curvature_of_the_limit() -> None:
    """What a limit of its own for each entry changes: the log det of [I, K / L; (K / L)', I], by differences."""
    network = arms()
    loop, asked, K = network.loop(2), claim(network, 2, ALPHA), published().blocks
    found = least_rho(loop, K, asked)
    assert found is not None
    F = BalancedF(loop, asked, np.linalg.cholesky(found.P))
    programs = [InteriorProgram(loop, asked, limit) for limit in (L, 1e9)]
    x = programs[0]._inside(F, BarrierPoint(K, found), "rho")
    assert x is not None
    task = programs[0]._task(F, x, "rho", np.inf)
    (slope, square, _), (free, flat, _) = (one._slopes(F, x, task, 1.0) for one in programs)
    place = F.place["K"]

    def limit_part(gains: np.ndarray) -> float:
        return -float(np.linalg.slogdet(programs[0]._limits(gains.reshape(K.shape)))[1].sum())

    way = np.random.default_rng(4).standard_normal(K.size)
    assert (slope - free)[place] @ way == pytest.approx(difference(limit_part, K.ravel(), way), rel=1e-6)
    second = (
        limit_part(K.ravel() + 1e-4 * way) + limit_part(K.ravel() - 1e-4 * way) - 2 * limit_part(K.ravel())
    )
    assert way @ (square - flat)[place, place] @ way == pytest.approx(second / 1e-8, rel=1e-4)


def test_gains_and_one_P_together_begin_within_the_limit() -> None:
    network = arms()
    modes, K = Modes(network.plant, 2), 40 * published().blocks[0]
    at = Together(modes, claim(network, 2, ALPHA), (1.0, 3.0), L, 0.0, (3, 4), np.eye(modes.at(1.0).n_x))
    limit = next(one for one in at.program.conditions if len(one.constant) == 7)
    for scale, inside in ((0.99, True), (1.01, False)):
        x = np.zeros(at.size)
        x[at.places["K"]] = (scale * K / np.linalg.norm(K / L, 2)).ravel()
        assert bool(np.linalg.eigvalsh(limit.constant + np.tensordot(x, limit.linear, 1))[0] > 0) is inside


def slider(unit: float, length: float, said: str) -> Problem:
    """p'' = u - p' - sin p / 2, with u in a unit of force and p in one of length."""
    return problem(
        dynamics={"p": "v", "v": f"{unit / length}*u - v - {0.5 / length}*sin({length}*p)"},
        outputs={"y": "p"},
        network=PATH_2,
        design=f"order = 1\nstarts = 1\n{said}\n[design.weights]\nstate = {length**2}\n"
        f"[design.disturbances]\nstates = {1 / length}",
    )


@pytest.mark.slow
def test_a_limit_in_units_is_the_limit_of_the_same_plant_in_these_units() -> None:
    """Powers of two: u in kN or so and p in mm or so. Each rho is rounded up, by 0.05 % to 0.2 % above the least one."""
    one = design(slider(1.0, 1.0, "gain_limit = 6.0"), jobs=1)
    units = "gain_limit = 6.0\ngain_units = { inputs = { u = 1024.0 }, outputs = { y = 0.015625 } }"
    other = design(slider(2.0**-10, 2.0**6, units), jobs=1)
    assert other.certificate is not None
    assert one.certificate is not None
    assert other.certificate.rho == pytest.approx(one.certificate.rho, rel=2e-3)
    back = np.array([[1.0, 2.0**-6], [2.0**-10, 2.0**-16]])
    assert all(np.linalg.norm(K * back, 2) <= 6.0 for K in other.gains.blocks)
    assert max(np.linalg.norm(K, 2) for K in other.gains.blocks) > 6.0


@pytest.mark.parametrize("newton", [1.0, 1000.0])
def test_defaults_of_units_far_apart_are_a_limit_in_natural_units(newton: float) -> None:
    """In N or in mN, D of 4 kN per 30 mm: a norm beside A in 1/s would hold neither A nor B nor C."""
    posed = problem(
        dynamics={"z": "v", "v": f"u/{2000 * newton} - v"},
        outputs={"y": "z"},
        network=PATH_2,
        agent=f"limits = {{ u = [{-4000 * newton}, {4000 * newton}] }}",
        design="order = 1\n[simulation]\ninitial = [[0.0, 0.0], [0.03, 0.0]]",
    )
    asked = first_wishes(posed)
    units = asked["gain_units"]
    assert asked["gain_limit"] == 2.0, "of 2 x 2 entries of size one"
    # |r| is 0.03 in units of y: half of 4 kN is one unit of u there. Both units are rounded to one digit, by a third at most.
    assert units["inputs"]["u"] * 0.03 / units["outputs"]["y"] == pytest.approx(2000 * newton, rel=0.5)
    again = posed.from_document(posed.document() | {"design": asked})
    assert again.gain_limit[1, 1] == pytest.approx(2.0 * units["inputs"]["u"] / units["outputs"]["y"])
    assert again.gain_limit[0, 0] == pytest.approx(2.0 / units["time"])


def test_equal_gains_are_drawn_and_made_stable_in_the_units_of_the_limit() -> None:
    """u in units 1024 times as large, y in units 64 times as small: powers of two change no digit."""
    network = arms()
    few, ends, rate = claim(network, 2, ALPHA), np.array([1.0, 3.0]), 0.1
    limit = 4.0 * np.ones((3, 4))
    u, y = np.array([1.0, 1.0, 2.0**10]), np.array([1.0, 1.0, 2.0**6, 2.0**6])
    other = replace(network.plant, B=tuple(B / 2**10 for B in network.plant.B), C=network.plant.C / 2**6)
    first = ModalSearch.of(Modes(network.plant, 2), few, ends, limit, rate).stable(np.random.default_rng(5))
    second = ModalSearch.of(Modes(other, 2), few, ends, limit * np.outer(u, y), rate).stable(
        np.random.default_rng(5)
    )
    assert first is not None
    assert second is not None
    np.testing.assert_allclose(second, first * np.outer(u, y), rtol=1e-6)


def test_no_entry_is_taken_for_a_rounding_error_because_another_has_a_large_unit() -> None:
    """What is 1e-13 of another in the numbers of the file may be a third of its own limit."""
    K, limit = np.array([[[0.3, 1e-14], [1.0, 1e12]]]), np.array([[1.0, 1.0], [1e6, 1e13]])
    short = short_gains(K, limit)
    assert short[0, 0, 0] == 0.3
    assert short[0, 0, 1] == 0.0


def test_a_modal_search_that_finds_nothing_says_so_in_units_too() -> None:
    """Position of x'' = u without damping: no static gain makes it stable."""
    posed = problem(
        dynamics=DOUBLE_INTEGRATOR,
        outputs={"y": "p"},
        design='method = "modal"\norder = 0\nstarts = 1\ngain_units = { inputs = 0.5 }',
        network='agents = 4\ntopology = "path"',
    )
    bound = proved_bound(posed)
    units = 50.0 * np.array([[0.5]]) * np.ones((1, 1))
    with pytest.raises(Infeasible, match=r"within gain_limit, in \[design.gain_units\], were found"):
        design_modes(network_of(posed, bound), claim_of(posed, bound), 0, units, starts=1, seed=0)


@pytest.mark.parametrize(("said", "found"), [("gain_limit = 50.0", True), ("gain_limit = 5e-4", False)])
def test_the_protocol_of_the_literature_keeps_to_a_limit_in_units(said: str, found: bool) -> None:
    """u in units of 1000: 50 of them are 50 000, and 5e-4 are half of the least gain that carries sin(p) / 3."""
    posed = problem(
        dynamics={"p": "v", "v": "u - 0.3*sin(p)"},
        outputs={"y": "p", "w": "v"},
        design=f'method = "lipschitz"\norder = 0\n{said}\ngain_units = {{ inputs = 1000.0, outputs = {{ y = 0.5 }} }}',
        network='agents = 4\ntopology = "path"',
    )
    if not found:
        with pytest.raises(Infeasible, match="gain_units"):
            design(posed, jobs=1)
        return
    made = design(posed, jobs=1)
    assert max(np.linalg.norm(K / posed.gain_limit, 2) for K in made.gains.blocks) <= 1
    assert certify(design_file_of(made)).certified


def test_a_limit_whose_square_is_no_double_is_none() -> None:
    """A random problem with gain_limit = 1e300 ended in an OverflowError."""
    network = arms()
    search = ModalSearch.of(Modes(network.plant, 2), claim(network, 2, ALPHA), np.array([1.0, 3.0]), 1e300)
    assert search.stable(np.random.default_rng(5)) is not None
