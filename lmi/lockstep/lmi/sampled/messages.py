"""Witnesses for what a network does to messages are looked for here, in doubles, by one semidefinite program.

What is assumed and what decides is in `lockstep.check.sampled.messages`. For a given decay its two inequalities are linear in P,
Gamma, X and the pair weights m. As in `convex` they are put to the solver for differences over a period T, with P = L V L'
near the identity on xi: with eta^ = sqrt(T) L' xi and

    P     = [ V_11           sqrt(T) V_12 ]        Gamma = [ V_11 + T G_11   sqrt(T) G_12 ]
            [ sqrt(T) V_21   V_22         ],               [ sqrt(T) G_21    G_22         ]

(in the coordinates L' xi and eps), every entry that the conditions hold is of order one. Rounding is left out of the program and
priced afterwards; the room for it is the least eigenvalue of both conditions, which is what is made large.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from lockstep.check.inequality import Performance
from lockstep.check.sampled.controller import HeldController, SampledNetwork
from lockstep.check.sampled.inequality import multiplier
from lockstep.check.sampled.lifting import Lifted, copies
from lockstep.check.sampled.loop import SampledLoop, sampled_loop
from lockstep.check.sampled.messages import (
    W_1,
    W_2,
    Messages,
    MessageWitness,
    message_step,
    proves_messages,
)
from lockstep.lmi.analysis.solve import run
from lockstep.lmi.sampled.certify import in_doubles, period_in_doubles
from lockstep.lmi.sampled.convex import NOTHING, _basis
from lockstep.lmi.sampled.search import spectral_radius
from lockstep.lmi.sampled.storage import holds_in_doubles

RATES = (0.02, 0.1, 0.004)
"""How fast V is asked to decay, as parts of how fast the linear loop without faults does."""

CLAIMED = 0.5
"""The part of the decay that is claimed: the rest is room for rounding."""

ROUNDINGS = (1e6, 1e4, 1e8, 1e3)
"""Prices of rounding, relative to what its directions weigh in P."""

ERROR = 1e8
"""The price of an error of a message, relative to X."""

MU = 1e6
"""The price of underflow, relative to what it weighs in P."""


@dataclass(frozen=True)
class ProvedMessages:
    """What is proved to be survived, and its witness."""

    messages: Messages
    witness: MessageWitness


def certify_messages(
    network: SampledNetwork, controllers: tuple[HeldController, ...], messages: Messages
) -> ProvedMessages | None:
    """Look for a witness that the loop agrees whatever a network does to messages within bounds, and prove it.

    Args:
        network: agents, coordinates, alpha, period, delay, the matrices exact.
        controllers: one per agent, with the coefficients of the code.
        messages: what happens to the messages.
    """
    loop, exact_loop = in_doubles(network, controllers), sampled_loop(network, controllers)
    for witness in message_witnesses(loop, messages):
        if proves_messages(exact_loop, messages, witness):
            return ProvedMessages(messages, witness)
    return None


def message_witnesses(loop: SampledLoop, messages: Messages) -> Iterator[MessageWitness]:
    """Yield witnesses that hold in doubles."""
    one = period_in_doubles(loop)
    if one is None or not (spread := 1 - spectral_radius(loop, one) ** 2) > 0:
        return
    for rate in RATES:
        found = _solved(loop, one, messages, 1 - rate * spread)
        if found is not None:
            yield from _priced(loop, one, messages, found)


def _solved(
    loop: SampledLoop, one: Lifted, messages: Messages, decay: float
) -> MessageWitness | None:
    """Solve the program; return a witness without prices of rounding, or None."""
    import cvxpy as cp

    d, n, n_d, T = loop.network.d, loop.n_xi, loop.n_d, loop.network.period
    Y, links, q = loop.differences[:, :n], len(loop.differences), len(loop.network.plant.C)
    p, D = messages.loss, messages.age
    lifted = copies(one, np.eye(d.N - 1))
    start = loop.start
    N = np.vstack([lifted.A_d @ start, loop.advanced])
    C = Y.T @ Y
    L = _basis(N[:, :n], np.eye(n))
    if L is None:
        return None
    back = np.linalg.inv(L).T
    values, vectors = np.linalg.eigh(one.S)
    root = (vectors * np.sqrt(np.maximum(values, 0.0)))[:, values > NOTHING * values.max(initial=0.0)]
    count = (d.N - 1) * root.shape[1]
    F = L[:n_d].T @ np.kron(np.eye(d.N - 1), root) / np.sqrt(T)
    # Columns: eta^ = sqrt(T) L' xi; the held error nu; nu1 of it that chance is to blame for; omega, into the nonlinearity.
    held = links if D else 0
    chance = links if p > 0 else 0
    B = L.T @ N[:, loop.messages] / T * np.sqrt(T)
    if not (D or p):
        B = B[:, :0]
    zero = np.zeros
    ups = max(held, chance)
    # delta, with L' (xi+ - xi) = sqrt(T) delta
    delta = np.hstack([L.T @ (N[:, :n] - np.eye(n)) @ back / T, B, zero((n, chance if D else 0)), F])
    width = delta.shape[1]
    nu = zero((links, width))
    nu[:, n : n + ups] = np.eye(links, ups)
    nu1 = zero((links, width))
    if chance:
        at = n + (links if D else 0)
        nu1[:, at : at + links] = np.eye(links)
    after = nu1 - np.sqrt(T) * (Y @ back) @ delta
    eta = np.eye(n, width)
    omega = zero((count, width))
    omega[:, width - count :] = np.eye(count)
    # The cost a'Q a of each pair, on (eta^, nu).
    whole = np.eye(d.N - 1)
    pairs = d.pairs()
    into = np.vstack([back @ eta / np.sqrt(T), *([nu] if ups else [])])
    columns = np.r_[0:n, loop.messages.start : loop.messages.stop] if ups else np.arange(n)
    begin = start[:, columns] @ into
    costs = [begin.T @ (copies(one, whole + d.pair_multiplier(i, j)).Q - lifted.Q) @ begin for i, j in pairs]
    size = max(float(np.linalg.norm(cost, 2)) for cost in costs) or 1.0
    unit = np.eye(root.shape[1])

    V11, V22 = cp.Variable((n, n), symmetric=True), cp.Variable((links, links), symmetric=True)
    V12 = cp.Variable((n, links))
    G11 = cp.Variable((n, n), symmetric=True)
    m, slack = cp.Variable(len(pairs), nonneg=True), cp.Variable()
    conditions = []
    M = sum(m[k] / size * np.kron(d.pair_multiplier(i, j), unit) for k, (i, j) in enumerate(pairs))
    Q = sum(m[k] * (cost + cost.T) / (2 * size) for k, cost in enumerate(costs))
    K = eta.T @ G11 @ eta + omega.T @ (M * 1.0) @ omega - Q
    cross = eta.T @ (V11 @ delta + V12 @ after)
    K = K - cross - cross.T
    rate = (1 - decay) / T
    P12, Z22 = decay * V12, decay * V22
    if chance:
        G12, G22 = cp.Variable((n, links)), cp.Variable((links, links), symmetric=True)
        side = eta.T @ G12 @ nu1
        K = K + side + side.T + nu1.T @ G22 @ nu1
        P12 = P12 - p * G12
        Z22 = Z22 - p * p * G22 - p * (1 - p) * cp.multiply(G22, np.kron(np.eye(links // q), np.ones((q, q))))
    X = None
    if D:
        blocks = [cp.Variable((q, q), symmetric=True) for _ in range(links // q)]
        X = sum(
            np.eye(links)[:, k * q : (k + 1) * q] @ one_ @ np.eye(links)[k * q : (k + 1) * q]
            for k, one_ in enumerate(blocks)
        )
        apart = nu - nu1
        K = K + apart.T @ X @ apart
        Z22 = Z22 - (1 - p) * D * D * decay ** (1 - D) * X
        conditions += [one_ >> slack * np.eye(q) for one_ in blocks]
    second = cp.bmat([[-rate * V11 - G11, P12], [P12.T, Z22]])
    stored = cp.bmat([[V11, np.sqrt(T) * V12], [np.sqrt(T) * V12.T, V22]])
    moved = stored @ np.vstack([np.sqrt(T) * delta, after])
    first = cp.bmat([[K, moved.T], [moved, stored]])
    conditions += [
        (first + first.T) / 2 >> slack * np.diag(np.r_[np.ones(width), zero(n + links)]),
        (second + second.T) / 2 >> slack * np.eye(n + links),
        stored >> 1e-5 * np.eye(n + links),
        cp.trace(V11) == n,
        slack <= 1,
    ]
    problem = cp.Problem(cp.Maximize(slack), conditions)
    if not run(problem) or V11.value is None or not slack.value > 0:
        return None
    # Back to (xi, eps).
    change = np.zeros((n + links,) * 2)
    change[:n, :n], change[n:, n:] = L, np.eye(links)
    P = change @ stored.value @ change.T
    top = V11.value + T * G11.value
    if chance:
        g12, g22 = np.sqrt(T) * G12.value, G22.value
    else:
        g12, g22 = np.zeros((n, links)), np.zeros((links, links))
    Gamma = change @ np.block([[top, g12], [g12.T, g22]]) @ change.T
    xs = np.vstack([b.value for b in blocks]) if D else np.tile(np.eye(q), (links // q, 1))
    return MessageWitness(
        _symmetric(P),
        _symmetric(Gamma),
        np.vstack([_symmetric(b) for b in np.split(xs, links // q)]),
        np.maximum(m.value, 1e-9 * max(float(m.value.max(initial=0.0)), 1e-300)) / size,
        np.zeros(len(loop.ways)),
        decay,
        0.0,
        0.0,
    )


def _priced(
    loop: SampledLoop, one: Lifted, messages: Messages, found: MessageWitness
) -> Iterator[MessageWitness]:
    """Yield a witness with prices of rounding, of errors, and of what does not occur, if one holds in doubles."""
    lifted, n = copies(one, multiplier(loop.network.d, found.m)), loop.n_xi
    N, links = message_step(loop, lifted)[0], len(loop.differences)
    decay = 1 - CLAIMED * (1 - found.decay)

    def weighed(columns: slice) -> float:
        E = N[:, columns]
        return float(np.linalg.norm(E.T @ found.P @ E, 2)) or 1.0

    Gamma, X = found.Gamma.copy(), found.X.copy()
    never = ERROR * max(weighed(loop.messages), weighed(slice(loop.n_z, loop.n_z + links)))
    if not messages.loss:
        Gamma[n:, n:] = never * np.eye(links)
    if not messages.age:
        X = X * never
    kappa = ERROR * float(np.linalg.norm(X, 2))
    # Half of the room of the decay goes to the first inequality.
    Gamma = Gamma + 0.25 * (1 - found.decay) * _top(found.P, n)
    for dear in ROUNDINGS:
        t = np.array([dear * weighed(way.place) for way in loop.ways])
        witness = replace(
            found, Gamma=Gamma, X=X, t=t, decay=decay, kappa=kappa, kappa_mu=MU * weighed(loop.underflows)
        )
        if holds_in_doubles(W_2(loop, messages, witness)) and holds_in_doubles(W_1(loop, lifted, witness)):
            yield witness
            return


def _top(P: Float[np.ndarray, "k k"], n: int) -> Float[np.ndarray, "k k"]:
    out = np.zeros_like(P)
    out[:n, :n] = P[:n, :n]
    return out


def _symmetric(form: Float[np.ndarray, "k k"]) -> Float[np.ndarray, "k k"]:
    return np.asarray((form + form.T) / 2)
