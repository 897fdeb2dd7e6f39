"""What the C of a campaign evaluates, as CasADi expressions: slopes, costs, disagreements.

X' of (2) with (9), Delta of (11) included; |z|^2 and |xi_d|^2 in the coordinates of the certificate.
"""

import casadi as ca
import numpy as np
from jaxtyping import Float

from lockstep.campaign.compiled.statements import DOUBLE, LaneFunction, lane_function
from lockstep.check.continuous.inequality import LETTERS, Performance
from lockstep.check.numbers import as_floats
from lockstep.check.system.loop import Gains
from lockstep.model.network import Network


def continuous_functions(
    network: Network, gains: Gains, weights: Performance, letters: tuple[str, ...]
) -> list[LaneFunction]:
    """slope(X, t, xi[, delta, turn]) -> (X', |z|^2, u) with X = (x, x_C) and K + Delta(t) in the place of K."""
    N, n, n_C = network.N, network.agent.n, gains.order
    x, x_C, xi = ca.SX.sym("x", n, N), ca.SX.sym("x_C", n_C, N), ca.SX.sym("xi", n, N)
    t, turn = ca.SX.sym("t"), ca.SX.sym("turn", 2)
    sizes = {letter: getattr(gains, letter)[0].shape for letter in letters}
    count = N * sum(int(np.prod(shape)) for shape in sizes.values())
    E = ca.SX.sym("E", 2 * count)
    error = turn[0] * E[:count] + turn[1] * E[count:]
    blocks, place = [], 0
    for i in range(N):
        block = {letter: ca.SX(ca.DM(getattr(gains, letter)[i])) for letter in LETTERS}
        for letter, shape in sizes.items():
            size = int(np.prod(shape))
            # Row by row, as NumPy ravels.
            block[letter] = block[letter] + ca.reshape(error[place : place + size], shape[1], shape[0]).T
            place += size
        blocks.append(block)
    r = ca.mtimes([ca.DM(network.agent.lure.C), x, ca.DM(network.graph.laplacian.T)])
    u = [K["C"] @ x_C[:, i] + K["D"] @ r[:, i] for i, K in enumerate(blocks)]
    dx_C = [K["A"] @ x_C[:, i] + K["B"] @ r[:, i] for i, K in enumerate(blocks)]
    slope = ca.vertcat(plant_slope(network, x, u, t, xi), *dx_C)
    cost = on_disagreement(network, x, weights.R) + on_controllers(x_C, weights.Q)
    cost += on_inputs(ca.horzcat(*u), weights.W)
    inputs, names = [ca.vertcat(ca.vec(x), ca.vec(x_C)), t, ca.vec(xi)], "x t xi"
    if letters:
        inputs, names = [*inputs, E, turn], f"{names} delta turned"
    return [lane_function("slope", inputs, [slope, cost, ca.vertcat(*u)], f"{names} dx z u")]


def sampled_functions(network: Network, weights: Performance) -> list[LaneFunction]:
    """slope(x, u, t, xi) -> (x', |x_d|^2 and |u|^2 weighed), measure(x) -> y, cost_of(x_C) -> x_C' Q x_C."""
    N, n, m = network.N, network.agent.n, network.agent.m
    x, u, xi, t = ca.SX.sym("x", n, N), ca.SX.sym("u", m, N), ca.SX.sym("xi", n, N), ca.SX.sym("t")
    slope = plant_slope(network, x, ca.horzsplit(u), t, xi)
    cost = on_disagreement(network, x, weights.R) + on_inputs(u, weights.W)
    y = ca.vec(ca.DM(network.agent.lure.C) @ x)
    inputs = [ca.vec(x), ca.vec(u), t, ca.vec(xi)]
    return [
        lane_function("slope", inputs, [slope, cost], "x u t xi dx z"),
        lane_function("measure", [ca.vec(x)], [y], "x y"),
    ]


def plant_slope(network: Network, x: ca.SX, u: list[ca.SX], t: ca.SX, xi: ca.SX) -> ca.SX:
    """x' of all agents, one below the other."""
    drift = network.drift()
    return ca.vertcat(*[drift(x[:, i], t) + ca.DM(network.B[i]) @ u[i] + xi[:, i] for i in range(network.N)])


def on_disagreement(network: Network, x: ca.SX, R: Float[np.ndarray, "n n"]) -> ca.SX:
    """x_d' (S (x) R) x_d: in orthonormal coordinates sum_i e_i' R e_i with e_i = x_i - mean."""
    if network.coordinates == "orthonormal":
        rows = _errors(x)
    else:
        d = network.loop(0).d
        rows = ca.horzsplit(x @ ca.DM(as_floats(d.T)).T)
    return sum((ca.dot(row, ca.DM(R) @ row) for row in rows), start=ca.SX(0))


def on_controllers(x_C: ca.SX, Q: Float[np.ndarray, "n_C n_C"]) -> ca.SX:
    """sum_i x_Ci' Q x_Ci."""
    if x_C.shape[0] == 0:
        return ca.SX(0)
    return sum((ca.dot(one, ca.DM(Q) @ one) for one in ca.horzsplit(x_C)), start=ca.SX(0))


def on_inputs(u: ca.SX, W: Float[np.ndarray, "m m"]) -> ca.SX:
    """sum_i u_i' W u_i, 0 where u weighs nothing."""
    return on_controllers(u, W) if len(W) else ca.SX(0)


def in_scales(xi: ca.SX, weights: Performance) -> ca.SX:
    """xi in units of the scales that rho is measured with, 0 where it is no gain from a state."""
    s = weights.states
    return ca.diag(ca.DM(np.divide(1.0, s, out=np.zeros_like(s), where=s > 0))) @ xi if len(s) else xi


def cost_expression(Q: Float[np.ndarray, "n_C n_C"]) -> str:
    """x' Q x as a C expression of one controller's memory."""
    terms = [
        f"{DOUBLE.literal(value)} * ((double)x[{a}] * (double)x[{b}])"
        for (a, b), value in np.ndenumerate(Q)
        if value
    ]
    return " + ".join(terms) or "0.0"


def _errors(x: ca.SX) -> list[ca.SX]:
    mean = ca.sum2(x) / x.shape[1]
    return [one - mean for one in ca.horzsplit(x)]


def monitors(network: Network, weights: Performance) -> list[LaneFunction]:
    """errors(x) -> |e_i|^2, differences(xi) -> |xi_d|^2 in scales, strays(x) -> 1 where an agent is out of its domain."""
    x = ca.SX.sym("x", network.agent.n, network.N)
    each = ca.vertcat(*[ca.sumsqr(e) for e in _errors(x)])
    entered = on_disagreement(network, in_scales(x, weights), np.eye(network.agent.n))
    return [
        lane_function("errors", [ca.vec(x)], [each], "x e"),
        lane_function("differences", [ca.vec(x)], [entered], "xi w"),
        lane_function("strays", [ca.vec(x)], [strays(network, x)], "x out"),
    ]


def strays(network: Network, x: ca.SX) -> ca.SX:
    """1 where an agent is out of its domain, else 0."""
    out = ca.SX(0)
    for k, (low, high) in enumerate(network.agent.box):
        for i in range(network.N):
            if np.isfinite(low):
                out = ca.logic_or(out, x[k, i] < low)
            if np.isfinite(high):
                out = ca.logic_or(out, x[k, i] > high)
    return out
