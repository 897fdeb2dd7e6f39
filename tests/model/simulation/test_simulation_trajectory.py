"""A trajectory's figures, against signals whose integrals are known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from simulation_cases import ARMS

from lockstep.check.continuous.inequality import Performance
from lockstep.check.errors import ProblemError
from lockstep.check.numbers import as_floats
from lockstep.model.graphs.graph import Graph
from lockstep.model.graphs.orthonormal import orthonormal_factor
from lockstep.model.simulation import RhoWeights, Trajectory, effort_indices, energies, indices
from lockstep.model.simulation.results.table import columns, to_csv


def trajectory(t, x=None, *, N=2, x_C=None, u=None, xi=None, **holds) -> Trajectory:
    K = len(t)
    x = np.zeros((K, N, 1)) if x is None else x
    given_or_zero = [np.zeros((K, N, 1)) if part is None else part for part in (x_C, u, xi)]
    return Trajectory(
        t, x, given_or_zero[0], given_or_zero[1], x, given_or_zero[2], ("p",), ("f",), ("p",), "cart", **holds
    )


def both(signal):
    """The signal for agent 1, its negative for agent 2."""
    return np.stack([signal, -signal], axis=1)[:, :, None]


def test_indices_of_an_exponential():
    """e_1 = exp(-t): ISE 1/2, IAE 1, ITSE 1/4, ITAE 1, but for exp(-30)."""
    t = np.linspace(0.0, 30.0, 30_001)
    found = indices(trajectory(t, both(np.exp(-t))))
    for one in found:
        # Trapezoids: h^2 / 12 times the slope at 0, below 4e-7.
        assert np.allclose((one.ISE, one.IAE, one.ITSE, one.ITAE), (0.5, 1.0, 0.25, 1.0), rtol=0, atol=4e-7)


def test_what_is_common_to_all_is_no_disagreement():
    t = np.linspace(0.0, 1.0, 11)
    same = np.repeat(np.sin(t)[:, None, None], 2, axis=1)
    run = trajectory(t, same)
    assert not run.disagreement().any()
    assert indices(run)[0].IAE == 0
    assert indices(trajectory(t, both(np.sin(t))))[0].IAE > 0.4


def test_held_inputs_are_integrated_exactly():
    """u = 2 on [0, 1), 4 on [1, 3): ISE 4 + 32, IAE 2 + 8, ITSE 2 + 64, ITAE 1 + 16."""
    t = np.array([0.0, 1.0, 3.0])
    u = np.array([2.0, 4.0, 4.0])[:, None, None] * np.ones((1, 2, 1))
    one = effort_indices(trajectory(t, u=u, u_hold="held"))[0]
    assert (one.ISE, one.IAE, one.ITSE, one.ITAE) == (36.0, 10.0, 66.0, 17.0)
    smooth = effort_indices(trajectory(t, u=u, u_hold="smooth"))[0]
    assert smooth.IAE != 10.0


@settings(max_examples=25)
@given(seed=st.integers(0, 2**32 - 1), N=st.integers(2, 6))
def test_the_disagreement_is_the_orthonormal_x_d(seed, N):
    """sum_i |x_i - mean|^2 = |F T x|^2, F'F = (T T')^-1: two ways to the same number."""
    x = np.random.default_rng(seed).normal(size=(2, N, 1))
    run = trajectory(np.array([0.0, 1.0]), x, N=N)
    from lockstep.check.system.disagreement import disagreement

    d = disagreement(Graph.topology("cycle", N))
    x_d = orthonormal_factor(d) @ as_floats(d.T) @ x[0, :, 0]
    assert np.isclose(run.disagreement()[0], np.linalg.norm(x_d), rtol=1e-12)


def test_the_disagreement_by_state_mixes_no_units():
    """Two agents 6 m and 8e6 Pa apart: each is half of that from the mean, 3 2^1/2 and 4e6 2^1/2."""
    x = np.array([[[0.0, 1e6], [6.0, 9e6]]])
    x, none = np.repeat(x, 2, axis=0), np.zeros((2, 2, 1))
    run = Trajectory(
        np.array([0.0, 1.0]), x, none, none, none, np.zeros_like(x), ("p", "F"), ("f",), ("p",), "cart"
    )
    assert np.allclose(run.disagreement_by_state(), [3 * 2**0.5, 4e6 * 2**0.5], rtol=1e-15)


def weights(N=2, R=1.0, Q=1.0):
    return RhoWeights.of(Graph.topology("path", N), Performance(R * np.eye(1), Q * np.eye(1)))


def test_the_gain_of_known_signals():
    """z^2 = 4 * 2 sin^2 + 9 * 2 (held 1/3), xi_d^2 = 2: over a period, |z|^2 = 4 * 2 * pi + 4 pi."""
    t = np.linspace(0.0, 2 * np.pi, 2001)
    ones = np.ones_like(t)
    run = trajectory(
        t, both(np.sin(t)), x_C=both(np.where(t > 0, ones / 3, 0.0)), xi=both(ones), u_hold="smooth"
    )
    found = energies(run, weights(R=4.0, Q=9.0))
    assert np.isclose(found.output[-1], 8 * np.pi + 4 * np.pi, rtol=1e-3)
    assert np.isclose(found.input[-1], 4 * np.pi, rtol=1e-12)
    assert np.isclose(found.gain, np.sqrt(3), rtol=1e-3)


def test_the_gain_counts_inputs_and_the_scales_of_disturbances():
    """u = sin for both agents, held or smooth: W int u^2 = 3 * 2 pi; xi_d^2 = 2 / 4 per second in units of 2."""
    t = np.linspace(0.0, 2 * np.pi, 2001)
    run = trajectory(t, xi=both(np.ones_like(t)), u=both(np.sin(t)), u_hold="smooth")
    asked = Performance(np.eye(1), np.eye(1), 3 * np.eye(1), np.array([2.0]))
    pair = Graph.topology("path", 2)
    found = energies(run, RhoWeights.of(pair, asked))
    assert np.isclose(found.output[-1], 6 * np.pi, rtol=1e-6)
    assert np.isclose(found.input[-1], 2 * np.pi / 2, rtol=1e-12)
    elsewhere = RhoWeights.of(pair, asked._replace(states=np.zeros(1)))
    assert energies(run, elsewhere).input[-1] == 0.0


def test_the_largest_ratio_is_over_the_whole_run():
    """A burst that the disturbance makes up for later: the ratio at its end counts, not the one at the end."""
    t = np.array([0.0, 1.0, 2.0, 3.0])
    z = both(np.array([0.0, 2.0, 0.0, 0.0]))
    xi = both(np.array([0.5, 0.5, 10.0, 10.0]))
    found = energies(trajectory(t, z, xi=xi), weights())
    assert np.isclose(found.largest_ratio(2.0), 4.0 * 2 / (4 * 1.0))
    assert found.largest_ratio(2.0) > found.output[-1] / (4 * found.input[-1])
    assert found.largest_ratio(2.0, storage=2.0) == pytest.approx(8.0 / (2.0 + 4.0))


@pytest.mark.parametrize("case", ["starts apart", "no disturbance", "the same disturbance for all"])
def test_no_gain_where_there_is_none(case):
    t = np.array([0.0, 1.0])
    x = both(np.array([1.0, 0.0])) if case == "starts apart" else None
    xi = {
        "starts apart": both(np.ones(2)),
        "no disturbance": None,
        "the same disturbance for all": np.ones((2, 2, 1)),
    }[case]
    assert energies(trajectory(t, x, xi=xi), weights()).gain is None


def test_agreement_far_from_zero_is_agreement():
    t = np.array([0.0, 1.0])
    far = np.full((2, 2, 1), np.pi * 1e6)
    assert energies(trajectory(t, far, xi=both(np.ones(2))), weights()).gain == 0


def test_the_rows_of_the_laplacian_measure_in_their_own_metric():
    """T = rows of L: |x_d|^2 = |L_r x|^2, no S; against the definition."""
    x = np.random.default_rng(0).normal(size=(1, 3, 4))
    w = RhoWeights.of(ARMS.graph, Performance(np.eye(4), np.eye(2)), "laplacian_rows")
    rows = w.T @ x[0]
    assert np.isclose(w.squared_states(x)[0], (rows**2).sum())
    assert not np.isclose(
        RhoWeights.of(ARMS.graph, Performance(np.eye(4), np.eye(2))).squared_states(x)[0], (rows**2).sum()
    )


@pytest.mark.parametrize(
    "break_it",
    [
        lambda p: p | {"t": np.array([0.0, 0.0])},
        lambda p: p | {"x": np.zeros((2, 2, 3))},
        lambda p: p | {"u": np.zeros((3, 2, 1))},
        lambda p: p | {"xi": np.full((2, 2, 1), np.nan)},
    ],
)
def test_a_record_that_does_not_fit_is_refused(break_it):
    parts = {name: np.zeros((2, 2, 1)) for name in ("x", "x_C", "u", "y", "xi")} | {"t": np.array([0.0, 1.0])}
    names = {"state_names": ("p",), "input_names": ("f",), "output_names": ("p",), "agent": "cart"}
    Trajectory(**parts, **names)
    with pytest.raises(ProblemError):
        Trajectory(**break_it(parts), **names)


def test_the_table_reads_back():
    t = np.array([0.0, 0.1, 0.30000000000000004])
    run = trajectory(t, both(t / 3))
    lines = to_csv(run).splitlines()
    names = lines[0].split(",")
    assert names[:4] == ["t", "disagreement", "cart1_p", "cart1_controller_x1"]
    assert "cart2_y_p" in names, "an output named as a state is told from it"
    values = np.array([[float(x) for x in line.split(",")] for line in lines[1:]])
    assert np.array_equal(values, np.column_stack(list(columns(run).values())))
