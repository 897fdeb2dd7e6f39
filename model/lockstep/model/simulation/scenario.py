"""What a run starts from and what acts on it."""

import math
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from lockstep.check.errors import ProblemError, demand
from lockstep.model.simulation.disturbance import MOST_INSTANTS, Disturbance, Quiet, Samples, Sum
from lockstep.model.simulation.integrate import Method
from lockstep.model.simulation.message_channel import MessageChannel
from lockstep.model.simulation.perturbation import Perturbation


@dataclass(frozen=True, eq=False)
class Scenario:
    """A run: from `start` for `horizon` seconds, recorded every `step` seconds.

    Args:
        start: (N, n), the agents' states; the controllers start at zero.
        horizon: in s; it is rounded up to whole steps.
        step: in s, between the instants; disturbances and gain errors that jump do so at instants only.
        disturbance: xi; none by default.
        perturbation: Delta(t) of (11), for continuous controllers; none by default.
        channel: what happens to messages, for sampled controllers.
        method: "rk4", `substeps` to a step, or "adaptive" with a relative `tolerance`.
        pinned: a disturbance common to all agents keeps their mean where it starts. It has no part in xi_d, so it is
            admitted, and it lets the disagreement meet the slopes of phi at any common state, stable or not. The
            recorded xi is without it.
        offsets: (N, n), o_i of a formation, which no agent's equation sees: x_i - o_i are to agree. The steppers of sampled
            controllers are given y_i, and take C o_i from it themselves.

    Raises:
        ProblemError: a start that is no finite N x n matrix, or times that make no grid.
    """

    start: Float[np.ndarray, "N n"]
    horizon: float
    step: float = 0.005
    disturbance: Disturbance | None = None
    perturbation: Perturbation | None = None
    channel: MessageChannel = field(default_factory=MessageChannel)
    method: Method = "rk4"
    substeps: int = 4
    tolerance: float = 1e-10
    pinned: bool = False
    offsets: Float[np.ndarray, "N n"] | None = None

    def __post_init__(self) -> None:
        start = np.array(self.start, dtype=float)
        finite = start.ndim == 2 and np.isfinite(start).all()
        demand(finite, "`start` is no finite N x n matrix", "scenario")
        object.__setattr__(self, "start", start)
        for name in ("horizon", "step"):
            value = getattr(self, name)
            demand(0 < value < math.inf, f"`{name}` is {value!r}", "scenario", "seconds above 0")
        found = f"{self.horizon / self.step:.3g} steps of {self.step:g} s"
        expected, remedy = f"at most {MOST_INSTANTS}", "shorten the horizon"
        demand(self.horizon / self.step <= MOST_INSTANTS, found, "scenario", expected, remedy)
        parts = self.disturbance.parts if isinstance(self.disturbance, Sum) else (self.disturbance,)
        for part in parts:
            if isinstance(part, Samples):
                whole_number(part.interval / self.step, "the disturbance's interval over `step`")

    @property
    def instants(self) -> Float[np.ndarray, " K"]:
        """The grid: k times the step, from 0 to the horizon or just beyond."""
        return np.arange(math.ceil(self.horizon / self.step - 1e-9) + 1) * self.step

    def xi(self) -> Disturbance:
        """Return the disturbance."""
        return self.disturbance or Quiet(*self.start.shape)


def whole_number(ratio: float, what: str) -> int:
    """Return a ratio that is to be a whole number of 1 or more, to rounding.

    Raises:
        ProblemError: it is not.
    """
    nearest = round(ratio)
    if nearest < 1 or abs(ratio - nearest) > 1e-6 * nearest:
        raise ProblemError(f"{what} is {ratio:.9g}", where="scenario", expected="a whole number, 1 or more")
    return nearest
