"""Slopes entry by entry: what they certify that one alpha does not, that it is true, and what the checker refuses.

The pair of agents: a' = u + 2 sin a + 0.02 sin b, b' = 20 a - b. From phi to a the loop below has the gain 1/4 and to b
the gain 5: 2 / 4 + 0.02 * 5 < 1 holds entry by entry, but an alpha above 2 grants b the slope 2 as well, and 2 * 5 > 1.
"""

import copy
import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from lmi_cases import EXAMPLES, problem
from test_soundness import h_infinity

from lockstep.check.continuous.decide import decide
from lockstep.check.continuous.inequality import Claim, F_matrix
from lockstep.check.continuous.modes import ModalCertificate, decide_modes
from lockstep.check.errors import NotCertified, ProblemError
from lockstep.check.system.loop import Gains
from lockstep.lmi.analysis.certificate_sdp import AffineF, least_rho
from lockstep.lmi.analysis.fundamental_limits import largest_alpha_of_any_controller
from lockstep.lmi.analysis.rounding import prove
from lockstep.lmi.analysis.unit_scaling import claim_at
from lockstep.lmi.design import design
from lockstep.lmi.design_verdict import certify
from lockstep.lmi.document import answer_document, design_file_of, parse
from lockstep.lmi.floor.bisection import largest_floor
from lockstep.lmi.methods.modal import prove_modes
from lockstep.lmi.proposal import claim_of, proved_bound
from lockstep.lmi.search.barrier import BarrierPoint, InteriorProgram
from lockstep.model.assembly import network_of
from lockstep.model.graphs.graph import Graph
from lockstep.model.network import Network
from lockstep.model.problem import Problem, load_problem

GAIN = -2.0


def pair(agents: int = 2, topology: str = "path", gain: float = GAIN) -> Problem:
    gains = [f"[[design.gains]]\nA = []\nB = []\nC = [[]]\nD = [[{gain}, 0.0]]"] * agents
    return problem(
        dynamics={"a": "u + 2*sin(a) + 0.02*sin(b)", "b": "20*a - b"},
        outputs={"y1": "a", "y2": "b"},
        network=f'agents = {agents}\ntopology = "{topology}"',
        design="\n".join(['order = 0\nmethod = "given"', *gains]),
    )


def posed(one: Problem) -> tuple[Network, Gains, Claim]:
    bound = proved_bound(one)
    return network_of(one, bound), design(one).gains, claim_of(one, bound)


def test_entries_certify_where_alpha_does_not() -> None:
    network, gains, claim = posed(pair())
    assert [one.bound for one in claim.entries] == [2.0, 0.02]
    assert claim.alpha == pytest.approx(np.hypot(2.0, 0.02))
    proved = prove(network, gains, claim)
    loop = network.loop(0, exact_arithmetic=True)
    assert decide(loop, gains.blocks, claim, proved).positive
    with pytest.raises(NotCertified):
        prove(network, gains, replace(claim, entries=()))


def test_just_beyond_the_small_gain_condition_nothing_is_certified() -> None:
    """2 s / 4 + 0.02 s 5 = 1 at s = 5/3: phi = s (2 a + 0.02 b) then has a pole at 0, so that the condition is sharp."""
    network, gains, claim = posed(pair())
    loop = network.loop(0)
    for share, holds in ((0.999, True), (1.001, False)):
        at = claim_at(claim, alpha=share * 5 / 3 * claim.alpha)
        assert (least_rho(loop, gains.blocks, at) is not None) is holds


def worst_of_vertices(network: Network, gains: Gains, claim: Claim, share: float) -> float:
    """Return the largest gain from xi_d to x_d over phi = J v with each J_kl at +- its bound, from (2), (4), (9)."""
    plant, N, n = network.plant, network.N, network.agent.n
    T = np.linalg.svd(np.eye(N) - 1.0 / N)[2][: N - 1]
    L, B = np.kron(network.graph.laplacian, plant.C), np.kron(np.eye(N), plant.B[0])
    D = np.kron(np.eye(N), gains.D[0])
    down, worst = np.kron(T, np.eye(n)), 0.0
    for signs in np.ndindex(*[2] * len(claim.entries)):
        J = np.zeros((plant.G.shape[1], plant.H.shape[0]))
        for sign, one in zip(signs, claim.entries, strict=True):
            J[one.component, one.argument] = share * (1 - 2 * sign) * one.bound
        A = np.kron(np.eye(N), plant.A + plant.G @ J @ plant.H) + B @ D @ L
        worst = max(worst, h_infinity(down @ A @ down.T, np.eye(n * (N - 1)), np.eye(n * (N - 1))))
    return worst


def test_the_certified_rho_holds_at_every_vertex_of_the_slopes() -> None:
    network, gains, claim = posed(pair())
    found = least_rho(network.loop(0), gains.blocks, claim)
    assert found is not None
    worst = worst_of_vertices(network, gains, claim, 1.0)
    assert 0.5 * found.rho < worst < found.rho * (1 + 1e-3)
    assert worst_of_vertices(network, gains, claim, 1.5) > found.rho


@pytest.mark.slow
def test_the_storage_function_falls_for_four_agents_whatever_phi_is() -> None:
    """Four agents, and values of phi that no phi_a(a) + phi_b(b) takes: on a rectangle 0, 0, 0 and the most at a corner.

    Any values with |phi_i - phi_j| <= sum_l r_l |v_l,i - v_l,j| for all pairs are those of some admitted phi (McShane
    1934), so V' + |x|^2 < 0 has to hold for all of them. With 1.7 times the bounds it must not.
    """
    network, gains, claim = posed(pair(4, "complete", -1.0))
    certificate = prove(network, gains, claim)
    loop, generator = network.loop(0), np.random.default_rng(3)
    A_cl, bounds = loop.A_cl(gains.blocks), np.array([one.bound for one in claim.entries])
    excess = []
    for share in (1.0, 1.7):
        worst = -np.inf
        for k in range(3000):
            x = generator.standard_normal((4, 2)) * [1.0, generator.choice([1.0, 5.0, 20.0])]
            if k % 3 == 0:
                x = np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) * x[0]
            elif k % 3 == 1:
                x = np.outer(generator.standard_normal(4), [1.0, 5.0 + 15 * generator.uniform()])
            phi = admitted_values(generator, x @ network.plant.H.T, share * bounds)
            x_d = (loop.d.T @ x).ravel()
            rate = A_cl @ x_d + loop.E @ (loop.d.T @ phi @ loop.plant.G.T).ravel()
            gain = 2 * x_d @ certificate.P @ rate + ((x - x.mean(axis=0)) ** 2).sum()
            worst = max(worst, gain / (x_d @ x_d))
        excess.append(worst)
    assert excess[0] < 0 < excess[1]


def admitted_values(generator: np.random.Generator, v: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """Return phi at each row of v, one after the other as high or as low as the bounds allow."""
    values = np.zeros((len(v), 1))
    for i in range(1, len(v)):
        reach = np.abs(v[:i] - v[i]) @ bounds
        low, high = (values[:i, 0] - reach).max(), (values[:i, 0] + reach).min()
        values[i] = generator.choice([low, high])
    return values


def test_a_product_is_no_sum_of_functions_of_one_argument() -> None:
    """Why w_kl belongs to a pair: a b on a rectangle is 0, 0, 0, 1, and f(a) + g(b) would be 0 at the last corner."""
    corners = np.array([[0, 0], [1, 0], [0, 1], [1, 1]])
    sums = np.column_stack([corners == 0, corners == 1]).astype(float)  # f(0), g(0), f(1), g(1)
    product = corners.prod(axis=1).astype(float)
    nearest = sums @ np.linalg.lstsq(sums, product, rcond=None)[0]
    assert np.linalg.norm(product - nearest) == pytest.approx(0.5)


def test_the_affine_form_is_F() -> None:
    network, gains, claim = posed(pair(3, "cycle"))
    form = AffineF(network.loop(0), gains.blocks, claim)
    assert len(form.slopes) == 3 * 3 + 1
    generator = np.random.default_rng(0)
    w, P = generator.uniform(0.1, 1, len(form.slopes)), np.diag(generator.uniform(1, 2, 4))
    half = np.vstack([P @ form.Z, np.zeros((len(form.constant) - 4, len(form.constant)))])
    whole = half + half.T + form.constant + np.tensordot(w, form.slopes, 1)
    expected = F_matrix(form.loop, form.gains, form.claim, form.certificate(P, w))
    np.testing.assert_allclose(whole, expected, atol=1e-12)


@pytest.mark.slow
def test_the_nonlinear_program_lowers_rho_with_entries() -> None:
    network, gains, claim = posed(pair())
    loop, K = network.loop(0), gains.blocks
    start = least_rho(loop, K, claim)
    assert start is not None
    better = InteriorProgram(loop, claim, 10.0).improve(BarrierPoint(K, start), "rho")
    after = least_rho(loop, better.K, claim)
    assert after is not None
    assert after.rho < 0.2 * start.rho
    assert after.rho == pytest.approx(better.certificate.rho, rel=0.05)


@pytest.mark.slow
def test_modes_with_entries_prove_what_the_whole_network_has() -> None:
    """lambda from 0.59 to 3.41 on a path of four: 2 / (6 lambda) + 0.02 * 20 / (6 lambda) < 1, 2 * 20 / (6 lambda) > 1."""
    network, gains, claim = posed(pair(4, "path", -6.0))
    modal = prove_modes(network, gains, claim)
    assert len(modal.mu_entries) == 2
    whole = least_rho(network.loop(0), gains.blocks, claim)
    assert whole is not None
    assert 0.5 * modal.rho < whole.rho < modal.rho * (1 + 1e-4)
    with pytest.raises(NotCertified):
        prove_modes(network, gains, replace(claim, entries=()))
    for wrong in (modal.mu_entries[::-1], (modal.mu_entries[0], -1.0), (0.0, 0.0)):
        assert not decide_modes(network.matrices, gains, claim, replace(modal, mu_entries=wrong)).positive
    with pytest.raises(ProblemError, match="one an entry"):
        decide_modes(network.matrices, gains, claim, replace(modal, mu_entries=()))


@pytest.mark.slow
def test_method_modal_designs_with_entries() -> None:
    table = pair(4, "path").document()
    table["design"] |= {"method": "modal", "gain_limit": 8.0, "starts": 1}
    del table["design"]["gains"]
    made = design(Problem.from_document(table))
    stored = parse(json.loads(json.dumps(design_file_of(made).document())), "memory")
    assert certify(stored).certified
    assert isinstance(stored.proofs.certificate, ModalCertificate)
    assert len(stored.proofs.certificate.mu_entries) == 2
    small = tuple(replace(one, bound=0.99 * one.bound) for one in stored.claims.entries)
    assert not certify(replace(stored, claims=replace(stored.claims, entries=small))).certified


def test_an_alpha_that_is_asked_for_stands_for_every_phi_that_has_it() -> None:
    table = pair().document()
    table["design"]["alpha"] = 2.5
    asked = Problem.from_document(table)
    assert claim_of(asked, proved_bound(asked)).entries == ()
    with pytest.raises(NotCertified):
        design(asked)


@pytest.fixture(scope="module")
def file() -> dict[str, Any]:
    made: dict[str, Any] = json.loads(json.dumps(design_file_of(design(pair(3, "cycle"))).document()))
    return made


def test_the_checker_proves_the_entries_again(file: dict[str, Any]) -> None:
    assert [one["bound"] for one in file["claims"]["entries"]] == [2.0, 0.02]
    assert np.shape(file["proofs"]["certificate"]["m_entries"]) == (2, 3)
    verdict = certify(parse(file, "memory"))
    assert verdict.certified
    assert verdict.scope == "global"


@pytest.mark.parametrize(
    ("scales", "times"), [(None, (1.0, 1.0)), ({"G": [4.0], "H": [2.0, 8.0]}, (2.0, 0.5))]
)
def test_slopes_are_said_in_the_units_of_the_file(
    file: dict[str, Any], scales: Any, times: tuple[float, float]
) -> None:
    """And not in the scales of the bound: |d phi_k / d v_l| D_v,l / D_w,k <= bound, with D_w = 4 and D_v = (2, 8)."""
    changed = {**file, "claims": file["claims"] | {"scales": scales}}
    said = [one["slope"] for one in answer_document(parse(changed, "memory"))["entries"]]
    assert said == pytest.approx([2.0 * times[0], 0.02 * times[1]], rel=1e-14)


def test_a_proof_with_entries_is_less_than_alpha_asks_for(file: dict[str, Any]) -> None:
    changed = copy.deepcopy(file)
    changed["problem"]["design"]["alpha"] = changed["claims"]["alpha"]
    verdict = certify(parse(changed, "memory"))
    assert not verdict.certified
    assert "every nonlinearity" in verdict.reason


@pytest.mark.parametrize("place", [0, 1])
def test_an_entry_that_is_stored_too_small_is_refused(file: dict[str, Any], place: int) -> None:
    changed = copy.deepcopy(file)
    changed["claims"]["entries"][place]["bound"] *= 0.999
    verdict = certify(parse(changed, "memory"))
    assert not verdict.certified
    one = changed["claims"]["entries"][place]
    assert f"slope ({one['component']}, {one['argument']})" in verdict.reason
    assert verdict.figures["slope"] > one["bound"], "a slope provably reached"


def test_an_entry_that_is_left_out_is_refused(file: dict[str, Any]) -> None:
    """Without that of b the certificate would be one for phi = 2 sin a."""
    changed = copy.deepcopy(file)
    del changed["claims"]["entries"][1]
    for proof in ("certificate", "decay"):
        del changed["proofs"][proof]["m_entries"][1]
    verdict = certify(parse(changed, "memory"))
    assert not verdict.certified
    assert "missing" in verdict.reason


def test_the_floor_beside_entries_is_that_of_alpha_0() -> None:
    """What alpha alone cannot certify is no limit: entries certify more. What no linear agents certify is one."""
    one = problem(
        dynamics={"a": "b + 0.5*sin(a) + 0.01*sin(b)", "b": "u"},
        outputs={"y1": "a", "y2": "b"},
        network='agents = 2\ntopology = "path"',
        design='order = 0\nmethod = "given"'
        + 2 * "\n[[design.gains]]\nA = []\nB = []\nC = [[]]\nD = [[-1.0, -1.0]]",
    )
    network, _, claim = posed(one)
    stored = parse(json.loads(json.dumps(design_file_of(design(one)).document())), "memory")
    assert stored.proofs.certificate is not None
    assert len(stored.claims.entries) == 2
    rho = stored.proofs.certificate.rho
    low, high = (
        largest_floor(network.matrices, asked, certified=rho) for asked in (claim, replace(claim, entries=()))
    )
    assert low is not None
    assert high is not None
    assert low.rho < high.rho
    assert certify(stored).certified
    for floor, holds in ((low, True), (high, False)):
        claims, proofs = replace(stored.claims, floor=floor.rho), replace(stored.proofs, floor=floor)
        verdict = certify(replace(stored, claims=claims, proofs=proofs))
        assert verdict.certified is holds
        assert holds or "certify a rho below" in verdict.reason


def test_weights_below_zero_and_too_small_are_refused(file: dict[str, Any]) -> None:
    for factor in (-1.0, 0.0, 1e-3):
        changed = copy.deepcopy(file)
        changed["proofs"]["certificate"]["m_entries"][0][1] *= factor
        assert not certify(parse(changed, "memory")).certified


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda f: f["proofs"]["certificate"].pop("m_entries"), "m_entries"),
        (lambda f: f["proofs"]["certificate"]["m_entries"].pop(), "m_entries"),
        (lambda f: f["claims"]["entries"].pop(), "m_entries"),
        (lambda f: f["claims"]["entries"][0].update(component=0), "component"),
        (lambda f: f["claims"]["entries"][0].update(argument=1.5), "argument"),
        (lambda f: f["claims"]["entries"][0].update(bound=-1.0), "bound"),
        (lambda f: f["claims"]["entries"][0].update(bound="2"), "bound"),
        (lambda f: f["claims"].update(entries={}), "entries"),
        (lambda f: f["claims"]["entries"].__setitem__(0, 3), "entry 1"),
    ],
)
def test_files_that_do_not_fit_together_are_refused(file: dict[str, Any], change: Any, said: str) -> None:
    changed = copy.deepcopy(file)
    change(changed)
    with pytest.raises(ProblemError, match=said):
        parse(changed, "memory")


def test_entries_of_arguments_that_phi_does_not_have_are_refused(file: dict[str, Any]) -> None:
    changed = copy.deepcopy(file)
    changed["claims"]["entries"][0]["argument"] = 3
    with pytest.raises(ProblemError, match="entries"):
        certify(parse(changed, "memory"))


@pytest.mark.slow
def test_quadrotors_with_the_thrust_as_a_state() -> None:
    """With alpha alone no controllers of any order carry them; entry by entry three of them are certified."""
    quadrotors = load_problem(EXAMPLES / "quadrotors.toml")
    bound = proved_bound(quadrotors)
    network, claim = network_of(quadrotors, bound), claim_of(quadrotors, bound)
    assert largest_alpha_of_any_controller(network) < 0.7 * claim.alpha
    made = design(quadrotors)
    assert made.certificate is not None
    assert made.certificate.rho < 7
    stored = parse(json.loads(json.dumps(design_file_of(made).document())), "memory")
    assert certify(stored).certified
    assert certify(stored).scope == "local"


def test_a_leader_and_one_follower_with_gains_made_by_hand() -> None:
    """Position, speed, angle and rate feed the torque; height, climb and thrust the motors: a norm of 21, and rho 14.4."""
    K = np.zeros((2, 7))
    K[0, [0, 1, 4, 5]] = 1.27, 2.95, -20.32, -4.94
    K[1, [2, 3, 6]] = -5.35, -14.73, -1.79
    assert np.linalg.norm(K, 2) < 22
    quadrotors = load_problem(EXAMPLES / "quadrotors.toml")
    bound = proved_bound(quadrotors)
    network = Network(
        quadrotors.agent(), Graph.from_edges(2, [[2, 1]]), scales=(bound.output_scale, bound.input_scale)
    )
    claim = Claim(bound.alpha, np.eye(7), np.zeros((0, 0)), np.zeros((2, 4)), bound.entries)
    gains = Gains.from_blocks(np.stack([0 * K, K]), 0)
    assert prove(network, gains, claim).rho < 15
    with pytest.raises(NotCertified):
        prove(network, gains, replace(claim, entries=()))
