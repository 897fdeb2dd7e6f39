"""Controllers that run in steps: anything that takes outputs and messages and gives an input.

`SampledControllers` holds one stepper per agent and what they need from a network: who hears whom, the period, and
when the input takes effect. A stepper may be the compiled C or its bit-exact reference: a message that does not arrive is
replaced by the last one, and a neighbour never heard counts as the agent itself.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from jaxtyping import Float

from lockstep.check.errors import ProblemError, demand

OK, CLIPPED = 0, 8
"""What a good step says: all of u is applied, or an entry met its limit, which is."""


class Stepper(Protocol):
    """One agent's controller as a program."""

    @property
    def memory(self) -> Float[np.ndarray, " n_C"]:
        """Its state before the next step."""
        ...

    def init(self) -> None:
        """Go to the state before the first step."""
        ...

    def step(
        self, y: Float[np.ndarray, " q"], neighbour_y: Float[np.ndarray, "nn q"], received: int
    ) -> tuple[int, Float[np.ndarray, " m"]]:
        """Take own and neighbours' outputs, bit j of `received` for row j; return (`OK`, `CLIPPED` or a fault, u)."""
        ...


@dataclass(frozen=True, eq=False)
class SampledControllers:
    """steppers: one per agent;  sources: whom each hears, from 0, in the order of its rows;  period: in s;

    delay: periods between sampling y and applying u;  real: the type the steppers take y in.
    """

    steppers: Sequence[Stepper]
    sources: tuple[tuple[int, ...], ...]
    period: float
    delay: Literal[0, 1] = 0
    real: Literal["float32", "float64"] = "float64"

    def __post_init__(self) -> None:
        where = "sampled controllers"
        found = f"{len(self.steppers)} steppers for {len(self.sources)} lists of sources"
        demand(len(self.steppers) == len(self.sources), found, where)
        if any(not 0 <= j < len(self.sources) for heard in self.sources for j in heard):
            raise ProblemError("a source is no agent", where=where, expected=f"0 to {len(self.sources) - 1}")
        demand(0 < self.period < math.inf, f"the period is {self.period!r}", where, "seconds above 0")
        demand(self.delay in (0, 1), f"the delay is {self.delay!r}", where, "0 or 1 periods")

    @property
    def N(self) -> int:
        """Number of agents."""
        return len(self.sources)

    def init(self) -> None:
        """Bring every controller to the state before its first step."""
        for stepper in self.steppers:
            stepper.init()
