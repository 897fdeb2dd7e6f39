"""Multipliers by frequencies, which replace the semidefinite programs of large loops, against figures measured apart."""

import numpy as np
import pytest
from lmi_cases import ALPHA, arms, claim, published

from cart import cart
from lockstep.check.continuous.decide import decide
from lockstep.check.errors import NotCertified
from lockstep.lmi.analysis import certificate_sdp, frequency_multipliers
from lockstep.lmi.analysis.certificate_sdp import AffineF
from lockstep.lmi.analysis.frequency_multipliers import Response, least_by_frequencies
from lockstep.lmi.analysis.rounding import prove
from lockstep.lmi.proposal import claim_of, given_gains, proved_bound
from lockstep.model.assembly import network_of
from lockstep.model.problem import Problem, parse_problem

WORSE = 1.011
"""A p-norm of p = 201 over some 80 frequencies is at most 80^(1/201) times the largest rho^2: the root of that of rho."""


def form_of(coordinates: str = "orthonormal", which: str = "corollary_1") -> AffineF:
    network = arms(coordinates=coordinates)
    return AffineF(network.loop(2), published(which).blocks, claim(network, 2, ALPHA))


@pytest.mark.parametrize(
    ("which", "coordinates", "rho"),
    [
        ("corollary_1", "orthonormal", 13.23),  # those of test_least_rho: measured apart from this code
        ("corollary_1", "laplacian_rows", 12.153),
        ("theorem_1", "laplacian_rows", 212.3),
    ],
)
def test_the_published_gains_have_the_measured_rho(which: str, coordinates: str, rho: float) -> None:
    form = form_of(coordinates, which)
    found = least_by_frequencies(form.Z, form.constant, form.slopes)
    assert found is not None
    assert (1 - 1e-3) * rho < np.sqrt(found[1][-1]) < WORSE * rho


@pytest.mark.parametrize("kind", ["gain", "rho"])
def test_slopes_are_those_of_differences(kind: str) -> None:
    form = form_of()
    response = Response.of(form.Z, form.constant, form.slopes)
    w = least_by_frequencies(form.Z, form.constant, form.slopes)
    assert w is not None
    # A little off the least, where no slope is 0; 10 % more of each holds what the least one holds.
    at = np.log(1.1 * w[1][:-1]) + np.linspace(0.0, 0.05, len(w[1]) - 1)
    function, step = getattr(response, kind), 1e-6
    slope = response.value(function, at, 7, response.y)[1]
    for k, unit in enumerate(np.eye(len(at))):
        high, low = (response.value(function, at + s * step * unit, 7, response.y)[0] for s in (1, -1))
        # A central difference of log lambda: of the order step^2, and rounding over step.
        assert slope[k] == pytest.approx((high - low) / (2 * step), rel=1e-4, abs=1e-7)


def test_none_is_found_where_a_slope_destabilises() -> None:
    network = arms()
    form = AffineF(network.loop(2), published().blocks, claim(network, 2, 4.7))
    assert least_by_frequencies(form.Z, form.constant, form.slopes) is None


def test_multipliers_that_left_the_range_of_doubles_are_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """A descent that nothing holds took them to e^800 (a random problem's loop), and the search ended with an error."""
    form, gone = form_of(), np.array([800.0, -800.0, 800.0])
    assert least_by_frequencies(form.Z, form.constant, form.slopes) is not None
    monkeypatch.setattr(frequency_multipliers, "_lowered", lambda *_given, **_named: (gone, 0.5))
    with np.errstate(all="ignore"):
        assert least_by_frequencies(form.Z, form.constant, form.slopes) is None


def test_an_unstable_loop_has_none() -> None:
    network = arms()
    form = AffineF(network.loop(2), -published().blocks, claim(network, 2, ALPHA))
    assert least_by_frequencies(form.Z, form.constant, form.slopes) is None


def twenty_pendulums(gain: float) -> Problem:
    edges = [[i, (i + hop - 1) % 20 + 1] for i in range(1, 21) for hop in (1, 2, 18, 19)]
    gains = "".join(f"[[design.gains]]\nD = [[{gain - 0.01 * i:.2f}, {gain:.2f}]]\n" for i in range(20))
    return parse_problem(
        f"""
        [agent]
        name = "pendulum"
        states = ["angle", "rate"]
        inputs = ["u"]
        dynamics = {{ angle = "rate", rate = "-2*sin(angle) - 0.3*rate + u" }}
        outputs = {{ y1 = "angle", y2 = "rate" }}
        [network]
        agents = 20
        edges = {edges}
        [design]
        method = "given"
        order = 0
        {gains}
        """,
        "twenty.toml",
    )


def test_twenty_agents_with_gains_of_their_own_are_proved() -> None:
    problem = twenty_pendulums(-8.0)
    bound = proved_bound(problem)
    network, weights, gains = network_of(problem, bound), claim_of(problem, bound), given_gains(problem)
    assert certificate_sdp.eliminates_P(network.loop(0))
    certificate = prove(network, gains, weights)
    assert decide(network.loop(0, exact_arithmetic=True), gains.blocks, weights, certificate).positive


def test_gains_too_small_for_the_slope_are_refused() -> None:
    # The slowest mode is Re lambda_2 = 0.48: -0.2 of it is below the slope of 2 that parts pendulums which hang upside down.
    problem = twenty_pendulums(-0.2)
    bound = proved_bound(problem)
    with pytest.raises(NotCertified):
        prove(network_of(problem, bound), given_gains(problem), claim_of(problem, bound))


def test_a_long_chain_of_equal_agents_is_proved() -> None:
    # Each agent hears the one before: poles 29 times at one place, whose eigenvectors doubles do not tell apart.
    problem = parse_problem(
        cart("f")
        + f"[network]\nagents = 30\nedges = {[[i + 1, i] for i in range(1, 30)]}\n"
        + "[design]\nmethod = 'given'\norder = 0\n"
        + "[[design.gains]]\nD = [[-1.0, -2.0]]\n" * 30
    )
    bound = proved_bound(problem)
    network, weights, gains = network_of(problem, bound), claim_of(problem, bound), given_gains(problem)
    certificate = prove(network, gains, weights)
    assert decide(network.loop(0, exact_arithmetic=True), gains.blocks, weights, certificate).positive
