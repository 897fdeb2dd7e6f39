"""How much each fault of the messages may be before no certificate is found, and what breaks the loop beyond it.

Each fault by itself: the largest that is certified, by bisection, each step a proof; and one that is seen to break the
linear part at a constant slope, in doubles, the least of those that are looked at: for losses the exact growth of the mean
square, the spectral radius of

    X -> F X F' + sum_e p (1 - p) F_e X F_e',    (x_cl+, eps+) = (F + sum_e (delta_e - p) F_e) (x_cl, eps),

for ages and jitter a periodic pattern with a multiplier of more than 1. Between the two nothing is said.
"""

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import reduce
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.linalg import expm
from scipy.sparse import csr_array
from scipy.sparse.linalg import ArpackError, LinearOperator, eigs

from lockstep.check.bound.slope_bounds import Entry
from lockstep.check.sampled.controller import HeldController, SampledNetwork
from lockstep.check.sampled.lifting import copies, lift
from lockstep.check.sampled.links import Messages
from lockstep.check.sampled.messages import message_step
from lockstep.lmi.sampled.messages.witnesses import certify_messages
from lockstep.lmi.sampled.witnesses import in_doubles

Form = Float[np.ndarray, "k k"]

MOST_PERIODS, MOST_BROKEN = 64, 96
"""Ages that are looked at: to be certified, and to break the loop."""

LOSSES, JITTERS = 100, 50
"""Steps of a whole: how finely a loss and a jitter are told."""

LARGE = 150
"""States of a loop with memory, of which one eigenvalue is looked for and not all."""

STRIDE = 0.25
"""Of an age that did not break the loop: how much further the next is that is looked at; those between are after it."""

DENSE = 400
"""Entries of a mean square up to which all eigenvalues are computed."""


@dataclass(frozen=True)
class FaultLimit:
    """Of one fault by itself.

    certified: the largest that is proved to be survived;  breaks: one that is not, None where none was seen;  how: it does.
    """

    certified: float
    breaks: float | None = None
    how: str = "nothing tried broke the loop"

    def document(self) -> dict[str, Any]:
        """Return the limit as plain JSON types."""
        return dict(vars(self))


def message_limits(
    network: SampledNetwork,
    controllers: tuple[HeldController, ...],
    near: Form,
    entries: tuple[Entry, ...] = (),
    tell: Callable[[str], None] = lambda _: None,
) -> dict[str, FaultLimit]:
    """Return the limit of each fault: loss, burst, delay, jitter.

    Args:
        network, controllers: of a design whose sampled loop is certified.
        near: P of its witness.
        entries: bounds of single slopes that are used besides alpha.
        tell: called with what is being done.
    """

    def certified(messages: Messages) -> bool:
        tell(f"messages with {messages.text}")
        return certify_messages(network, controllers, messages, near) is not None

    loss = _largest(LOSSES, lambda k: certified(Messages(loss=k / LOSSES)))
    age = _largest_age(lambda D: certified(Messages(burst=D)))
    jitter = _largest(JITTERS, lambda k: certified(Messages(jitter=k / JITTERS)))
    tell("what breaks the loop")
    cases = [
        ConstantSlope(network, controllers, slope, said) for slope, said in constant_slopes(network, entries)
    ]
    burst, delay = (_breaking_age(cases, age, patterns) for patterns in (bursts, delays))
    return {
        "loss": FaultLimit(loss / LOSSES, *_breaking_loss(cases, loss)),
        "burst": FaultLimit(age, *burst),
        "delay": FaultLimit(age, *delay),
        "jitter": FaultLimit(jitter / JITTERS, *_breaking_jitter(cases, jitter)),
    }


def _largest(steps: int, holds: Callable[[int], bool]) -> int:
    """Return a step that holds while the next one does not, by bisection; 0 if none does."""
    low, high = 0, steps
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def _largest_age(holds: Callable[[int], bool]) -> int:
    high = 1
    while high < MOST_PERIODS and holds(high):
        high *= 2
    low = high // 2
    return low + _largest(high - low, lambda k: holds(low + k))


def constant_slopes(
    network: SampledNetwork, entries: tuple[Entry, ...]
) -> Iterator[tuple[Float[np.ndarray, "r v"], str]]:
    """Yield constant slopes of phi that are admitted: 0, and each single entry at its bound."""
    r, v = network.plant.G.shape[1], len(network.plant.H)
    bounds = {(one.component, one.argument): min(one.bound, network.alpha) for one in entries}
    yield np.zeros((r, v)), "slope 0"
    for k in range(r):
        for l in range(v):
            size = bounds.get((k, l), 0.0 if entries else network.alpha)
            for sign in (size, -size) if size else ():
                slope = np.zeros((r, v))
                slope[k, l] = sign
                yield slope, f"slope {sign:g} of phi{k + 1} by v{l + 1}"


class ConstantSlope:
    """The sampled loop with phi = slope v, alike for all agents: (x_cl, zeta) to x_cl+, and what is read early."""

    def __init__(
        self, network: SampledNetwork, controllers: tuple[HeldController, ...], slope: Form, said: str
    ) -> None:
        self.loop, self.said = in_doubles(network, controllers), said
        plant = self.loop.network.plant
        self.A = plant.A + plant.G @ slope @ plant.H
        step = message_step(self.loop, self._period(1.0))[0]
        self.n, self.links = self.loop.n_x, len(self.loop.differences)
        self.Y = self.loop.differences[:, : self.n]
        self.x_cl, self.zeta = step[: self.n, : self.n], step[: self.n, self.loop.messages]
        self.q = len(plant.C)

    def _period(self, part: float) -> Any:
        zero, T = np.zeros_like(self.A), self.loop.network.period
        one = lift(self.A, self.loop.into, zero, zero, part * T, expm)
        return copies(one, np.eye(self.loop.network.d.N - 1))

    def outcome(self, held: Form) -> Form:
        """Return (x_cl, eps) to (x_cl+, eps+) with zeta = zeta1 = held eps."""
        top = np.hstack([self.x_cl, self.zeta @ held])
        keep = np.eye(self.n, len(top[0]))
        return np.vstack([top, np.hstack([np.zeros((self.links, self.n)), held]) - self.Y @ (top - keep)])

    def mean_square(self, loss: float) -> float:
        """Return the growth of the mean square per period."""
        unit = np.eye(self.links)
        mean = self.outcome(loss * unit)
        apart = []
        for place in np.split(unit, self.links // self.q):
            own = place.T @ place
            apart.append(np.sqrt(loss * (1 - loss)) * (self.outcome(own) - self.outcome(0 * own)))

        def once(X: Form) -> Form:
            X = X.reshape(mean.shape)
            return np.asarray(mean @ X @ mean.T + sum(F @ X @ F.T for F in apart)).ravel()

        size = mean.size
        if size <= DENSE:
            return float(np.abs(np.linalg.eigvals(np.column_stack([once(x) for x in np.eye(size)]))).max())
        found = eigs(
            LinearOperator((size, size), once, dtype=float), 1, v0=np.eye(len(mean)).ravel(), tol=1e-6
        )
        return float(np.abs(found[0]).max())

    def aged(self, ages: tuple[int, ...], memory: int) -> Any:
        """Return (x_cl, d(k - 1), ..., d(k - memory)) to the next, each link holding what is so old. Mostly a shift."""
        n, links, q = self.n, self.links, self.q
        size = n + memory * links
        held = np.zeros((links, size))
        for e, age in enumerate(ages):
            rows = slice(e * q, (e + 1) * q)
            if age:
                held[rows, n + (age - 1) * links :][:, :links] = np.eye(links)[rows]
            else:
                held[rows, :n] = self.Y[rows]
        zeta = held.copy()
        zeta[:, :n] -= self.Y
        F = np.zeros((size, size))
        F[:n] = self.zeta @ zeta
        F[:n, :n] += self.x_cl
        F[n : n + links, :n] = self.Y
        F[n + links :, n : size - links] = np.eye(size - n - links)
        return csr_array(F)

    def early(self, part: float) -> Form:
        """Return (x_cl, eta) to the next, with readings so much of a period before the next instant."""
        early = message_step(self.loop, self._period(1 - part))[0]
        columns = np.r_[0 : self.n, self.loop.messages.start : self.loop.messages.stop]
        n_d, now = self.loop.n_d, np.hstack([self.x_cl, self.zeta])
        read = self.Y[:, :n_d] @ (early[:n_d, columns] - now[:n_d])
        return np.vstack([now, read])


def bursts(age: int) -> Iterator[tuple[int, ...]]:
    """Yield patterns of ages in which so many are lost in a row, alone or with some that arrive between."""
    saw = tuple(range(age + 1))
    yield saw
    for arrived in (1, 2, 4):
        yield saw + (0,) * arrived
    yield saw + tuple(range(age // 2 + 1))


def delays(age: int) -> Iterator[tuple[int, ...]]:
    """Yield patterns of ages in which messages are so late, always or in turns."""
    yield (age,)
    for first in (1, 2, 3):
        for second in (1, 2, 3):
            yield (age,) * first + (0,) * second
    yield from bursts(age)


def _breaking_loss(cases: list[ConstantSlope], certified: int) -> tuple[float | None, str]:
    def growth(k: int) -> tuple[float, str]:
        return max((case.mean_square(k / LOSSES), case.said) for case in cases)

    if growth(LOSSES - 1)[0] <= 1:
        return None, FaultLimit.how
    k = 1 + _largest(LOSSES - 1, lambda one: growth(one)[0] <= 1)
    found, said = growth(max(k, certified + 1))
    return max(k, certified + 1) / LOSSES, f"the mean square grows by {found:.6g} per period at {said}"


def _breaking_age(
    cases: list[ConstantSlope], certified: int, patterns: Callable[[int], Iterator[tuple[int, ...]]]
) -> tuple[float | None, str]:
    def grows(age: int) -> tuple[float, str]:
        return max(_pattern_growth(case, age, pattern) for case in cases for pattern in patterns(age))

    below, age = certified, certified + 1
    while age < MOST_BROKEN:
        if grows(age)[0] > 1:
            return next(
                (one, said)
                for one in range(below + 1, age + 1)
                for growth, said in [grows(one)]
                if growth > 1
            )
        below, age = age, max(age + 1, min(age + 1 + int(age * STRIDE), MOST_BROKEN - 1))
    return None, FaultLimit.how


def _pattern_growth(case: ConstantSlope, age: int, pattern: tuple[int, ...]) -> tuple[float, str]:
    links = case.links // case.q
    steps = {one: case.aged((one,) * links, age) for one in set(pattern)}
    growth = _radius([steps[one] for one in pattern])
    return (
        growth,
        f"ages of {runs_text(pattern)} in turn: growth {growth:.6g} per period at {case.said}",
    )


def runs_text(ages: tuple[int, ...]) -> str:
    """Return ages in turn, those that rise by one as first and last.

    >>> runs_text((0, 1, 2, 3, 0, 0, 1))
    '0 to 3, 0, 0 to 1'
    """
    starts = [k for k in range(len(ages)) if k == 0 or ages[k] != ages[k - 1] + 1]
    runs = (ages[k:end] for k, end in pairwise([*starts, len(ages)]))
    return ", ".join(f"{run[0]} to {run[-1]}" if len(run) > 1 else f"{run[0]}" for run in runs)


def _breaking_jitter(cases: list[ConstantSlope], certified: int) -> tuple[float | None, str]:
    for k in range(certified + 1, JITTERS + 1):
        part, found = k / JITTERS, []
        for case in cases:
            early, exact = case.early(part), case.early(0.0)
            for said, steps in {"always": [early], "every other time": [early, exact]}.items():
                growth = _radius(steps)
                found.append((growth, f"read so early {said}: growth {growth:.6g} per period at {case.said}"))
        growth, said = max(found)
        if growth > 1:
            return part, said
    return None, FaultLimit.how


def _radius(steps: list[Any]) -> float:
    """Return the growth per step of a product: of a large one by Arnoldi's method, if that converges."""
    size = steps[0].shape[0]

    def product(X: Form) -> Form:
        return reduce(lambda x, step: step @ x, steps, X)

    found = np.zeros(0)
    if size > LARGE:
        with suppress(ArpackError):
            found = eigs(LinearOperator((size, size), product, dtype=float), 1, v0=np.ones(size), tol=1e-9)[0]
    most = np.abs(found if len(found) else np.linalg.eigvals(product(np.eye(size)))).max()
    return float(most ** (1 / len(steps)))
