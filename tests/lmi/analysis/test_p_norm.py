"""The p-norm of a response against its eigenvalues, its slope against differences, and the frequencies that count."""

import numpy as np
import pytest

from lockstep.lmi.analysis.p_norm import dominant, gram, p_norm, thinned


def response(seed: int, rank: int = 6) -> np.ndarray:
    """Hermitian matrices at 5 frequencies, positive semidefinite, of very different sizes."""
    rng = np.random.default_rng(seed)
    half = rng.normal(size=(5, 6, rank)) + 1j * rng.normal(size=(5, 6, rank))
    return (half @ half.conj().swapaxes(1, 2)) * 10.0 ** rng.uniform(-150, 150)


@pytest.mark.parametrize("p", [1, 5, 61, 201])
@pytest.mark.parametrize("rank", [1, 3, 6])
def test_the_norm_is_that_of_the_eigenvalues(p, rank):
    for seed in range(5):
        M = response(seed, rank)
        logs = p * np.log(np.maximum(np.linalg.eigvalsh(M), 1e-300)).ravel()
        expected = np.logaddexp.reduce(logs) / p
        assert p_norm(M, p)[0] == pytest.approx(expected, rel=1e-12, abs=1e-9)


@pytest.mark.parametrize("p", [1, 5, 61])
def test_the_factors_are_those_of_the_slope(p):
    M = response(3)
    size, rng = np.abs(M).max(), np.random.default_rng(4)
    turn = rng.normal(size=M.shape) + 1j * rng.normal(size=M.shape)
    turn = (turn + turn.conj().swapaxes(1, 2)) * size
    step = 1e-6
    forth, back = (p_norm(M + sign * step * turn, p)[0] for sign in (1, -1))
    factor = p_norm(M, p)[1]
    slope = sum(np.trace(S @ S.conj().T @ d).real for S, d in zip(factor, turn, strict=True))
    assert slope * step == pytest.approx((forth - back) / 2, rel=1e-6)


def test_where_there_is_none():
    M = response(0)
    assert p_norm(0 * M, 5)[0] == np.inf
    M[2, 1, 1] = np.nan
    assert p_norm(M, 5)[0] == np.inf


def test_an_even_p_is_a_mistake():
    with pytest.raises(AssertionError, match="half of p - 1"):
        p_norm(response(0), 4)


def test_frequencies_count_near_the_top_and_over_the_range():
    """With the top alone, a descent of ten arms' own gains raised what it did not see, and ended where it began."""
    frequencies = thinned(np.geomspace(0.01, 100.0, 400))
    levels = np.exp(-((np.log(frequencies) - 1.0) ** 2) * 4)
    used = dominant(frequencies, levels, 5)
    assert used[levels > 0.5 * levels.max()].all()
    assert used.sum() < 0.5 * len(frequencies)
    gaps = frequencies[used][1:] / frequencies[used][:-1]
    assert gaps.max() < 1.3 * 1.03 + 1e-9


def test_a_gram_of_two():
    rng = np.random.default_rng(0)
    a, b = (rng.normal(size=(3, 2, 4)) + 1j * rng.normal(size=(3, 2, 4)) for _ in range(2))
    expected = sum((x @ y.conj().T).real for x, y in zip(a, b, strict=True))
    np.testing.assert_allclose(gram(a, b), expected, rtol=1e-12)
    np.testing.assert_allclose(gram(a), gram(a, a), rtol=1e-12)
