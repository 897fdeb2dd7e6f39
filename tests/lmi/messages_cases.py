"""Brute force for messages that are lost or late: full coordinates, plain expm, every link and outcome by itself."""

import itertools
from dataclasses import replace

import numpy as np
from sampled_cases import controllers, network, random_problem
from scipy.linalg import expm

from lockstep.check.numbers import as_floats
from lockstep.check.sampled.links import Messages

EDGES = [(1, 2, 1.0), (2, 3, 1.0), (3, 1, 1.0)]
SLOPES = (-1.0, 0.0, 1.0)


class HeldLoop:
    """All agents in full coordinates, phi_i = slope H x_i, controllers on differences that are held.

    State: x of all agents, x_C of all, u of all where it acts a period late, and for each link the held differences of
    the last `memory` instants, newest first; with jitter, last, what is read of each link for this instant.
    """

    def __init__(self, net, ones, slope, memory=1, jitter=()):
        A, C, G, H = (as_floats(M) for M in (net.plant.A, net.plant.C, net.plant.G, net.plant.H))
        B = [as_floats(b) for b in net.plant.B]
        self.n, self.m, self.q, self.N, self.n_C = len(A), B[0].shape[1], len(C), len(ones), ones[0].order
        self.ones, self.delay, self.memory = ones, net.delay, memory
        self.links = [
            (i, j, a) for i, one in enumerate(ones) for j, a in zip(one.sources, one.weights, strict=True)
        ]
        self.flows, self.early, self.jitter = [], {part: [] for part in jitter}, jitter
        for b in B:
            F = np.zeros((self.n + self.m,) * 2)
            F[: self.n, : self.n], F[: self.n, self.n :] = A + slope * G @ H, b
            self.flows.append(expm(F * net.period)[: self.n])
            for part in jitter:
                self.early[part].append(expm(F * net.period * (1 - part))[: self.n])
        self.C = C
        self.rest = self.N * (self.n + self.n_C + (self.m if self.delay else 0))
        self.past = self.rest + len(self.links) * self.q * memory
        self.size = self.past + (len(self.links) * self.q if jitter else 0)

    def step(self, lost=(), ages=(), early=()):
        """The matrix of one period; of each link: lost by chance (True: held), its age, how early it is read next."""
        columns = np.eye(self.size)
        return np.column_stack([self._moved(column, lost, ages, early) for column in columns])

    def _moved(self, state, lost, ages, early):
        N, n, n_C, m, q = self.N, self.n, self.n_C, self.m, self.q
        x = state[: N * n].reshape(N, n)
        x_C = state[N * n : N * (n + n_C)].reshape(N, n_C)
        u_before = state[N * (n + n_C) : self.rest].reshape(N, m) if self.delay else None
        past = state[self.rest : self.past].reshape(len(self.links), self.memory, q)
        read = state[self.past :].reshape(-1, q)
        y, r = x @ self.C.T, np.zeros((N, q))
        held = np.zeros_like(past)
        for e, (i, j, a) in enumerate(self.links):
            now = read[e] if self.jitter else a * (y[i] - y[j])
            now = past[e, 0] if lost and lost[e] else now
            known = np.vstack([now[None], past[e]])
            r[i] += known[ages[e] if ages else 0]
            held[e] = known[: self.memory]
        out = [one.table @ np.r_[x_C[i], r[i]] for i, one in enumerate(self.ones)]
        u = [v[n_C:] for v in out]
        applied = u_before if self.delay else u
        x_next = [flow @ np.r_[x[i], applied[i]] for i, flow in enumerate(self.flows)]
        parts = [*x_next, *(v[:n_C] for v in out), *(u if self.delay else [])]
        reads = []
        for part, (i, j, a) in zip(early, self.links, strict=True) if self.jitter else ():
            x_i, x_j = (self.early[part][k] @ np.r_[x[k], applied[k]] for k in (i, j))
            reads.append(a * self.C @ (x_i - x_j))
        return np.concatenate([np.concatenate(parts), held.ravel(), *reads])

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

    loss: of all links, or one for each;  age: of what chance spares, on all links for ever.
    """
    links = sum(len(one.sources) for one in ones)
    return growth_in_turn(net, ones, [np.broadcast_to(loss, links)], slope, age)


def growth_in_turn(net, ones, losses, slope, age=0):
    """The growth of the mean square per period where one vector of the links' probabilities follows another."""
    loop = HeldLoop(net, ones, slope, memory=max(age, 1))
    ages, totals = (age,) * len(loop.links), [0] * len(losses)
    for lost in itertools.product((False, True), repeat=len(loop.links)):
        F = loop.across(loop.step(lost, ages))
        square = np.kron(F, F)
        for k, p in enumerate(losses):
            totals[k] = totals[k] + np.where(lost, p, 1 - np.asarray(p)).prod() * square
    product = totals[0]
    for total in totals[1:]:
        product = total @ product
    return float(np.abs(np.linalg.eigvals(product)).max()) ** (1 / len(losses))


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


def worst_jitter(net, ones, messages, slope, longest=3):
    """The largest growth of the (mean) square per period when all links read early by a periodic pattern of parts."""
    parts = (0.0, messages.jitter / 2, messages.jitter)
    loop = HeldLoop(net, ones, slope, memory=1, jitter=parts)
    links, loss, lifted = len(loop.links), messages.loss, {}
    for part in parts:
        total = 0
        for lost in itertools.product((False, True), repeat=links) if loss else [(False,) * links]:
            share = loss ** sum(lost) * (1 - loss) ** (links - sum(lost))
            F = loop.across(loop.step(lost, early=(part,) * links))
            total = total + share * np.kron(F, F)
        lifted[part] = total
    worst = 0.0
    for length in range(1, longest + 1):
        for pattern in itertools.product(parts, repeat=length):
            product = np.linalg.multi_dot([lifted[p] for p in pattern]) if length > 1 else lifted[pattern[0]]
            worst = max(worst, float(np.abs(np.linalg.eigvals(product)).max()) ** (1 / length))
    return worst


def growth_of(net, ones, messages, slope, pattern, periods=240):
    """The growth of the mean square per period, by iteration of its exact recursion, outcome by outcome.

    pattern: for each period in turn, the ages of all links, and how early each reads what it uses in the next.
    """
    parts = tuple(sorted({part for _, early in pattern for part in early})) if messages.jitter else ()
    loop = HeldLoop(net, ones, slope, memory=max(messages.age, 1), jitter=parts)
    links, p = len(loop.links), messages.loss
    outcomes = list(itertools.product((False, True), repeat=links)) if p else [(False,) * links]
    maps = [
        [
            np.sqrt(p ** sum(lost) * (1 - p) ** (links - sum(lost)) if p else 1.0)
            * loop.across(loop.step(lost, ages, early))
            for lost in outcomes
        ]
        for ages, early in pattern
    ]
    X, logs = np.eye(len(maps[0][0])), []
    for k in range(periods * len(pattern)):
        X = sum(F @ X @ F.T for F in maps[k % len(maps)])
        logs.append(np.log(np.linalg.norm(X)))
        X = X / np.linalg.norm(X)
    whole = len(pattern)
    return float(np.exp(np.mean(logs[whole * (periods // 2) :])))


def patterns(messages, links, rng, random):
    """Ages and parts: the newest and the oldest, on time and early, always and in turns, and by chance link by link."""
    oldest, newest, early, on_time = ((value,) * links for value in (messages.age, 0, messages.jitter, 0.0))
    saw = [((age,) * links, early) for age in range(messages.age + 1)]
    found = [
        [(oldest, early)],
        [(oldest, on_time)],
        [(newest, early)],
        saw,
        [(oldest, early), (newest, on_time)],
    ]
    for _ in range(random):
        length = int(rng.integers(1, 4))
        found.append(
            [
                (
                    tuple(rng.integers(0, messages.age + 1, links)),
                    tuple(rng.choice([0.0, messages.jitter], links)),
                )
                for _ in range(length)
            ]
        )
    return found


def pendulums(delay=0):
    """Three pendulums that damp their relative velocity, stepped every 50 ms."""
    A, B, H = [[0.0, 1.0], [-2.0, -0.5]], [[0.0], [1.0]], [[1.0, 0.0]]
    net = network(A, B, np.eye(2), B, H, EDGES, alpha=1.0, period=0.05, delay=delay)
    return net, controllers([[[0.9, 0.01, 0.02], [0.1, -1.0, -2.0]]] * 3, 1, EDGES)


def drawn(seed):
    """A random loop that steps often enough to have a chance, and faults of its messages."""
    rng = np.random.default_rng(1000 + seed)
    net, ones = random_problem(seed)
    loss = float(rng.choice([0.1, 0.4, 0.7, 0.9])) if seed % 3 != 1 else 0.0
    age = int(rng.integers(1, 4)) if seed % 3 != 0 else 0
    burst = int(rng.integers(0, age + 1))
    return replace(net, period=min(net.period, 0.2)), ones, Messages(loss, burst, (0, age - burst)), rng


def strong():
    """Pendulums with so much gain that lost messages matter."""
    net, _ = pendulums()
    return net, controllers([[[0.9, 0.01, 0.02], [0.1, -10.0, -14.0]]] * 3, 1, EDGES)
