"""The set of initial disagreements of a local certificate: what starts in it stays, something beside it leaves."""

import math
from dataclasses import replace

import casadi as ca
import local_cases
import numpy as np
import pytest
from local_cases import (
    SIDE,
    N,
    certified,
    disagreement_of,
    leaders,
    network,
    run,
    starts,
)

from lockstep.check.continuous.inequality import Certificate
from lockstep.check.continuous.modes import ModalCertificate, Segment
from lockstep.check.continuous_claims import decide_initial_set
from lockstep.check.errors import ProblemError
from lockstep.check.numbers import as_floats, exactly
from lockstep.check.system.disagreement import disagreement
from lockstep.lmi.initial_set import Unavailable, _ratio_above
from lockstep.lmi.scope import domain_of, initial_states, inner_box
from lockstep.model.assembly import bound_of
from lockstep.model.bound_search import Box

net, certificate, found = local_cases.net, local_cases.certificate, local_cases.found
"""Fixtures."""


@pytest.mark.slow
def test_from_the_boundary_of_the_set_all_stay_and_agree(net, certificate, found):
    generator = np.random.default_rng(3)
    x, x_C = starts(net, certificate, found.level, generator, 200, widest=True)
    first, nearest = disagreement_of(x), 0.0
    for t, now, _ in run(net, x, x_C, horizon=12.0):
        positions, last = now[::2], now
        nearest = max(nearest, float(np.abs(positions).max()))
        assert np.abs(positions[0]).max() <= 0.6 + 1e-6, "the leader keeps to the inner box, as the set asks"
        assert np.abs(positions).max() <= SIDE, f"an agent left the domain at t = {t}"
    assert disagreement_of(last).max() < 1e-3 * first.min()
    assert nearest > 0.98 * SIDE  # the set is not so small that staying is no news


def test_from_a_larger_set_one_leaves_that_started_inside(net, certificate, found):
    generator = np.random.default_rng(4)
    x, x_C = starts(net, certificate, 9 * found.level, generator, 200)
    inside = np.abs(x[::2]).max(axis=0) < SIDE
    assert inside.sum() > 50
    largest = max(
        float(np.abs(x[::2]).max()) for _, x, _ in run(net, x[:, inside], x_C[:, inside], horizon=4.0)
    )
    assert largest > SIDE * 1.01


def test_a_leader_whose_controller_is_not_at_rest_is_not_covered(net, certificate, found):
    """The set is one of x_C1 = 0: with x_C1 the leader is pushed, here out of its inner box."""
    x, x_C = starts(net, certificate, found.level, np.random.default_rng(5), 2)
    x_C[0] = 3.0
    assert max(float(np.abs(x[0]).max()) for _, x, _ in run(net, x, x_C, horizon=4.0)) > 0.6


def test_the_level_is_where_the_ellipsoid_touches_the_margin(certificate, found):
    keep = np.delete(np.arange(7), 4)
    P_0 = certificate.P[np.ix_(keep, keep)]
    w = {
        2: np.array([-1.0, 0, 1, 0, 0, 0]),
        3: np.array([-1.0, 0, 0, 0, 0, 0]),
    }  # T = [I, -1]: p_2 - p_1, p_3 - p_1
    widths = {i: math.sqrt(found.level * row @ np.linalg.solve(P_0, row)) for i, row in w.items()}
    assert max(widths.values()) == pytest.approx(0.6, rel=1e-12)
    assert found.agent == max(widths, key=widths.get) == 3
    assert found.argument == 1
    assert found.inner == Box((-0.6,), (0.6,))


@pytest.mark.parametrize("coordinates", ["orthonormal", "laplacian_rows"])
def test_the_radius_is_inside_the_set_and_no_smaller_than_need_be(coordinates):
    net = network(coordinates=coordinates)
    certificate = certified(net)
    found = initial_states(net, certificate)
    T = np.kron(as_floats(disagreement(net.graph, coordinates).T), np.eye(2))
    x = np.random.default_rng(6).standard_normal((6, 200_000))
    x *= found.radius / disagreement_of(x)
    x_d = T @ x
    V = np.einsum("ik,ij,jk->k", x_d, certificate.P[:4, :4], x_d)
    assert V.max() <= found.level * (1 + 1e-12)
    assert V.max() > 0.98 * found.level


def test_the_energy_of_a_disturbance_is_paid_from_the_level(net, certificate, found):
    """From agreement, a push on agent 3 of almost that energy: rho^2 times it is c, and all stay."""
    assert found.energy == pytest.approx(found.level / certificate.rho**2, rel=1e-12)
    length, push = 0.5, np.zeros((6, 1))
    # |xi_d|^2 = sum |xi_i - mean|^2 = 2/3 force^2 for a force on one of three agents.
    push[5] = math.sqrt(0.999 * found.energy / length * 3 / 2)
    generator = np.random.default_rng(7)
    x = np.tile(leaders(generator, 20), (N, 1))
    steps = run(net, x, np.zeros((3, 20)), horizon=8.0, xi=lambda t: push if t < length else 0 * push)
    apart = 0.0
    for _, x, _ in steps:
        assert np.abs(x[::2]).max() <= SIDE
        apart = max(apart, float(np.abs(x[4] - x[0]).max()))
    assert 0.0 < apart < 0.6


def test_a_larger_inner_box_leaves_a_smaller_set(net, certificate, found):
    tighter = initial_states(net, certificate, fraction=0.75)
    assert tighter.level == pytest.approx(found.level / 4, rel=1e-12)
    assert tighter.radius == pytest.approx(found.radius / 2, rel=1e-9)
    given = initial_states(net, certificate, inner=Box((-0.3,), (0.9,)))
    assert given.level == pytest.approx(found.level / 4, rel=1e-12)


def test_the_inner_box_is_around_the_middle():
    assert inner_box(Box((-1.0,), (3.0,)), 0.5) == Box((0.0,), (2.0,))


def test_agents_that_lead_each_other_have_no_set():
    answer = initial_states(network("path"), Certificate(1.0, np.eye(4), np.ones(3)))
    assert isinstance(answer, Unavailable)
    assert "agents 1, 2, 3 hear each other" in answer.text()
    assert answer.document()["available"] is False


def test_without_sides_there_is_nothing_to_keep_to():
    answer = initial_states(network(domain=None), Certificate(1.0, np.eye(4), np.ones(3)))
    assert "holds everywhere" in answer.reason


def test_a_modal_certificate_has_no_one_P(net):
    modal = ModalCertificate(1.0, 1.0, (Segment(1.0, np.eye(2)),), 1.0, np.zeros((0, 0)))
    assert "modal" in initial_states(net, modal).reason


def test_what_does_not_fit_is_refused(net, certificate):
    with pytest.raises(ProblemError, match="P has 5 rows"):
        initial_states(net, Certificate(1.0, np.eye(5), np.ones(3)))
    for box in (Box((-1.2,), (0.0,)), Box((-1.0,), (math.inf,)), Box((2.0,), (3.0,))):
        with pytest.raises(ProblemError, match="inside"):
            initial_states(net, certificate, inner=box)
    with pytest.raises(ProblemError, match="components"):
        initial_states(net, certificate, inner=Box.everywhere(2))
    for fraction in (1.0, -0.5, math.nan):
        with pytest.raises(ProblemError, match="from 0 up to"):
            initial_states(net, certificate, fraction=fraction)


def test_it_is_said_in_words_and_in_json(found):
    assert "agent 1 leads" in found.text()
    assert "-0.6 <= p <= 0.6 ([network] leader)" in found.text()
    assert f"; p of agent {found.agent} limits it" in found.text()
    # Arguments and states may be called alike: each is replaced once.
    swapped = replace(found, arguments="v1 = v2, v2 = v3 ... 2*v4")
    assert "-0.6 <= v2 <= 0.6" in swapped.text()
    assert found.document()["inner"] == [[-0.6, 0.6]]
    assert found.document()["level"] == found.level


def test_the_clipped_nonlinearity_of_the_proof_keeps_the_bound(net):
    """phi(clip(v)) has the bound everywhere: sampled pairs far outside of the box."""
    alpha, phi = bound_of(net.agent).alpha, net.agent.lure.phi
    v = np.random.default_rng(8).uniform(-5, 5, (2, 2000))
    values = [np.asarray(phi.map(2000)(ca.DM(np.clip(row, -SIDE, SIDE)[None, :]), 0.0)).ravel() for row in v]
    ratio = np.abs(values[0] - values[1]) / np.abs(v[0] - v[1])
    assert ratio.max() <= alpha * (1 + 1e-12)


def test_the_ratio_is_proved_where_doubles_cannot_propose_one():
    """Entries whose products overflow: the trace of D^-1 P answers, 2e300 for a ratio of 1e300."""
    P, D = exactly(np.diag([1e300, 1e300])), exactly(np.eye(2))
    assert 1e300 <= _ratio_above(P, D) <= 2e300
    tight = _ratio_above(exactly(np.array([[2.0, 1.0], [1.0, 2.0]])), D)
    assert 3 < tight < 3 * (1 + 1e-9)


def test_a_set_too_small_for_a_double_is_none(net, certificate):
    huge = Certificate(1e300, certificate.P, certificate.m)
    assert "doubles" in initial_states(net, huge).reason


@pytest.mark.parametrize(
    ("change", "proved"),
    [
        ({}, True),
        ({"level": 0.999}, True),
        ({"level": 1 + 1e-12}, False),
        ({"radius": 0.999, "energy": 0.5}, True),
        ({"radius": 1.001}, False),
        ({"energy": 1 + 1e-12}, False),
    ],
)
def test_a_claimed_set_is_decided_as_no_better_than_the_proved_one(net, certificate, found, change, proved):
    claimed = replace(found, **{name: part * getattr(found, name) for name, part in change.items()})
    answer = decide_initial_set(net.matrices, certificate, domain_of(net.agent), claimed)
    assert answer.proved == proved
    assert proved or next(iter(change)) in answer.reason


def test_another_leader_or_a_smaller_domain_is_not_proved(net, certificate, found):
    domain = domain_of(net.agent)
    for claimed, says in (
        (replace(found, leader=2), "agent 1 leads, not 2"),
        (replace(found, box=Box((-1.1,), (1.2,))), "stay in"),
        (replace(found, box=Box.everywhere(2)), "stay in"),
    ):
        answer = decide_initial_set(net.matrices, certificate, domain, claimed)
        assert answer.status == "undecided"
        assert says in answer.reason
    none = decide_initial_set(network("path").matrices, certificate, domain, found)
    assert "hear each other" in none.reason
