"""Witnesses for what a network does to messages are looked for here, in doubles, by one semidefinite program.

What is assumed and what decides is in `lockstep.check.sampled.messages`. For a given decay its two inequalities are linear in
P, Gamma, X, Xj and the pair weights m, but for the lifting of jitter, known without the nonlinearity at first, and
then with Xj and m fixed. They are put to the solver in coordinates in which P is near the identity: near what proves the loop
whose messages all arrive. Rounding is left out of the program and priced afterwards; the room for it is the least eigenvalue
of both conditions, which is what is made large.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.linalg import expm, solve_discrete_lyapunov

from lockstep.check.inequality import Performance
from lockstep.check.sampled.controller import HeldController, SampledNetwork
from lockstep.check.sampled.inequality import Witness, multiplier, step_matrix
from lockstep.check.sampled.lifting import Lifted, copies, lift
from lockstep.check.sampled.loop import SampledLoop, sampled_loop
from lockstep.check.sampled.messages import (
    W_1,
    W_2,
    Messages,
    MessageWitness,
    message_step,
    period_parts,
    proves_messages,
)
from lockstep.check.sampled.performance import SampledRho, running_cost
from lockstep.lmi.analysis.solve import run
from lockstep.lmi.sampled.certify import in_doubles, period_in_doubles
from lockstep.lmi.sampled.convex import FLATTEST, NOTHING
from lockstep.lmi.sampled.search import spectral_radius
from lockstep.lmi.sampled.storage import holds_in_doubles

Form = Float[np.ndarray, "k k"]

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

MORE = 1.1
"""What jitter counts in the first program, which lifts it without the nonlinearity."""

FACTORS = (
    *((1.02, 1.0), (1.1, 1.0), (1.1, 1.2), (1.3, 1.0), (1.3, 1.7), (2.0, 1.0), (2.0, 4.0)),
    *((4.0, 4.0), (4.0, 16.0), (10.0, 10.0), (10.0, 100.0), (100.0, 100.0), (100.0, 1e4)),
)
"""Multiples of rho of the loop whose messages all arrive, and of its pair weights, that are tried."""


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
        N = step_matrix(loop, copies(one, np.eye(loop.network.d.N - 1)))[:, : loop.n_xi]
        near = np.asarray(solve_discrete_lyapunov(N.T, np.eye(loop.n_xi)))
    program = _with_free_weights(loop, one, near)
    for rate in RATES:
        decay = 1 - rate * spread
        found = _solved(loop, program, messages, decay)
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
        if lifted is None or not np.isfinite(lifted.Q).all():
            return
        if messages.jitter:
            near = found.P[: loop.n_xi, : loop.n_xi]
            program = _with_fixed_weights(loop, lifted, running, near)
            again = _solved(loop, program, messages, found.decay, found)
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
        weights: what rho is a gain to and from; noise of the outputs is left out.
        known: rho of the loop whose messages all arrive: its pair weights and P are where this starts.
    """
    loop, exact_loop = in_doubles(network, controllers), sampled_loop(network, controllers)
    for factor, scale in FACTORS:
        rho = float(f"{factor * known.rho:.4g}")
        for witness in _with_rho(loop, messages, weights, rho, scale, known.witness):
            if proves_messages(exact_loop, messages, witness, weights, rho):
                return rho, witness
    return None


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
        if lifted is None or not np.isfinite(lifted.Q).all():
            return
        program = _with_fixed_weights(loop, lifted, running_cost(loop, weights, rho), P)
    except np.linalg.LinAlgError:
        return
    found = _solved(loop, program, messages, 1.0, start)
    if found is not None:
        yield from _exactly(loop, messages, found, 1.0, weights, rho)


@dataclass(frozen=True, eq=False)
class _Program:
    """What the conditions are made of, in coordinates in which P is near the identity.

    basis: (xi, eps) = basis @ coordinates;  N: (xi+, eps+) from (xi, nu, nu1, omega), w_d = root omega;  costs,
    multipliers: of each pair's weight, on these and on omega, in units of `size`; one of each where the weights are fixed;
    rates: whose squares sum up to T int |Y x_d'|^2 dt over a period, without nonlinearity.
    """

    basis: Form
    N: Float[np.ndarray, "k l"]
    costs: list[Form]
    multipliers: list[Form]
    size: float
    rates: list[Float[np.ndarray, "links l"]]

    @property
    def count(self) -> int:
        """The length of omega."""
        return len(self.multipliers[0])

    @classmethod
    def of(
        cls,
        loop: SampledLoop,
        lifted: Lifted,
        root: Float[np.ndarray, "n_d o"],
        costs: list[Form],
        multipliers: list[Form],
        near: Form,
        *,
        scaled: bool,
    ) -> "_Program":
        """costs: on z;  multipliers: on omega;  near: a form that the part of P on xi is to be near;
        scaled: whether the costs, and with them omega, are put in units in which the largest is 1."""
        n, links, count = loop.n_xi, len(loop.differences), root.shape[1]
        step, enters = message_step(loop, lifted)
        columns = np.r_[0:n, loop.messages.start : loop.messages.stop, loop.n_z : loop.n_z + links]
        L = np.linalg.inv(np.linalg.cholesky(near)).T
        into, out = step[:n, loop.messages], step[n:, :n] @ L
        weighs = float(np.linalg.norm(np.linalg.solve(L, into), 2))
        sigma = float(np.sqrt(np.linalg.norm(out, 2) / weighs)) if weighs > 0 and out.any() else 1.0
        basis, given = (np.diag(np.full(n + k * links, sigma)) for k in (1, 2))
        basis[:n, :n] = given[:n, :n] = L
        held = given[: n + links, : n + links]
        costs = [
            _symmetric(held.T @ cost[np.ix_(columns[: n + links], columns[: n + links])] @ held)
            for cost in costs
        ]
        size = (max(float(np.linalg.norm(cost, 2)) for cost in costs) or 1.0) if scaled else 1.0
        N = np.linalg.solve(basis, np.hstack([step[:, columns] @ given, enters @ root * np.sqrt(size)]))
        padded = [np.pad(cost / size, (0, links + count)) for cost in costs]
        into_rates = [each @ loop.start[:, columns[: n + links]] @ held / sigma for each in _rates(loop)]
        rates = [np.pad(each, ((0, 0), (0, links + count))) for each in into_rates]
        return cls(basis, N, padded, multipliers, size, rates)


def _rates(loop: SampledLoop) -> list[Float[np.ndarray, "links a"]]:
    """Return the change of the differences at three instants of Gauss, weighed, from a = (x_d, v)."""
    plant, T, unit = loop.network.plant, loop.network.period, np.eye(loop.network.d.N - 1)
    flow = np.hstack([np.kron(unit, plant.A), np.kron(unit, loop.into)])
    whole = np.vstack([flow, np.zeros((flow.shape[1] - len(flow), flow.shape[1]))])
    nodes, weights = np.polynomial.legendre.leggauss(3)
    Y = loop.differences[:, : loop.n_d]
    return [
        np.sqrt(w / 2) * T * Y @ flow @ expm(whole * T * (1 + x) / 2)
        for x, w in zip(nodes, weights, strict=True)
    ]


def _with_free_weights(loop: SampledLoop, one: Lifted, near: Form) -> _Program:
    d, unit = loop.network.d, np.eye(loop.network.d.N - 1)
    lifted, forms = copies(one, unit), [d.pair_multiplier(*pair) for pair in d.pairs()]
    root = _root(one.S)
    # Linear in M, and `copies` wants a regular one.
    costs = [loop.start.T @ (copies(one, unit + form).Q - lifted.Q) @ loop.start for form in forms]
    multipliers = [np.kron(form, np.eye(root.shape[1])) for form in forms]
    return _Program.of(loop, lifted, np.kron(unit, root), costs, multipliers, near, scaled=True)


def _with_fixed_weights(loop: SampledLoop, lifted: Lifted, running: Form | None, near: Form) -> _Program:
    root = _root(lifted.S)
    costs = [loop.start.T @ lifted.Q @ loop.start + (0.0 if running is None else running)]
    return _Program.of(loop, lifted, root, costs, [np.eye(root.shape[1])], near, scaled=False)


def _root(square: Form) -> Float[np.ndarray, "n k"]:
    values, vectors = np.linalg.eigh(square)
    kept = values > NOTHING * values.max(initial=0.0)
    return np.asarray(vectors[:, kept] * np.sqrt(values[kept]))


def _solved(
    loop: SampledLoop,
    program: _Program,
    messages: Messages,
    decay: float,
    fixed: MessageWitness | None = None,
) -> MessageWitness | None:
    """Solve the program; return a witness without prices of rounding, or None.

    fixed: holds the weights of the pairs and, unless it is empty, Xj, where the period was lifted with them.
    """
    import cvxpy as cp

    n, links, q = loop.n_xi, len(loop.differences), len(loop.network.plant.C)
    p, D, J = messages.loss, messages.age, messages.jitter
    # Columns of (xi, nu, nu1, omega) that occur: without ages nu is nu1, and without chance and jitter nu1 is 0.
    unit = np.eye(n + 2 * links + program.count)
    xi, nu, nu1, omega = np.split(unit, np.cumsum([n, links, links]), axis=1)
    keep = np.hstack(
        [xi, *([nu, nu1] if D and (p or J) else [nu] if D else [nu + nu1] if p or J else []), omega]
    )
    of_nu, of_nu1, of_omega = np.split(keep[n:], np.cumsum([links, links]))
    known, costs = np.vstack([keep[:n], of_nu1]), [keep.T @ cost @ keep for cost in program.costs]
    V, Gamma = (cp.Variable((n + links,) * 2, symmetric=True) for _ in range(2))
    slack, m = cp.Variable(), cp.Variable(len(costs), nonneg=True)
    blocks = [cp.Variable((q, q), symmetric=True) for _ in range(links // q)]
    places = np.split(np.eye(links), links // q)
    X = sum(place.T @ block @ place for place, block in zip(places, blocks, strict=True))
    M = sum(m[k] * form for k, form in enumerate(program.multipliers))
    K = known.T @ Gamma @ known - sum(m[k] * cost for k, cost in enumerate(costs)) + of_omega.T @ M @ of_omega
    K = K + (of_nu - of_nu1).T @ X @ (of_nu - of_nu1) if D else K
    own = np.kron(np.eye(links // q), np.ones((q, q)))
    spread = p * (1 - p) * cp.multiply(Gamma[n:, n:], own) + (1 - p) * D * D * decay ** (1 - D) * X
    early = links if J else 0
    mean = np.zeros((n + links, n + links + early))
    mean[:n, :n], mean[n:, n : n + links] = np.eye(n), p * np.eye(links)
    mean[n:, n + links :] = (1 - p) * np.eye(links, early)
    apart = np.hstack([np.zeros((links, n)), np.eye(links), -np.eye(links, early)])
    stored = np.eye(n + links, n + links + early)
    second = decay * stored.T @ V @ stored - mean.T @ Gamma @ mean - apart.T @ spread @ apart
    X_jitter = None
    if J:
        ones = [cp.Variable((q, q), symmetric=True) for _ in range(links // q)]
        if fixed is not None and fixed.X_jitter.size:
            ones = list(np.split(fixed.X_jitter * program.basis[-1, -1] ** 2, links // q))
        X_jitter = sum(place.T @ block @ place for place, block in zip(places, ones, strict=True))
        tail = np.eye(n + 2 * links)[n + links :]
        second = second + decay * tail.T @ X_jitter @ tail
        if fixed is None or not fixed.X_jitter.size:
            K = K - MORE * J * sum(
                rate.T @ X_jitter @ rate for rate in (each @ keep for each in program.rates)
            )
    moved = V @ (program.N @ keep)
    first = cp.bmat([[K, moved.T], [moved, V]])
    room = np.diag(np.r_[np.ones(keep.shape[1]), np.zeros(n + links)])
    conditions = [
        (first + first.T) / 2 >> slack * room,
        (second + second.T) / 2 >> slack * np.eye(n + links + early),
        V >> FLATTEST * np.eye(n + links),
        slack <= 1,
        cp.trace(V[:n, :n]) == n if fixed is None else m == 1,
        *[block >> slack * np.eye(q) for block in blocks],
    ]
    problem = cp.Problem(cp.Maximize(slack), conditions)
    if not run(problem, decompose=False, equilibrate=False) or V.value is None or not slack.value > 0:
        return None
    back = np.linalg.inv(program.basis)
    free = np.maximum(m.value, 1e-9 * max(float(m.value.max(initial=0.0)), 1e-300)) / program.size
    scale = program.basis[-1, -1] ** 2
    early_ones = np.tile(np.eye(q), (links // q, 1))
    if J:
        early_ones = np.vstack([_symmetric(getattr(block, "value", block)) for block in ones]) / scale
    return MessageWitness(
        _symmetric(back.T @ V.value @ back),
        _symmetric(back.T @ Gamma.value @ back),
        np.vstack([_symmetric(block.value) for block in blocks]) / scale,
        early_ones,
        free if fixed is None else fixed.m,
        np.zeros(len(loop.ways)),
        decay,
        0.0,
        0.0,
    )


def _priced(
    loop: SampledLoop,
    lifted: Lifted,
    messages: Messages,
    found: MessageWitness,
    decay: float,
    running: Form | None = None,
) -> Iterator[MessageWitness]:
    """Yield a witness with prices of rounding, of errors, and of what does not occur, if one holds in doubles."""
    n = loop.n_xi
    N, links = message_step(loop, lifted)[0], len(loop.differences)

    def weighed(columns: slice) -> float:
        E = N[:, columns]
        return float(np.linalg.norm(E.T @ found.P @ E, 2)) or 1.0

    Gamma, X = found.Gamma.copy(), found.X.copy()
    never = ERROR * max(weighed(loop.messages), weighed(slice(loop.n_z, loop.n_z + links)))
    if not (messages.loss or messages.jitter):
        Gamma[n:, n:] = never * np.eye(links)
    if not messages.age:
        X = np.tile(never * np.eye(X.shape[1]), (len(X) // X.shape[1], 1))
    # Half of the room that the decay leaves goes to the first inequality.
    Gamma[:n, :n] += 0.5 * (decay - found.decay) * found.P[:n, :n]
    kappa = ERROR * float(np.linalg.norm(X, 2))
    for dear in ROUNDINGS:
        t = np.array([dear * weighed(way.place) for way in loop.ways])
        witness = replace(
            found, Gamma=Gamma, X=X, t=t, decay=decay, kappa=kappa, kappa_mu=MU * weighed(loop.underflows)
        )
        W = W_1(loop, lifted, witness, running)
        if holds_in_doubles(W_2(loop, messages, witness)) and holds_in_doubles(W):
            yield witness
            return


def _symmetric(form: Form) -> Form:
    return np.asarray((form + form.T) / 2)
