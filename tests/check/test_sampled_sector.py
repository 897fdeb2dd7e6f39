"""The one sector of phi that stands for alpha and all entries in the lifted loop."""

from fractions import Fraction

import numpy as np
import pytest

from lockstep.check.continuous.inequality import Certificate
from lockstep.check.sampled.sector import common_sector
from lockstep.lmi.sampled.loop_gain import common_pair_weights
from lockstep.model.bound_search import Entry

ENTRIES = (Entry(0, 0, 2.0), Entry(0, 1, 0.02), Entry(1, 1, 0.5))


def weights(m: list[float], m_entries: list[list[float]]) -> tuple[np.ndarray, np.ndarray]:
    return np.array(m), np.array(m_entries)


def test_it_holds_for_all_admitted_differences_and_for_no_smaller_one() -> None:
    """phi = sum_l w_l at the ends of its bounds: Cauchy and Schwarz is an equality where mu_l w_l is one number."""
    found = common_sector(9.0, ENTRIES[:2], *weights([0.0], [[3.0], [50.0]]), 1, 2)
    assert found is not None
    generator = np.random.default_rng(0)
    v = generator.standard_normal((2000, 2)) * generator.choice([1.0, 30.0], (2000, 2))
    v[0] = 1 / (3.0 * 2.0), 1 / (50.0 * 0.02)
    phi = np.abs(v) @ [2.0, 0.02]
    ratios = found.Pi_w[0] * phi**2 / (v**2 @ found.Pi_z)
    assert ratios.max() == pytest.approx(1.0)
    assert ratios.max() == ratios[0]


def test_components_have_weights_of_their_own() -> None:
    found = common_sector(9.0, ENTRIES, *weights([0.0], [[3.0], [50.0], [7.0]]), 2, 2)
    assert found is not None
    np.testing.assert_allclose(found.Pi_w, np.array([150 / 53, 7.0]) / 7.0)
    np.testing.assert_allclose(found.Pi_z, np.array([3.0 * 4.0, 50.0 * 0.0004 + 7.0 * 0.25]) / 7.0)


def test_alpha_is_added_with_its_own_weights() -> None:
    found = common_sector(4.0, ENTRIES, *weights([1.0, 2.0], [[0.0, 0.0]] * 3), 2, 2)
    assert found is not None
    assert found.Pi_w.tolist() == [1.0, 1.0]
    assert found.Pi_z.tolist() == [16.0, 16.0]


def test_a_component_without_weights_has_no_sector() -> None:
    """An entry whose weight is 0 says nothing, and its component has no others to be added to it."""
    assert common_sector(4.0, ENTRIES, *weights([0.0], [[1.0], [0.0], [1.0]]), 2, 2) is None
    assert common_sector(4.0, ENTRIES, *weights([0.1], [[1.0], [0.0], [1.0]]), 2, 2) is not None


def test_numbers_are_rounded_to_the_safe_side() -> None:
    generator = np.random.default_rng(4)
    for _ in range(50):
        m, entries = generator.uniform(0, 1, 3), generator.uniform(0, 1, (2, 3))
        found = common_sector(0.3, ENTRIES[:2], *weights(m.tolist(), entries.tolist()), 1, 2)
        assert found is not None
        mu = [sum(Fraction(float(value)) for value in row) for row in entries]
        whole = sum(Fraction(float(value)) for value in m)
        Q, W = (
            whole + 1 / (1 / mu[0] + 1 / mu[1]),
            [
                whole * Fraction(0.3) ** 2 + one * Fraction(r) ** 2
                for one, r in zip(mu, (2.0, 0.02), strict=True)
            ],
        )
        for above, exact in zip(found.Pi_z, W, strict=True):
            assert Fraction(float(found.Pi_w[0])) * exact <= Q * Fraction(float(above))


def test_the_first_guess_has_the_ratios_of_the_pairs() -> None:
    m, m_entries = weights([0.0, 0.0], [[1.0, 4.0], [2.0, 8.0], [3.0, 12.0]])
    found = common_sector(1.0, ENTRIES, m, m_entries, 2, 2)
    assert found is not None
    c = Certificate(1.0, np.zeros((1, 1)), m, np.zeros(0), m_entries)
    guess = common_pair_weights(ENTRIES, c, found)
    assert guess[1] == pytest.approx(4 * guess[0])
    assert guess[0] * found.Pi_w == pytest.approx([2 / 3, 3.0])
