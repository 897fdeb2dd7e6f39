"""Networks with a local certificate behind a leader, and runs that start in a set of initial disagreements."""

import numpy as np
import pytest

from lockstep.check.continuous.inequality import Certificate, Claim
from lockstep.check.continuous.initial_set import InitialSet
from lockstep.check.numbers import as_floats
from lockstep.check.system.disagreement import disagreement
from lockstep.check.system.loop import Gains
from lockstep.lmi.analysis.rounding import prove
from lockstep.lmi.scope import initial_states
from lockstep.model.agents.agent import Agent
from lockstep.model.assembly import bound_of
from lockstep.model.graphs.graph import Graph
from lockstep.model.network import Network

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


def claim_of(net: Network) -> Claim:
    return Claim(bound_of(net.agent).alpha, np.eye(2), np.eye(ORDER), np.zeros((N, 4)))


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
