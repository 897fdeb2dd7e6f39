"""Exact positive definiteness: known constructions, matrices on the very edge, extreme scales, and the vectors that refute.

Every expectation is a closed form or comes from `exact_twin.positive_definite` (leading minors in integers).
"""

from fractions import Fraction

import numpy as np
import pytest
from exact_twin import fractions, positive_definite
from flint import fmpq
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from lockstep.check.numbers import exactly
from lockstep.check.psd import MOST_BITS, Definiteness, decide_positive_definite


def decided(matrix: object) -> Definiteness:
    return decide_positive_definite(exactly(np.array(matrix, dtype=float)))


def form(matrix: object, z: np.ndarray) -> Fraction:
    """z' M z, exactly."""
    rows, z_exact = fractions(np.array(matrix, dtype=float)), [Fraction(float(x)) for x in z]
    return sum(
        (z_exact[i] * rows[i][j] * z_exact[j] for i in range(len(z)) for j in range(len(z))), Fraction(0)
    )


@pytest.mark.parametrize(
    ("matrix", "positive"),
    [
        ([[5e-324]], True),
        ([[0.0]], False),
        ([[-0.0]], False),
        ([[-5e-324]], False),
        ([[1.0, 1.0], [1.0, 1.0 + 2**-52]], True),  # det = 2^-52
        ([[1.0, 1.0], [1.0, 1.0]], False),  # det = 0
        ([[1.0, 1.0], [1.0, 1.0 - 2**-53]], False),  # det = -2^-53
        ([[9.0, 3.0], [3.0, 1.0]], False),  # det = 0, and its null vector (-1, 3) / sqrt(10) is no double
        ([[9.0, 3.0], [3.0, np.nextafter(1.0, 2)]], True),
        ([[9.0, 3.0], [3.0, np.nextafter(1.0, 0)]], False),
        ([[1e300, 0.0], [0.0, 1e-300]], True),
        ([[1e300, 0.999], [0.999, 1e-300]], True),  # 1e300 * 1e-300 is 1 to 1e-16
        ([[1e300, 1.001], [1.001, 1e-300]], False),
        ([[1e308, 1e308], [1e308, 1e308]], False),
        ([[5e-324, 5e-324], [5e-324, 1e-323]], True),
    ],
)
def test_the_edge_is_decided_exactly(matrix: list[list[float]], positive: bool) -> None:
    assert positive_definite(fractions(matrix)) is positive
    assert decided(matrix).positive is positive


@pytest.mark.parametrize("n", [2, 5, 9])
def test_a_hilbert_matrix_is_positive_definite_and_a_perturbed_one_is_not(n: int) -> None:
    """The Hilbert matrix times the least common multiple of 1 ... 2n - 1 is one of integers, so nothing is rounded."""
    common = int(np.lcm.reduce(np.arange(1, 2 * n)))
    hilbert = np.array([[common // (i + j + 1) for j in range(n)] for i in range(n)], dtype=float)
    assert decided(hilbert).positive
    # The determinant is affine in the last entry, with the slope det H_(n-1): this far down it is 0.
    least = float(common * inverse_corner(n))
    for share, positive in ((1 - 1e-6, True), (1 + 1e-6, False)):
        moved = hilbert.copy()
        moved[-1, -1] -= share * least
        assert decided(moved).positive is positive


def inverse_corner(n: int) -> Fraction:
    """Return 1 / (H^-1)_nn = 1 / ((2n - 1) binom(2n - 2, n - 1)^2), the distance of H_nn from singularity."""
    from math import comb

    return Fraction(1, (2 * n - 1) * comb(2 * n - 2, n - 1) ** 2)


small = st.integers(-4, 4).map(float)


@settings(max_examples=150)
@given(hnp.arrays(float, st.integers(1, 5).map(lambda n: (n, n)), elements=small), st.integers(-300, 300))
def test_small_integers_agree_with_the_leading_minors(half: np.ndarray, exponent: int) -> None:
    """Integers from -4 to 4 make a third of the cases singular; powers of two as scales are exact."""
    matrix = np.ldexp(half + half.T, exponent)
    answer = decided(matrix)
    assert answer.positive is positive_definite(fractions(matrix))
    if not answer.positive:
        assert answer.vector is not None
        # To rounding of the vector: a null vector such as (1, 3)/sqrt(10) has no doubles.
        assert form(matrix, answer.vector) <= Fraction(np.abs(matrix).max()) * Fraction(1, 10**28)


@settings(max_examples=100)
@given(hnp.arrays(float, st.integers(2, 6).map(lambda n: (n, n)), elements=small), st.integers(-60, 0))
def test_a_shift_of_a_gram_matrix_flips_the_answer(half: np.ndarray, exponent: int) -> None:
    """A A' of rank below n is singular; plus any 2^-k I it is definite, minus it is not, however small."""
    gram = half @ half.T
    gram[-1], gram[:, -1] = gram[0], gram[:, 0]
    gram[-1, -1] = gram[0, 0]
    shift = np.ldexp(np.eye(len(gram)), exponent)
    up, down = exactly(gram) + exactly(shift), exactly(gram) - exactly(shift)
    assert decide_positive_definite(up).positive
    assert not decide_positive_definite(exactly(gram)).positive
    assert not decide_positive_definite(down).positive


@settings(max_examples=60)
@given(st.lists(st.integers(-400, 400), min_size=2, max_size=6), st.integers(0, 2**32))
def test_congruence_by_extreme_powers_of_two_changes_nothing(exponents: list[int], seed: int) -> None:
    generator = np.random.default_rng(seed)
    n = len(exponents)
    half = generator.integers(-3, 4, size=(n, n + 1)).astype(float)
    matrix = exactly(half @ half.T)
    scale = np.array([fmpq(2) ** k for k in exponents], dtype=object)
    scaled = matrix * np.outer(scale, scale)
    assert decide_positive_definite(scaled).positive is decide_positive_definite(matrix).positive


def test_a_tiny_negative_pivot_deep_inside_is_found() -> None:
    """L D L' with unit triangular L of integers and one pivot of -2^-200: exactly representable only as rationals."""
    n = 6
    generator = np.random.default_rng(3)
    L = exactly(np.tril(generator.integers(-2, 3, size=(n, n)), -1) + np.eye(n))
    for sign in (1, -1):
        D = np.array([fmpq(1)] * n, dtype=object)
        D[3] = sign * fmpq(2) ** -200
        assert decide_positive_definite(L @ np.diag(D) @ L.T).positive is (sign > 0)


def test_the_vector_refutes_in_exact_arithmetic() -> None:
    generator = np.random.default_rng(5)
    for _ in range(20):
        half = generator.standard_normal((7, 7))
        matrix = half + half.T
        answer = decided(matrix)
        assert not answer.positive  # Gaussian symmetric matrices of this seed are all indefinite
        assert answer.vector is not None
        assert form(matrix, answer.vector) < 0
        assert float(form(matrix, answer.vector)) == pytest.approx(answer.value, rel=1e-12)
        assert np.linalg.norm(answer.vector) == pytest.approx(1.0)


def test_each_stage_answers_where_it_should() -> None:
    """The fast stages take the clear cases, the exact one the edge: the method names which argument decided."""
    assert decided(np.eye(3) * 2).method == "factor and exact residual"
    assert decided([[1.0, 2.0], [2.0, 1.0]]).method == "exact quadratic form"
    assert decided([[1.0, 1.0], [1.0, 1.0 + 2**-52]]).method == "exact LDL'"
    assert decided([[1.0, 1.0], [1.0, -1.0]]).method == "diagonal"


def test_the_vector_survives_extreme_scales() -> None:
    matrix = [[1e-300, 0.0, 0.0], [0.0, 1e300, 1.2e300], [0.0, 1.2e300, 1e300]]
    answer = decided(matrix)
    assert not answer.positive
    assert answer.vector is not None
    assert form(matrix, answer.vector) < 0


def test_the_value_of_a_refutation_is_not_positive() -> None:
    assert decided([[9.0, 3.0], [3.0, 1.0]]).value <= 0


def test_entries_near_the_largest_double_are_decided_without_a_warning() -> None:
    big = np.finfo(float).max
    assert not decided([[1.0, big], [big, 1.0]]).positive


def test_wildly_scaled_numbers_are_not_decided_and_those_just_below_are() -> None:
    """Of [[1, c], [c, 1 + c^2]] with c = 2^-k the determinant is 1; the last entry has 2 k + 1 bits."""
    for k, decided_here in (((MOST_BITS - 1) // 2, True), (MOST_BITS // 2 + 1, False)):
        c = fmpq(1, 2**k)
        answer = decide_positive_definite(np.array([[fmpq(1), c], [c, 1 + c * c]], dtype=object))
        assert (answer.positive, answer.decided) == (decided_here, decided_here)
        assert decided_here or "too wildly scaled" in answer.method


def test_the_exact_stage_stops_before_it_takes_hours() -> None:
    """M = J + e I is positive definite; with e = 2^-1500 no double tells, and 60 rows are too many for the exact factor."""
    for n, decided_here in ((4, True), (60, False)):
        M = np.array(
            [[fmpq(1) + (fmpq(1, 2**1500) if i == j else 0) for j in range(n)] for i in range(n)],
            dtype=object,
        )
        answer = decide_positive_definite(M)
        assert (answer.positive, answer.decided) == (decided_here, decided_here)
