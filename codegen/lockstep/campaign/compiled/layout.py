"""What differs from run to run, what is reported of each, and which numbers in a row are which."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

FIXED_FIGURES = (
    *("disagreement_initial", "disagreement_final", "disagreement_peak", "effort_peak"),
    *("z_squared", "w_squared", "ended", "outside", "faults", "clipped"),
)
"""Of every run: |x_d| at both ends and at most; the largest |u|; int |z|^2 and int |xi_d|^2; when it diverged, or -1;
at how many steps it was out of the agents' domain; how many controller steps were a fault, and how many clipped u."""

INDICES = ("ISE", "IAE", "ITSE", "ITAE")


@dataclass(frozen=True)
class Features:
    """What a campaign needs of its C; a loop without them is smaller and faster.

    waves: sinusoids, steps, windows;  noise: Gaussian, held;  sequences: disturbances given row by row;  drops: messages
    that do not arrive;  uncertain: Delta of (11).
    """

    waves: bool = False
    noise: bool = False
    sequences: bool = False
    drops: bool = False
    uncertain: bool = False


@dataclass(frozen=True)
class Layout:
    """Sizes, and where each parameter of a run stands in its row.

    N: agents;  n: states, m: inputs of each;  order: of the controllers;  deltas: entries of all Delta of (11);
    period: T;  step: of the integration, in s;  substeps: steps in a period;  sampled: the C that ships, or (9).
    """

    N: int
    n: int
    m: int
    order: int
    deltas: int
    period: float
    step: float
    substeps: int
    sampled: bool
    features: Features

    @property
    def places(self) -> dict[str, slice]:
        """Where each parameter is in a row, by name."""
        f, states = self.features, self.N * self.n
        widths = {"x": states, "bias": states}
        if f.noise:
            widths["sigma"] = states
        if f.waves:
            widths |= {"cosine": states, "sine": states}
            widths |= dict.fromkeys(("omega", "start", "stop", "hann", "turn"), 1)
        if f.sequences:
            widths["scale"] = 1
        if f.drops:
            widths["drop"] = 1
        if f.uncertain:
            widths |= {"delta": 2 * self.deltas, "nu": 1}
        found, place = {}, 0
        for name, width in widths.items():
            found[name] = slice(place, place + width)
            place += width
        return found

    @property
    def parameters(self) -> int:
        """Length of a run's row of parameters."""
        return sum(place.stop - place.start for place in self.places.values())

    @property
    def columns(self) -> tuple[str, ...]:
        """The names of a run's figures, in order."""
        each = [f"{index}_{i}" for i in range(1, self.N + 1) for index in INDICES]
        states = [f"x_{i}_{k}" for i in range(1, self.N + 1) for k in range(1, self.n + 1)]
        return (*FIXED_FIGURES, *each, *states)

    @property
    def whole(self) -> int:
        """Number of states that are integrated: with those of continuous controllers."""
        return self.N * (self.n + (0 if self.sampled else self.order))

    @property
    def trace_width(self) -> int:
        """Length of a row of a trace: x, x_C, u of all agents."""
        return self.N * (self.n + self.order + self.m)

    def periods(self, horizon: float) -> int:
        """Return the whole periods that cover a horizon in s."""
        return max(1, int(np.ceil(horizon / self.period - 1e-9)))

    def rows(self, count: int) -> Float[np.ndarray, "count parameters"]:
        """Return rows of parameters for runs at rest, undisturbed."""
        rows = np.zeros((count, self.parameters))
        if self.features.waves:
            rows[:, self.places["stop"]] = np.inf
        return rows
