"""The same step in NumPy and CasADi's virtual machine, for machines without a C compiler: slower, the same scheme.

The controllers' bits are those of the compiled ones: sums from left to right, each operation rounded once.
"""

from collections.abc import Sequence

import casadi as ca
import numpy as np
from jaxtyping import Float

from lockstep.model.simulation.divergence import beyond
from lockstep.swarm.disturbances import Fields, Pace
from lockstep.swarm.loop import SwarmLoop


class PlainSwarm:
    """A swarm in NumPy, from `start` at rest; the arguments and methods are those of `CompiledSwarm`."""

    def __init__(self, loop: SwarmLoop, start: Float[np.ndarray, "N n"], fields: Fields, pace: Pace) -> None:
        self._loop, self._fields, self._per, self._substeps = loop, fields, pace.per, pace.substeps
        self._instant, self._real = pace.instant, np.dtype(loop.real)
        N, agent = loop.N, loop.agent
        self._x, self._beyond = start.T.copy(), beyond(agent)
        self._u, self._late = np.zeros((2, N, agent.m))
        self._memory = np.zeros((N, loop.order), self._real)
        self._drift = _drift(loop)
        self._slots = _slots(loop)
        self._index, self._effort = np.zeros((N, 4)), np.zeros((N, 5))

    def step(self, k: int, mean: Float[np.ndarray, " n"], *, last: bool = False) -> Float[np.ndarray, " f"]:
        """Go from instant k to the next; see `CompiledSwarm.step`."""
        since, T = k * self._instant, self._instant
        self._fields.advance(since)
        e = self._x.T - mean
        square = (e**2).sum(axis=1)
        share = T / 2 if k == 0 or last else T
        for place, part in enumerate((square, np.sqrt(square))):
            self._index[:, place] += share * part
            self._index[:, place + 2] += share * since * part
        weighed = float(np.einsum("ia,ab,ib->", e, self._loop.R, e))
        cost = faults = 0.0
        self._clipped = 0
        if k % self._per == 0 and not last:
            memory = self._memory.astype(float)
            cost = float(np.einsum("ia,ab,ib->", memory, self._loop.Q, memory))
            faults = self._control()
            self._count(since, (k + self._per) * T)
        if not last:
            self._integrate(since)
        strays = float((~(np.abs(self._x) <= self._beyond)).sum())
        sums = (self._x.T - mean).sum(axis=0)
        return np.array([*sums, square.sum(), weighed, cost, faults, strays, self._clipped])

    def states(self, agents: Sequence[int] | np.ndarray) -> Float[np.ndarray, "k n"]:
        """Return the states of some agents."""
        return np.asarray(self._x.T[np.asarray(agents)])

    def inputs(self, agents: Sequence[int] | np.ndarray) -> Float[np.ndarray, "k m"]:
        """Return the inputs that act on some agents."""
        return np.asarray(self._u[np.asarray(agents)])

    def memories(self, agents: Sequence[int] | np.ndarray) -> Float[np.ndarray, "k n_C"]:
        """Return the states of some controllers."""
        return np.asarray(self._memory[np.asarray(agents)].astype(float))

    def figures(self) -> tuple[Float[np.ndarray, "N 4"], Float[np.ndarray, "N 5"]]:
        """Return the indices of the disagreements, and of the inputs with the largest |u| behind."""
        return self._index, self._effort

    def close(self) -> None:
        """Nothing is held."""

    def _control(self) -> float:
        """Step all controllers; return at how many a number was not finite: they keep what they had."""
        loop, n_C = self._loop, self._loop.order
        with np.errstate(all="ignore"):
            y = (self._x.T @ loop.agent.lure.C.T).astype(self._real)
            r = np.zeros_like(y)
            for listener, source, weight in self._slots:
                r[listener] += weight[:, None] * (y[listener] - y[source])
            given = np.concatenate([self._memory, r], axis=1)
            found = np.empty((loop.N, loop.tables.shape[1]), self._real)
            for i in range(found.shape[1]):
                found[:, i] = _row(loop.tables[:, i], given)
        fine = np.isfinite(found).all(axis=1) & np.isfinite(r).all(axis=1)
        if len(loop.limits):
            lower, upper = loop.limits.T.astype(self._real)
            u = np.clip(found[:, n_C:], lower, upper)
            self._clipped = int(((u != found[:, n_C:]).any(axis=1) & fine).sum())
            found[:, n_C:] = u
        self._memory[fine] = found[fine, :n_C]
        if loop.delay:
            self._u = self._late.copy()
            self._late[fine] = found[fine, n_C:]
        else:
            self._u[fine] = found[fine, n_C:]
        return float((~fine).sum())

    def _count(self, begin: float, end: float) -> None:
        square = (self._u**2).sum(axis=1)
        for place, part in enumerate((square, np.sqrt(square))):
            self._effort[:, place] += (end - begin) * part
            self._effort[:, place + 2] += (end * end - begin * begin) / 2 * part
        self._effort[:, 4] = np.maximum(self._effort[:, 4], np.abs(self._u).max(axis=1, initial=0.0))

    def _integrate(self, since: float) -> None:
        h, fields = self._instant / self._substeps, self._fields
        B = np.broadcast_to(self._loop.B, (self._loop.N, *self._loop.B.shape[1:]))
        forced = np.einsum("inm,im->in", B, self._u)
        fixed = forced.T + (fields.value.T if fields.held else 0.0)

        def slope(x: np.ndarray, t: float) -> np.ndarray:
            dx: np.ndarray = np.asarray(self._drift(x, t)) + fixed
            if fields.waves:
                s, c = fields.waves_at(np.array([t]), since)[0]
                dx = dx + s * fields.sine.T + c * fields.cosine.T
            return dx

        with np.errstate(all="ignore"):
            for i in range(self._substeps):
                t, x = since + i * h, self._x
                k_1 = slope(x, t)
                k_2 = slope(x + h / 2 * k_1, t + h / 2)
                k_3 = slope(x + h / 2 * k_2, t + h / 2)
                k_4 = slope(x + h * k_3, t + h)
                self._x = x + h / 6 * ((k_1 + k_4) + 2 * (k_2 + k_3))


def _row(coefficients: np.ndarray, given: np.ndarray) -> np.ndarray:
    """One row of M z for all controllers, from left to right; a term without any coefficient is left out."""
    total = np.zeros(len(given), given.dtype)
    for j in range(given.shape[1]):
        if coefficients[:, j].any():
            total = total + coefficients[:, j] * given[:, j]
    return total


def _slots(loop: SwarmLoop) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Each agent's first neighbour, then each one's second, ...: listeners, sources, weights."""
    lists, weights = loop.neighbours, loop.weights
    found = []
    for slot in range(int(lists.degrees.max(initial=0))):
        listener = np.flatnonzero(lists.degrees > slot)
        edge = lists.first[listener] + slot
        found.append((listener, lists.source[edge], weights[edge]))
    return found


def _drift(loop: SwarmLoop) -> ca.Function:
    """(x, t) -> A x + G phi(H x, t) + offset(t): CasADi maps it over the columns of a matrix."""
    lure = loop.agent.lure
    x, t = ca.SX.sym("x", loop.agent.n), ca.SX.sym("t")
    value = ca.DM(lure.A) @ x + ca.DM(lure.G) @ lure.phi(ca.DM(lure.H) @ x, t) + lure.offset(t)
    return ca.Function("drift", [x, t], [ca.densify(value)])
