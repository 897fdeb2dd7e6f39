"""A network: agents with one dynamics and inputs of their own, on a graph, in disagreement coordinates.

`Network.loop` gives the matrices of (15); `Network.closed_loop` gives (12) itself, symbolic and nonlinear,
for simulation and for checking that the two are the same system.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from jaxtyping import Float

from lockstep.check.errors import demand
from lockstep.check.numbers import exactly
from lockstep.check.system.disagreement import Coordinates
from lockstep.check.system.loop import Gains, Loop, Plant
from lockstep.check.system.network import ExactNetwork
from lockstep.model.agents.agent import Agent
from lockstep.model.graphs.graph import Graph
from lockstep.model.real_numbers import reals


@dataclass(frozen=True, eq=False)
class Network:
    """N agents x_i' = A x_i + B_i u_i + G phi(H x_i, t) + offset(t) + xi_i, y_i = C x_i on a graph (2), (4).

    Args:
        agent: the dynamics all agents share; the paper's reduction to disagreements needs A, C and h common.
        graph: who listens to whom; it must have a spanning tree.
        B: the input matrix (n, m) of each agent; by default the agent's own for all.
        coordinates: "orthonormal" (default), in which lengths are (see `loop`), or "laplacian_rows" (the paper's (14)).
        spectrum: [a, b] where every connected undirected graph with its eigenvalues but 0 there is meant, `graph` being one.
        decay: of e^(decay t) x_cl, whose loop it is; see `lockstep.check.system.network.ExactNetwork`.
        scales: (D_w, D_v), the diagonals with which the bound on phi was proved: |D_w^-1 J D_v| <= alpha,
            such that G D_w and D_v^-1 H are exact in doubles (`lockstep.model.assembly.bound_of` gives such ones).
    """

    agent: Agent
    graph: Graph
    B: Sequence[Float[np.ndarray, "n m"]] = ()
    coordinates: Coordinates = "orthonormal"
    scales: tuple[tuple[float, ...], tuple[float, ...]] | None = None
    decay: float = 0.0
    spectrum: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        shape = self.agent.lure.B.shape
        B = (
            tuple(reals(b, "B", f"agent {i}") for i, b in enumerate(self.B, start=1))
            or (self.agent.lure.B,) * self.graph.N
        )
        for i, b in enumerate(B):
            found = f"`B` is {b.shape[0]} x {b.shape[1]}"
            demand(b.shape == shape, found, f"agent {i + 1}", f"{shape[0]} x {shape[1]}")
        demand(len(B) == self.N, f"{len(B)} input matrices for {self.N} agents", "network", "one B per agent")
        object.__setattr__(self, "B", B)
        if self.scales is not None:
            self._check_scales(*self.scales)
        _ = self.matrices  # which refuses what is no network

    @property
    def N(self) -> int:
        """Number of agents."""
        return self.graph.N

    @cached_property
    def plant(self) -> Plant:
        """The matrices of (2), G and H scaled as the bound was proved."""
        lure = self.agent.lure
        D_w, D_v = self.scales or ((1.0,) * lure.G.shape[1], (1.0,) * lure.H.shape[0])
        H = lure.H / np.array(D_v).reshape(-1, 1)
        return Plant(lure.A, tuple(self.B), lure.C, lure.G * np.array(D_w), H)

    @cached_property
    def matrices(self) -> ExactNetwork:
        """What the checker decides about: the plant, the graph and the coordinates, without the equations."""
        return ExactNetwork(self.plant, self.graph, self.coordinates, self.decay, self.spectrum)

    def decaying(self, decay: float) -> "Network":
        """Return the network of e^(decay t) x_cl."""
        return replace(self, decay=decay)

    def loop(self, order: int, *, exact_arithmetic: bool = False) -> Loop:
        """Return the loop (15) for controllers of an order, in doubles or in the same rationals.

        Its states are x_d = (T (x) I) x and x_C, T = `loop.d.T`. With "orthonormal" coordinates T is a rational stand-in, and
        lengths are measured with S = `loop.d.S`: x_d' (S (x) I) x_d is the square of |x - mean|.
        """
        return self.matrices.loop(order, exact_arithmetic=exact_arithmetic)

    def closed_loop(self, gains: Gains) -> ca.Function:
        """Return (12): (x, x_C, t, xi) -> (dx, dx_C, u), symbolic and nonlinear, all agents stacked.

        x: (N n,), x_C: (N n_C,), xi: (N n,) disturbances; u: (N m,) what the controllers ask for.
        """
        n, n_C, N = self.agent.n, gains.order, self.N
        x, x_C, xi = ca.SX.sym("x", n, N), ca.SX.sym("x_C", n_C, N), ca.SX.sym("xi", n, N)
        t = ca.SX.sym("t")
        r = ca.mtimes([ca.DM(self.agent.lure.C), x, ca.DM(self.graph.laplacian.T)])
        drift = self.drift()
        u = [ca.DM(gains.C[i]) @ x_C[:, i] + ca.DM(gains.D[i]) @ r[:, i] for i in range(N)]
        dx = [drift(x[:, i], t) + ca.DM(self.B[i]) @ u[i] + xi[:, i] for i in range(N)]
        dx_C = [ca.DM(gains.A[i]) @ x_C[:, i] + ca.DM(gains.B[i]) @ r[:, i] for i in range(N)]
        return ca.Function(
            "closed_loop",
            [ca.vec(x), ca.vec(x_C), t, ca.vec(xi)],
            [ca.vertcat(*dx), ca.vertcat(*dx_C), ca.vertcat(*u)],
            ["x", "x_C", "t", "xi"],
            ["dx", "dx_C", "u"],
        )

    def agents_alone(self, *, pinned: bool = False) -> ca.Function:
        """Return (X, t, p) -> dX of x_i' = A x_i + B_i u_i + G phi(H x_i, t) + offset(t) + xi_i, p = (u, xi), all stacked.

        pinned: with a disturbance common to all agents that keeps their mean where it is: see `Scenario`.
        """
        n, m, N = self.agent.n, self.agent.m, self.N
        x, u, xi, t = ca.SX.sym("x", n, N), ca.SX.sym("u", m, N), ca.SX.sym("xi", n, N), ca.SX.sym("t")
        drift = self.drift()
        dx = [drift(x[:, i], t) + ca.DM(self.B[i]) @ u[:, i] + xi[:, i] for i in range(N)]
        dx = pinned_at_mean(dx) if pinned else dx
        p = ca.vertcat(ca.vec(u), ca.vec(xi))
        return ca.Function("agents", [ca.vec(x), t, p], [ca.vertcat(*dx)], ["X", "t", "p"], ["dX"])

    def to_control(
        self, gains: Gains | None = None, *, linear: bool = False, period: float | None = None
    ) -> Any:
        """Return the network for python-control.

        Args:
            gains: of the controllers (9) that close it: inputs xi_i, outputs x_i, y_i, u_i. Without them the inputs are the
                u_i, then the xi_i, and the outputs the y_i, then the relative outputs r_i.
            linear: without phi and the offset; with gains in disagreement coordinates, orthonormal ones unless the network's
                are the rows of L: inputs xi_d and w_d in the place of phi_d, outputs x_d, v_d and u.
            period: in s, of the linear part without gains, its inputs held.
        """
        from lockstep.model.control.bridge import network_to_control

        return network_to_control(self, gains, linear=linear, period=period)

    def controllers_to_control(self, gains: Gains, **sampling: Any) -> list[Any]:
        """Return the controllers for python-control, one `control.ss` per agent, from r_i to u_i.

        Args:
            gains: continuous ones, or with `period` and no `method` those of sampled controllers.
            sampling: `period` in s, and `method` ("tustin" or "zoh") to sample continuous gains with.
        """
        from lockstep.model.control.bridge import controllers_to_control

        return controllers_to_control(self.agent, gains, **sampling)

    def _check_scales(self, D_w: Sequence[float], D_v: Sequence[float]) -> None:
        """A certificate for rounded G D_w and D_v^-1 H would be one for another agent."""
        G, H = self.agent.lure.G, self.agent.lure.H
        found = f"{len(D_w)} and {len(D_v)} scales"
        expected = f"{G.shape[1]} for phi and {H.shape[0]} for its arguments"
        demand((len(D_w), len(D_v)) == (G.shape[1], H.shape[0]), found, "network scales", expected)
        w, v = exactly(np.array(D_w, dtype=float)), exactly(np.array(D_v, dtype=float))
        plant = self.plant
        same_G, same_H = exactly(plant.G) == exactly(G) * w, exactly(plant.H) * v[:, None] == exactly(H)
        found, expected = "G D_w or D_v^-1 H is no matrix of doubles", "scales that leave both exact"
        remedy = "take them from assembly.bound_of"
        demand(same_G.all() and same_H.all(), found, "network scales", expected, remedy)

    def drift(self) -> ca.Function:
        """Return (x, t) -> A x + G phi(H x, t) + offset(t): one agent without input or disturbance."""
        lure = self.agent.lure
        x, t = ca.SX.sym("x", self.agent.n), ca.SX.sym("t")
        value = ca.DM(lure.A) @ x + ca.DM(lure.G) @ lure.phi(ca.DM(lure.H) @ x, t) + lure.offset(t)
        return ca.Function("drift", [x, t], [value], ["x", "t"], ["dx"])


def pinned_at_mean(dx: list[ca.SX]) -> list[ca.SX]:
    """Return the derivatives less their mean, which then stays where it is."""
    mean = sum(dx[1:], start=dx[0]) / len(dx)
    return [one - mean for one in dx]
