"""The published gains against the reference's figures, what a multiplier on all pairs is worth, rounding that proves."""

from dataclasses import replace

import cvxpy as cp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lmi_cases import ALPHA, arms, claim, published

from lockstep.check.continuous.decide import decide
from lockstep.check.continuous.inequality import Certificate, F_matrix
from lockstep.check.errors import NotCertified
from lockstep.lmi.analysis.certificate_sdp import AffineF, balance, least_rho
from lockstep.lmi.analysis.decimals import round_up
from lockstep.lmi.analysis.rounding import SLACKS, _definite, prove, rounded
from lockstep.lmi.proposal import claim_of, given_gains, proved_bound
from lockstep.model.assembly import network_of
from lockstep.model.problem import Problem, load_problem


@pytest.mark.parametrize(
    ("which", "coordinates", "rho"),
    [
        ("corollary_1", "orthonormal", 13.23),  # all three measured apart from this code
        ("corollary_1", "laplacian_rows", 12.153),
        ("theorem_1", "laplacian_rows", 212.3),
    ],
)
def test_the_published_gains_have_the_measured_rho_and_are_proved(
    which: str, coordinates: str, rho: float
) -> None:
    network = arms(coordinates=coordinates)
    gains, weights = published(which), claim(network, 2, ALPHA)
    least = least_rho(network.loop(2), gains.blocks, weights)
    assert least is not None
    assert least.rho == pytest.approx(rho, rel=1e-3)
    certificate = prove(network, gains, weights)
    # Rounded up to four figures after the documented slack.
    assert least.rho <= certificate.rho <= least.rho * (1 + SLACKS[-1]) * 1.001
    exact = network.loop(2, exact_arithmetic=True)
    assert decide(exact, gains.blocks, weights, certificate).positive
    assert not decide(exact, gains.blocks, weights, replace(certificate, rho=0.99 * least.rho)).positive


def test_a_certificate_at_hand_is_put_to_the_proof_where_the_solver_has_none(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As a search ends with one that semidefinite programs, in whatever units, do not come up to."""
    network, gains = arms(), published()
    weights = claim(network, 2, ALPHA)
    known = prove(network, gains, weights)
    monkeypatch.setattr("lockstep.lmi.analysis.rounding.tight_certificate", lambda *_args, **_more: None)
    with pytest.raises(NotCertified, match="did not survive"):
        prove(network, gains, weights)
    proved = prove(network, gains, weights, near=known)
    assert known.rho <= proved.rho <= known.rho * (1 + SLACKS[0]) * 1.001  # rounded up to four figures
    assert decide(network.loop(2, exact_arithmetic=True), gains.blocks, weights, proved).positive


@pytest.mark.parametrize("alpha", [4.7, 10.0])
def test_they_are_refused_where_a_slope_destabilises(alpha: float) -> None:
    network = arms()
    with pytest.raises(NotCertified) as error:
        prove(network, published(), claim(network, 2, alpha))
    assert error.value.figures["alpha"] == alpha


def test_gains_that_do_not_stabilise_are_refused_with_the_abscissa() -> None:
    network = arms()
    gains = published()
    unstable = type(gains)(gains.A, gains.B, gains.C, tuple(-D for D in gains.D))
    with pytest.raises(NotCertified) as error:
        prove(network, unstable, claim(network, 2, ALPHA))
    assert error.value.figures["abscissa"] > 0


def test_a_rho_that_is_asked_for_is_the_one_that_is_proved() -> None:
    network, gains = arms(), published()
    assert prove(network, gains, claim(network, 2, ALPHA), rho=20.0).rho == 20.0
    with pytest.raises(NotCertified):
        prove(network, gains, claim(network, 2, ALPHA), rho=13.0)


def largest_alpha(equal: bool) -> float:
    """Bisect alpha for the published gains, by a program of this test: feasibility of F < 0, full P, weights m as given.

    No disturbance and no weights: only stability for every phi. In orthonormal coordinates, straight from (12).
    """
    network, gains = arms(), published()
    loop = network.loop(2)
    A_cl, n_x = loop.A_cl(gains.blocks), loop.n_x
    E_G = loop.E @ np.kron(np.eye(2), loop.plant.G)
    H = np.hstack([np.kron(np.eye(2), loop.plant.H), np.zeros((2, 6))])
    shapes = [loop.d.pair_multiplier(i, j) for i, j in loop.d.pairs()]

    def feasible(alpha: float) -> bool:
        P, m, s = cp.Variable((n_x, n_x), symmetric=True), cp.Variable(3), cp.Variable()
        M = sum(m[k] * shapes[k] for k in range(3))
        F = cp.bmat([[P @ A_cl + A_cl.T @ P + alpha**2 * H.T @ M @ H, P @ E_G], [E_G.T @ P, -M]])
        conditions = [
            P >> s * np.eye(n_x),
            (F + F.T) / 2 + s * np.eye(n_x + 2) << 0,
            cp.trace(P) <= 100,
            m >= 0,
            m <= 100,
        ]
        program = cp.Problem(cp.Maximize(s), conditions + ([m[0] == m[1], m[1] == m[2]] if equal else []))
        program.solve(solver=cp.CLARABEL)
        return program.status == cp.OPTIMAL and float(s.value) > 1e-9

    low, high = 0.0, 6.0
    for _ in range(9):
        middle = (low + high) / 2
        low, high = (middle, high) if feasible(middle) else (low, middle)
    return low


def test_one_weight_for_all_pairs_loses_the_example() -> None:
    """(30) with the identity in place of the multiplier does not carry 3.33; weights on the pairs carry 4.58."""
    network, gains = arms(), published()
    assert largest_alpha(equal=True) < ALPHA
    assert largest_alpha(equal=False) == pytest.approx(4.58, abs=0.02)
    weights = prove(network, gains, claim(network, 2, ALPHA)).m
    assert weights.max() > 2 * weights.min()


@pytest.mark.parametrize(
    ("which", "largest", "beyond"), [("theorem_1", 3.41, 3.43), ("corollary_1", 4.55, 4.59)]
)
def test_the_largest_alpha_of_the_published_gains(which: str, largest: float, beyond: float) -> None:
    """The reference: 3.42 and 4.58 (rho goes to infinity there, so the last hundredths are the solver's)."""
    network, gains = arms(), published(which)
    assert prove(network, gains, claim(network, 2, largest)).rho > 100
    with pytest.raises(NotCertified):
        prove(network, gains, claim(network, 2, beyond))


@settings(max_examples=10)
@given(st.integers(0, 2**32))
def test_the_affine_form_is_F(seed: int) -> None:
    """What the solver is given, at random unknowns, against F assembled from them."""
    network, gains, generator = arms(), published(), np.random.default_rng(seed)
    weights = claim(network, 2, ALPHA, delta=(0.5, 0.0, 0.2, 0.2))
    loop = network.loop(2)
    form = AffineF(loop, gains.blocks, weights)
    P, w = generator.standard_normal((14, 14)), generator.uniform(0, 2, 3 + 9 + 1)
    witness = form.certificate(P, w)
    half = np.eye(len(form.constant), 14) @ witness.P @ form.Z
    affine = half + half.T + form.constant + np.tensordot(w, form.slopes, 1)
    np.testing.assert_allclose(affine, F_matrix(loop, gains.blocks, weights, witness), atol=1e-9)


@given(st.floats(1e-200, 1e200), st.integers(1, 12))
def test_rounding_up_is_up_and_no_further_than_it_must(value: float, digits: int) -> None:
    up = round_up(value, digits)
    assert value <= up <= value * (1 + 1.001 * 10.0 ** (1 - digits))
    assert float(f"{up:.{digits}g}") == up


@pytest.mark.parametrize(
    ("value", "up"), [(13.2323, 13.24), (9.9999, 10.0), (0.012341, 0.01235), (5.0, 5.0), (0.0, 0.0)]
)
def test_rounding_up_by_hand(value: float, up: float) -> None:
    assert round_up(value) == up


def test_rounded_keeps_symmetry_and_the_number_of_digits() -> None:
    generator = np.random.default_rng(0)
    P = generator.standard_normal((5, 5)) * 1e4
    short = rounded(
        Certificate(1.0, P + P.T, np.array([0.0, 1.23456789, 9.87654e-7]), np.array([123456.0])), 4
    )
    np.testing.assert_array_equal(short.P, short.P.T)
    np.testing.assert_allclose(short.P, P + P.T, atol=np.abs(P + P.T).max() * 1e-3)
    assert short.m.tolist() == [0.0, 1.235, 9.877e-07]
    assert short.t.tolist() == [123500.0]


def test_units_in_which_the_solver_stops_early_do_not_decide_rho(root) -> None:
    """Gains of benchmarks/designs/converters.toml: in SI units the solver stops at 0.00372, 3.7 times the least.

    The sampled loop of these gains is proved with 0.001011, and no controllers have less than 0.000999.
    """
    content = load_problem(root / "benchmarks" / "designs" / "converters.toml").document()
    tables = [
        {"A": [[A]], "B": [[0.0, B]], "C": [[0.0]], "D": [D]}
        for A, B, D in [
            (-33.4716, 1e-4, [-4.0555, -46.194]),
            (-33.4012, 0.0, [-4.0548, -46.1866]),
            (-33.4009, 0.0, [-4.0548, -46.1865]),
        ]
    ]
    content["design"] = {"method": "given", "order": 1, "gains": tables}
    problem = Problem.from_document(content)
    bound = proved_bound(problem)
    certificate = prove(network_of(problem, bound), given_gains(problem), claim_of(problem, bound))
    assert 0.000999 < certificate.rho < 1.02 * 0.001011


def test_products_that_overflow_are_no_certificate_and_no_error() -> None:
    """Weights of 1e-310 make a P of their size: its inverse root squared is beyond the doubles."""
    network = arms()
    weights = claim(network, 2, ALPHA)
    tiny = replace(weights, R=1e-310 * weights.R, Q=1e-310 * weights.Q)
    assert balance(AffineF(network.loop(2), published("corollary_1").blocks, tiny)) is None
    assert not _definite(np.array([[np.inf]]))
    assert not _definite(np.array([[1.0, np.inf], [np.inf, 1.0]]))
