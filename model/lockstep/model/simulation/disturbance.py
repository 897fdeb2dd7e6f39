"""Disturbances xi of (2): one number per state of every agent, as functions of time that a seed fixes.

Of white noise only the intensity means anything: a Gaussian held for T seconds with the standard deviation sigma has
the intensity S = sigma^2 T, the variance of its integral over one second; for T -> 0 at a fixed S it becomes white
noise with E[w(t) w(s)] = S delta(t - s). "Zero mean and unit variance" (the paper's Section 4) leaves T open.

A disturbance is "held" (constant between the instants of the run) or "smooth"; the integrators treat the two apart,
so that neither steps over a jump.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from jaxtyping import Float

from lockstep.check.errors import ProblemError, demand
from lockstep.model.simulation.quadrature import Hold

MOST_INSTANTS = 5_000_000
"""Rows of a record, and samples of a noise: with ten agents of four states, about 2 GB of a record."""

_ROUNDING = 1e-9
"""Part of an interval by which an instant may miss its start: instants are multiples of a step, rounded."""


class Disturbance(Protocol):
    """What a run asks of a disturbance."""

    @property
    def hold(self) -> Hold:
        """Whether it is constant between the instants of a run."""
        ...

    def at(self, t: Float[np.ndarray, " M"], since: Float[np.ndarray, " M"]) -> Float[np.ndarray, "M N n"]:
        """Return xi at the times t, each within the step of the run that begins at `since`."""
        ...


@dataclass(frozen=True)
class Quiet:
    """No disturbance of N agents with n states."""

    N: int
    n: int
    hold: Hold = field(default="held", init=False)

    def at(self, t: Float[np.ndarray, " M"], since: Float[np.ndarray, " M"]) -> Float[np.ndarray, "M N n"]:  # noqa: ARG002
        """Return zeros."""
        return np.zeros((len(t), self.N, self.n))


@dataclass(frozen=True, eq=False)
class Samples:
    """Given samples, each held for `interval` s from `start` on; zero before and after.

    values: (M, N, n);  interval: in s, a whole number of the steps of the run.
    """

    values: Float[np.ndarray, "M N n"]
    interval: float
    start: float = 0.0
    hold: Hold = field(default="held", init=False)

    def __post_init__(self) -> None:
        values = np.asarray(self.values, dtype=float)
        if values.ndim != 3 or not np.isfinite(values).all():
            raise ProblemError("the samples are no finite M x N x n numbers", where="disturbance")
        demand(0 < self.interval < math.inf, f"samples held for {self.interval!r} s", "disturbance")
        object.__setattr__(self, "values", values)

    def at(self, t: Float[np.ndarray, " M"], since: Float[np.ndarray, " M"]) -> Float[np.ndarray, "M N n"]:  # noqa: ARG002
        """Return the sample that is held during the step."""
        index = np.floor((since - self.start) / self.interval + _ROUNDING).astype(int)
        there = (index >= 0) & (index < len(self.values))
        return np.asarray(np.where(there[:, None, None], self.values[np.where(there, index, 0)], 0.0))


@dataclass(frozen=True, eq=False)
class Steps:
    """Constant values (N, n) from the first instant not before `start` to the first not before `stop`."""

    values: Float[np.ndarray, "N n"]
    start: float = 0.0
    stop: float = math.inf
    hold: Hold = field(default="held", init=False)

    def at(self, t: Float[np.ndarray, " M"], since: Float[np.ndarray, " M"]) -> Float[np.ndarray, "M N n"]:  # noqa: ARG002
        """Return the values where the step is on."""
        return np.asarray(_on(since, self.start, self.stop)[:, None, None] * self.values)


@dataclass(frozen=True, eq=False)
class Sines:
    """values sin(2 pi f (t - start) + phases) from `start` to `stop`; values and phases (N, n), f in Hz."""

    values: Float[np.ndarray, "N n"]
    phases: Float[np.ndarray, "N n"]
    frequency: float
    start: float = 0.0
    stop: float = math.inf
    hold: Hold = field(default="smooth", init=False)

    def at(self, t: Float[np.ndarray, " M"], since: Float[np.ndarray, " M"]) -> Float[np.ndarray, "M N n"]:
        """Return the sines; on or off for a whole step."""
        angle = 2 * np.pi * self.frequency * (t - self.start)[:, None, None] + self.phases
        return np.asarray(_on(since, self.start, self.stop)[:, None, None] * self.values * np.sin(angle))


@dataclass(frozen=True, eq=False)
class Driven:
    """One agent's states driven by an input of its own, B v(t); those of the others are not.

    agent: counted from 0, of N;  B: (n, m);  v: times (M,) -> (M, m).
    """

    agent: int
    N: int
    B: Float[np.ndarray, "n m"]
    v: Callable[[Float[np.ndarray, " M"]], Float[np.ndarray, "M m"]]
    hold: Hold = field(default="smooth", init=False)

    def at(self, t: Float[np.ndarray, " M"], since: Float[np.ndarray, " M"]) -> Float[np.ndarray, "M N n"]:  # noqa: ARG002
        """Return B v on the agent's states."""
        xi = np.zeros((len(t), self.N, len(self.B)))
        xi[:, self.agent] = self.v(np.asarray(t, dtype=float)) @ self.B.T
        return xi


@dataclass(frozen=True)
class Sum:
    """Several disturbances at once."""

    parts: tuple[Disturbance, ...]

    @property
    def hold(self) -> Hold:
        """Smooth if any part is."""
        return "held" if all(part.hold == "held" for part in self.parts) else "smooth"

    def at(self, t: Float[np.ndarray, " M"], since: Float[np.ndarray, " M"]) -> Float[np.ndarray, "M N n"]:
        """Return the sum of the parts."""
        return np.asarray(sum(part.at(t, since) for part in self.parts))


def noise(
    N: int,
    n: int,
    *,
    interval: float,
    horizon: float,
    seed: int,
    sigma: float | Float[np.ndarray, "N n"] | None = None,
    intensity: float | None = None,
) -> Samples:
    """Return independent Gaussian noise on every state, held for `interval` s.

    Args:
        N, n: agents and states.
        interval: T, how long a sample is held, in s.
        horizon: how long it lasts, in s.
        seed: of NumPy's default generator; the same seed gives the same noise.
        sigma: the standard deviation of a sample, one or (N, n); or
        intensity: S = sigma^2 T, in (units of xi)^2 s, for a sigma that goes with the interval.

    >>> noise(2, 1, interval=0.01, horizon=1.0, seed=0, intensity=0.04).values.std().round(0)
    np.float64(2.0)
    """
    if (sigma is None) == (intensity is None):
        raise ProblemError("noise with both `sigma` and `intensity`, or neither", where="disturbance")
    if sigma is None:
        sigma = math.sqrt(float(intensity or 0.0) / interval)
    found, expected = f"{horizon / interval:.3g} samples of noise", f"at most {MOST_INSTANTS}"
    demand(horizon / interval <= MOST_INSTANTS, found, "disturbance", expected, "shorten the horizon")
    samples = max(1, math.ceil(horizon / interval - _ROUNDING))
    return Samples(sigma * np.random.default_rng(seed).standard_normal((samples, N, n)), interval)


def _on(since: Float[np.ndarray, " M"], start: float, stop: float) -> Float[np.ndarray, " M"]:
    """Return 1 within [start, stop), to rounding of the instants."""
    slack = _ROUNDING * max(1.0, abs(start))
    return np.asarray((since >= start - slack) & (since < stop - slack), dtype=float)
