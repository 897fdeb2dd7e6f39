"""F of the certificate against a slow twin in fractions, for every shape of problem, and where the proof says no."""

from dataclasses import replace

import networkx  # noqa: F401  its import draws random numbers, which hypothesis forbids inside a strategy
import numpy as np
import pytest
from exact_twin import Twin, fractions
from hypothesis import given, settings
from hypothesis import strategies as st
from lmi_cases import ALPHA, TABLE_1, arms, claim, published

from lockstep.check.continuous.decide import decide
from lockstep.check.continuous.inequality import Certificate, Claim, F_matrix, gain_errors, performance_weight
from lockstep.check.sampled.inequality import multiplier
from lockstep.check.system.disagreement import disagreement
from lockstep.check.system.loop import Loop, Plant, build_loop
from lockstep.model.bound_search import Entry
from lockstep.model.graphs.graph import Graph

Case = tuple[Loop, Twin, np.ndarray, Claim, Certificate]

WITNESS = Certificate(
    rho=13.24,
    P=np.zeros((14, 14)),
    m=np.array([0.3, 0.0, 1.5]),
)


SIZES = st.fixed_dictionaries(
    {
        "N": st.integers(2, 4),
        "n": st.integers(1, 3),
        "m": st.integers(1, 2),
        "q": st.integers(1, 2),
        "order": st.integers(0, 2),
        "r": st.integers(0, 2),
        "v": st.integers(1, 2),
    }
)


def case(seed: int, N: int, n: int, m: int, q: int, order: int, r: int, v: int) -> Case:
    """Random agents, graph, gains, claim and witness, of any shape: order 0, linear, several inputs, some delta 0."""
    generator = np.random.default_rng(seed)
    plant = Plant(
        generator.standard_normal((n, n)),
        tuple(generator.standard_normal((n, m)) for _ in range(N)),
        generator.standard_normal((q, n)),
        generator.standard_normal((n, r)),
        generator.standard_normal((v if r else 0, n)),
    )
    a = np.triu(generator.uniform(0, 1, (N, N)), 1) + np.diag(np.ones(N - 1), -1)
    loop = build_loop(plant.in_numbers(True), disagreement(Graph(a), exact_arithmetic=True), order)
    K = generator.standard_normal((N, order + m, order + q))
    delta = generator.choice([0.0, 0.3, 1.0], size=(N, 4))
    R, Q = (np.diag(generator.uniform(0.5, 2, size)) for size in (n, order))
    places = [(k, l) for k in range(r) for l in range(v if r else 0) if generator.uniform() < 0.7]
    entries = tuple(Entry(k, l, float(generator.uniform(0, 3))) for k, l in places)
    weights = Claim(float(generator.uniform(0, 3)), R, Q, delta, entries)
    P = generator.standard_normal((loop.n_x, loop.n_x))
    ways = len(gain_errors(loop, delta))
    witness = Certificate(
        float(generator.uniform(0.1, 9)),
        P + P.T,
        generator.uniform(0, 1, N * (N - 1) // 2),
        generator.uniform(0, 1, ways),
        generator.uniform(0, 1, (len(entries), N * (N - 1) // 2)),
    )
    blocks = [
        {"A": k[:order, :order], "B": k[:order, order:], "C": k[order:, :order], "D": k[order:, order:]}
        for k in K
    ]
    return loop, Twin(plant, a, blocks), K, weights, witness


@settings(max_examples=25)
@given(st.integers(0, 2**32), SIZES)
def test_F_is_the_twin_s_to_the_last_bit(seed: int, sizes: dict[str, int]) -> None:
    loop, twin, K, weights, witness = case(seed, **sizes)
    F = F_matrix(loop, K, weights, witness)
    expected = twin.F(weights, witness)
    assert F.shape == (len(expected), len(expected))
    for i, row in enumerate(expected):
        for j, value in enumerate(row):
            assert int(F[i, j].p) * value.denominator == value.numerator * int(F[i, j].q), (i, j)


def test_the_twin_can_tell_a_wrong_F() -> None:
    """One sign, one missing square, one metric: each of these slips changes the twin's form."""
    network = arms()
    weights = claim(network, 2, ALPHA, delta=(0.5, 0.2, 0.2, 0.2))
    twin = Twin(
        network.plant,
        network.graph.adjacency,
        [{k: TABLE_1["corollary_1"][k][i] for k in "ABCD"} for i in range(3)],
    )
    witness = replace(WITNESS, t=np.ones(12), P=np.eye(14))
    F = twin.F(weights, witness)
    for slip in (
        replace(weights, alpha=-(ALPHA**2)),
        replace(weights, delta=weights.delta**2),
        replace(weights, R=weights.R * 2),
        replace(weights, Q=weights.R[:2, :2]),
    ):
        assert twin.F(slip, witness) != F
    assert (
        twin.F(weights, replace(witness, rho=-witness.rho)) == F
    )  # rho enters squared: `certify` asks rho > 0


def test_the_multiplier_is_the_sum_over_pairs() -> None:
    loop = arms().loop(0)
    m, d = np.array([0.25, 2.0, 0.5]), loop.d
    x = np.random.default_rng(2).standard_normal((3, 4))
    x_d = (d.T @ x).ravel()
    X = np.diag([1.0, 2.0, 3.0, 4.0])
    expected = sum(
        w * (x[i] - x[j]) @ X @ (x[i] - x[j]) for w, (i, j) in zip(m, [(0, 1), (0, 2), (1, 2)], strict=True)
    )
    assert x_d @ np.kron(multiplier(loop.d, m), X) @ x_d == pytest.approx(expected)


@pytest.mark.parametrize(
    ("order", "delta", "expected"),
    [
        (2, (0.5, 0.2, 0.2, 0.2), "ABCD"),
        (2, (0.0, 0.2, 0.0, 0.2), "BD"),
        (0, (0.5, 0.2, 0.2, 0.2), "D"),  # Remark 1: there is nothing else that could be off
        (2, (0.0, 0.0, 0.0, 0.0), ""),
    ],
)
def test_only_gains_that_are_there_can_be_off(order: int, delta: tuple[float, ...], expected: str) -> None:
    network = arms()
    found = gain_errors(network.loop(order), claim(network, order, ALPHA, delta=delta).delta)
    assert ["ABCD"[way.letter] for way in found] == list(expected) * 3
    assert [way.agent for way in found] == [i for i in range(3) for _ in expected]


def test_the_channels_are_where_the_gains_enter() -> None:
    """X_j Delta Y_j is what A_cl gains when the gains are off by Delta."""
    network, gains = arms(), published()
    loop, generator = network.loop(2), np.random.default_rng(0)
    slots = {0: np.s_[:2, :2], 1: np.s_[:2, 2:], 2: np.s_[2:, :2], 3: np.s_[2:, 2:]}
    for way in gain_errors(loop, np.ones((3, 4))):
        error = np.zeros((3, 3, 4))
        error[(way.agent, *slots[way.letter])] = generator.standard_normal(
            error[(way.agent, *slots[way.letter])].shape
        )
        moved = loop.A_cl(gains.blocks + error) - loop.A_cl(gains.blocks)
        np.testing.assert_allclose(moved, way.X @ error[(way.agent, *slots[way.letter])] @ way.Y, atol=1e-12)


def test_the_weight_charges_each_controller_and_the_projection() -> None:
    network = arms()
    loop = network.loop(2)
    weight = performance_weight(loop, claim(network, 2, ALPHA, Q=2.0))
    x, x_C = np.random.default_rng(1).standard_normal((3, 4)), np.array([1.0, 2, 3, 4, 5, 6])
    x_cl = np.concatenate([(loop.d.T @ x).ravel(), x_C])
    expected = ((x - x.mean(axis=0)) ** 2).sum() + 2 * (x_C**2).sum()
    assert x_cl @ weight @ x_cl == pytest.approx(expected)


def scalar_case() -> tuple[Loop, Claim]:
    """Two agents x' = u + phi + xi, y = x that hear each other: x_d' = (D_1 + D_2) x_d + phi_d + xi_d, one number each."""
    one = np.eye(1)
    plant = Plant(np.zeros((1, 1)), (one, one), one, one, one)
    loop = build_loop(
        plant.in_numbers(True), disagreement(Graph.topology("path", 2), exact_arithmetic=True), 0
    )
    return loop, Claim(1.0, one, np.zeros((0, 0)), np.zeros((2, 4)))


def closed_form_rho(a: float) -> float:
    """x' = -a x + phi + xi, |phi| <= |x|: the gain from xi to x is 1 / (a - 1) (small gain, tight for phi = x)."""
    return 1.0 / (a - 1.0)


@pytest.mark.parametrize("a", [1.5, 2.0, 5.0])
def test_a_scalar_loop_against_its_closed_form(a: float) -> None:
    """m = P and the best P: certified just above 1/(a - 1), never just below, for any of 61 P around the best."""
    loop, weights = scalar_case()
    K = np.full((2, 1, 1), -a / 2)
    rho = closed_form_rho(a)
    for share, holds in ((1.001, True), (0.999, False)):
        certified = False
        for p in rho / 2 * np.linspace(0.5, 2, 61):  # P in units of S
            witness = Certificate(share * rho, np.array([[p]]), np.array([p]))
            certified |= decide(loop, K, weights, witness).positive
        assert certified is holds


def test_signs_of_the_witnesses_are_part_of_the_proof() -> None:
    loop, weights = scalar_case()
    K, good = np.full((2, 1, 1), -2.5), Certificate(0.3, np.array([[0.15]]), np.array([0.15]))
    assert decide(loop, K, weights, good).positive
    for bad in (
        replace(good, m=np.array([-0.15])),
        replace(good, m=np.array([0.0])),  # M is singular: F has a zero on its diagonal
        replace(good, P=-good.P),
        replace(good, P=np.zeros((1, 1))),
        replace(good, rho=0.0),
    ):
        answer = decide(loop, K, weights, bad)
        assert not answer.positive
        assert answer.value <= 0
    assert decide(loop, K, weights, replace(good, m=np.array([0.15]))).positive


def test_some_weights_may_be_zero_and_all_may_not() -> None:
    """A tree of pairs keeps M positive definite; two pairs out of three connect three agents."""
    loop = arms().loop(2)
    assert np.linalg.eigvalsh(multiplier(loop.d, np.array([1.0, 0.0, 1.0])))[0] > 0.1
    assert np.linalg.eigvalsh(multiplier(loop.d, np.array([1.0, 0.0, 0.0])))[0] == pytest.approx(
        0.0, abs=1e-12
    )


def test_a_witness_that_is_not_symmetric_is_no_witness() -> None:
    one, zero = np.eye(2), np.zeros((0, 2))
    plant = Plant(-one, (one, one), one, np.zeros((2, 0)), zero)
    loop = build_loop(
        plant.in_numbers(True), disagreement(Graph.topology("path", 2), exact_arithmetic=True), 0
    )
    weights = Claim(0.0, one, np.zeros((0, 0)), np.zeros((2, 4)))
    skew = np.array([[1.0, 0.5], [-0.5, 1.0]])
    answer = decide(loop, np.zeros((2, 2, 2)), weights, Certificate(9.0, skew, np.zeros(1)))
    assert not answer.positive
    assert "symmetric" in answer.method


def test_fractions_of_the_twin_are_the_doubles() -> None:
    assert fractions([[0.1]])[0][0] != fractions([[0.1000000000000001]])[0][0]
