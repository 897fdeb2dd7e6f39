"""The set of initial disagreements of a local certificate: what starts in it stays, something beside it leaves."""

import math
import tomllib
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from lockstep.check.continuous.certificate import decide_certificate, decide_initial_set
from lockstep.check.continuous.inequality import Certificate, Claim
from lockstep.check.continuous.local import InitialSet
from lockstep.check.continuous.modes import ModalCertificate, Segment
from lockstep.check.errors import NotCertified, ProblemError
from lockstep.check.numbers import as_floats, exactly
from lockstep.check.system.disagreement import disagreement
from lockstep.check.system.loop import Gains
from lockstep.lmi.analysis.rounding import prove
from lockstep.lmi.initial import Unavailable, _ratio_above
from lockstep.lmi.local_sets import largest_initial_states, with_larger_set
from lockstep.lmi.scope import domain_of, initial_states, inner_box
from lockstep.model.agents.agent import Agent
from lockstep.model.assembly import bound_of
from lockstep.model.bound_search import Box
from lockstep.model.graphs.graph import Graph
from lockstep.model.network import Network
from lockstep.model.problem import Problem, parse_problem

N, ORDER, SIDE = 3, 1, 1.2
GAINS = Gains(
    (-np.eye(1),) * N,
    (np.array([[0.1, 0.1]]),) * N,
    (np.array([[0.1]]),) * N,
    (np.array([[-4.0, -3.0]]),) * N,
)


def network(topology: str = "leader_path", *, domain: float | None = SIDE, **options) -> Network:
    """Duffing oscillators with a softening spring: beyond |p| = sqrt 2 they do not come back by themselves."""
    agent = Agent.from_expressions(
        "duffing",
        states=["p", "v"],
        inputs=["u"],
        outputs={"y1": "p", "y2": "v"},
        dynamics={"p": "v", "v": "-p + 0.5*p**3 + u"} if domain else {"p": "v", "v": "-sin(p) + u"},
        domain={"p": (-domain, domain)} if domain else {},
        centre=True,
    )
    bound = bound_of(agent)
    return Network(
        agent, Graph.topology(topology, N), scales=(bound.output_scale, bound.input_scale), **options
    )


def certified(net: Network, gains: Gains = GAINS) -> Certificate:
    claim = Claim(bound_of(net.agent).alpha, np.eye(2), np.eye(gains.order), np.zeros((N, 4)))
    return prove(net, gains, claim)


@pytest.fixture(scope="module")
def net():
    return network()


@pytest.fixture(scope="module")
def certificate(net):
    return certified(net)


@pytest.fixture(scope="module")
def found(net, certificate):
    answer = initial_states(net, certificate)
    assert isinstance(answer, InitialSet)
    return answer


def leaders(generator, count):
    """States on the largest orbit of one Duffing oscillator in |p| <= 0.6: v^2/2 + p^2/2 - p^4/8 is constant on it."""
    p = generator.uniform(-0.6, 0.6, count)
    p[: count // 2] = np.sign(p[: count // 2]) * 0.6
    level = 0.6**2 - 0.6**4 / 4
    return np.stack([p, generator.choice([-1, 1], count) * np.sqrt(np.maximum(level - p**2 + p**4 / 4, 0.0))])


def starts(net, certificate, level, generator, count, *, widest=False):
    """Return x (N n, count) and x_C (N n_C, count) with V = level, the root's controller at rest."""
    P, d = certificate.P, disagreement(net.graph)
    keep = np.delete(np.arange(len(P)), 4)  # x_C1 is at rest
    P_0 = P[np.ix_(keep, keep)]
    z = generator.standard_normal((len(keep), count))
    if widest:  # towards the farthest |p_3 - p_1| of the ellipsoid
        z[:, ::2] = np.linalg.solve(P_0, -np.eye(len(keep))[:, [0]])
        z[:, ::2] += (
            0.02 * generator.standard_normal((len(keep), z[:, ::2].shape[1])) * np.linalg.norm(z[:, 0])
        )
    z *= np.sqrt(level / np.einsum("ik,ij,jk->k", z, P_0, z))
    whole = np.zeros((len(P), count))
    whole[keep] = z
    apart = np.kron(as_floats(d.right), np.eye(2)) @ whole[:4]
    x = apart + np.tile(leaders(generator, count) - apart[:2], (N, 1))
    return x, whole[4:]


def run(net, x, x_C, *, horizon, step=0.01, xi=lambda _: np.zeros((6, 1))):
    """Classical Runge-Kutta on the symbolic nonlinear loop; yields (t, x, x_C) of all runs at once."""
    f = net.closed_loop(GAINS).map(x.shape[1])

    def rate(t, y):
        dx, dx_C, _ = f(y[:6], y[6:], t, np.broadcast_to(xi(t), (6, x.shape[1])))
        return np.vstack([np.asarray(dx), np.asarray(dx_C)])

    y = np.vstack([x, x_C])
    for k in range(round(horizon / step)):
        t = k * step
        yield t, y[:6], y[6:]
        a = rate(t, y)
        b = rate(t + step / 2, y + step / 2 * a)
        c = rate(t + step / 2, y + step / 2 * b)
        y = y + step / 6 * (a + 2 * b + 2 * c + rate(t + step, y + step * c))
    yield horizon, y[:6], y[6:]


def disagreement_of(x):
    agents = x.reshape(N, 2, -1)
    return np.sqrt(((agents - agents.mean(axis=0)) ** 2).sum(axis=(0, 1)))


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
    assert "-0.6 <= v1 <= 0.6 (v1 = p)" in found.text()
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


@pytest.fixture(scope="module")
def own(net, certificate):
    found, proof = largest_initial_states(net, GAINS, claim_of(net), certificate)
    assert proof is not None
    return found, proof


def claim_of(net: Network) -> Claim:
    return Claim(bound_of(net.agent).alpha, np.eye(2), np.eye(ORDER), np.zeros((N, 4)))


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


def test_a_leader_that_keeps_to_less_leaves_more_to_the_others(net, certificate, own):
    text = asked(order=1).document()
    text["network"]["leader"] = {"p": [-0.2, 0.2]}
    inner = Problem.from_document(text).leader
    assert inner == Box((-0.2,), (0.2,))
    found, _ = largest_initial_states(net, GAINS, claim_of(net), certificate, inner)
    assert found.radius == pytest.approx(own[0].radius / 0.6, rel=0.02)  # (1.2 - 0.2) / (1.2 - 0.6)
