"""Larger sets of initial disagreements: a P of their own, gains that move, what a leader keeps to."""

import math
import tomllib
from dataclasses import replace

import local_cases
import numpy as np
import pytest
from local_cases import (
    GAINS,
    ORDER,
    SIDE,
    claim_of,
    disagreement_of,
    network,
    run,
    starts,
)

from lockstep.check.continuous.inequality import Certificate
from lockstep.check.continuous_claims import decide_certificate, decide_initial_set
from lockstep.check.errors import NotCertified, ProblemError
from lockstep.check.system.loop import Gains
from lockstep.lmi.analysis.rounding import prove
from lockstep.lmi.initial_set_design import largest_initial_states, with_larger_set
from lockstep.lmi.scope import domain_of
from lockstep.model.bound_search import Box
from lockstep.model.problem import Problem, parse_problem

net, certificate, found = local_cases.net, local_cases.certificate, local_cases.found
"""Fixtures."""


@pytest.fixture(scope="module")
def own(net, certificate):
    found, proof = largest_initial_states(net, GAINS, claim_of(net), certificate)
    assert proof is not None
    return found, proof


def test_a_P_of_its_own_gives_a_larger_set_that_the_checker_proves(net, found, own):
    larger, proof = own
    assert larger.radius > 1.2 * found.radius
    domain = domain_of(net.agent)
    assert decide_certificate(net.matrices, GAINS, claim_of(net), proof).proved
    assert decide_initial_set(net.matrices, proof, domain, larger).proved
    beyond = replace(larger, radius=1.001 * larger.radius)
    assert not decide_initial_set(net.matrices, proof, domain, beyond).proved


def test_no_set_is_larger_than_the_room_between_the_boxes(own):
    """|p_3 - p_1| <= sqrt(2) |x_d| is reached, and the room is 0.6: what starts farther apart is outside at once."""
    assert own[0].radius <= 0.6 / math.sqrt(2) * (1 + 1e-9)


def test_from_the_boundary_of_the_larger_set_none_leaves(net, own):
    larger, proof = own
    generator = np.random.default_rng(9)
    x, x_C = starts(net, proof, larger.level, generator, 200, widest=True)
    first = disagreement_of(x)
    for _, now, _ in run(net, x, x_C, horizon=12.0):
        last = now
        assert np.abs(now[::2]).max() <= SIDE
    assert disagreement_of(last).max() < 1e-3 * first.min()


def asked(**keys) -> Problem:
    """Return a problem with the [design] asked for: its agents are those of the tests' networks."""
    design = "\n".join(f"{key} = {value}" for key, value in keys.items())
    return parse_problem(
        "[agent]\nstates = ['p', 'v']\ninputs = ['u']\noutputs = { y1 = 'p', y2 = 'v' }\n"
        "dynamics = { p = 'v', v = '-p + 0.5*p**3 + u' }\ndomain = { p = [-1.2, 1.2] }\n"
        f"[network]\nagents = 3\ntopology = 'leader_path'\n[design]\nobjective = 'initial_set'\n{design}\n"
    )


def test_gains_that_move_have_a_larger_set_within_rho_and_the_gain_limit(net, certificate, own):
    larger, _ = own
    problem = asked(order=1, gain_limit=8.0, rho=2 * certificate.rho)
    K = with_larger_set(problem, net, GAINS, claim_of(net), certificate, rate=0.2)
    assert np.linalg.norm(K, 2, axis=(1, 2)).max() <= 8.0
    assert all(np.linalg.eigvals(block[:ORDER, :ORDER]).real.max() < 0 for block in K)
    gains = Gains.from_blocks(K, ORDER)
    moved = prove(net, gains, claim_of(net))
    assert moved.rho <= 2 * certificate.rho
    found, _ = largest_initial_states(net, gains, claim_of(net), moved)
    assert found.radius > 1.02 * larger.radius


def test_an_initial_set_that_cannot_be_is_no_objective():
    none = Certificate(1.0, np.eye(7), np.ones(3))
    with pytest.raises(NotCertified, match="hear each other"):
        with_larger_set(asked(order=1), network("path"), GAINS, claim_of(network()), none)


@pytest.mark.parametrize(
    ("leader", "says"),
    [
        ("{ p = [-1.2, 0.0] }", "inside its own"),
        ("{ p = [0.5, -0.5] }", "inside its own"),
        ("{ v = [-1.0, 1.0] }", "`v` has no domain.*: p"),
        ("{}", "it is missing"),
    ],
)
def test_a_box_that_a_leader_cannot_have_is_refused(leader, says):
    text = asked(order=1).document()
    text["network"]["leader"] = tomllib.loads(f"x = {leader}")["x"]
    with pytest.raises(ProblemError, match=says):
        Problem.from_document(text)


@pytest.mark.parametrize(
    ("part", "change", "says"),
    [
        ("network", {"topology": "cycle"}, "no agent leads alone"),
        ("agent", {"domain": {}}, r"no \[agent.domain\]"),
    ],
)
def test_an_initial_set_that_no_gains_can_have_is_refused_before_a_search(root, part, change, says):
    text = Problem.load(root / "examples" / "cart_poles.toml").document()
    del text["network"]["leader"]
    Problem.from_document(text)
    text[part] |= change
    with pytest.raises(ProblemError, match=says):
        Problem.from_document(text)


def test_states_that_rho_is_no_gain_from_are_named(net, certificate):
    claim = claim_of(net)
    for scales, low in (((0.5, 1.0), "p"), ((0.0, 0.0), "p, v")):
        told, _ = largest_initial_states(net, GAINS, replace(claim, states=np.array(scales)), certificate)
        assert f"has no scale of 1 or more for {low}, so that" in told.text()


def test_a_leader_that_keeps_to_less_leaves_more_to_the_others(net, certificate, own):
    text = asked(order=1).document()
    text["network"]["leader"] = {"p": [-0.2, 0.2]}
    inner = Problem.from_document(text).leader
    assert inner == Box((-0.2,), (0.2,))
    found, _ = largest_initial_states(net, GAINS, claim_of(net), certificate, inner)
    assert found.radius == pytest.approx(own[0].radius / 0.6, rel=0.02)  # (1.2 - 0.2) / (1.2 - 0.6)
