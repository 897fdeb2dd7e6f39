"""rho of the sampled loop: the gain from the disturbances to what the design weighs, between the samples too.

    int_0^inf x_d' (S (x) R) x_d dt + T sum_k x_C(t_k)' (I (x) Q) x_C(t_k)
        <= V(xi(0)) + rho^2 int_0^inf xi_d' (S (x) I) xi_d dt + kappa sum_k (|nu_k|^2 + |mu_k|^2),

the continuous rho's weights, the controllers' states being counted at the sampling instants and held for a period, as
the controllers hold them. The disturbance is one more way into the period that is lifted, and the weighted state
one more way out:

    E E' = M^-1 (x) G G' + rho^-2 S^-1 (x) I,     F'F = M (x) alpha^2 H'H + S (x) R.

M and S do not commute, so all of x_d is lifted at once, and anew for each M and rho.
"""

import itertools
import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lockstep.lmi.sampled import balls
from lockstep.lmi.sampled.certify import first_guess, in_doubles, squares
from lockstep.lmi.sampled.conjugate import no_conjugate_point
from lockstep.lmi.sampled.controller import HeldController, Network
from lockstep.lmi.sampled.inequality import W_matrix, Witness, multiplier, step_matrix
from lockstep.lmi.sampled.lifting import Lifted, lift
from lockstep.lmi.sampled.loop import SampledLoop, sampled_loop
from lockstep.lmi.sampled.riccati import smallest_storage
from lockstep.lmi.sampled.search import Room, fitted, padded
from lockstep.model.numbers import Matrix, converter, eye, is_exact, zeros

EVALUATIONS = 40
"""Multipliers tried in the search for the least rho; those of the continuous certificate are a good start."""

HALVINGS = 14

SLACKS = (2e-3, 5e-3, 1e-2, 2e-2, 5e-2, 0.1, 0.2, 0.5)
"""How far above the least rho found the proof is tried: what rounding needs depends on the gains."""

ROOMS = tuple((a, b) for a in (1e-6, 1e-3, 1e-2, 0.1) for b in (1e-6, 1e-3, 1e-2, 0.1))
"""What is left to the rounding: parts of the decay, and of a weight of one on every state."""


@dataclass(frozen=True, eq=False)
class Weights:
    """R (n, n) of the disagreement and Q (n_C, n_C) of each controller's state, in doubles."""

    R: Float[np.ndarray, "n n"]
    Q: Float[np.ndarray, "n_C n_C"]


@dataclass(frozen=True, eq=False)
class SampledRho:
    """A rho of the sampled loop that was proved in ball arithmetic, and its witness (decay 1, no weight, no ratio)."""

    rho: float
    witness: Witness


def sampled_rho(
    network: Network,
    controllers: tuple[HeldController, ...],
    weights: Weights,
    guess: Float[np.ndarray, " pairs"] | None = None,
    *,
    improve: bool = False,
) -> SampledRho | None:
    """Find and prove a small rho; None if none is proved.

    Args:
        network: agents, coordinates, alpha, period, delay, the matrices exact.
        controllers: one per agent, with the coefficients of the code; all their rounding is covered.
        weights: R and Q.
        guess: pair weights, in their own scale: those of the continuous certificate.
        improve: look for better pair weights than those.
    """
    loop = in_doubles(network, controllers)
    m = first_guess(network.d, guess)
    if improve:
        m = _better(loop, weights, m)
    least = _least_rho(loop, weights, m)
    if least is None:
        return None
    exact_loop = sampled_loop(network, controllers)
    for slack, room in itertools.product(SLACKS, ROOMS):
        rho = float(f"{least * (1 + slack):.4g}")
        witness = _witness(loop, weights, m, rho, room)
        if witness is not None and proves_rho(exact_loop, weights, SampledRho(rho, witness)):
            return SampledRho(rho, witness)
    return None


def proves_rho(exact_loop: SampledLoop, weights: Weights, found: SampledRho) -> bool:
    """Decide in balls whether P > 0, m >= 0, t >= 0, M > 0 and W > 0, and that the period holds no conjugate point."""
    witness = found.witness
    if not witness.fits(exact_loop) or np.any(witness.m < 0) or np.any(witness.t < 0):
        return False
    if not (witness.decay == 1 and witness.weight == 0 and witness.kappa >= 0 and found.rho > 0):
        return False
    with balls.working_precision():
        M = multiplier(exact_loop.network.d, converter(True)(witness.m))
        P = converter(True)(witness.P)
        if (
            not np.array_equal(P, P.T)
            or not balls.is_positive_definite(P)
            or not balls.is_positive_definite(M)
        ):
            return False
        EE, FF = _ways(exact_loop, weights, M, found.rho)
        unit = eye(exact_loop.network.d.N - 1, M)
        if not no_conjugate_point(
            np.kron(unit, exact_loop.network.plant.A), EE, FF, exact_loop.network.period
        ):
            return False
        W = W_matrix(exact_loop, _lifted(exact_loop, EE, FF), witness, running_cost(exact_loop, weights))
        return balls.is_positive_definite(W)


def running_cost(loop: SampledLoop, weights: Weights) -> Matrix:
    """Return T x_C' (I (x) Q) x_C as a form on z."""
    number = converter(is_exact(loop.held))
    Q = number(np.array([[loop.network.period]]))[0, 0] * number(weights.Q)
    form, n_C = zeros(loop.n_z, loop.n_z, loop.held), len(weights.Q)
    for i in range(loop.network.d.N):
        place = slice(loop.n_d + i * n_C, loop.n_d + (i + 1) * n_C)
        form[place, place] = Q
    return form


def _ways(loop: SampledLoop, weights: Weights, M: Matrix, rho: float) -> tuple[Matrix, Matrix]:
    """Return E E' and F'F."""
    number, S = converter(is_exact(loop.held)), loop.network.d.S
    square = number(np.array([[rho]]))[0, 0] ** 2
    GG, HH = squares(loop)
    unit = eye(len(GG), M)
    EE = np.kron(balls.inverse(M), GG) + np.kron(balls.inverse(S), unit) / square
    return EE, np.kron(M, HH) + np.kron(S, number(weights.R))


def _lifted(loop: SampledLoop, EE: Matrix, FF: Matrix) -> Lifted:
    unit = eye(loop.network.d.N - 1, loop.held)
    A, B = np.kron(unit, loop.network.plant.A), np.kron(unit, loop.into)
    return lift(A, B, EE, FF, loop.network.period)


def _storage(
    loop: SampledLoop,
    weights: Weights,
    m: Float[np.ndarray, " pairs"],
    rho: float,
    room: tuple[float, float] = ROOMS[0],
) -> tuple[Lifted, Float[np.ndarray, "n_xi n_xi"], Float[np.ndarray, "n_xi n_xi"]] | None:
    """Return the lifted period, the smallest V for a rho and the room kept in it, or None."""
    n_xi = loop.n_xi
    try:
        lifted = _lifted(loop, *_ways(loop, weights, multiplier(loop.network.d, m), rho))
    except np.linalg.LinAlgError:
        return None
    start = loop.start[:, :n_xi]
    cost = start.T @ lifted.Q @ start + running_cost(loop, weights)[:n_xi, :n_xi]
    if not np.isfinite(cost).all() or not np.isfinite(lifted.S).all():
        return None
    # A V that decays by `spread` of itself beyond what is asked leaves that much of itself as room, in every direction.
    A = step_matrix(loop, lifted)[:, :n_xi]
    spread = room[0] * (1 - float(np.abs(np.linalg.eigvals(A)).max()) ** 2)
    if spread <= 0:
        return None
    rest = room[1] * loop.network.period * np.eye(n_xi)
    P = smallest_storage(A / np.sqrt(1 - spread), padded(loop, lifted.S), (cost + rest) / (1 - spread))
    return None if P is None else (lifted, P, spread * P + rest)


def _least_rho(loop: SampledLoop, weights: Weights, m: Float[np.ndarray, " pairs"]) -> float | None:
    """Bisect rho between a thousandth and ten thousand."""
    low, high = -3.0, 4.0
    if _storage(loop, weights, m, 10**high) is None:
        return None
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        holds = _storage(loop, weights, m, 10**middle) is not None
        low, high = (low, middle) if holds else (middle, high)
    return float(10**high)


def _better(
    loop: SampledLoop, weights: Weights, m: Float[np.ndarray, " pairs"]
) -> Float[np.ndarray, " pairs"]:
    """Return pair weights with a smaller rho; here their scale counts, unlike in the proof of stability."""
    from scipy.optimize import minimize

    start = np.log(np.maximum(m, 1e-9 * m.max()))
    found = minimize(
        lambda logs: math.log(_least_rho(loop, weights, np.exp(np.clip(logs, -40, 40))) or 1e9),
        start,
        method="Nelder-Mead",
        options={"maxfev": EVALUATIONS, "adaptive": True},
    )
    return np.asarray(np.exp(np.clip(found.x, -40, 40)))


def _witness(
    loop: SampledLoop, weights: Weights, m: Float[np.ndarray, " pairs"], rho: float, room: tuple[float, float]
) -> Witness | None:
    """Return a witness for a rho, with the room left to the rounding."""
    found = _storage(loop, weights, m, rho, room)
    if found is None:
        return None
    lifted, P, slack = found
    return fitted(loop, lifted, m, Room(P, slack / 2, 1.0, 0.0), running_cost(loop, weights))
