"""Poles and singular values against matrices put together by hand."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag, null_space, sqrtm

from lockstep.report.poles import poles_figure, singular_values_figure, spectrum_of


def loop_by_hand(facts):
    """(12) without phi, all states kept: x' = (I (x) A) x + B u, r = (L (x) C) x, and the controllers."""
    network, gains = facts.network, facts.stored.gains
    lure, L, N = network.agent.lure, network.graph.laplacian, network.N
    B, r = block_diag(*network.B), np.kron(L, lure.C)
    A_C, B_C, C_C, D_C = (block_diag(*getattr(gains, letter)) for letter in "ABCD")
    return np.block([[np.kron(np.eye(N), lure.A) + B @ D_C @ r, B @ C_C], [B_C @ r, A_C]])


def test_the_poles_are_those_of_the_whole_loop_but_for_the_agreement(facts, spectrum):
    whole = np.linalg.eigvals(loop_by_hand(facts))
    common = np.linalg.eigvals(facts.network.agent.lure.A)
    together = np.concatenate([spectrum.loop, common])
    # The disagreement and the agreement split the spectrum: each of the whole loop's eigenvalues is in one of them.
    assert len(together) == len(whole)
    far = [np.abs(together - pole).min() for pole in whole]
    assert max(far) < 1e-5 * np.abs(whole).max()


def by_hand(facts, claim, w):
    """The largest singular value at w, all states kept: x' = .. + xi, y + nu, and z = (R^1/2 x_d, Q^1/2 x_C, W^1/2 u)."""
    network, gains = facts.network, facts.stored.gains
    (n, q), N, L = network.agent.lure.C.shape[::-1], network.N, network.graph.laplacian
    T, n_x_C = null_space(np.ones((1, N))).T, N * gains.order
    A, (B_C, C_C, D_C) = loop_by_hand(facts), (block_diag(*getattr(gains, letter)) for letter in "BCD")
    heard = np.kron(L @ T.T, np.diag(claim.outputs))
    pushed = np.kron(T.T, np.diag(claim.states if len(claim.states) else np.ones(n)))
    inward = np.block(
        [[pushed, block_diag(*network.B) @ D_C @ heard], [np.zeros((n_x_C, (N - 1) * n)), B_C @ heard]]
    )
    x = np.linalg.solve(1j * w * np.eye(len(A)) - A, inward)
    u = np.hstack([D_C @ np.kron(L, network.agent.lure.C), C_C]) @ x
    u[:, (N - 1) * n :] += D_C @ heard
    roots = (sqrtm(claim.R), sqrtm(claim.Q), sqrtm(claim.W))
    parts = (
        np.kron(T, roots[0]) @ x[: N * n],
        np.kron(np.eye(N), roots[1]) @ x[N * n :],
        np.kron(np.eye(N), roots[2]) @ u,
    )
    assert heard.shape == (N * q, (N - 1) * q)
    return np.linalg.norm(np.vstack(parts), 2)


@pytest.mark.parametrize("states", [(), (1.0, 0.0, 3.0, 0.2)])
def test_the_largest_singular_value_is_that_of_the_hand_made_transfer_matrix(facts, states):
    """Of the gain that rho is: scales of disturbances, noise and weights of u counted, or the line beside it says nothing."""
    claim = replace(facts.stored.claim, states=np.array(states))
    assert claim.outputs.all()
    assert claim.W.all()
    spectrum = spectrum_of(facts.network, facts.stored.gains, claim)
    for k in (0, 40, 130, 200):
        assert spectrum.sigma[k, 0] == pytest.approx(by_hand(facts, claim, spectrum.omega[k]), rel=1e-6)


def test_the_certified_rho_is_above_and_a_smaller_one_is_not(facts, spectrum):
    peak, _ = spectrum.peak
    assert peak < facts.stored.claims.rho
    assert peak > 0.5 * facts.stored.claims.rho, "a bound that is never approached would be worth little"


def test_unstable_controllers_are_seen(spectrum):
    # Those of the committed design are proved stable by themselves.
    assert [bool((poles.real > 0).any()) for poles in spectrum.controllers] == [False, False, False]


def test_the_figures_hold_them(spectrum):
    poles = poles_figure(spectrum, "arm").axes[0]
    crosses = next(d for d in poles.lines if d.get_label() == "the loop")
    np.testing.assert_array_equal(crosses.get_xdata(), spectrum.loop.real)
    values = singular_values_figure(spectrum, 4.648).axes[0]
    assert "certified rho = 4.648" in [d.get_label() for d in values.lines]


def test_a_loop_too_large_has_poles_only(facts, spectrum, monkeypatch):
    import lockstep.report.poles as module

    monkeypatch.setattr(module, "MOST_STATES", 3)
    few = spectrum_of(facts.network, facts.stored.gains, facts.stored.claim)
    assert few.sigma is None
    assert few.peak is None
    np.testing.assert_allclose(np.sort(few.loop), np.sort(spectrum.loop))
    with pytest.raises(ValueError, match="no singular values"):
        singular_values_figure(few, 1.0)


def test_a_loop_far_too_large_has_the_controllers_poles_only(facts, monkeypatch):
    import lockstep.report.poles as module

    monkeypatch.setattr(module, "MOST_POLES", 3)
    few = spectrum_of(facts.network, facts.stored.gains, facts.stored.claim)
    assert few.abscissa is None
    assert few.peak is None
    labels = {drawn.get_label() for drawn in poles_figure(few, "arm").axes[0].lines}
    assert "the loop" not in labels
    assert "arm1's controller" in labels
