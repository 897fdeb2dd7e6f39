"""The loop (12) with Delta(t) as it is integrated, compiled by CasADi; the agents alone are `Network.agents_alone`.

States are stacked agent by agent, x first and x_C behind: X = (x_1, ..., x_N, x_C1, ..., x_CN). What changes with
time besides X is one vector p: the held inputs and xi for the agents alone, xi and the gains K(t) for the loop.
"""

import casadi as ca
import numpy as np
from jaxtyping import Float

from lockstep.check.system.loop import Gains
from lockstep.model.network import Network, pinned_at_mean


def closed_loop(
    network: Network, gains: Gains, *, perturbed: bool = False, pinned: bool = False
) -> ca.Function:
    """Return (X, t, p) -> dX of (12), p = xi, or p = (xi, Delta) with Delta row by row if `perturbed`."""
    n, m, q, N, n_C = network.agent.n, network.agent.m, network.agent.q, network.N, gains.order
    x, x_C, xi = ca.SX.sym("x", n, N), ca.SX.sym("x_C", n_C, N), ca.SX.sym("xi", n, N)
    t = ca.SX.sym("t")
    # SX.reshape fills columns first: one column of `errors` holds one agent's block, transposed.
    errors = ca.SX.sym("Delta", (n_C + m) * (n_C + q), N) if perturbed else None
    r = ca.mtimes([ca.DM(network.agent.lure.C), x, ca.DM(network.graph.laplacian.T)])
    drift, dx, dx_C = network.drift(), [], []
    for i in range(N):
        K = ca.SX(ca.DM(gains.blocks[i]))
        if errors is not None:
            K += ca.reshape(errors[:, i], n_C + q, n_C + m).T
        # An empty slice of an SX is not empty: a static controller needs the split.
        ahead, u = ca.vertsplit(K @ ca.vertcat(x_C[:, i], r[:, i]), [0, n_C, n_C + m])
        dx.append(drift(x[:, i], t) + ca.DM(network.B[i]) @ u + xi[:, i])
        dx_C.append(ahead)
    dx = pinned_at_mean(dx) if pinned else dx
    p = ca.vec(xi) if errors is None else ca.vertcat(ca.vec(xi), ca.vec(errors))
    X = ca.vertcat(ca.vec(x), ca.vec(x_C))
    return ca.Function("loop", [X, t, p], [ca.vertcat(*dx, *dx_C)], ["X", "t", "p"], ["dX"])


def inputs_of(
    network: Network,
    x: Float[np.ndarray, "K N n"],
    x_C: Float[np.ndarray, "K N n_C"],
    blocks: Float[np.ndarray, "K N k l"],
) -> Float[np.ndarray, "K N m"]:
    """Return u_i = (C_C + Delta C_C) x_C + (D_C + Delta D_C) r_i of (9), for gains given at each instant."""
    r = np.einsum("ij,qn,kjn->kiq", network.graph.laplacian, network.agent.lure.C, x, optimize=True)
    heard = np.concatenate([x_C, r], axis=2)
    return np.asarray(np.einsum("kiab,kib->kia", blocks[:, :, x_C.shape[2] :], heard))
