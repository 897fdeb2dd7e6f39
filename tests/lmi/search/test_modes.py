"""Equal gains for all agents: the modes of a graph as a small loop, and how a search for gains of their own begins."""

from dataclasses import replace

import numpy as np
import pytest
from lmi_cases import ALPHA, arms, claim, published

from lockstep.check.continuous.modes import Modes
from lockstep.lmi.analysis.certificate_sdp import eliminates_P, least_rho
from lockstep.lmi.methods.certified import equal_gains
from lockstep.lmi.proposal import claim_of, proved_bound
from lockstep.lmi.search import GainSearch
from lockstep.lmi.search.common_gains import ModalSearch, loop_of, representative_eigenvalues
from lockstep.lmi.search.random_start import run_start, stable_gains
from lockstep.model.assembly import network_of
from lockstep.model.graphs.graph import Graph
from lockstep.model.network import Network
from lockstep.model.problem import Problem, parse_problem

PENDULUMS = """
[agent]
states = ["a", "b"]
inputs = ["u"]
dynamics = {{ a = "b", b = "-a - sin(a) + u" }}
outputs = {{ y1 = "a", y2 = "b" }}

[network]
agents = {agents}
{graph}

[design]
order = 1
gain_limit = 10.0
starts = 2

[controller]
period = 0.01
"""


def pendulums(agents: int, graph: str) -> Problem:
    return parse_problem(PENDULUMS.format(agents=agents, graph=graph))


def begun_with(posed: Problem) -> GainSearch:
    """The search as a design makes it."""
    bound = proved_bound(posed)
    network, asked = network_of(posed, bound), claim_of(posed, bound)
    modes = equal_gains(network, asked, posed.order, posed.design.gain_limit, None)
    loop = network.loop(posed.order)
    return GainSearch.of(loop, asked, posed.design.gain_limit, modes=modes)


@pytest.mark.parametrize(
    "adjacency",
    [
        [[0, 1, 0], [0, 0, 1], [1, 0, 0]],
        [[0, 1, 1], [1, 0, 1], [1, 1, 0]],
        [[0, 2, 0.5], [0.5, 0, 2], [2, 0.5, 0]],
    ],
    ids=["cycle", "complete", "weighted cycle"],
)
def test_the_modes_of_a_normal_laplacian_have_the_poles_and_the_rho_of_the_whole_loop(adjacency):
    """Equal gains: the loop of all agents is another basis of the modes', and so is F with equal pair weights."""
    network = Network(arms().agent, Graph(np.array(adjacency, dtype=float)))
    values = np.linalg.eigvals(network.graph.laplacian)
    values = np.where(np.abs(values.imag) < 1e-9, values.real, values)[np.abs(values) > 1e-9]
    loops = loop_of(Modes(network.plant, 2), values[values.imag >= 0].astype(complex)), network.loop(2)
    K = np.repeat(published().blocks[:1], 3, axis=0)
    small, whole = (np.sort_complex(np.linalg.eigvals(loop.A_cl(K)).round(7)) for loop in loops)
    assert np.allclose(small, whole, atol=1e-6)
    assert whole.real.max() < 0, "or there is no rho"
    norms = [GainSearch.of(loop, claim(arms(), 2, 0.01 * ALPHA), 50.0).shared_norm for loop in loops]
    levels = [
        norm.level(norm.pack(K, 1e3 * np.ones(len(norm.W))), None, np.geomspace(1e-2, 1e2, 200))
        for norm in norms
    ]
    assert np.isfinite(levels[0])
    assert levels[0] == pytest.approx(levels[1], rel=1e-6)


def test_a_few_eigenvalues_stand_for_those_of_a_long_cycle():
    L = np.eye(10) - np.roll(np.eye(10), 1, axis=1)
    found = representative_eigenvalues(np.linalg.eigvals(L))
    assert abs(found[0]) == pytest.approx(2 * np.sin(np.pi / 10))
    assert len(found) == 4
    assert (found.imag >= 0).all()
    assert np.abs(found).max() == pytest.approx(2.0)


def test_a_small_loop_begins_with_gains_of_its_own():
    assert not run_start(begun_with(pendulums(3, 'topology = "cycle"')), None, 0, 1).equal


CARRIERS = """
[agent]
states = ["p", "v", "F"]
inputs = ["u"]
dynamics = { p = "v", v = "(F - 0.9*v)/60", F = "(u - F)/0.3" }
outputs = { y1 = "p", y2 = "v" }

[network]
agents = 4
topology = "leader_path"

[design]
order = 0
gain_limit = 50.0
decay = 0.08
"""


@pytest.mark.parametrize("index", range(4))
def test_followers_on_a_path_are_made_stable_though_their_modes_are_one(index):
    """The modes of all three are those of one, and D = [-8, -25] gives it 18 s^3 + 60.3 s^2 + 25.9 s + 8: -0.22."""
    posed = parse_problem(CARRIERS)
    bound = proved_bound(posed)
    network, asked = network_of(posed, bound).decaying(0.08), claim_of(posed, bound)
    limit = posed.design.gain_limit
    search = GainSearch.of(network.loop(0), asked, limit, modes=equal_gains(network, asked, 0, limit, None))
    assert search.abscissa(np.repeat([[[-8.0, -25.0]]], 4, axis=0)) < 0
    K, abscissa = stable_gains(search, 0, index)
    assert abscissa < 0
    assert np.linalg.norm(K, 2, axis=(1, 2)).max() <= 50.0


def test_agents_that_differ_have_no_equal_gains():
    posed = pendulums(10, 'topology = "cycle"')
    bound = proved_bound(posed)
    network = network_of(posed, bound)
    other = replace(network, B=(*network.B[:-1], 2 * network.B[-1]))
    asked = claim_of(posed, bound)
    assert equal_gains(network, asked, posed.order, 6.4, None) is not None
    assert equal_gains(other, asked, posed.order, 6.4, None) is None


@pytest.mark.parametrize(
    ("graph", "regular"),
    [('topology = "ring"', True), ('topology = "star"', False), ('topology = "cycle"', True)],
)
def test_ten_agents_begin_with_equal_gains_that_have_a_certificate(graph, regular):
    """A star has a hub: every other start, and own gains from there. A cycle has complex eigenvalues."""
    search = begun_with(pendulums(10, graph))
    assert eliminates_P(search.loop)
    assert isinstance(search.modes, ModalSearch)
    assert search.is_regular is regular
    start = run_start(search, None, 0, 1)
    assert start.equal
    assert (start.at.K[0] == start.at.K).all()
    assert np.isfinite(start.at.rho)
    found = least_rho(search.loop, start.at.K, search.claim)
    # Weights of their own for all pairs, at all frequencies: 1 % for what lies between those of the descent.
    assert found is not None
    assert found.rho <= 1.01 * start.at.rho
    if not regular:
        own = run_start(search, None, 0, 0)
        assert not own.equal
        assert np.ptp(own.at.K, axis=0).max() > 0
