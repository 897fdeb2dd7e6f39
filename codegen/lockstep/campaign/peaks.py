"""Where the linearised loop amplifies most: operating points, frequencies and directions to disturb a campaign's runs in.

At a common state x_i = c of all agents, which a common disturbance -drift(c) holds and which costs nothing, for it is no
part of xi_d, small disagreements obey the loop with A_c = d drift/dx (c) in the place of A. The largest singular value of
the response from xi_d to z, over the frequency omega, is the least rho of that loop, its right singular vector the
direction to disturb in. These are guesses of where a run comes near rho; nothing rests on them.
"""

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np
from jaxtyping import Complex, Float

from lockstep.campaign.frequency_response import Response
from lockstep.check.continuous.inequality import Performance
from lockstep.check.numbers import as_floats
from lockstep.model.agents.state_sizes import middle
from lockstep.model.graphs.orthonormal import orthonormal_factor
from lockstep.model.network import Network

REACH = np.pi
"""Operating points are within this of 0 in every state, or of the middle of a domain without 0, and in the domain: all slopes
of a sine are met."""

GRID = 200
DIGITS = 6
"""What linear algebra may differ in from machine to machine is rounded away: a campaign is resumed by its numbers."""


@dataclass(frozen=True, eq=False)
class Peak:
    """One operating point: the common state c (n,), the disturbance -drift(c) that holds it, and the peak there.

    gain: the largest singular value;  omega: at which frequency, in rad/s;  direction: (N, n), complex, of unit length
    in xi_d, in the scales of rho: xi(t) = Re(direction exp(j omega t)).
    """

    point: Float[np.ndarray, " n"]
    hold: Float[np.ndarray, " n"]
    gain: float
    omega: float
    direction: Complex[np.ndarray, "N n"]


def peaks(
    network: Network, response: Response, weights: Performance, *, count: int, seed: int = 0
) -> tuple[Peak, ...]:
    """Return the peaks at 0, or in the middle of a domain without it, and at random operating points: `count` in all."""
    agent = network.agent
    x, t = ca.SX.sym("x", agent.n), ca.SX.sym("t")
    drift = network.drift()
    slope = ca.Function("slope", [x, t], [ca.jacobian(drift(x, t), x), drift(x, t)])
    about = middle(agent)
    low, high = about + np.clip(agent.box.T - about, -REACH, REACH)
    random = np.random.default_rng(seed)
    points = [about, *random.uniform(low, high, (max(count - 1, 0), agent.n))]
    scales = weights.states if len(weights.states) else np.ones(agent.n)
    return tuple(_peak(network, response, slope, np.round(point, DIGITS), scales) for point in points[:count])


def _peak(
    network: Network,
    response: Response,
    slope: ca.Function,
    point: Float[np.ndarray, " n"],
    scales: Float[np.ndarray, " n"],
) -> Peak:
    A, rate = (np.array(value) for value in slope(point, 0.0))
    transfer = response(A)

    def gain(omega: float) -> float:
        return float(np.linalg.svd(transfer(omega), compute_uv=False)[0])

    omega = _best_frequency(gain, float(np.abs(np.linalg.eigvals(A)).max()))
    _, values, right = np.linalg.svd(transfer(omega))
    direction = scales * _on_agents(network, right[0].conj())
    return Peak(point, np.round(-rate.ravel(), DIGITS), round(float(values[0]), DIGITS), omega, direction)


def _on_agents(network: Network, xi_d: Complex[np.ndarray, " n_d"]) -> Complex[np.ndarray, "N n"]:
    """Return the shortest xi with the disagreement xi_d, in orthonormal coordinates: it has no common part.

    The phase is fixed by the largest entry, which becomes real.
    """
    d = network.loop(0).d
    back = np.linalg.pinv(orthonormal_factor(d) @ as_floats(d.T))
    direction = back @ xi_d.reshape(network.N - 1, -1)
    largest = direction.ravel()[int(np.argmax(np.abs(direction)))]
    return np.asarray(np.round(direction * (np.abs(largest) / largest), DIGITS))


def _best_frequency(gain: Callable[[float], float], fastest: float) -> float:
    """The frequency of the largest gain: of a grid around the agent's poles, then between its neighbours."""
    from scipy.optimize import minimize_scalar

    fastest = max(fastest, 1e-3)
    grid = np.geomspace(1e-3 * fastest, 30 * fastest, GRID)
    best = int(np.argmax([gain(omega) for omega in grid]))
    low, high = np.log(grid[max(best - 1, 0)]), np.log(grid[min(best + 1, GRID - 1)])
    found = minimize_scalar(lambda log: -gain(float(np.exp(log))), bounds=(low, high), method="bounded")
    return float(f"{np.exp(found.x):.{DIGITS}g}")
