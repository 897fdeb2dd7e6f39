"""Brute force for messages that are lost or late: full coordinates, plain expm, every link and outcome by itself."""

import itertools

import numpy as np
from scipy.linalg import expm

from lockstep.check.numbers import as_floats


class HeldLoop:
    """All agents in full coordinates, phi_i = slope H x_i, controllers on differences that are held.

    State: x of all agents, x_C of all, u of all where it acts a period late, and for each link the held differences of
    the last `memory` instants, newest first.
    """

    def __init__(self, net, ones, slope, memory=1):
        A, C, G, H = (as_floats(M) for M in (net.plant.A, net.plant.C, net.plant.G, net.plant.H))
        B = [as_floats(b) for b in net.plant.B]
        self.n, self.m, self.q, self.N, self.n_C = len(A), B[0].shape[1], len(C), len(ones), ones[0].order
        self.ones, self.delay, self.memory = ones, net.delay, memory
        self.links = [
            (i, j, a) for i, one in enumerate(ones) for j, a in zip(one.sources, one.weights, strict=True)
        ]
        self.flows = []
        for b in B:
            F = np.zeros((self.n + self.m,) * 2)
            F[: self.n, : self.n], F[: self.n, self.n :] = A + slope * G @ H, b
            self.flows.append(expm(F * net.period)[: self.n])
        self.C = C
        self.rest = self.N * (self.n + self.n_C + (self.m if self.delay else 0))
        self.size = self.rest + len(self.links) * self.q * memory

    def step(self, lost=(), ages=()):
        """The matrix of one period, and of the held differences: lost by chance (True: held), or of an age for each link."""
        columns = np.eye(self.size)
        return np.column_stack([self._moved(column, lost, ages) for column in columns])

    def _moved(self, state, lost, ages):
        N, n, n_C, m, q = self.N, self.n, self.n_C, self.m, self.q
        x = state[: N * n].reshape(N, n)
        x_C = state[N * n : N * (n + n_C)].reshape(N, n_C)
        u_before = state[N * (n + n_C) : self.rest].reshape(N, m) if self.delay else None
        past = state[self.rest :].reshape(len(self.links), self.memory, q)
        y, r = x @ self.C.T, np.zeros((N, q))
        held = np.zeros_like(past)
        for e, (i, j, a) in enumerate(self.links):
            now = past[e, 0] if lost and lost[e] else a * (y[i] - y[j])
            known = np.vstack([now[None], past[e]])
            r[i] += known[ages[e] if ages else 0]
            held[e] = known[: self.memory]
        out = [one.table @ np.r_[x_C[i], r[i]] for i, one in enumerate(self.ones)]
        u = [v[n_C:] for v in out]
        applied = u_before if self.delay else u
        x_next = [flow @ np.r_[x[i], applied[i]] for i, flow in enumerate(self.flows)]
        parts = [*x_next, *(v[:n_C] for v in out), *(u if self.delay else [])]
        return np.concatenate([np.concatenate(parts), held.ravel()])

    def across(self, matrix):
        """The matrix on the quotient by agreement with everything else at rest."""
        down = np.eye(self.size)[self.n :]
        for i in range(1, self.N):
            rows = slice((i - 1) * self.n, i * self.n)
            down[rows, : self.n] = -np.eye(self.n)
        up = np.eye(self.size)[:, self.n :]
        return down @ matrix @ up


def mean_square_radius(net, ones, loss, slope, age=0):
    """The growth of the mean square per period: the spectral radius of E F (x) F, outcome by outcome.

    age: of what chance spares, on all links for ever.
    """
    loop = HeldLoop(net, ones, slope, memory=max(age, 1))
    ages, total = (age,) * len(loop.links), 0
    for lost in itertools.product((False, True), repeat=len(loop.links)):
        part = loss ** sum(lost) * (1 - loss) ** (len(lost) - sum(lost))
        F = loop.across(loop.step(lost, ages))
        total = total + part * np.kron(F, F)
    return float(np.abs(np.linalg.eigvals(total)).max())


def worst_pattern(net, ones, age, slope, longest=6, rng=None, random=0):
    """The largest growth of the square per period under a periodic pattern of ages, alike on all links and by chance."""
    loop = HeldLoop(net, ones, slope, memory=max(age, 1))
    links = len(loop.links)
    steps = {a: loop.across(loop.step(ages=(a,) * links)) for a in range(age + 1)}
    worst = 0.0
    for length in range(1, longest + 1):
        for pattern in itertools.product(range(age + 1), repeat=length):
            product = np.eye(len(steps[0]))
            for a in pattern:
                product = steps[a] @ product
            worst = max(worst, float(np.abs(np.linalg.eigvals(product)).max()) ** (2 / length))
    for _ in range(random):
        length = int(rng.integers(1, longest + 1))
        product = np.eye(len(steps[0]))
        for _ in range(length):
            product = loop.across(loop.step(ages=tuple(rng.integers(0, age + 1, links)))) @ product
        worst = max(worst, float(np.abs(np.linalg.eigvals(product)).max()) ** (2 / length))
    return worst
