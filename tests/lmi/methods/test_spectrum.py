"""One controller for every graph with its spectrum in an interval: continuous, sampled, decided by the checker alone."""

import copy
import json

import numpy as np
import pytest

from lockstep.check.certify import certified
from lockstep.check.continuous.inequality import Claim, Performance
from lockstep.check.continuous.modes import Modes
from lockstep.check.design_file.content import parse
from lockstep.check.design_file.problem import ProblemTables, default_order
from lockstep.check.errors import Infeasible, ProblemError
from lockstep.check.sampled.controller import SampledNetwork
from lockstep.check.sampled.discretise import sampled_controllers
from lockstep.check.sampled.inequality import Omega_matrix, Witness, multiplier
from lockstep.check.sampled.lifting import copies
from lockstep.check.sampled.modes import ModalLoop, common_controller, widened
from lockstep.check.system.disagreement import single_difference
from lockstep.check.system.graph import Digraph
from lockstep.check.system.graph_family import SpectrumRange
from lockstep.check.system.loop import Gains, Plant
from lockstep.check.system.network import ExactNetwork
from lockstep.codegen.period_redesign import as_shipped
from lockstep.lmi.design import design
from lockstep.lmi.document import answer_document, design_file_of
from lockstep.lmi.methods.modal_interval import CommonSearch
from lockstep.lmi.sampled.modal.witnesses import certify_modal, certify_modal_decay
from lockstep.lmi.sampled.witnesses import in_doubles, period_in_doubles
from lockstep.model.problem import Problem

PENDULUMS = """
title = "Pendulums"
[agent]
states = ["q", "w"]
inputs = ["u"]
dynamics = {{ q = "w", w = "u - 0.5*sin(q)" }}
outputs = {{ y1 = "q", y2 = "w" }}
[network]
{network}
[design]
method = "modal"
order = {order}
starts = 1
{design}
[controller]
period = 0.02
"""


def posed(network="spectrum = [1.0, 4.0]", order=0, design=""):
    return Problem.parse(PENDULUMS.format(network=network, order=order, design=design))


@pytest.fixture(scope="module")
def stored():
    return as_shipped(design_file_of(design(posed())))


def verdicts(document):
    return certified(parse(document, "the design", ProblemTables.from_document)).verdicts


def changed(stored, change):
    document = copy.deepcopy(json.loads(json.dumps(stored.document())))
    change(document)
    return document


def test_certified_for_every_graph_and_as_it_ships(stored):
    found = verdicts(changed(stored, lambda _: None))
    assert all(one.proved for one in found.values()), found
    assert {"certificate", "decay", "sampled", "sampled_rho", "max_period"} <= set(found)
    said = answer_document(stored)
    assert said["spectrum"] == [1.0, 4.0] and said["max_degree"] == 4 and "graph_proof" not in said
    assert len(said["gains"]) == 1 and said["sampled"]["rho"] < 1.3 * said["rho"]


def set_spectrum(document, lower, upper):
    document["problem"]["network"]["spectrum"] = [lower, upper]


@pytest.mark.parametrize(
    ("change", "claim"),
    [
        (lambda d: set_spectrum(d, 1.0, 4.001), "certificate"),
        (lambda d: set_spectrum(d, 0.999, 4.0), "certificate"),
        (lambda d: d["claims"].update(rho=0.98 * d["claims"]["rho"]), "certificate"),
        (lambda d: d["claims"]["sampled"].update(rho=0.95 * d["claims"]["sampled"]["rho"]), "sampled_rho"),
        (lambda d: d["proofs"]["sampled"].update(mu=0.0), "sampled"),
        (lambda d: d["proofs"]["sampled"].update(lower=1.01), "sampled"),
        (lambda d: d["proofs"]["sampled"]["segments"][0].update(upper=3.9), "sampled"),
        (lambda d: d["proofs"]["sampled"].update(kappa=0.5 * d["proofs"]["sampled"]["kappa"]), "sampled"),
        (lambda d: d["proofs"]["sampled"].update(kappa=1.7e308), "sampled"),
        (lambda d: d["proofs"]["sampled"].update(t=[0.0] * 4), "sampled"),
        (lambda d: d["proofs"].update(sampled=None), "sampled"),
        (lambda d: d["problem"]["network"].update(max_degree=5), "sampled"),
        (
            lambda d: d["claims"]["sampled"].update(max_period=4 * d["claims"]["sampled"]["max_period"]),
            "max_period",
        ),
    ],
)
def test_what_is_not_proved_is_refused(stored, change, claim):
    document = changed(stored, change)
    if "rho" in document["claims"] and claim == "certificate":
        document["proofs"]["floor"] = None
    found = verdicts(document)
    assert not found[claim].proved, found


def test_more_than_one_p_does_not_cover_switching(stored):
    def cut(document):
        (one,) = document["proofs"]["certificate"]["segments"]
        document["proofs"]["certificate"]["segments"] = [{**one, "upper": 2.0}, one]

    with pytest.raises(ProblemError, match="2 segments"):
        verdicts(changed(stored, cut))


@pytest.mark.parametrize("claim", ["floor", "radius"])
def test_what_needs_one_graph_is_not_claimed_of_many(stored, claim):
    """The two agents that stand for a spectrum are one of its graphs: nothing is decided of them alone."""

    def claimed(document):
        if claim == "floor":
            document["claims"]["floor"] = 1e-3
            document["proofs"]["floor"] = [{"upper": None, "Z": [[1.0]], "Z_dual": [[1.0]], "k": [[1.0]]}]
        else:
            document["problem"]["agent"]["limits"] = {"u": [-1.0, 1.0]}
            document["claims"]["sampled"]["radius"] = 1e-6
            document["proofs"]["radius"] = {
                "P": [[1.0]], "m": [1.0], "t": [1.0], "decay": 0.5, "kappa": 1.0, "weight": 0.0, "ratio": 1.0,
                "kappa_mu": 1.0,
            }  # fmt: skip

    document = changed(stored, claimed)
    if claim == "radius":
        with pytest.raises(ProblemError, match="many graphs"):
            verdicts(document)
    else:
        assert not verdicts(document)["floor"].proved


def test_the_matrix_of_a_mode_is_convex_in_lambda_with_noise_and_input_weight():
    random = np.random.default_rng(3)
    n, m, q, n_C = 3, 2, 2, 2
    A, B, C, G, H = (random.standard_normal(s) for s in ((n, n), (n, m), (q, n), (n, 1), (1, n)))
    claim = Claim(
        0.7, np.eye(n), np.eye(n_C), np.zeros((2, 4)), (), 0.3 * np.eye(m), np.ones(n), np.array([0.2, 0.5])
    )
    modes = Modes(Plant(A, (B, B), C, G, H), n_C)
    K, P = random.standard_normal((1, n_C + m, n_C + q)), np.eye(n + n_C)

    def F(value):
        stated = modes.inequality(claim, value)
        return stated.F(P, K, np.array([2.0, 1.5]))

    ends, middle = (F(1.0) + F(5.0)) / 2, F(3.0)
    assert np.linalg.eigvalsh(ends - middle)[0] > -1e-10
    assert np.linalg.norm(ends - middle) > 1e-3  # u'W u makes it more than affine


def test_a_decay_of_modes_that_is_asked_for_is_proved_where_it_is_near_that_of_the_loop():
    """x_i' = u_i, four that all hear each other, u_i = sum_j (x_j - x_i), held: x_d+ = (1 - 4 T) x_d, and V+ = 0.92^2 V."""
    one, graph = np.eye(1), Digraph.topology("complete", 4)
    exact = Plant(0 * one, (one,) * 4, one, one, one).in_numbers(True)
    held = sampled_controllers(
        Gains.from_blocks(np.full((4, 1, 1), -1.0), 0), graph.edges, 0.02, "tustin", "float32"
    )
    network = SampledNetwork(exact, single_difference(exact.A), 1e-4, 0.02, 0)
    modal, loss = ModalLoop(network, held, *widened(3.999, 4.001)), 1 - 0.92**2
    given = modal, (4.0, 4.0), Performance(one, np.zeros((0, 0))), 1.0, None
    plain, asked = certify_modal_decay(*given), certify_modal_decay(*given, 1 - 0.97 * loss)
    assert 0.94 * loss < 1 - plain.witness.decay < 0.96 * loss
    assert 1 - asked.witness.decay == pytest.approx(0.97 * loss, rel=1e-12), "all but rounding of doubles"
    beyond = certify_modal_decay(*given, 1 - 1.01 * loss)
    assert beyond.witness.decay == plain.witness.decay, "what no V has is not proved"


@pytest.mark.parametrize("topology", ["ring", "path", "complete"])
@pytest.mark.parametrize("delay", [0, 1])
@pytest.mark.parametrize("order", [0, 1])
def test_modes_prove_what_the_assembled_loop_has(topology, delay, order):
    """The slow obvious twin: the witness of the modes, assembled for all agents, holds in the sampled loop of `loop`."""
    graph = Digraph.topology(topology, 4)
    values = np.linalg.eigvalsh(graph.laplacian)[1:]
    A, B, C = np.array([[0.0, 1], [0, -0.2]]), np.array([[0.0], [1]]), np.eye(2)
    plant = Plant(A, (B,) * 4, C, np.array([[0.0], [1]]), np.array([[1.0, 0]]))
    network = ExactNetwork(plant, graph)
    K = np.array([[-1.0, -1.5]]) if order == 0 else np.array([[-3.0, 0.3, 0.2], [0.4, -1.0, -1.5]])
    gains = Gains.from_blocks(np.stack([K] * 4), order)
    held = sampled_controllers(gains, graph.edges, 0.02, "tustin", "float32")
    exact = plant.in_numbers(True)
    modal = ModalLoop(
        SampledNetwork(exact, single_difference(exact.A), 0.3, 0.02, delay),
        held,
        *widened(values[0] * 0.999, values[-1] * 1.001),
    )
    weights = Performance(np.eye(2), np.eye(order))
    verdict = certify_modal(modal, (values[0], values[-1]), weights)
    assert verdict.certified, verdict.reason
    w, (one,) = verdict.witness, verdict.witness.segments
    d = network.loop(order, exact_arithmetic=True).d
    loop = in_doubles(SampledNetwork(exact, d, 0.3, 0.02, delay), held)
    # xi = (x_d, x_C, u): V = sum_i |(x_i, x_Ci, u_i) - mean|_P^2 + |mean of (x_Ci, u_i)|_P_mean^2.
    right = np.array(loop.network.d.right, dtype=float)
    mean = np.full((4, 4), 0.25)
    off, n = np.eye(4) - mean, 2
    centred = off @ right
    parts, P = [("x", 0, n), ("C", n, n + order), ("u", n + order, n + order + delay)], one.P

    def map_of(kind):
        return centred if kind == "x" else off

    blocks = [
        [np.kron(map_of(k1).T @ map_of(k2), P[a1:b1, a2:b2]) for k2, a2, b2 in parts] for k1, a1, b1 in parts
    ]
    for i in (1, 2):
        for j in (1, 2):
            rows = slice(parts[i][1] - n, parts[i][2] - n), slice(parts[j][1] - n, parts[j][2] - n)
            blocks[i][j] = blocks[i][j] + np.kron(mean, w.P_mean[rows])
    whole = np.block(blocks)
    t = np.array([w.t["ABCD".index(way.letter)] for way in loop.ways])
    kappa = 3 * w.kappa + 2 * sum(
        w.t["ABCD".index(k)] * max(c.errors[k].delta for c in held) ** 2 for k in "BD"
    )
    m = np.full(6, w.mu / 4)
    assembled = Witness((whole + whole.T) / 2, m, t, w.decay, kappa, w.weight, w.ratio, w.kappa_mu)
    lifted = copies(period_in_doubles(loop), multiplier(loop.network.d, m))
    Omega = Omega_matrix(loop, lifted, assembled)
    scale = 1 / np.sqrt(np.diag(Omega))
    assert np.linalg.eigvalsh(Omega * np.outer(scale, scale))[0] > -1e-9


def test_one_controller_stands_for_all_with_fewer_neighbours_and_smaller_weights():
    random = np.random.default_rng(0)
    table = random.standard_normal((3, 4)).astype(np.float32).astype(float)
    spectrum = SpectrumRange(0.5, 6.0, 5)
    common = common_controller(table, 2, spectrum, "float32")
    from lockstep.check.sampled.controller import HeldController

    for count in range(1, 6):
        weights = random.uniform(0.1, 1.0, count)
        weights *= min(1.0, 6.0 / weights.sum(), 3.0 / weights.max())
        own = HeldController.row_by_row(table, 2, tuple(range(1, count + 1)), weights)
        assert all(own.deltas[k] <= common.deltas[k] for k in "ABCD")
        assert own.message_noise(1.0) <= common.message_noise(1.0)


def test_bad_intervals_and_other_methods_are_refused():
    for network, says in (
        ("spectrum = [4.0, 1.0]", "0 < a <= b"),
        ("spectrum = [1.0]", "spectrum"),
        ("spectrum = [1.0, 4.0]\nmax_degree = 0", "max_degree"),
        ('spectrum = [1.0, 4.0]\ntopology = "ring"\nagents = 3', "topology"),
        ('topology = "ring"\nagents = 3\nmax_degree = 3', "max_degree"),
    ):
        with pytest.raises(ProblemError, match=says):
            posed(network)
    with pytest.raises(ProblemError, match="modal"):
        Problem.parse(
            PENDULUMS.format(network="spectrum = [1.0, 4.0]", order=0, design="").replace(
                '"modal"', '"certified"'
            )
        )


def test_a_spectrum_asks_for_a_reduced_observer_and_the_checker_reads_the_same_order():
    text = PENDULUMS.format(network="spectrum = [1.0, 4.0]", order=0, design="").replace("order = 0\n", "")
    assert Problem.parse(text).order == 2
    for states, order in ((1, 2), (3, 2), (4, 3), (5, 4), (12, 4)):
        assert default_order(states, many_graphs=True) == order
        assert default_order(states, many_graphs=False) == 2


@pytest.mark.slow
def test_too_wide_a_spectrum_names_the_ratio_that_has_one_p():
    with pytest.raises(Infeasible, match="a ratio of") as caught:
        design(posed("spectrum = [2.5e-4, 4.0]", design="gain_limit = 5.0"))
    assert 1 <= caught.value.figures["reachable_ratio"] < 16000


def test_the_slope_of_sigma_is_that_of_differences():
    problem = posed(order=1)
    from lockstep.lmi.proposal import claim_of, proved_bound
    from lockstep.model.assembly import network_of

    bound = proved_bound(problem)
    network = network_of(problem, bound)
    search = CommonSearch(Modes(network.plant, 1), claim_of(problem, bound), (1.0, 4.0), 50.0)
    K = np.array([[-3.0, 0.3, 0.2], [0.4, -3.0, -4.0]])
    value, slope = search.sigma(K)
    for index in ((0, 0), (1, 1), (1, 2)):
        step = np.zeros(K.shape)
        step[index] = 1e-4
        difference = (search.sigma(K + step)[0] - search.sigma(K - step)[0]) / 2e-4
        assert slope[index] == pytest.approx(difference, rel=2e-2, abs=1e-3 * value)
