"""The two inequalities of `lockstep.check.sampled.messages` as one semidefinite program, rounding left out.

For a given decay they are linear in P, Gamma, X, Xj and the pair weights m, but for the lifting of jitter, known without the
nonlinearity at first, and then with Xj and m fixed. They are put to the solver in coordinates in which P is near the
identity: near what proves the loop whose messages all arrive. The room for rounding is the least eigenvalue of both
conditions, which is what is made large.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.linalg import expm

from lockstep.check.sampled.lifting import Lifted, copies
from lockstep.check.sampled.links import Messages, MessageWitness
from lockstep.check.sampled.loop import SampledLoop
from lockstep.check.sampled.messages import message_step
from lockstep.lmi.analysis.dense_sdp import run_dense
from lockstep.lmi.analysis.semidefinite import square_root_factor
from lockstep.lmi.sampled.step_program import FLATTEST, NOTHING

Form = Float[np.ndarray, "k k"]

ALL_AT_ONCE = 8
"""Corners of the losses that are put to the solver at once; of more, those come in that are violated most."""

NEAR = 0.05
"""The part of the room that the solver may leave: any room will do."""

MORE = 1.1
"""What jitter counts in the first program, which lifts it without the nonlinearity."""


@dataclass(frozen=True, eq=False)
class MessageProgram:
    """What the conditions are made of, in coordinates in which P is near the identity.

    basis: (x_cl, eps) = basis @ coordinates;  N: (x_cl+, eps+) from (x_cl, zeta, zeta1, omega), w_d = root omega;  costs,
    multipliers: of each pair's weight, on these and on omega, in units of `size`; one of each where the weights are fixed;
    rates: whose squares sum up to T int |Y x_d'|^2 dt over a period, without nonlinearity;  noise: what is read from the
    outputs' own noise of price 1, in the coordinates of eps.
    """

    basis: Form
    N: Float[np.ndarray, "k l"]
    costs: list[Form]
    multipliers: list[Form]
    size: float
    rates: list[Float[np.ndarray, "links l"]]
    noise: Float[np.ndarray, "links n"]

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
    ) -> "MessageProgram":
        """costs: on z;  multipliers: on omega;  near: a form that the part of P on x_cl is to be near;
        scaled: whether the costs, and with them omega, are put in units in which the largest is 1."""
        n, links, count = loop.n_x, len(loop.differences), root.shape[1]
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
        return cls(basis, N, padded, multipliers, size, rates, np.zeros((links, 0)))


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


def with_free_weights(loop: SampledLoop, one: Lifted, near: Form) -> MessageProgram:
    """Return the program whose pair weights are found with it; one: period of one agent;  near: as for `of`."""
    d, unit = loop.network.d, np.eye(loop.network.d.N - 1)
    lifted, forms = copies(one, unit), [d.pair_multiplier(*pair) for pair in d.pairs()]
    root = square_root_factor(one.BB_d, NOTHING)
    # Linear in M, and `copies` wants a regular one.
    costs = [loop.start.T @ (copies(one, unit + form).CC_d - lifted.CC_d) @ loop.start for form in forms]
    multipliers = [np.kron(form, np.eye(root.shape[1])) for form in forms]
    return MessageProgram.of(loop, lifted, np.kron(unit, root), costs, multipliers, near, scaled=True)


def with_fixed_weights(loop: SampledLoop, lifted: Lifted, running: Form | None, near: Form) -> MessageProgram:
    """Return the program of a period lifted with all weights; running: a cost of z at each sampling instant."""
    root = square_root_factor(lifted.BB_d, NOTHING)
    costs = [loop.start.T @ lifted.CC_d @ loop.start + (0.0 if running is None else running)]
    found = MessageProgram.of(loop, lifted, root, costs, [np.eye(root.shape[1])], near, scaled=False)
    if running is None:
        return found
    price = np.linalg.cholesky(-running[loop.outputs, loop.outputs])
    noise = np.linalg.solve(price, loop.differences[:, loop.outputs].T).T
    return replace(found, noise=noise / found.basis[-1, -1])


def solved(
    loop: SampledLoop,
    program: MessageProgram,
    messages: Messages,
    decay: float,
    fixed: MessageWitness | None = None,
) -> MessageWitness | None:
    """Solve the program; return a witness without prices of rounding, or None.

    fixed: holds the weights of the pairs and, unless it is empty, Xj, where the period was lifted with them.
    """
    import cvxpy as cp

    n, links, q = loop.n_x, len(loop.differences), len(loop.network.plant.C)
    p, D, J = messages.loss, messages.age, messages.jitter
    # Columns of (x_cl, zeta, zeta1, omega) that occur: without ages zeta is zeta1, and without chance and jitter zeta1 is 0.
    chance = bool(p or J or program.noise.size)
    unit = np.eye(n + 2 * links + program.count)
    x_cl, zeta, zeta1, omega = np.split(unit, np.cumsum([n, links, links]), axis=1)
    keep = np.hstack(
        [x_cl, *([zeta, zeta1] if D and chance else [zeta] if D else [zeta + zeta1] if chance else []), omega]
    )
    of_zeta, of_zeta1, of_omega = np.split(keep[n:], np.cumsum([links, links]))
    padded_zeta1 = np.eye(n + links)[n:]
    known, costs = np.vstack([keep[:n], of_zeta1]), [keep.T @ cost @ keep for cost in program.costs]
    V, Gamma = (cp.Variable((n + links,) * 2, symmetric=True) for _ in range(2))
    slack, m = cp.Variable(), cp.Variable(len(costs), nonneg=True)
    blocks = [cp.Variable((q, q), symmetric=True) for _ in range(links // q)]
    places = np.split(np.eye(links), links // q)
    X = sum(place.T @ block @ place for place, block in zip(places, blocks, strict=True))
    M = sum(m[k] * form for k, form in enumerate(program.multipliers))
    K = known.T @ Gamma @ known - sum(m[k] * cost for k, cost in enumerate(costs)) + of_omega.T @ M @ of_omega
    K = K + (of_zeta - of_zeta1).T @ X @ (of_zeta - of_zeta1) if D else K
    seconds = [[cp.Variable((q, q), symmetric=True) for _ in blocks] for _ in range(3 if D and chance else 0)]
    Xa, Xb, Xs = (
        sum(place.T @ block @ place for place, block in zip(places, ones, strict=True))
        for ones in seconds or [blocks] * 3
    )
    inner = Gamma
    if seconds:
        K = K + of_zeta.T @ Xs @ of_zeta
        inner = Gamma + (D + 1) * decay**-D * padded_zeta1.T @ Xa @ padded_zeta1
    own = np.kron(np.eye(links // q), np.ones((q, q)))
    X_jitter: Any = None
    if J:
        ones = [cp.Variable((q, q), symmetric=True) for _ in range(links // q)]
        if fixed is not None and fixed.X_jitter.size:
            ones = list(np.split(fixed.X_jitter * program.basis[-1, -1] ** 2, links // q))
        X_jitter = sum(place.T @ block @ place for place, block in zip(places, ones, strict=True))
        if fixed is None or not fixed.X_jitter.size:
            K = K - MORE * J * sum(
                rate.T @ X_jitter @ rate for rate in (each @ keep for each in program.rates)
            )
    early, noisy = links if J else 0, program.noise.shape[1]
    read = np.hstack([np.eye(links, early), program.noise])
    size = n + links + early + noisy
    apart = np.hstack([np.zeros((links, n)), np.eye(links), -read])
    stored, tail, priced = np.split(np.eye(size), [n + links, n + links + early])
    rest = decay * stored.T @ V @ stored + priced.T @ priced
    rest = rest + decay * tail.T @ X_jitter @ tail if J else rest

    def second(parts: Float[np.ndarray, " links"]) -> Any:
        lost = p * np.repeat(parts, q)
        mean = np.vstack(
            [np.eye(n, size), np.hstack([np.zeros((links, n)), np.diag(lost), (1 - lost)[:, None] * read])]
        )
        spread = cp.multiply(inner[n:, n:], own * (lost * (1 - lost))[:, None])
        if D:
            spread = spread + cp.multiply(D * D * decay ** (1 - D) * X, own * (1 - lost)[:, None])
        found = rest - mean.T @ inner @ mean - apart.T @ spread @ apart
        return (found + found.T) / 2

    moved = V @ (program.N @ keep)
    rows = [[K, moved.T], [moved, V]]
    if seconds:
        R, none = D * D * decay**-D * Xb, np.zeros((n + links, links))
        change = R @ (of_zeta1 - (program.N @ keep)[n:])
        rows = [[K, moved.T, change.T], [moved, V, none], [change, none.T, R]]
    first = cp.bmat(rows)
    room = np.diag(np.r_[np.ones(keep.shape[1]), np.zeros(first.shape[0] - keep.shape[1])])
    conditions = [
        (first + first.T) / 2 >> slack * room,
        V >> FLATTEST * np.eye(n + links),
        slack <= 1,
        cp.trace(V[:n, :n]) == n if fixed is None else m == 1,
        *[block >> slack * np.eye(q) for block in blocks],
        *[
            cp.bmat([[a - s, -s], [-s, b - s]]) >> slack * np.eye(2 * q)
            for a, b, s in zip(*seconds, strict=True)
        ],
        *[s >> slack * np.eye(q) for ones in seconds[2:] for s in ones],
    ]
    losses = messages.losses(links // q)
    found, unit = [second(parts) for parts in losses], np.eye(size)
    if messages.alike(links // q):
        found = [found[0], 2 * found[1] - (found[0] + found[2]) / 2, found[2]]
    asked = list(range(len(found))) if len(found) <= ALL_AT_ONCE else [0, len(found) - 1]
    while True:
        every = [*conditions, *(found[k] >> slack * unit for k in asked)]
        problem = cp.Problem(cp.Maximize(slack), every)
        if not run_dense(problem, NEAR) or V.value is None or not slack.value > 0:
            return None
        least = np.array([np.linalg.eigvalsh(one.value)[0] for one in found])
        more = [k for k in np.argsort(least)[:ALL_AT_ONCE] if k not in asked and least[k] < slack.value / 2]
        if not more:
            break
        asked += more
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
        *(np.vstack([_symmetric(one.value) for one in ones]) / scale for ones in seconds),
    )


def _symmetric(form: Form) -> Form:
    return np.asarray((form + form.T) / 2)
