"""The frequency response of the linearised loop, from xi_d in the scales of rho to z, both in orthonormal coordinates.

Continuous controllers: z = W (j omega I - A_cl)^-1 E xi_d with (15) and W'W = diag(S (x) R, I (x) Q) and, of u, I (x) W.

Sampled ones: with xi_d = v exp(j omega t), one period takes (x_d, x_C) at t_k to

    x_d+ = e^(A T) x_d + int e^(A s) ds B u + Gamma v,   Gamma = (A - j omega I)^-1 (e^(A T) - e^(j omega T) I),

and x_C+, u as the controllers compute them; so z = W (e^(j omega T) I - M)^-1 [Gamma; 0] v at the samples. In between,
x_d hardly moves: its square there is off by some (omega T)^2 / 12 of itself, and what aliases is not counted.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from jaxtyping import Complex, Float

from lockstep.check.continuous.inequality import Performance
from lockstep.check.sampled.controller import HeldController, SampledNetwork
from lockstep.check.sampled.loop import sampled_loop
from lockstep.check.system.loop import Gains, build_loop
from lockstep.model.graphs.orthonormal import orthonormal_factor
from lockstep.model.network import Network

Transfer = Callable[[float], Complex[np.ndarray, "n_z n_d"]]
Response = Callable[[Float[np.ndarray, "n n"]], Transfer]
"""From the agents' A at an operating point, and from a frequency in rad/s."""


def continuous_response(network: Network, gains: Gains, weights: Performance) -> Response:
    """Return the response of the loop with continuous controllers."""
    base = network.loop(gains.order)
    W, back = _weighing(network, weights, base.n_x)
    inputs = [block[gains.order :] @ Y for block, Y in zip(gains.blocks, base.Y, strict=True)]
    W = np.vstack([W, *(_root(weights.W) @ rows for rows in inputs)]) if len(weights.W) else W

    def response(A: Float[np.ndarray, "n n"]) -> Transfer:
        loop = build_loop(replace(network.plant, A=A), base.d, gains.order)
        A_cl, E = loop.A_cl(gains.blocks), loop.E @ back
        return lambda omega: np.asarray(W @ np.linalg.solve(1j * omega * np.eye(len(A_cl)) - A_cl, E))

    return response


def sampled_response(
    network: Network, controllers: tuple[HeldController, ...], weights: Performance, period: float, delay: int
) -> Response:
    """Return the response of the loop with sampled controllers, at the sampling instants."""
    from scipy.linalg import expm

    # alpha has no part in the linear loop
    described = SampledNetwork(network.plant, network.loop(controllers[0].order).d, 0.0, period, delay)
    loop = sampled_loop(described, controllers)
    n_d, n_x, copies = loop.n_d, loop.n_x, np.eye(network.N - 1)
    W, back = _weighing(network, weights, n_x)
    if len(weights.W):
        W = np.vstack([W, np.kron(np.eye(network.N), _root(weights.W)) @ loop.applied[:, :n_x]])
    held, advanced = loop.held[:, :n_x], loop.advanced[:, :n_x]

    def response(A: Float[np.ndarray, "n n"]) -> Transfer:
        A_, B_ = np.kron(copies, A), np.kron(copies, loop.into)
        both = np.block([[A_, B_], [np.zeros((B_.shape[1], n_d + B_.shape[1]))]])
        step = expm(both * period)
        M = np.vstack([step[:n_d, :n_d] @ np.eye(n_d, n_x) + step[:n_d, n_d:] @ held, advanced])

        def transfer(omega: float) -> Complex[np.ndarray, "n_z n_d"]:
            turn = np.exp(1j * omega * period)
            Gamma = np.linalg.solve(A_ - 1j * omega * np.eye(n_d), step[:n_d, :n_d] - turn * np.eye(n_d))
            entering = np.vstack([Gamma @ back, np.zeros((n_x - n_d, n_d))])
            return np.asarray(W @ np.linalg.solve(turn * np.eye(n_x) - M, entering))

        return transfer

    return response


def _weighing(
    network: Network, weights: Performance, width: int
) -> tuple[Float[np.ndarray, "n_z width"], Float[np.ndarray, "n_d n_d"]]:
    """W with |W (x_d, x_C, ...)| = |z| but for u, and the map from orthonormal xi_d, in the scales of rho, to the loop's."""
    n, N = network.agent.n, network.N
    F = np.kron(orthonormal_factor(network.loop(0).d), np.eye(n))
    R, Q = np.kron(np.eye(N - 1), _root(weights.R)) @ F, np.kron(np.eye(N), _root(weights.Q))
    W = np.zeros((len(R) + len(Q), width))
    W[: len(R), : len(F)] = R
    W[len(R) :, len(F) : len(F) + len(Q)] = Q
    scales = weights.states if len(weights.states) else np.ones(n)
    return W, np.linalg.inv(F) @ np.kron(np.eye(N - 1), np.diag(scales))


def _root(weight: Float[np.ndarray, "k k"]) -> Float[np.ndarray, "k k"]:
    """A factor with root' root = weight, which may be singular."""
    values, vectors = np.linalg.eigh(weight)
    return np.asarray(np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T)
