"""What is proved besides rho of the paper: u weighed, noise, decay, stable controllers, limits; each against brute force."""

import dataclasses
import functools
import json
import re

import numpy as np
import pytest

from lockstep.check.continuous.stability import is_stable, is_stable_step
from lockstep.check.design_file.problem import ProblemTables
from lockstep.check.errors import NotCertified, ProblemError
from lockstep.check.numbers import exactly
from lockstep.check.requirements import shortfalls
from lockstep.check.sampled.controller import Precision
from lockstep.check.sampled.inputs.input_limits import proves_radius
from lockstep.check.sampled.loop import sampled_loop
from lockstep.codegen.period_redesign import as_shipped
from lockstep.codegen.sampled_design import sampled_network
from lockstep.codegen.sampled_modes import sampled_controllers
from lockstep.lmi.design import design
from lockstep.lmi.design_verdict import certify
from lockstep.lmi.document import Stored, design_file_of, parse
from lockstep.lmi.proposal import claim_of, proved_bound
from lockstep.lmi.sampled.loop_gain import _step_of_state
from lockstep.lmi.sampled.witnesses import in_doubles, period_in_doubles
from lockstep.model.assembly import network_of
from lockstep.model.problem import Problem

PENDULUMS = """
[agent]
name = "pendulum"
states = ["q", "v"]
inputs = ["u"]
dynamics = { q = "v", v = "-2*q - 0.5*v + slope*sin(q) + u" }
outputs = { y1 = "q", y2 = "v" }
parameters = { slope = SLOPE }
limits = { u = [-3.0, 2.0] }
[network]
agents = 3
edges = [[1, 2], [2, 3], [3, 1]]
[design]
method = "given"
DESIGN
gains = [GAINS, GAINS, GAINS]
[controller]
period = PERIOD
"""

STATIC = "{ D = [[-2.0, -1.5]] }"
DYNAMIC = "{ A = [[-3.0]], B = [[1.0, 0.5]], C = [[-1.0]], D = [[-1.5, -1.0]] }"


def pendulums(gains: str = STATIC, slope: float = 0.0, period: float = 0.01, asked: str = "") -> Problem:
    """Return three pendulums with given gains."""
    words = {
        "SLOPE": f"{slope}",
        "GAINS, GAINS, GAINS": gains if gains.count("D =") == 3 else ", ".join([gains] * 3),
        "PERIOD": f"{period}",
        "DESIGN": asked,
    }
    text = PENDULUMS
    for word, value in words.items():
        text = text.replace(word, value)
    return Problem.parse(text)


def shipped(problem: Problem) -> Stored:
    """Return the design file, sampled claims included."""
    return as_shipped(design_file_of(design(problem)))


@functools.cache
def with_springs() -> Stored:
    """Return dynamic controllers of pendulums that gravity pulls as their springs push, which several tests look at."""
    return shipped(pendulums(DYNAMIC, slope=1.0))


def norm_of_loop(problem: Problem) -> float:
    """Return the H-infinity norm from (xi, nu) to (x, x_C, u) weighted, on a grid: a loop written down agent by agent.

    In the modes of the disagreement (the cycle's L is normal) the disturbances are unit vectors across 1.
    """
    gains, asked = problem.gains, problem.performance
    assert gains is not None
    agent, L = problem.agent(), np.asarray(problem.graph().laplacian, dtype=float)
    A, B, C = agent.lure.A, agent.lure.B, agent.lure.C
    N, n, m = len(L), len(A), B.shape[1]
    n_C = gains[0].A.shape[0] if gains[0].A.size else 0
    blocks = [np.atleast_2d(np.asarray(getattr(gains[0], letter), dtype=float)) for letter in "ABCD"]
    A_C, B_C, C_C, D_C = (
        blocks if n_C else [np.zeros((0, 0)), np.zeros((0, len(C))), np.zeros((m, 0)), blocks[3]]
    )
    I = np.eye(N)
    a = np.block([
        [np.kron(I, A) + np.kron(L, B @ D_C @ C), np.kron(I, B @ C_C)],
        [np.kron(L, B_C @ C), np.kron(I, A_C)],
    ])  # fmt: skip
    scale = asked.outputs if len(asked.outputs) else np.zeros(len(C))
    states = asked.states if len(asked.states) else np.ones(n)
    b = np.block([
        [np.kron(I, np.diag(states)), np.kron(L, B @ D_C @ np.diag(scale))],
        [np.zeros((N * n_C, N * n)), np.kron(L, B_C @ np.diag(scale))],
    ])  # fmt: skip
    across = np.linalg.svd(np.ones((1, N)))[2][1:].T
    b = b @ np.block([
        [np.kron(across, np.eye(n)), np.zeros((N * n, (N - 1) * len(C)))],
        [np.zeros((N * len(C), (N - 1) * n)), np.kron(across, np.eye(len(C)))],
    ])  # fmt: skip
    W = asked.W if len(asked.W) else np.zeros((m, m))
    root = np.linalg.cholesky(W + 1e-15 * np.eye(m)).T
    P = across @ across.T
    c = np.block([
        [np.kron(P, np.linalg.cholesky(asked.R).T), np.zeros((N * n, N * n_C))],
        [np.zeros((N * n_C, N * n)), np.kron(I, np.linalg.cholesky(asked.Q).T if n_C else np.zeros((0, 0)))],
        [np.kron(L, root @ D_C @ C), np.kron(I, root @ C_C)],
    ])  # fmt: skip
    d = np.zeros((len(c), b.shape[1]))
    d[N * (n + n_C) :, :] = (
        np.hstack([np.zeros((N * m, N * n)), np.kron(L, root @ D_C @ np.diag(scale))])
        @ np.block([
            [np.kron(across, np.eye(n)), np.zeros((N * n, (N - 1) * len(C)))],
            [np.zeros((N * len(C), (N - 1) * n)), np.kron(across, np.eye(len(C)))],
        ])
    )  # fmt: skip
    # The mean of the states is not controlled and not seen: a little damping of it changes nothing that is.
    mean = np.kron(np.ones((N, N)) / N, np.eye(n))
    a[: N * n, : N * n] -= 10.0 * mean
    grid = np.concatenate([[0.0], np.geomspace(1e-3, 1e3, 3000)])
    return max(
        float(np.linalg.norm(c @ np.linalg.solve(1j * w * np.eye(len(a)) - a, b) + d, 2)) for w in grid
    )


ASKED = [
    "",
    "weights = { input = 0.3 }",
    "weights = { input = 0.3 }\ndisturbances = { outputs = 0.2 }",
    "disturbances = { outputs = { y2 = 0.5 }, states = { v = 2.0 } }",
]


@pytest.mark.parametrize("asked", ASKED)
@pytest.mark.parametrize("gains", [STATIC, DYNAMIC])
def test_rho_of_linear_agents_is_the_norm_of_the_loop(gains: str, asked: str) -> None:
    problem = pendulums(gains, asked=asked)
    found, norm = design(problem).certificate, norm_of_loop(problem)
    assert found is not None
    assert norm <= found.rho <= 1.005 * norm


@pytest.mark.slow
@pytest.mark.parametrize("asked", ASKED)
def test_the_sampled_rho_tends_to_the_continuous_one(asked: str) -> None:
    problem = pendulums(DYNAMIC, period=1e-3, asked=asked)
    stored, norm = shipped(problem), norm_of_loop(problem)
    rho = stored.claims.sampled.rho
    assert rho is not None
    assert norm <= rho <= 1.02 * norm
    assert certify(stored).ok


def test_a_rho_that_leaves_the_weight_of_u_out_is_refused() -> None:
    """The certificate of the loop without it, under a problem that weighs u."""
    without = json.loads(json.dumps(design_file_of(design(pendulums())).document()))
    asked = pendulums(asked="weights = { input = 3.0 }").document()
    without["problem"]["design"] = {k: v for k, v in asked["design"].items() if k != "gains"}
    assert not certify(parse(without, "memory")).ok


def test_the_decay_is_the_linear_one_and_more_is_refused() -> None:
    problem = pendulums(DYNAMIC)
    stored = design_file_of(design(problem))
    network = network_of(problem, proved_bound(problem))
    slowest = -np.linalg.eigvals(network.loop(1).A_cl(stored.gains.blocks)).real.max()
    decay = stored.claims.decay
    assert decay is not None
    assert 0.9 * slowest <= decay <= slowest
    for factor, ok in ((1.0, True), (0.999, True), (1.2, False)):
        claims = dataclasses.replace(stored.claims, decay=factor * decay)
        assert certify(dataclasses.replace(stored, claims=claims)).ok == ok


def test_the_decay_holds_for_every_slope() -> None:
    """Of sin with a slope up to 1.5: no constant slope within is slower."""
    problem = pendulums(slope=1.5)
    stored, bound = design_file_of(design(problem)), proved_bound(problem)
    network = network_of(problem, bound)
    loop, K = network.loop(0), stored.gains.blocks
    lure = network.plant
    rates = []
    for slope in np.linspace(-bound.alpha, bound.alpha, 41):
        phi = np.kron(np.eye(2), lure.G @ (slope * lure.H))
        rates.append(-np.linalg.eigvals(loop.A_cl(K) + phi).real.max())
    decay = stored.claims.decay
    assert decay is not None
    assert 0 < decay <= min(rates)
    assert claim_of(problem, bound).alpha == bound.alpha


def test_a_decay_that_is_asked_for_and_not_there_is_refused() -> None:
    with pytest.raises(NotCertified, match="decay asks for 5 1/s"):
        design(pendulums(asked="decay = 5.0"))


def test_controllers_that_are_not_stable_by_themselves() -> None:
    """Of one agent: were all of them, their mean, of which no message tells, would grow."""
    unstable = DYNAMIC.replace("A = [[-3.0]]", "A = [[0.05]]") + ", " + DYNAMIC + ", " + DYNAMIC
    stored = design_file_of(design(pendulums(unstable)))
    assert not stored.claims.controllers_stable
    better = dataclasses.replace(stored, claims=dataclasses.replace(stored.claims, controllers_stable=True))
    assert not certify(better).ok
    with pytest.raises(NotCertified, match=r"that of agent 1 is not"):
        design(pendulums(unstable, asked="stable_controllers = true"))
    assert design_file_of(
        design(pendulums(DYNAMIC, asked="stable_controllers = true"))
    ).claims.controllers_stable


def test_stability_is_decided_exactly() -> None:
    """Against eigenvalues, and where these cannot tell: a pole on the edge."""
    generator = np.random.default_rng(0)
    for _ in range(100):
        A = generator.standard_normal((4, 4)) - generator.uniform(0, 3) * np.eye(4)
        assert is_stable(A) == (np.linalg.eigvals(A).real.max() < 0)
        M = generator.uniform(0.2, 1) * generator.standard_normal((4, 4))
        assert is_stable_step(M) == (np.abs(np.linalg.eigvals(M)).max() < 1)
    edge = np.array([[0.0, 1.0], [-1.0, 0.0]])
    assert not is_stable(edge)
    assert not is_stable_step(edge)
    assert is_stable(edge - 2.0**-50 * np.eye(2))
    assert is_stable_step((1 - 2.0**-50) * edge)


@pytest.mark.slow
def test_a_larger_radius_is_refused() -> None:
    stored = with_springs()
    radius = stored.claims.sampled.radius
    assert radius is not None
    assert certify(stored).ok
    for factor in (0.9, 1.3):
        claims = stored.claims
        sampled = dataclasses.replace(claims.sampled, radius=factor * radius)
        changed = dataclasses.replace(stored, claims=dataclasses.replace(claims, sampled=sampled))
        assert certify(changed).ok == (factor < 1)


@pytest.mark.parametrize("slope", [-1.0, 0.0, 1.0])
def test_no_input_meets_its_limit_from_within_the_radius(slope: float) -> None:
    """By the worst direction at every step, for phi = slope x, whose bound is that of slope sin; the limit 2 is nearer."""
    stored = with_springs()
    radius = stored.claims.sampled.radius
    assert radius is not None
    network = sampled_network(stored)
    plant = dataclasses.replace(
        network.plant, A=network.plant.A + exactly(np.array([[0.0, 0.0], [slope, 0.0]]))
    )
    linear = dataclasses.replace(network, plant=plant, alpha=0.0)
    loop = in_doubles(linear, sampled_controllers(stored, 0.01))
    one = period_in_doubles(loop)
    assert one is not None
    step, rows = _step_of_state(loop, one), loop.computed[:, : loop.n_x]
    unit = np.linalg.inv(np.linalg.cholesky(np.kron(np.asarray(loop.network.d.S), np.eye(2)))).T
    x_cl, worst = np.eye(loop.n_x)[:, : loop.n_d] @ unit, 0.0
    for _ in range(2000):
        worst = max(worst, float(np.linalg.norm(rows @ x_cl, axis=1).max()))
        x_cl = step @ x_cl
    assert radius * worst <= 2.0
    assert radius * worst >= 1.0, "the bound is within a factor of 2 of what some slope does"


@pytest.mark.slow
def test_the_radius_counts_what_underflow_adds_to_messages_and_to_u() -> None:
    """The largest radius a witness proves, from the equations, in doubles: no more is, and less by 2e-9 is.

    With an underflow of 2^-26 in place of 2^-150, and edges of weight 1/2, so that products with it may underflow.
    """
    text = re.sub(
        r"edges = .*", "edges = [[1, 2, 0.5], [2, 3, 0.5], [3, 1, 0.5]]", pendulums(DYNAMIC, slope=1.0).toml()
    )
    stored = shipped(Problem.parse(text))
    witness, network = stored.proofs.radius, sampled_network(stored)
    assert witness is not None
    witness = dataclasses.replace(witness, kappa=1e-4 * witness.kappa, kappa_mu=1e-6 * witness.kappa_mu)
    toy = Precision(2.0**-24, 2.0**-26)
    held = tuple(dataclasses.replace(one, precision=toy) for one in sampled_controllers(stored, 0.01))
    loop = in_doubles(network, held)
    n_d, q, limit = loop.n_d, 2, 2.0
    P_inverse = np.linalg.inv(witness.P)
    nu = [np.sqrt(q) * 2 * toy.underflow * np.sqrt(len(one.sources)) for one in held]
    mu = [2 * one.table.shape[1] * np.sqrt(len(one.table)) * toy.underflow for one in held]
    e = witness.kappa * np.dot(nu, nu) + witness.kappa_mu * np.dot(mu, mu)

    def largest(e: float, nu_counts: bool) -> float:
        levels = []
        for i, row in enumerate(loop.computed):
            g = np.sqrt(row[: loop.n_x] @ P_inverse @ row[: loop.n_x])
            for way in loop.ways:
                if way.agent == i and way.letter in "CD":
                    Y = way.Y[:, : loop.n_x]
                    g += way.delta * np.sqrt(np.trace(Y @ P_inverse @ Y.T))
            D = held[i].table[1:, 1:]
            through = (np.linalg.norm(D) * np.sqrt(len(held[i].sources)) + held[i].deltas["D"]) * nu[i]
            levels.append((limit - mu[i] - nu_counts * through) / g)
        c = min(levels) ** 2 - e / (1 - witness.decay)
        D = np.kron(np.asarray(loop.network.d.S, dtype=float), np.eye(2))
        return float(np.sqrt(c / np.linalg.eigvals(np.linalg.solve(D, witness.P[:n_d, :n_d])).real.max()))

    exact, limits = sampled_loop(network, held), np.array([limit])
    most, loose = largest(e, True), largest(witness.kappa_mu * np.dot(mu, mu), False)
    assert min(loose, largest(e, False)) > (1 + 1e-8) * most, "what nu does is seen, in V and in u"
    assert proves_radius(exact, witness, limits, (1 - 2e-9) * most)
    assert not proves_radius(exact, witness, limits, (1 + 2e-9) * most)


def test_what_the_checker_reads_of_limits_weights_and_disturbances() -> None:
    """From the file alone: nothing there that is no table, a key or a value of another kind."""
    content = pendulums(DYNAMIC).document()
    for table, key, value in (
        ("agent", "limits", []),
        ("agent", "limits", {"w": [-1.0, 1.0]}),
        ("agent", "limits", {"u": [0.5, 1.0]}),
        ("agent", "limits", {"u": 1.0}),
        ("design", "weights", {"state": 1.0, "controller": 1.0, "inputs": 1.0}),
        ("design", "weights", {"state": 1.0, "controller": 1.0, "input": False}),
        ("design", "disturbances", []),
        ("design", "disturbances", {"states": False}),
    ):
        with pytest.raises(ProblemError):
            ProblemTables.from_document({**content, table: {**content[table], key: value}})
    none = {**content, "design": {**content["design"], "disturbances": {"states": 0.0, "outputs": {}}}}
    found = ProblemTables.from_document(none).performance
    assert (found.states.tolist(), found.outputs.tolist()) == ([0.0, 0.0], [0.0, 0.0])


@pytest.mark.parametrize(
    "asked", [{"decay": "2"}, {"decay": True}, {"stable_controllers": "no"}, {"stable_controllers": 1}]
)
def test_what_is_asked_for_is_of_its_kind(asked: dict[str, object]) -> None:
    stored = design_file_of(design(pendulums(DYNAMIC)))
    units = ProblemTables.from_document(stored.problem.document()).gain_units
    with pytest.raises(ProblemError, match=next(iter(asked))):
        list(shortfalls(asked, stored.claims, stored.gains, units))


def test_a_radius_without_limits_is_not_proved() -> None:
    content = json.loads(json.dumps(with_springs().document()))
    del content["problem"]["agent"]["limits"]
    assert not certify(parse(content, "memory")).ok


def test_limits_that_are_none() -> None:
    with pytest.raises(ProblemError, match="`w` is no input"):
        Problem.parse(pendulums().toml().replace("u = [-3.0, 2.0]", "w = [-3.0, 2.0]"))
    with pytest.raises(ProblemError, match="a range around 0"):
        Problem.parse(pendulums().toml().replace("u = [-3.0, 2.0]", "u = [0.5, 2.0]"))
    with pytest.raises(ProblemError, match="a lower below an upper end"):
        Problem.parse(pendulums().toml().replace("u = [-3.0, 2.0]", "u = [3.0, -2.0]"))


@pytest.mark.slow
def test_a_floor_is_of_its_own_disturbances() -> None:
    """A hundredth of the disturbance has a hundredth of the gain and of the floor: that of the whole one is none of it."""
    found = design_file_of(design(pendulums()))
    searched = pendulums().toml().replace('method = "given"', 'method = "certified"\norder = 0\nstarts = 1')
    searched = searched[: searched.index("[[design.gains]]")] + searched[searched.index("[controller]") :]
    whole = design(Problem.parse(searched))
    assert whole.floor is not None
    small = searched.replace("starts = 1", "starts = 1\ndisturbances = { states = 0.01 }")
    part = design(Problem.parse(small))
    assert part.floor is not None
    assert part.floor.rho == pytest.approx(
        whole.floor.rho / 100, rel=5e-3
    )  # as far as the search for it goes
    assert part.certificate is not None
    assert part.certificate.rho < whole.floor.rho
    assert found.claims.floor is None
    for floor in (whole.floor, dataclasses.replace(whole.floor, slopes=None)):
        with_floor = dataclasses.replace(
            design_file_of(part),
            claims=dataclasses.replace(design_file_of(part).claims, floor=floor.rho),
            proofs=dataclasses.replace(design_file_of(part).proofs, floor=floor),
        )
        assert not certify(with_floor).ok
