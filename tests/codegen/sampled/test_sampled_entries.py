"""The sampled controllers of a design whose certificate needs the slopes entry by entry."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from lockstep.check.design_file.proofs import Proofs
from lockstep.codegen.from_design import signed_lines
from lockstep.codegen.sampled_design import (
    pair_weights,
    prove_design,
    sampled_controllers,
    sampled_network,
    with_sampled,
)
from lockstep.lmi.design import design
from lockstep.lmi.document import design_file_of, parse
from lockstep.lmi.sampled.l2_gain import least_rho, sampled_rho
from lockstep.lmi.sampled.witnesses import in_doubles
from lockstep.model.bound_search import Entry
from lockstep.model.problem import parse_problem

GAIN, PERIOD = -2.0, 0.05
TEXT = (
    f"""
[agent]
states = ["a", "b"]
inputs = ["u"]
outputs = {{ y1 = "a", y2 = "b" }}
dynamics = {{ a = "u + 2*sin(a) + 0.02*sin(b)", b = "20*a - b" }}
[network]
agents = 3
topology = "cycle"
[design]
order = 0
method = "given"
[controller]
period = {PERIOD}
"""
    + 3 * f"\n[[design.gains]]\nA = []\nB = []\nC = [[]]\nD = [[{GAIN}, 0.0]]\n"
)


@pytest.fixture(scope="module")
def stored():
    return parse(json.loads(json.dumps(design_file_of(design(parse_problem(TEXT))).document())), "memory")


def with_claims(stored, **changes):
    return replace(stored, claims=replace(stored.claims, **changes))


def spectral_radius(slopes, period) -> float:
    """Over one period of all agents, u held, less the mode in which they move together: plain expm."""
    A = np.array([slopes, [20.0, -1.0]])
    L = np.eye(3) - np.roll(np.eye(3), 1, axis=1)
    whole = np.zeros((9, 9))
    whole[:6, :6], whole[:6, 6:] = np.kron(np.eye(3), A), np.kron(np.eye(3), [[1.0], [0.0]])
    step = expm(period * whole)
    closed = step[:6, :6] + step[:6, 6:] @ np.kron(L, [[GAIN, 0.0]])
    down = np.kron(np.linalg.svd(np.eye(3) - 1 / 3)[2][:2], np.eye(2))
    return float(np.abs(np.linalg.eigvals(down @ closed @ down.T)).max())


def test_they_are_proved_and_no_vertex_of_the_slopes_contradicts_it(stored):
    held = prove_design(stored)
    assert held.verdict.certified
    assert stored.proofs.certificate.rho < held.rho.rho < 3 * stored.proofs.certificate.rho
    assert held.longest.period > PERIOD
    assert "each single slope up to its bound" in signed_lines(stored)["assumes"]
    assert "single" not in signed_lines(with_claims(stored, entries=()))["assumes"]
    corners = [(a, b) for a in (-2.0, 2.0) for b in (-0.02, 0.02)]
    for period in (PERIOD, held.longest.period):
        assert max(spectral_radius(one, period) for one in corners) < 1
    assert max(spectral_radius(one, 3 * held.longest.period) for one in corners) > 1


def test_alpha_alone_does_not_prove_them(stored):
    only = replace(stored.proofs.certificate, m=np.ones(3), m_entries=np.zeros((0, 3)))
    held = prove_design(replace(with_claims(stored, entries=()), proofs=Proofs(only)))
    assert not held.verdict.certified
    assert "gain around the nonlinearity" in held.verdict.reason


def test_entries_that_are_too_small_prove_nothing(stored):
    small = (Entry(0, 0, 1.9), stored.claims.entries[1])
    held = prove_design(with_claims(stored, entries=small))
    assert not held.verdict.certified
    assert "single slopes" in held.verdict.reason


@pytest.mark.slow
def test_witnesses_of_a_file_are_proved_again(stored):
    held = prove_design(stored)
    again = prove_design(with_sampled(stored, held))
    np.testing.assert_array_equal(again.verdict.witness.P, held.verdict.witness.P)
    assert again.rho.rho == held.rho.rho


@pytest.mark.slow
def test_a_modal_certificate_gives_a_sector_too():
    agents = (
        TEXT.replace("agents = 3", "agents = 4")
        .replace('"cycle"', '"path"')
        .replace('"given"', '"modal"\ngain_limit = 8.0\nstarts = 1')
        .split("[[design.gains]]")[0]
    )
    stored = parse(json.loads(json.dumps(design_file_of(design(parse_problem(agents))).document())), "memory")
    assert prove_design(stored).verdict.certified
    small = tuple(replace(one, bound=0.9 * one.bound) for one in stored.claims.entries)
    assert "single slopes" in prove_design(with_claims(stored, entries=small)).verdict.reason


TRACKERS = """
[agent]
states = ["th", "w", "i"]
inputs = ["u"]
outputs = { y = "th" }
[agent.dynamics]
th = "w"
w = "(60*i - 90*sin(th) - 400*w - 25*tanh(100*w))/180"
i = "20*(u - i)"
[network]
agents = 4
topology = "path"
[design]
method = "given"
order = 1
weights = { input = 6e-5 }
disturbances = { states = 1.0, outputs = { y = 0.0007 } }
[controller]
period = 0.02
"""
ENDS, MIDDLE = (
    "A = [[-12.0]]\nB = [[16.0]]\nC = [[-16.0]]\nD = [[-12.0]]",
    "A = [[-4.0]]\nB = [[-3.6]]\nC = [[-3.6]]\nD = [[-19.0]]",
)


@pytest.mark.slow
def test_pair_weights_are_lowered_in_a_sector_of_several_slopes() -> None:
    """Solar trackers with dry friction: rho with the continuous weights was 134.8 or 150.8, as the kernel had them, 97 before
    sampling; in other proportions it is below either. Of what is one slope alone the continuous weights are next to best."""
    gains = "\n".join(f"[[design.gains]]\n{one}" for one in (ENDS, MIDDLE, MIDDLE, ENDS))
    stored = design_file_of(design(parse_problem(TRACKERS.replace("[controller]", f"{gains}\n[controller]"))))
    network, weights = sampled_network(stored), stored.problem.performance
    controllers, known = sampled_controllers(stored, 0.02), pair_weights(stored)
    assert network.sector is not None
    before = least_rho(in_doubles(network, controllers, weights.outputs), weights, known)
    found = sampled_rho(network, controllers, weights, known)
    assert before is not None
    assert found is not None
    assert stored.claims.rho < found.rho < 0.95 * before
