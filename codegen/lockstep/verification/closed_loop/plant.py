"""The agents themselves, stepped over one period with the inputs held: what closes the loop around the controllers.

x_i' = A x_i + B_i u_i + G phi(H x_i, t) + offset(t), all agents in one CasADi function, classical Runge-Kutta of fourth
order. It makes realistic data for comparing C with its reference; no claim rests on its accuracy.
"""

import casadi as ca
import numpy as np
from jaxtyping import Float

from lockstep.model.network import Network
from lockstep.model.simulation.integrate import runge_kutta_step

SUBSTEPS = 4
"""Runge-Kutta steps per period: at 5 ms, 1.25 ms against poles of some 10 rad/s."""


class HeldPlant:
    """N agents with state, advanced one period at a time.

    Args:
        network: the agents; only their dynamics and their B_i are used.
        start: (N, n), the states at t = 0.
        period: of the controllers, in s.
    """

    def __init__(self, network: Network, start: Float[np.ndarray, "N n"], period: float) -> None:
        self._network, self._x, self._t, self._period = network, ca.DM(np.asarray(start).T), 0.0, period
        self._advance = _advance(network, period)

    @property
    def outputs(self) -> list[Float[np.ndarray, " q"]]:
        """y_i = C x_i of each agent, now."""
        y = self._network.agent.lure.C @ np.array(self._x)
        return [y[:, i].copy() for i in range(self._network.N)]

    def __call__(self, inputs: list[Float[np.ndarray, " m"]]) -> list[Float[np.ndarray, " q"]]:
        """Hold the inputs for one period and return the outputs at its end."""
        self._x = self._advance(self._x, ca.DM(np.array(inputs, dtype=float).T), self._t)
        self._t += self._period
        return self.outputs


def _advance(network: Network, period: float) -> ca.Function:
    n, m, N = network.agent.n, network.agent.m, network.N
    x, u, t = ca.SX.sym("x", n, N), ca.SX.sym("u", m, N), ca.SX.sym("t")
    step, h = runge_kutta_step(network.agents_alone()), period / SUBSTEPS
    held, state = ca.vertcat(ca.vec(u), ca.SX.zeros(n * N)), ca.vec(x)
    for k in range(SUBSTEPS):
        state = step(state, ca.vertcat(t + k * h, h, held, held, held))
    return ca.Function("advance", [x, u, t], [ca.reshape(state, n, N)], ["x", "u", "t"], ["x_next"])
