"""Witnesses for what a network does to messages are looked for here, in doubles, by one semidefinite program.

What is assumed and what decides is in `lockstep.check.sampled.messages`. For a given decay its two inequalities are linear in P,
Gamma, X and the pair weights m. They are put to the solver in coordinates in which P is near the identity: near what proves the loop
whose messages all arrive. Rounding is left out of the program and priced afterwards; the room for it is the least eigenvalue of
both conditions, which is what is made large.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_discrete_lyapunov

from lockstep.check.sampled.controller import HeldController, SampledNetwork
from lockstep.check.sampled.inequality import multiplier, step_matrix
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
from lockstep.lmi.sampled.convex import FLATTEST, NOTHING
from lockstep.lmi.sampled.search import spectral_radius
from lockstep.lmi.sampled.storage import holds_in_doubles

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


@dataclass(frozen=True)
class ProvedMessages:
    """What is proved to be survived, and its witness."""

    messages: Messages
    witness: MessageWitness


def certify_messages(
    network: SampledNetwork,
    controllers: tuple[HeldController, ...],
    messages: Messages,
    near: Float[np.ndarray, "n_xi n_xi"] | None = None,
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
    loop: SampledLoop, messages: Messages, near: Float[np.ndarray, "n_xi n_xi"] | None = None
) -> Iterator[MessageWitness]:
    """Yield witnesses that hold in doubles."""
    one = period_in_doubles(loop)
    if one is None or not (spread := 1 - spectral_radius(loop, one) ** 2) > 0:
        return
    if near is None:
        N = step_matrix(loop, copies(one, np.eye(loop.network.d.N - 1)))[:, : loop.n_xi]
        near = np.asarray(solve_discrete_lyapunov(N.T, np.eye(loop.n_xi)))
    for rate in RATES:
        found = _solved(loop, one, messages, 1 - rate * spread, near)
        if found is not None:
            yield from _priced(loop, one, messages, found)


def _solved(
    loop: SampledLoop, one: Lifted, messages: Messages, decay: float, near: Float[np.ndarray, "n n"]
) -> MessageWitness | None:
    """Solve the program; return a witness without prices of rounding, or None."""
    import cvxpy as cp

    program = _Program.of(loop, one, near)
    n, links, q = loop.n_xi, len(loop.differences), len(loop.network.plant.C)
    p, D = messages.loss, messages.age
    # Columns of (xi, nu, nu1, omega) that occur: without ages nu is nu1, and without chance nu1 is 0.
    unit = np.eye(n + 2 * links + program.count)
    xi, nu, nu1, omega = np.split(unit, np.cumsum([n, links, links]), axis=1)
    parts = [xi, *([nu, nu1] if D and p else [nu] if D else [nu + nu1] if p else []), omega]
    keep = np.hstack(parts)
    N, costs = program.N @ keep, [keep.T @ cost @ keep for cost in program.costs]
    known, apart = keep[np.r_[0:n, n + links : n + 2 * links]], keep[n : n + links] - keep[n + links : n + 2 * links]
    V, Gamma = (cp.Variable((n + links,) * 2, symmetric=True) for _ in range(2))
    m, slack = cp.Variable(len(costs), nonneg=True), cp.Variable()
    M = sum(m[k] * form for k, form in enumerate(program.multipliers))
    blocks = [cp.Variable((q, q), symmetric=True) for _ in range(links // q)]
    X = sum(place.T @ one_ @ place for place, one_ in zip(np.split(np.eye(links), links // q), blocks, strict=True))
    K = known.T @ Gamma @ known - sum(m[k] * cost for k, cost in enumerate(costs))
    K = K + keep[n + 2 * links :].T @ M @ keep[n + 2 * links :]
    if D:
        K = K + apart.T @ X @ apart
    moved = V @ N
    first = cp.bmat([[K, moved.T], [moved, V]])
    mean = np.diag(np.r_[np.ones(n), np.full(links, p)])
    second = decay * V - mean @ Gamma @ mean
    own = np.kron(np.eye(links // q), np.ones((q, q)))
    spread = p * (1 - p) * cp.multiply(Gamma[n:, n:], own) + (1 - p) * D * D * decay ** (1 - D) * X
    tail = np.eye(n + links)[n:]
    second = second - tail.T @ spread @ tail
    size = np.r_[np.ones(keep.shape[1]), np.zeros(n + links)]
    conditions = [
        (first + first.T) / 2 >> slack * np.diag(size),
        (second + second.T) / 2 >> slack * np.eye(n + links),
        V >> FLATTEST * np.eye(n + links),
        cp.trace(V[:n, :n]) == n,
        slack <= 1,
        *[one_ >> slack * np.eye(q) for one_ in blocks],
    ]
    problem = cp.Problem(cp.Maximize(slack), conditions)
    if not run(problem, decompose=False, equilibrate=False) or V.value is None or not slack.value > 0:
        return None
    back = np.linalg.inv(program.basis)
    return MessageWitness(
        _symmetric(back.T @ V.value @ back),
        _symmetric(back.T @ Gamma.value @ back),
        np.vstack([_symmetric(each.value) for each in blocks]) / program.basis[-1, -1] ** 2,
        np.maximum(m.value, 1e-9 * max(float(m.value.max(initial=0.0)), 1e-300)) / program.size,
        np.zeros(len(loop.ways)),
        decay,
        0.0,
        0.0,
    )


@dataclass(frozen=True, eq=False)
class _Program:
    """What the conditions are made of, in coordinates in which P is near the identity.

    basis: (xi, eps) = basis @ coordinates;  N: (xi+, eps+) from (xi, nu, nu1, omega), w_d = root omega;  costs, multipliers: of each
    pair's weight, on these and on omega, in units of `size`.
    """

    basis: Float[np.ndarray, "k k"]
    N: Float[np.ndarray, "k l"]
    costs: list[Float[np.ndarray, "l l"]]
    multipliers: list[Float[np.ndarray, "o o"]]
    size: float

    @property
    def count(self) -> int:
        """The length of omega."""
        return len(self.multipliers[0])

    @classmethod
    def of(cls, loop: SampledLoop, one: Lifted, near: Float[np.ndarray, "n n"]) -> "_Program":
        """near: a form that the part of P on xi is to be near."""
        d, n, links, copies_ = loop.network.d, loop.n_xi, len(loop.differences), loop.network.d.N - 1
        lifted = copies(one, np.eye(copies_))
        step, enters = message_step(loop, lifted)
        values, vectors = np.linalg.eigh(one.S)
        kept = values > NOTHING * values.max(initial=0.0)
        root = np.kron(np.eye(copies_), vectors[:, kept] * np.sqrt(values[kept]))
        columns = np.r_[0:n, loop.messages.start : loop.messages.stop, loop.n_z : loop.n_z + links]
        whole, start = np.eye(copies_), np.zeros((len(loop.start), n + 2 * links))
        start[:, : n + links] = loop.start[:, columns[: n + links]]
        L = np.linalg.inv(np.linalg.cholesky(near)).T
        into, out = step[:n, columns[n : n + links]], step[n:, :n] @ L
        sigma = float(np.sqrt(np.linalg.norm(out, 2) / np.linalg.norm(np.linalg.solve(L, into), 2)))
        basis = np.diag(np.full(n + links, sigma))
        basis[:n, :n] = L
        given = np.diag(np.full(n + 2 * links, sigma))
        given[:n, :n] = L
        begin = start @ given
        costs = [begin.T @ (copies(one, whole + d.pair_multiplier(*pair)).Q - lifted.Q) @ begin for pair in d.pairs()]
        size = max(float(np.linalg.norm(cost, 2)) for cost in costs) or 1.0
        count = root.shape[1]
        N = np.linalg.solve(basis, np.hstack([step[:, columns] @ given, enters @ root * np.sqrt(size)]))
        unit = np.eye(count // copies_)
        padded = [np.pad(_symmetric(cost) / size, (0, count)) for cost in costs]
        return cls(basis, N, padded, [np.kron(d.pair_multiplier(*pair), unit) for pair in d.pairs()], size)


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
