"""What disturbs a swarm, as the engines take it: xi = held + sin(a) S + cos(a) C, each (N, n), a = 2 pi f (t - start).

Noise is drawn a period at a time, with the numbers that `lockstep.model.simulation.disturbance.noise` draws at once.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from lockstep.check.errors import ProblemError
from lockstep.model.simulation.disturbance import Disturbance, Quiet, Sines
from lockstep.model.simulation.quadrature import Hold

_ROUNDING = 1e-9


@dataclass(frozen=True)
class Pace:
    """instant: s between the instants of a record;  per: of them to a period;  substeps: Runge-Kutta steps to each."""

    instant: float
    per: int
    substeps: int


@dataclass(eq=False)
class StreamedNoise:
    """Independent Gaussian noise on every state, held for `interval` s, drawn as the run goes on.

    N, n: agents and states;  sigma: standard deviation of a sample, one or (N, n);  interval, start, stop: in s;  seed: of
    the numbers.
    """

    N: int
    n: int
    sigma: float | Float[np.ndarray, "N n"]
    interval: float
    seed: int
    start: float = 0.0
    stop: float = math.inf
    hold: Hold = field(default="held", init=False)
    _drawn: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        self._random = np.random.default_rng(self.seed)
        self._quiet = np.zeros((self.N, self.n))
        self._now = self._quiet

    def at(self, t: Float[np.ndarray, " M"], since: Float[np.ndarray, " M"]) -> Float[np.ndarray, "M N n"]:  # noqa: ARG002
        """Return the sample that is held; instants may not go back.

        Raises:
            ProblemError: they do.
        """
        return np.array([self._sample(math.floor(one / self.interval + _ROUNDING)) for one in since])

    def current(self, since: float) -> Float[np.ndarray, "N n"]:
        """Return the sample that is held, the same array as long as it is the same."""
        return self._sample(math.floor(since / self.interval + _ROUNDING))

    def _sample(self, index: int) -> Float[np.ndarray, "N n"]:
        if index < self._drawn - 1:
            raise ProblemError("noise is drawn as the run goes on, and not again", where="disturbance")
        while self._drawn <= index:
            begin = self._drawn * self.interval
            fresh = self.sigma * self._random.standard_normal((self.N, self.n))
            on = self.start - 1e-9 <= begin < self.stop - 1e-9
            self._now = fresh if on else self._quiet
            self._drawn += 1
        return self._now


class Fields:
    """The three parts of a disturbance, instant by instant.

    held: whether there is a part that is held;  waves: whether there is a sinusoid;  `scale` is 1 or 0 as the sinusoid is on.
    """

    def __init__(self, disturbance: Disturbance | None, N: int, n: int) -> None:
        self._given = disturbance
        self.waves = isinstance(disturbance, Sines)
        self.held = disturbance is not None and not isinstance(disturbance, Sines | Quiet)
        if self.held and disturbance is not None and disturbance.hold != "held":
            raise ProblemError(
                "a sum of smooth disturbances", where="swarm", expected="one sinusoid, or what is held"
            )
        self.value = np.zeros((N, n))
        self.sine = self.cosine = self.value
        if isinstance(disturbance, Sines):
            values = np.broadcast_to(disturbance.values, (N, n))
            self.sine = values * np.cos(disturbance.phases)
            self.cosine = values * np.sin(disturbance.phases)
        self._gram = np.zeros((2, 2))
        if self.waves:
            self._gram = _gram(self.sine, self.cosine)
        self._squared = 0.0

    def advance(self, since: float) -> bool:
        """Go to an instant; tell whether the held part changed."""
        if not self.held or self._given is None:
            return False
        if isinstance(self._given, StreamedNoise):
            fresh = self._given.current(since)
            if fresh is self.value:
                return False
        else:
            fresh = self._given.at(np.array([since]), np.array([since]))[0]
            if np.array_equal(fresh, self.value):
                return False
        self.value = fresh
        self._squared = _gram(fresh)[0, 0]
        return True

    def waves_at(self, t: Float[np.ndarray, " M"], since: float) -> Float[np.ndarray, "M 2"]:
        """Return sine and cosine of the sinusoid at times within the step that begins at `since`; 0 while it is off."""
        if not isinstance(self._given, Sines):
            return np.zeros((len(t), 2))
        one = self._given
        slack = _ROUNDING * max(1.0, abs(one.start))
        on = one.start - slack <= since < one.stop - slack
        angle = 2 * np.pi * one.frequency * (t - one.start)
        return float(on) * np.column_stack([np.sin(angle), np.cos(angle)])

    def squared_at(self, since: float) -> float:
        """Return |xi_d|^2 at an instant: sum_i |xi_i - mean|^2."""
        if self.waves:
            wave = self.waves_at(np.array([since]), since)[0]
            return float(wave @ self._gram @ wave)
        return self._squared

    def of(self, agents: np.ndarray, since: float) -> Float[np.ndarray, "k n"]:
        """Return xi of some agents at an instant."""
        s, c = self.waves_at(np.array([since]), since)[0]
        return np.asarray(self.value[agents] + s * self.sine[agents] + c * self.cosine[agents])


def _gram(*fields: Float[np.ndarray, "N n"]) -> Float[np.ndarray, "k k"]:
    rows = np.array([(one - one.mean(axis=0)).ravel() for one in fields])
    return np.asarray(rows @ rows.T)
