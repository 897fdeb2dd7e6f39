"""Witnesses for what a network does to messages are looked for here, in doubles, by the program of `program`.

What is assumed and what decides is in `lockstep.check.sampled.messages`. Rounding, errors and what does not occur are priced
after the program.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import expm, solve_discrete_lyapunov

from lockstep.check.continuous.inequality import Performance
from lockstep.check.sampled.controller import HeldController, SampledNetwork
from lockstep.check.sampled.inequality import Witness, multiplier, step_matrix
from lockstep.check.sampled.l2_gain import running_cost
from lockstep.check.sampled.lifting import Lifted, copies, lift
from lockstep.check.sampled.links import Messages, MessageWitness
from lockstep.check.sampled.loop import SampledLoop, sampled_loop
from lockstep.check.sampled.messages import Omega_1, Omegas_2, message_step, period_parts, proves_messages
from lockstep.lmi.sampled.l2_gain import SampledRho
from lockstep.lmi.sampled.loop_gain import spectral_radius
from lockstep.lmi.sampled.messages.program import Form, solved, with_fixed_weights, with_free_weights
from lockstep.lmi.sampled.storage import holds_in_doubles
from lockstep.lmi.sampled.witnesses import in_doubles, period_in_doubles

RATES = (0.1, 0.02, 0.004)
"""How fast V is asked to decay, as parts of how fast the linear loop without faults does."""

CLAIMED = 0.5
"""The part of the decay that is claimed: the rest is room for rounding."""

ROUNDINGS = (1e6, 1e4, 1e8, 1e3)
"""Prices of rounding, relative to what its directions weigh in P."""

ERROR = 1e8
"""The price of an error of a message, relative to X."""

MU = 1e6
"""The price of underflow, relative to what it weighs in P."""

FACTORS = (1.02, 1.1, 1.3, 1.6, 2.0, 2.5, 3.2, 4.0, 5.0, 6.3, 8.0, 10.0, 16.0, 30.0, 100.0)
"""Multiples of rho of the loop whose messages all arrive, bisected; pair weights are tried times it and times its square."""


@dataclass(frozen=True)
class ProvedMessages:
    """What is proved to be survived, and its witness."""

    messages: Messages
    witness: MessageWitness


def certify_messages(
    network: SampledNetwork,
    controllers: tuple[HeldController, ...],
    messages: Messages,
    near: Form | None = None,
) -> ProvedMessages | None:
    """Look for a witness that the loop agrees whatever a network does to messages within bounds, and prove it.

    Args:
        network: agents, coordinates, alpha, period, delay, the matrices exact.
        controllers: one per agent, with the coefficients of the code.
        messages: what happens to the messages.
        near: P of a witness for messages that all arrive; by default what the linear loop sums up to.
    """
    loop, exact_loop = in_doubles(network, controllers), sampled_loop(network, controllers)
    for witness in message_witnesses(loop, messages, near):
        if proves_messages(exact_loop, messages, witness):
            return ProvedMessages(messages, witness)
    return None


def message_witnesses(
    loop: SampledLoop, messages: Messages, near: Form | None = None
) -> Iterator[MessageWitness]:
    """Yield witnesses that hold in doubles."""
    one = period_in_doubles(loop)
    if one is None or not (spread := 1 - spectral_radius(loop, one) ** 2) > 0:
        return
    if near is None:
        N = step_matrix(loop, copies(one, np.eye(loop.network.d.N - 1)))[:, : loop.n_x]
        near = np.asarray(solve_discrete_lyapunov(N.T, np.eye(loop.n_x)))
    program = with_free_weights(loop, one, near)
    for rate in RATES:
        decay = 1 - rate * spread
        found = solved(loop, program, messages, decay)
        if found is not None:
            yield from _exactly(loop, messages, found, 1 - CLAIMED * rate * spread)


def _exactly(
    loop: SampledLoop,
    messages: Messages,
    found: MessageWitness,
    decay: float,
    weights: Performance | None = None,
    rho: float | None = None,
) -> Iterator[MessageWitness]:
    """Yield witnesses whose period is lifted with the way out that jitter is; the program knows it without nonlinearity."""
    M = multiplier(loop.network.d, found.m)
    running = None if weights is None or rho is None else running_cost(loop, weights, rho)
    try:
        parts = period_parts(loop, messages, found, M, weights, rho)
        lifted = None if parts is None else lift(*parts, loop.network.period, expm)
        if lifted is None or not np.isfinite(lifted.CC_d).all():
            return
        if messages.jitter:
            near = found.P[: loop.n_x, : loop.n_x]
            program = with_fixed_weights(loop, lifted, running, near)
            again = solved(loop, program, messages, found.decay, found)
        else:
            again = found
    except np.linalg.LinAlgError:
        return
    if again is not None:
        yield from _priced(loop, lifted, messages, again, decay, running)


def message_rho(
    network: SampledNetwork,
    controllers: tuple[HeldController, ...],
    messages: Messages,
    weights: Performance,
    known: SampledRho,
) -> tuple[float, MessageWitness] | None:
    """Look for a small rho of the loop whose messages are lost or late, and prove it.

    Args:
        network, controllers, messages: as for `certify_messages`.
        weights: what rho is a gain to and from.
        known: rho of the loop whose messages all arrive: its pair weights and P are where this starts.
    """
    loop = in_doubles(network, controllers, weights.outputs)
    exact_loop = sampled_loop(network, controllers, weights.outputs)
    found, low, high = None, 0, len(FACTORS)
    while low < high:
        middle = (low + high) // 2
        factor = FACTORS[middle]
        rho = float(f"{factor * known.rho:.4g}")
        tried = (
            witness
            for scale in (factor, factor**2)
            for witness in _with_rho(loop, messages, weights, rho, scale, known.witness)
        )
        held = next((one for one in tried if proves_messages(exact_loop, messages, one, weights, rho)), None)
        found = found if held is None else (rho, held)
        low, high = (low, middle) if held else (middle + 1, high)
    return found


def _with_rho(
    loop: SampledLoop, messages: Messages, weights: Performance, rho: float, scale: float, known: Witness
) -> Iterator[MessageWitness]:
    """Yield witnesses of a rho with so many times the pair weights known."""
    none, P, m = np.zeros((0, 0)), scale * known.P, scale * known.m
    start = MessageWitness(P, P, none, none, m, known.t, 1.0, 0.0, 0.0)
    try:
        quiet = replace(messages, jitter=0.0)
        parts = period_parts(loop, quiet, start, multiplier(loop.network.d, m), weights, rho)
        lifted = None if parts is None else lift(*parts, loop.network.period, expm)
        if lifted is None or not np.isfinite(lifted.CC_d).all():
            return
        program = with_fixed_weights(loop, lifted, running_cost(loop, weights, rho), P)
    except np.linalg.LinAlgError:
        return
    found = solved(loop, program, messages, 1.0, start)
    if found is not None:
        yield from _exactly(loop, messages, found, 1.0, weights, rho)


def _priced(
    loop: SampledLoop,
    lifted: Lifted,
    messages: Messages,
    found: MessageWitness,
    decay: float,
    running: Form | None = None,
) -> Iterator[MessageWitness]:
    """Yield a witness with prices of rounding, of errors, and of what does not occur, if one holds in doubles."""
    n = loop.n_x
    N, links = message_step(loop, lifted)[0], len(loop.differences)

    def weighed(columns: slice) -> float:
        E = N[:, columns]
        return float(np.linalg.norm(E.T @ found.P @ E, 2)) or 1.0

    Gamma, X = found.Gamma.copy(), found.X.copy()
    never = ERROR * max(weighed(loop.messages), weighed(slice(loop.n_z, loop.n_z + links)))
    noisy = running is not None and loop.outputs.stop > loop.outputs.start
    if not (messages.loss or messages.jitter or noisy):
        Gamma[n:, n:] = never * np.eye(links)
    if not messages.age:
        X = np.tile(never * np.eye(X.shape[1]), (len(X) // X.shape[1], 1))
    # Half of the room that the decay leaves goes to the first inequality.
    Gamma[:n, :n] += 0.5 * (decay - found.decay) * found.P[:n, :n]
    kappa = ERROR * max(float(np.linalg.norm(one, 2)) for one in (X, *found.seconds[2:]))
    for dear in ROUNDINGS:
        t = np.array([dear * weighed(way.place) for way in loop.ways])
        witness = replace(
            found, Gamma=Gamma, X=X, t=t, decay=decay, kappa=kappa, kappa_mu=MU * weighed(loop.underflows)
        )
        form = Omega_1(loop, lifted, messages, witness, running)
        if holds_in_doubles(form) and all(map(holds_in_doubles, Omegas_2(loop, messages, witness, running))):
            yield witness
            return
