"""What happens to a message on its way, and to a measurement on its way into it: delay, loss and quantisation.

A message of agent j, its output y_j sampled at t_k, arrives at a listener `delay` periods later, or not at all. The
listener's own output is not delayed. What the listener does without a message is its own affair: the C code uses the
last one again, and before the first one ever takes the term as zero.

With send on change (`send_on_change`) there are fewer of them.

Quantisation is the converter's, so an agent hears of itself and of others in the same numbers: agents that agree then
see r = 0.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from lockstep.check.errors import ProblemError, demand


@dataclass(frozen=True)
class MessageChannel:
    """delay: whole periods;  drop: the probability that a message is lost, each by itself;  seed: of the losses.

    bits, full_scale: outputs are rounded to multiples of full_scale / 2^(bits - 1) and clipped to +-full_scale, as a
    converter of so many bits does;  real: outputs are rounded to this type first;  change: c; None: all is sent;  noise: the
    standard deviation of what each reading of an output is off, Gaussian, independent from agent to agent and in time.
    """

    delay: int = 0
    drop: float = 0.0
    seed: int = 0
    bits: int | None = None
    full_scale: float = 10.0
    real: Literal["float32", "float64"] = "float64"
    change: float | None = None
    noise: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        where = "channel"
        demand(self.delay >= 0, f"a delay of {self.delay}", where, "a whole number of periods, 0 or more")
        demand(0 <= self.drop <= 1, f"`drop` is {self.drop}", where, "a probability from 0 to 1")
        if self.bits is not None and not 2 <= self.bits <= 53:
            raise ProblemError(f"`bits` is {self.bits}", where=where, expected="a whole number from 2 to 53")
        if self.change is not None and not (math.isfinite(self.change) and self.change >= 0):
            raise ProblemError(f"a change of {self.change}", where=where, expected="a number, 0 or more")
        usable = 0 < self.full_scale < math.inf
        demand(usable, f"`full_scale` is {self.full_scale}", where, "a number above 0")

    @property
    def is_ideal(self) -> bool:
        """Whether everything arrives at once, as it was sent."""
        late, rounded = self.delay or self.drop, self.bits is not None or self.real != "float64"
        return not (late or rounded or self.change is not None or any(self.noise))

    def quantised(self, y: Float[np.ndarray, "N q"]) -> Float[np.ndarray, "N q"]:
        """Return outputs as the converter gives them, ties to even.

        >>> MessageChannel(bits=4, full_scale=8.0).quantised(np.array([[0.6, 9.0]])).tolist()
        [[1.0, 7.0]]
        """
        if self.real == "float32":
            with np.errstate(over="ignore", under="ignore"):
                y = y.astype(np.float32).astype(float)
        if self.bits is None:
            return y
        codes = 2 ** (self.bits - 1)
        quantum = self.full_scale / codes
        return np.asarray(quantum * np.clip(np.rint(y / quantum), -codes, codes - 1))

    def arrivals(self, steps: int, edges: int) -> Bool[np.ndarray, "steps edges"]:
        """Return which messages arrive: one row per step, one column per edge."""
        if not self.drop:
            return np.ones((steps, edges), dtype=bool)
        return np.random.default_rng(self.seed).random((steps, edges)) >= self.drop
