"""Starts in an ellipsoid whose half-axes have the units of the states: decided as a ball is, and knowing no units."""

import dataclasses

import numpy as np
import pytest
from lmi_cases import PATH_2, problem
from sampled_cases import random_problem

from lockstep.check.design_file.claims import claims_of
from lockstep.check.errors import ProblemError
from lockstep.check.numbers import exactly
from lockstep.check.sampled.balls import midpoints
from lockstep.check.sampled.inequality import metric
from lockstep.check.sampled.inputs.input_limits import proves_radius
from lockstep.check.sampled.inputs.saturation import ClippedWitness, proves_clipped_radius
from lockstep.check.sampled.loop import sampled_loop
from lockstep.codegen.period_redesign import as_shipped
from lockstep.lmi.analysis.covered_start import times_covered
from lockstep.lmi.design import design
from lockstep.lmi.document import design_file_of
from lockstep.lmi.sampled.half_axes import SHARE, largest_half_axes
from lockstep.lmi.sampled.input_limits import largest_radius
from lockstep.lmi.sampled.saturation import largest_clipped_radius

LIMITS, UNITS = np.array([1.0]), 2.0 ** np.array([10, -7, 3, 0])
"""Powers of two: what is measured in other units is the same number but for its exponent."""


def case(seed: int):
    """A loop of random agents, a witness of a radius, and the loop and the witness in other units of the states."""
    net, ones = random_problem(seed)
    found = largest_radius(net, ones, LIMITS, np.ones(len(net.d.pairs())))
    assert found is not None
    radius, w = found[0], dataclasses.replace(found[1], ratio=1e9)  # |x_d|^2 <= ratio V, in any of the units
    d = UNITS[: len(net.plant.A)]
    D, inverse = exactly(np.diag(d)), exactly(np.diag(1 / d))
    plant = net.plant
    other = dataclasses.replace(
        net,
        plant=dataclasses.replace(
            plant,
            A=D @ plant.A @ inverse,
            B=tuple(D @ B for B in plant.B),
            C=plant.C @ inverse,
            G=D @ plant.G,
            H=plant.H @ inverse,
        ),
    )
    scale = np.ones(len(w.P))
    scale[: len(d) * (net.d.N - 1)] = np.tile(1 / d, net.d.N - 1)
    scaled = dataclasses.replace(w, P=scale[:, None] * w.P * scale)
    return radius, d, (sampled_loop(net, ones), w), (sampled_loop(other, ones), scaled)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_half_axes_know_no_units_and_a_radius_does(seed):
    radius, d, (loop, w), (other, scaled) = case(seed)
    away = np.random.default_rng(seed).normal(size=(2, len(d)))
    away -= away.mean(axis=0)
    a = largest_half_axes(*_parts(loop, w), _level(loop, w), away, 1e-9 * radius)
    b = largest_half_axes(*_parts(other, scaled), _level(loop, w), away * d, 1e-9 * radius)
    # Three decimals are kept of each.
    np.testing.assert_allclose(np.array(b), d * np.array(a), rtol=0.01)
    for size, holds in ((0.999, True), (1.02, False)):
        inside = [size * one for one in a]
        assert proves_radius(loop, w, LIMITS, inside) == holds
        assert proves_radius(other, scaled, LIMITS, [float(x) for x in d * np.array(inside)]) == holds
    if len(d) > 1:
        assert not proves_radius(other, scaled, LIMITS, radius)


def jacks(mm: float, bar: float, lpm: float):
    """Two hydraulic jacks, metres, pascals and cubic metres per second in units of mm, bar and lpm: 10 t on 100 cm^2, 2 l of
    oil of 1 GPa, seals of 3 kN. States of 1 mm, 1 mm/s and 1 bar weigh alike, whatever they are counted in."""
    D = [[-6.67e-3 * mm / lpm, -5e-12 * bar / lpm]]
    weights = [(mm / 1e-3) ** 2, (mm / 1e-3) ** 2, (bar / 1e5) ** 2]
    gains = f"{{ A = [], B = [], C = [[]], D = {D} }}"
    return problem(
        dynamics={
            "x": "v",
            "v": f"({0.01 * bar / mm!r}*p - {3000.0 / mm!r}*tanh(v/{0.005 / mm!r}) - 2e4*v)/1e4",
            "p": f"{5e11 * lpm / bar!r}*q - {5e9 * mm / bar!r}*v - 0.5*p",
        },
        inputs=["q"],
        outputs={"y": "x", "z": "p"},
        network=PATH_2,
        agent=f"limits = {{ q = [{-5e-5 / lpm!r}, {5e-5 / lpm!r}] }}",
        design=f'method = "given"\ngains = [{gains}, {gains}]\nweights = {{ state = {weights} }}\n'
        '[controller]\nperiod = 0.005\nreal = "float64"',
    )


@pytest.mark.slow
def test_a_radius_is_found_in_metres_and_pascals_as_in_millimetres_and_bars():
    """Beside what disturbs a pressure in Pa, what disturbs a speed in m/s is as small as rounding."""
    of_si, of_mm = (
        as_shipped(design_file_of(design(jacks(*units)))).claims.sampled.radius
        for units in ((1.0, 1.0, 1.0), (1e-3, 1e5, 1e-5))
    )
    assert of_si is not None
    # The solver ends where its own tolerance, 1e-6 of sizes that differ by units, leaves it: 6e-4 apart here.
    assert 1e3 * of_si == pytest.approx(of_mm, rel=5e-3)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_a_radius_does_not_depend_on_what_the_sizes_of_the_states_are_multiples_of(seed):
    """Metres beside which pascals are sizes of 1e8: the radius counts in the smallest of them, a gamma then is 1e12."""
    net, ones = random_problem(seed)
    m = np.ones(len(net.d.pairs()))
    for largest in (
        lambda sizes: largest_radius(net, ones, LIMITS, m, sizes),
        lambda sizes: largest_clipped_radius(net, ones, LIMITS, None, sizes),
    ):
        plain, moved = largest(np.ones(len(net.plant.A))), largest(1e6 * np.ones(len(net.plant.A)))
        assert plain is not None
        assert moved is not None
        # The same program to the last bit but for two roundings: four digits are kept of each.
        assert 1e6 * moved[0] == pytest.approx(plain[0], rel=2e-3)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_radius_is_the_half_axes_that_are_alike(seed):
    """For each size both are decided alike, with inputs that are clipped off as well; of some sets, every one counts."""
    radius, d, (loop, w), _ = case(seed)
    count = len(loop.computed)
    clipped = ClippedWitness(w, np.full(count, 1e6 * np.linalg.norm(w.P)), np.zeros((count, loop.n_x)))
    for size in (0.5, 1.0, 1.05, 2.0):
        ball, axes = size * radius, [size * radius] * len(d)
        assert proves_radius(loop, w, LIMITS, ball) == proves_radius(loop, w, LIMITS, axes) == (size <= 1)
        assert proves_clipped_radius(loop, clipped, LIMITS, ball) == (size <= 1)
        assert proves_clipped_radius(loop, clipped, LIMITS, axes) == (size <= 1)
        assert proves_radius(loop, w, LIMITS, radius, axes) == (size <= 1)


def test_what_are_no_half_axes():
    radius, d, (loop, w), _ = case(1)
    some = [1e-3 * radius] * len(d)
    assert proves_radius(loop, w, LIMITS, some)
    for wrong in (
        [],
        some[:1],
        some + some,
        [*some, 1.0],
        [0.0, *some[1:]],
        [-1.0, *some[1:]],
        [np.nan, *some[1:]],
    ):
        assert not proves_radius(loop, w, LIMITS, wrong)
        assert not proves_radius(loop, w, LIMITS, some, wrong), "of some sets, every one counts"


def test_an_ellipsoid_inside_another_by_hand():
    """x_d of two agents, K = I, P = diag(4, 1/4), c = 1: V <= 1 is that ellipsoid itself, whatever the start."""
    K, P = np.eye(2), np.diag([4.0, 0.25])
    for away in ([[0.0, 0.0]], [[0.0, 3.0], [0.0, -3.0]], [[1.0, 1.0], [-1.0, -1.0]]):
        found = largest_half_axes(K, P, 1.0, np.array(away), 0.1)
        assert np.array(found) == pytest.approx([0.5, 2.0], rel=0.015), "0.995 of them, rounded down"
    assert largest_half_axes(K, np.eye(2), 1.0, np.zeros((1, 2)), 1.0) is None, "it is the ball"
    some = times_covered(None, (0.5, 2.0), np.array([[0.0, 3.0], [0.0, -3.0]]))
    assert some == pytest.approx(2 / 18**0.5)


def test_half_axes_are_of_the_start():
    """P = [[2, -1], [-1, 2]]: b_1, b_2 with (b_1 - 2)(b_2 - 2) = 1, of least sum of w_k b_k: (b_k - 2)^2 = w_j / w_k."""
    K, P = np.eye(2), np.array([[2.0, -1.0], [-1.0, 2.0]])
    start = np.array([[0.5, 0.25], [-0.5, -0.25]])
    share = np.array([0.5, 0.125]) * 2
    w = SHARE + share / share.sum()  # alone, each state has a half-axis of 2^-1/2
    expected = (2 + (w[::-1] / w) ** 0.5) ** -0.5
    assert np.array(largest_half_axes(K, P, 1.0, start, 0.01)) == pytest.approx(expected, rel=0.01)


def test_a_claim_of_half_axes_is_a_list_of_numbers_above_zero():
    content = {
        "certified": True, "rho": 1.0, "alpha": 1.0, "proof": "exact",
        "fragility": dict.fromkeys("ABCD", 0.0),
        "sampled": {"certified": True, "proof": "ball", "half_axes": [1.0, 2.0]},
    }  # fmt: skip
    assert claims_of(content).sampled.half_axes == (1.0, 2.0)
    for wrong in ([1.0, 0.0], [1.0, "2"], 3.0, [1.0, None]):
        with pytest.raises(ProblemError, match="half_axes"):
            claims_of({**content, "sampled": {**content["sampled"], "half_axes": wrong}})


def _parts(loop, w):
    K = midpoints(metric(loop))
    return K, w.P[: len(K), : len(K)]


def _level(loop, w) -> float:
    """c = min_l 1 / (k_l P^-1 k_l'), without what rounding takes of it."""
    rows = midpoints(loop.computed[:, : loop.n_x])
    return float(min(1 / (row @ np.linalg.solve(w.P, row)) for row in rows if row.any()))


def test_starts_whose_squares_overflow():
    far = np.array([[1e200, 0.0], [-1e200, 0.0]])
    assert times_covered(1.0, None, far) == pytest.approx(1e-200 / 2**0.5)
    found = largest_half_axes(np.eye(2), np.diag([4.0, 0.25]), 1.0, far, 0.01)
    assert np.array(found) == pytest.approx([0.5, 2.0], rel=0.015)


def test_no_start_is_claimed_beyond_what_agents_in_their_domain_can_be_apart():
    """x' = u - x - x^3/10 within 1 of 0: two are 2 apart at most, |x_d| = sqrt 2, and u = -r/10 never comes near 1000."""
    posed = problem(
        dynamics={"x": "u - x - 0.1*x**3"},
        outputs={"y": "x"},
        network=PATH_2,
        agent="domain = { x = [-1.0, 1.0] }\nlimits = { u = [-1000.0, 1000.0] }",
        design='method = "given"\norder = 0\n' + "[[design.gains]]\nD = [[-0.1]]\n" * 2,
    )
    claims = as_shipped(design_file_of(design(posed))).claims
    assert claims.scope == "local"
    assert claims.sampled.radius == claims.sampled.clipped_radius == pytest.approx(2**0.5, rel=1e-3)
    assert claims.sampled.half_axes is claims.sampled.clipped_half_axes is None
