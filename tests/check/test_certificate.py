"""One verdict for each continuous claim, on loops whose least rho is known in closed form."""

from dataclasses import replace

import numpy as np
import pytest

from lockstep.check.bound.slope_bounds import Entry
from lockstep.check.continuous.inequality import Certificate, Claim
from lockstep.check.continuous.modes import ModalCertificate, Segment
from lockstep.check.continuous_claims import decide_certificate, decide_floor
from lockstep.check.errors import ProblemError
from lockstep.check.floor.witness import FloorWitness, Piece
from lockstep.check.system.graph import Digraph
from lockstep.check.system.loop import Gains, Plant
from lockstep.check.system.network import ExactNetwork

ONE, NONE = np.eye(1), np.zeros((0, 0))
PAIR = ExactNetwork(
    Plant(-ONE, (ONE, ONE), ONE, ONE[:, :0], ONE[:0]), Digraph.from_edges(2, [[1, 2], [2, 1]])
)
"""Two agents x' = -x + u + xi, y = x; with u = 0, rho = 1, the gain of 1 / (s + 1)."""

REST = Gains.from_blocks(np.zeros((2, 1, 1)), 0)
CLAIM = Claim(0.0, ONE, NONE, np.zeros((2, 4)))
SOUND = Certificate(1.001, 0.5 * ONE, np.ones(1))
"""In d = x_1 - x_2, |x_d|^2 = d^2 / 2: with p = 1/2, F = [-1/2, 1/2; 1/2, -rho^2 / 2] < 0 where rho > 1."""

MODAL = ModalCertificate(1.001, 1.9, (Segment(2.1, ONE),), 1.0, NONE)
"""The same in orthonormal coordinates, p = 1; lambda_2 = 2."""


@pytest.mark.parametrize("certificate", [SOUND, MODAL])
def test_a_certificate_is_proved_just_above_the_least_rho_and_refuted_at_it(certificate):
    proved = decide_certificate(PAIR, REST, CLAIM, certificate)
    assert proved.proved
    assert proved.figures["margin"] > 0
    refuted = decide_certificate(PAIR, REST, CLAIM, replace(certificate, rho=1.0))
    assert refuted.status == "refuted"
    assert refuted.figures["value"] <= 0
    assert "z' M z" in refuted.reason


def test_a_bound_of_phi_is_paid_for():
    """x' = -x + phi + xi with |phi| <= alpha |x|: rho = 1 / (1 - alpha), and none from alpha = 1."""
    network = replace(PAIR, plant=replace(PAIR.plant, G=ONE, H=ONE), _loops={})
    # F = [-2p + 1/2 + m alpha^2, p, p; *, -rho^2/2, 0; *, 0, -m], least at m = p / alpha, p = rho / 2.
    claim = replace(CLAIM, alpha=0.5)
    for rho, holds in ((2.01, True), (1.99, False)):
        found = decide_certificate(network, REST, claim, Certificate(rho, rho / 2 * ONE, np.array([rho])))
        assert found.proved == holds
    assert not decide_certificate(network, REST, replace(claim, alpha=1.0), SOUND).proved


@pytest.mark.parametrize(
    ("claim", "certificate", "says"),
    [
        (CLAIM, replace(SOUND, rho=-1.001), "rho must be positive"),
        (CLAIM, replace(SOUND, rho=float("nan")), "rho must be positive"),
        (replace(CLAIM, alpha=-0.1), SOUND, "alpha not negative"),
        (CLAIM, replace(SOUND, m=-np.ones(1)), "sign of a multiplier"),
        (CLAIM, replace(SOUND, P=-0.5 * ONE), "M = P"),
        (replace(CLAIM, R=0 * ONE), SOUND, "M = R"),
        (CLAIM, replace(MODAL, mu=-1.0), "sign of mu"),
        (CLAIM, replace(MODAL, lower=2.0), "diagonal"),
    ],
)
def test_what_proves_nothing_is_refuted_by_name(claim, certificate, says):
    found = decide_certificate(PAIR, REST, claim, certificate)
    assert found.status == "refuted"
    assert says in found.reason


def test_a_modal_certificate_for_agents_of_their_own_is_bad_input():
    other = replace(PAIR, plant=replace(PAIR.plant, B=(ONE, 2 * ONE)), _loops={})
    with pytest.raises(ProblemError, match="input matrices"):
        decide_certificate(other, REST, CLAIM, MODAL)


def test_a_witness_that_proves_no_floor_leaves_it_undecided():
    point = Piece(np.inf, ONE, ONE, NONE)
    found = decide_floor(PAIR, replace(CLAIM, entries=(Entry(0, 0, 1.0),)), FloorWitness(0.5, (point,)))
    assert found.status == "undecided"
    assert "0.5" in found.reason
