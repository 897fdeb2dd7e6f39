"""Method `modal`: the split into modes, its exact certificate for any number of agents, and what it must refuse."""

import copy
import json
from pathlib import Path

import numpy as np
import pytest
from lmi_cases import CARTS, carts

from lockstep.check.continuous.inequality import Certificate, Claim, F_matrix
from lockstep.check.continuous.modes import Modes, decide_modes, mode_matrix
from lockstep.check.errors import Infeasible, NotCertified, ProblemError
from lockstep.check.numbers import as_floats
from lockstep.check.psd import MOST_ROWS
from lockstep.check.system.laplacian_spectrum import decide_spectrum, metric
from lockstep.lmi.analysis.certificate_sdp import least_rho
from lockstep.lmi.design import design
from lockstep.lmi.design_verdict import certify
from lockstep.lmi.document import design_file_of, parse
from lockstep.lmi.methods.modal import design_modes, prove_modes, segment_ends, shared_gains, spectrum_bounds
from lockstep.lmi.methods.modal_witness import witness
from lockstep.model.graphs.graph import Graph
from lockstep.model.network import Network
from lockstep.model.problem import parse_problem

EXAMPLES = Path(__file__).parents[3] / "examples"


@pytest.fixture(scope="module")
def designed():
    """A designed path of four carts, as JSON types."""
    return json.loads(json.dumps(design_file_of(design(parse_problem(CARTS))).document()))


def normalised(graph: Graph) -> Graph:
    """The same graph with weights divided by the listener's in-degree."""
    return Graph(graph.adjacency / graph.in_degrees[:, None])


def test_designed_and_certified_independently(designed):
    assert designed["claims"]["certified"]
    assert designed["claims"]["proof"] == "exact"
    assert designed["proofs"]["certificate"]["kind"] == "modal"
    assert designed["claims"]["floor"] < designed["claims"]["rho"]
    assert certify(parse(designed, "design")).certified


@pytest.mark.parametrize(
    "tamper",
    [
        lambda d: d["claims"].update(rho=0.9 * d["claims"]["rho"]),
        lambda d: d["claims"].update(alpha=3.0 * d["claims"]["alpha"]),
        lambda d: [one.update(D=[[-x for x in row] for row in one["D"]]) for one in d["gains"]],
        lambda d: d["proofs"]["certificate"].update(lower=1.01 * d["proofs"]["certificate"]["lower"]),
        lambda d: d["proofs"]["certificate"]["segments"][-1].update(
            upper=0.99 * d["proofs"]["certificate"]["segments"][-1]["upper"]
        ),
        lambda d: d["proofs"]["certificate"].update(mu=-d["proofs"]["certificate"]["mu"]),
        lambda d: d["proofs"]["certificate"]["segments"][0].update(P=[[0.0, 0.0], [0.0, 0.0]]),
    ],
)
def test_a_file_that_claims_more_is_refused(designed, tamper):
    content = copy.deepcopy(designed)
    tamper(content)
    if content["claims"]["alpha"] != designed["claims"]["alpha"]:
        content["problem"]["design"]["alpha"] = content["claims"]["alpha"]
    assert not certify(parse(content, "design")).certified


def test_a_weight_of_u_below_zero_is_no_claim(designed):
    """It makes each matrix of a mode smaller, so that every certificate of the loop without it would hold."""
    stored = parse(designed, "design")
    network = Network(stored.problem.agent(), stored.problem.graph()).matrices
    for W, proved in ((-0.1, False), (0.0, True), (1e-9, True)):
        claim = Claim(stored.claims.alpha, np.eye(2), np.zeros((0, 0)), np.zeros((4, 4)), W=np.array([[W]]))
        found = decide_modes(network, stored.gains, claim, stored.proofs.certificate)
        assert found.positive == proved


def test_gains_that_differ_and_broken_files_are_bad_input(designed):
    content = copy.deepcopy(designed)
    content["gains"][1]["D"][0][0] *= 1.001
    with pytest.raises(ProblemError, match="differ"):
        certify(parse(content, "design"))
    for breakage in (
        lambda c: c.update(kind="other"),
        lambda c: c.update(segments=[]),
        lambda c: c["segments"].reverse(),
        lambda c: c["segments"][0].update(P=[[1.0, 0.0], [0.5, 1.0]]),
    ):
        content = copy.deepcopy(designed)
        breakage(content["proofs"]["certificate"])
        with pytest.raises(ProblemError):
            parse(content, "design")


def test_modes_prove_what_the_whole_network_has(designed):
    """The slow obvious twin: the certificate of the whole network, with its own P and multipliers, is no worse."""
    stored = parse(designed, "design")
    network = Network(stored.problem.agent(), stored.problem.graph())
    claim = Claim(stored.claims.alpha, np.eye(2), np.zeros((0, 0)), np.zeros((4, 4)))
    whole = least_rho(network.loop(0), stored.gains.blocks, claim)
    assert whole is not None
    assert whole.rho <= stored.proofs.certificate.rho * (1 + 1e-4)


@pytest.mark.parametrize("graph", [Graph.topology("path", 4), normalised(Graph.topology("path", 4))])
def test_the_sum_over_modes_is_a_certificate_of_the_network(graph):
    """P of the modes, put together along the eigenvectors, satisfies the inequality of the whole network."""
    problem = parse_problem(CARTS)
    network = Network(problem.agent(), graph)
    known, claim = metric(graph), Claim(0.3, np.eye(2), np.eye(1), np.zeros((4, 4)))
    K = np.array([[-3.0, 0.5, 0.1], [0.2, -5.0, -6.0]])
    modes, ends = Modes(network.plant, 1), segment_ends(network, known)
    found = witness(modes, K, claim, ends)
    assert found is not None
    w = as_floats(known)
    root = np.sqrt(w)
    values, V = np.linalg.eigh(root[:, None] * graph.laplacian / root)
    parts = [found.P[min(int(np.searchsorted(ends, value)) - 1, len(found.P) - 1)] for value in values[1:]]
    # Columns of V are orthonormal in the scaled agents sqrt(w_i) x_i; x = right x_d with the last agent's state 0.
    loop = network.loop(1)
    lift = np.zeros((12, loop.n_x))
    lift[:8, :6] = np.kron(np.diag(root) @ loop.d.right, np.eye(2))
    lift[8:, 6:] = np.diag(root)
    P = np.zeros((12, 12))
    for k, part in enumerate(parts, start=1):
        direction = np.zeros((3, 12))
        direction[:2, :8], direction[2, 8:] = np.kron(V[:, k], np.eye(2)), V[:, k]
        P += direction.T @ part @ direction
    mean = np.concatenate([np.zeros(8), V[:, 0]])
    P += found.P_mean[0, 0] * np.outer(mean, mean)
    spread = max(w) / min(w)
    # min w = 1: V' + |.|_W^2 < sigma |xi|_W^2 <= sigma spread |xi|^2, and |.|_W >= |.|.
    m = np.array([found.mu[0] * w[i] * w[j] / w.sum() for i, j in loop.d.pairs()])
    whole = Certificate(float(np.sqrt(found.sigma * spread)) * 1.001, lift.T @ P @ lift, m)
    F = F_matrix(loop, np.stack([K] * 4), claim, whole)
    assert np.linalg.eigvalsh(whole.P)[0] > 0
    assert np.linalg.eigvalsh(F)[-1] < 1e-6 * np.abs(F).max()
    less = Certificate(whole.rho * 0.3, whole.P, m)
    assert np.linalg.eigvalsh(F_matrix(loop, np.stack([K] * 4), claim, less))[-1] > 1e-3


def test_the_matrix_of_a_mode_is_affine_in_lambda():
    problem = parse_problem(CARTS)
    modes = Modes(Network(problem.agent(), problem.graph()).plant, 1)
    generator = np.random.default_rng(0)
    K, P = generator.standard_normal((2, 3)), generator.standard_normal((3, 3))
    claim = Claim(0.3, np.eye(2), np.eye(1), np.zeros((4, 4)))
    low, middle, high = (
        mode_matrix(modes, K, claim, value, P @ P.T, [2.0], 3.0) for value in (0.5, 1.0, 1.5)
    )
    np.testing.assert_allclose(middle, (low + high) / 2, atol=1e-12)


def test_exact_bounds_on_the_spectrum():
    for graph in (
        Graph.topology("path", 6),
        normalised(Graph.topology("ring", 6)),
        normalised(Graph.topology("path", 6)),
    ):
        known = metric(graph)
        lower, upper = spectrum_bounds(graph, known)
        assert decide_spectrum(graph, known, lower, upper).positive
        assert not decide_spectrum(graph, known, lower + 1e-6, upper).positive
        assert not decide_spectrum(graph, known, lower, upper - 1e-6).positive
    # A path of N has lambda_k = 2 - 2 cos(k pi / N).
    assert spectrum_bounds(Graph.topology("path", 6), metric(Graph.topology("path", 6)))[0] == pytest.approx(
        2 - 3**0.5
    )


def test_more_agents_than_rows_are_decided_are_refused_before_a_search():
    """Their matrices of rationals would take minutes and gigabytes; so many are named by their spectrum."""
    graph = Graph.topology("ring", MOST_ROWS + 2)
    assert not decide_spectrum(graph, metric(graph), 0.0, 5.0).decided
    problem = parse_problem(CARTS)
    network = Network(problem.agent(), graph)
    with pytest.raises(ProblemError, match=r"702 agents; expected at most 701.*spectrum"):
        design_modes(network, Claim(0.3, np.eye(2), np.eye(1), np.zeros((702, 4))), 1, 50.0, starts=1, seed=0)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"topology": '"cycle"'}, 'not real.*method = "certified"'),
        ({"topology": '"leader_path"'}, "does not listen"),
        ({"order": '0\ncoordinates = "laplacian_rows"'}, "orthonormal"),
        ({"order": "0\nfragility = { D = 0.1 }"}, "fragility"),
    ],
)
def test_what_does_not_split_is_refused(changes, says):
    with pytest.raises(ProblemError, match=says):
        design(parse_problem(carts(**changes)))


def test_weights_that_do_not_balance_around_a_circle_are_refused():
    lopsided = np.array([[0.0, 2.0, 1.0], [1.0, 0.0, 1.0], [1.0, 1.0, 0.0]])
    with pytest.raises(ProblemError, match="do not balance"):
        metric(Graph(lopsided))
    assert max(metric(Graph(np.array([[0.0, 2.0], [1.0, 0.0]])))) == 2


def test_infeasible_says_what_was_reached():
    # Positions alone: no static gain agrees.
    with pytest.raises(Infeasible, match="identical gains"):
        design(parse_problem(carts(outputs='{ y1 = "p" }')))


def test_unstable_gains_are_not_certified():
    problem = parse_problem(CARTS)
    network = Network(problem.agent(), problem.graph())
    claim = Claim(0.3, np.eye(2), np.zeros((0, 0)), np.zeros((4, 4)))
    with pytest.raises(NotCertified):
        prove_modes(network, shared_gains(np.array([[1.0, 1.0]]), 0, 4), claim)


def test_segments_are_as_fine_as_lowers_rho():
    """One P for all lambda loses a factor of two on these gains; the full certificate, with any P, is the limit."""
    text = carts(
        dynamics='{ p = "v", v = "f" }', outputs='{ y = "p" }', agents="6", topology='"ring"', order="1"
    )
    problem = parse_problem(text)
    network, claim = (
        Network(problem.agent(), problem.graph()),
        Claim(0.0, np.eye(2), np.eye(1), np.zeros((6, 4))),
    )
    K = np.array([[-11.208975612766475, 33.08416284541953], [10.36618421898415, -33.38512385413251]])
    gains = shared_gains(K, 1, 6)
    full = least_rho(network.loop(1), gains.blocks, claim).rho
    one = witness(Modes(network.plant, 1), K, claim, segment_ends(network, metric(network.graph)))
    assert np.sqrt(one.sigma) > 2 * full
    assert full < prove_modes(network, gains, claim).rho < 1.03 * full


@pytest.mark.slow
@pytest.mark.parametrize("topology", ["path", "ring"])
def test_fifty_double_integrators(topology):
    text = carts(dynamics='{ p = "v", v = "f" }', agents="50", topology=f'"{topology}"', starts="2")
    content = json.loads(json.dumps(design_file_of(design(parse_problem(text))).document()))
    assert content["claims"]["certified"]
    # Measured 34.2 (path, lambda from 0.0039) and 4.2 (ring).
    assert content["claims"]["rho"] < {"path": 45.0, "ring": 5.0}[topology]
    assert certify(parse(content, "design")).certified


@pytest.mark.slow
def test_fifty_arms_that_hear_each_other():
    text = (EXAMPLES / "flexible_joint_arms.toml").read_text(encoding="utf-8")
    text = text.replace("agents = 3\nedges = [[1, 2], [2, 3], [3, 1]]", 'agents = 50\ntopology = "complete"')
    text = text.replace('method = "certified"', 'method = "modal"\nstarts = 2')
    text = text[: text.index("[simulation]")]
    content = json.loads(json.dumps(design_file_of(design(parse_problem(text))).document()))
    assert content["claims"]["alpha"] == 3.33
    # Measured 2.33, with a floor of 1.97.
    assert content["claims"]["floor"] < content["claims"]["rho"] < 3.0
    assert certify(parse(content, "design")).certified
