"""mu and disk margins: published figures, closed forms, and perturbations that are put into the loop."""

from pathlib import Path

import control
import numpy as np
import pytest

import lockstep
from lockstep.check.errors import ProblemError
from lockstep.lmi.robustness import (
    both_sides,
    disk_margin,
    loops_at_a_time,
    peak,
    proved_gain,
    structured_singular_value,
)
from lockstep.lmi.robustness.blocks import Structure
from lockstep.lmi.robustness.d_scaling import decide, scales_from_numbers
from lockstep.lmi.robustness.every_frequency import _decided
from lockstep.lmi.robustness.peak import response_of

ROOT = Path(__file__).parents[2]


def satellite(c: float = 10.0) -> control.StateSpace:
    return control.ss([[0, 10], [-10, 0]], np.eye(2), [[1, c], [-10, 1]], 0)


def gain(D) -> control.StateSpace:
    return control.ss([], [], [], D)


def missile() -> control.StateSpace:
    """L3 of RobustAndOptimalControl.jl, test/test_diskmargin.jl (commit e9e38fd): five states, three channels, 10 ms."""
    A = [
        [1.0, 0.0, 9.84, 0.0, 0.0],
        [0.0, 1.0, 0.01, 2.14634e-6, 0.0],
        [0, 0, 1, 0, 0],
        [0, 0, 0, 1, -1.73983959887],
        [0, 0, 0, 0, 0.56597684805],
    ]
    B = [
        [0, 4.901416e-5, 0.00019883877999999998],
        [0, 0, 0],
        [0, 0, 4.0414389999999996e-5],
        [0, -0.02004649371, 0],
        [0, -0.00490141631, 0],
    ]
    C = [
        [0, -0.83516488404, 0, 0, 0],
        [186.74725411661, 0, 0, 0, 0],
        [-7.44299057498, 0, 7035.08410814126, 0, 0],
    ]
    D = [[0, 0, 0], [34875.36444283988, 0, 0], [48304.01940122544, 0, 0]]
    return control.ss(A, B, C, D, 0.01)


def test_one_channel_has_the_margin_of_the_paper():
    """Seiler, Packard and Gahinet 2020, section on L = 25/(s^3 + 10 s^2 + 10 s + 10)."""
    found = disk_margin(control.tf(25, [1, 10, 10, 10]), prove=True)
    assert found.alpha == pytest.approx(0.46, abs=0.005)
    assert found.frequency == pytest.approx(1.94, abs=0.02)
    assert found.gain == pytest.approx((0.63, 1.59), abs=0.005)
    assert found.phase == pytest.approx(25.8, abs=0.1)
    assert 0.99 * found.alpha < found.proved < found.above


def test_skew_one_is_the_distance_of_the_nyquist_curve():
    L = control.tf(25, [1, 10, 10, 10])
    assert disk_margin(L, 1.0).alpha == pytest.approx(control.stability_margins(L)[2], rel=1e-3)
    T = control.ss(control.feedback(L, 1))
    w = np.geomspace(0.5, 5, 20_000)
    assert disk_margin(L, -1.0).alpha == pytest.approx(1 / abs(T(1j * w)).max(), rel=1e-4)


@pytest.mark.parametrize(
    ("loop", "alpha"),
    [
        # Seiler, Packard and Gahinet 2020, the spinning satellite: 0.0998 at the inputs, 0.0499 at both sides.
        (lambda: satellite() * gain(np.eye(2)), 0.0998),
        (lambda: both_sides(satellite(), gain(np.eye(2))), 0.0499),
        # MATLAB's documentation of diskmargin, C = [1 -2; 0 1], simultaneous at outputs: between 0.3754 and 0.3762.
        (lambda: satellite() * gain([[1, -2], [0, 1]]), 0.3758),
        # The same page with c_12 = 8: between 0.4890 and 0.4899.
        (lambda: satellite(8.0) * gain([[1, -2], [0, 1]]), 0.4895),
    ],
)
def test_simultaneous_margins_are_the_published_ones(loop, alpha):
    found = disk_margin(loop())
    assert found.alpha == pytest.approx(alpha, rel=0.01)
    assert found.alpha <= found.above * (1 + 1e-9)


def test_one_loop_at_a_time_the_satellite_looks_safe():
    """The same source: each loop alone has the margin 2, 90 degrees and every gain."""
    for found in loops_at_a_time(satellite() * gain(np.eye(2))):
        assert found.alpha == pytest.approx(2, rel=1e-6)
        # (2 + alpha)/(2 - alpha) is 2e6 or more where alpha is 2 to 1e-6, as above, and infinite where it is exact.
        assert found.gain[0] == pytest.approx(0, abs=1e-6) and found.gain[1] > 1.9e6
        assert found.phase == pytest.approx(90, abs=1e-4)


def test_the_discrete_loop_has_the_figures_of_the_julia_package():
    """test_diskmargin.jl: mu of the response between the two sides listed, the peak of the closed loop, one channel."""
    listed = [
        (0.01, 2.961061403927230, 2.961017564832289),
        (0.1, 0.029884614923336, 0.029880921297303),
        (1.0, 0.000453111209111, 0.000452684368322),
        (10.0, 0.000033811562301, 0.000033712186847),
        (100.0, 0.000003489834242, 0.000003488286208),
    ]
    for w, upper, lower in listed:
        found = structured_singular_value(response_of(missile())(w))
        assert 1e5 * lower * (1 - 1e-6) <= found.lower <= found.upper < found.proved <= 1e5 * upper
    T = control.feedback(missile(), control.ss([], [], [], np.eye(3), 0.01))
    assert peak(T).value.upper == pytest.approx(2.503148529400597, rel=1e-3)
    S = np.linalg.inv(np.eye(3) + response_of(missile())(4.05))
    assert 1 / abs(S[0, 0] - 0.5) == pytest.approx(0.794418036911981, rel=1e-3)


def test_multiplicative_uncertainty_of_a_controlled_oscillator():
    """test_uncertainty.jl: |0.2 T| peaks at 1.18612, so that Delta of 0.84 is the least that destabilises."""
    s = control.tf("s")
    L = control.ss((1 / (s**2 + 0.2 * s + 1)) * (1 + 2 / s + 0.9 * s / (0.1 * s + 1)))
    T = 0.2 * control.feedback(L, 1)
    found = peak(T, [(1, 1)])
    assert found.value.upper == pytest.approx(1.1861236982687908, rel=1e-3)
    assert proved_gain(T) == pytest.approx(1.1861236982687908, rel=5e-3)


def test_a_gain_is_proved_of_full_blocks_only():
    """Two equal first-order lags: 1 at rest, whatever the full block; for delta I no scaling of its own is looked for."""
    lags = control.ss(-np.eye(2), np.eye(2), np.eye(2), np.zeros((2, 2)))
    assert proved_gain(lags, [(2, 2)]) == pytest.approx(1.0, rel=0.03)
    with pytest.raises(ProblemError, match="full blocks"):
        proved_gain(lags, [2])


def test_closed_forms():
    """Zhou, Doyle and Glover 1996, chapter 11: one full block sigma(M), delta I rho(M), a b* the sum of |a_i| |b_i|."""
    rng = np.random.default_rng(3)
    M = rng.normal(size=(4, 4)) + 1j * rng.normal(size=(4, 4))
    cases = [([(4, 4)], np.linalg.norm(M, 2), M), ([4], max(abs(np.linalg.eigvals(M))), M)]
    a, b = rng.normal(size=(2, 4)) + 1j * rng.normal(size=(2, 4))
    full = np.linalg.norm(a[:2]) * np.linalg.norm(b[:2]) + abs(a[2] * b[2]) + abs(a[3] * b[3])
    cases += [
        ([1] * 4, sum(abs(a * b)), np.outer(a, b.conj())),
        ([(2, 2), 1, 1], full, np.outer(a, b.conj())),
    ]
    for blocks, mu, matrix in cases:
        found = structured_singular_value(matrix, blocks)
        assert found.lower == pytest.approx(mu, rel=1e-4)
        assert found.upper == pytest.approx(mu, rel=1e-2 if blocks == [4] else 1e-4)


@pytest.mark.parametrize("blocks", [[1, 1, 1], [(2, 1), 1], [(1, 2), (2, 1)], [2, (1, 1)]])
def test_the_perturbation_that_is_found_makes_it_singular_and_none_smaller_does(blocks):
    rng = np.random.default_rng(7)
    for _ in range(5):
        rows = sum(b if isinstance(b, int) else b[1] for b in blocks)
        columns = sum(b if isinstance(b, int) else b[0] for b in blocks)
        M = rng.normal(size=(rows, columns)) + 1j * rng.normal(size=(rows, columns))
        found = structured_singular_value(M, blocks)
        assert found.lower <= found.upper * (1 + 1e-9)
        assert found.upper <= 1.02 * found.lower  # equal where 2 repeated + full <= 3 (the same chapter)
        assert abs(np.linalg.det(np.eye(rows) - M @ found.Delta)) < 1e-6
        assert np.linalg.norm(found.Delta, 2) == pytest.approx(1 / found.lower)
        structure = Structure.of(blocks, M.shape)
        for _ in range(50):
            Delta = np.zeros((columns, rows), dtype=complex)
            for block, z, w in zip(structure.blocks, structure.of_z, structure.of_w, strict=True):
                part = rng.normal(size=(block.rows, block.columns)) + 1j * rng.normal(
                    size=(block.rows, block.columns)
                )
                part = np.eye(block.rows) * part[0, 0] if block.repeated else part
                Delta[w, z] = part / np.linalg.norm(part, 2) / found.proved
            assert max(abs(np.linalg.eigvals(M @ Delta))) < 1


def test_what_is_not_so_is_not_proved():
    rng = np.random.default_rng(11)
    M = rng.normal(size=(3, 3)) + 1j * rng.normal(size=(3, 3))
    found, structure = structured_singular_value(M), Structure.of(None, (3, 3))
    assert found.proved is not None
    assert not decide(M, structure, found.X, 0.999 * found.lower).positive
    assert not decide(M, structure, [-x for x in found.X], 10 * found.upper).positive
    assert not decide(M, structure, scales_from_numbers(structure, np.array([1.0, 0.0, 1.0])), 1e9).positive
    system = control.ss([[-1.0]], [[1.0]], [[1.0]], [[0.0]])  # norm 1: P = 1, x = 1 is on the edge at g = 1
    one = Structure.of([1], (1, 1))
    assert _decided(system, one, 1.01, np.array([[1.0]]), np.array([1.0]))
    assert not _decided(system, one, 1.0, np.array([[1.0]]), np.array([1.0]))
    assert not _decided(system, one, 1.01, np.array([[1.0]]), np.array([-1.0]))
    assert not _decided(control.ss(1.0, 1.0, 1.0, 0.0), one, 100.0, np.array([[-1.0]]), np.array([1.0]))


def test_the_factors_that_are_found_put_a_pole_on_the_axis():
    for L in (satellite() * gain([[1, -2], [0, 1]]), control.ss(control.tf(25, [1, 10, 10, 10]))):
        for skew in (0.0, 0.5, -1.0):
            found = disk_margin(L, skew)
            response = response_of(L)(found.frequency)
            assert abs(np.linalg.det(np.eye(len(response)) + response @ np.diag(found.factors))) < 1e-5


@pytest.fixture(scope="module")
def arms() -> lockstep.Design:
    return lockstep.load(ROOT / "generated" / "flexible_joint_arms")


def test_margins_of_the_arms_one_agent_all_agents_and_links(arms):
    """All at once is least; one channel alone is python-control's own disk margin on a fine grid."""
    found = arms.margins()
    assert list(found.rows) == ["arm1", "arm2", "arm3", "all inputs", "all links"]
    alone = [found.rows[f"arm{i}"].alpha for i in (1, 2, 3)]
    assert found.rows["all inputs"].alpha <= min(alone)
    loop = arms.loop()
    w = np.geomspace(0.05, np.pi / 0.005 * 0.999, 20_000)
    theirs = control.disk_margins(loop.opened(loop.inputs_of(1)), w)[0]
    assert alone[0] == pytest.approx(theirs, rel=1e-3)
    assert "all inputs" in found._repr_html_()
    assert found.document()["all links"]["gain"][0] < 1


def test_factors_within_the_margin_keep_the_sampled_arms_stable_and_those_found_do_not(arms):
    """Real gains inside the disk, put into the loop: poles inside; complex factors at the margin: a pole on the circle."""
    loop, rng = arms.loop(), np.random.default_rng(5)
    signals = loop.inputs_of()
    found = arms.margins().rows["all inputs"]
    L = loop.opened(signals)

    def radius(f) -> float:
        R = np.linalg.inv(np.eye(3) + np.diag(f) @ L.D)
        return max(abs(np.linalg.eigvals(L.A - L.B @ R @ np.diag(f) @ L.C)))

    low, high = found.gain
    assert all(radius(rng.uniform(low, min(high, 10), 3)) < 1 for _ in range(100))
    assert radius(found.factors) == pytest.approx(1, abs=1e-6)


def test_mu_of_one_agent_and_of_all(arms):
    """Multiplicative errors u (1 + Delta): of one agent the peak of |T|, of all at least that."""
    one, all_of_them = arms.mu(agent=2), arms.mu()
    loop = arms.loop(sampled=True)
    T = loop.complementary(loop.inputs_of(2))
    grid = np.geomspace(0.1, 600, 20_000)
    assert one.value.upper == pytest.approx(abs(T(np.exp(1j * grid * 0.005))).max(), rel=1e-4)
    assert all_of_them.value.upper >= one.value.upper
    assert all_of_them.value.lower <= all_of_them.value.upper * (1 + 1e-9)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: structured_singular_value(np.eye(3), [1, 1]), "blocks"),
        (lambda: disk_margin(control.ss(1.0, 1.0, 0.5, 0.0)), "not stable"),
        (lambda: disk_margin(control.ss([], [], [], [[1.0, 2.0]])), "square"),
        (lambda: disk_margin(control.ss([], [], [], [[-1.0]])), "singular"),
        (lambda: both_sides(gain([[1.0, 2.0]]), gain([[1.0, 2.0]])), "transposed"),
    ],
)
def test_what_has_no_margin_is_refused(call, said):
    with pytest.raises(ProblemError, match=said):
        call()
