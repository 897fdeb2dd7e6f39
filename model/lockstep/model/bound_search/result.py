"""What the search for a bound answers."""

from __future__ import annotations

import math
from dataclasses import dataclass

from lockstep.check.bound.slope_bounds import Entry
from lockstep.check.errors import BoundNotProved


@dataclass(frozen=True)
class SlopeWitness:
    """A point (v, t) with the slope that phi provably reaches there."""

    v: tuple[float, ...]
    t: float
    slope: float


@dataclass(frozen=True)
class Bound:
    """|D_w^-1 (phi(a, t) - phi(b, t))| <= alpha |D_v^-1 (a - b)| for all a, b in the box and t in its range.

    Attributes:
        alpha: the smallest bound shown, a double rounded up; infinite where none is.
        lower: a slope that phi provably reaches (or the supremum passes), so the truth is in [lower, alpha].
        witness: where `lower` is reached, if a point reaches it.
        refuted: whether the alpha asked for is false, with the witness to show it.
        converged: whether alpha - lower met the tolerance, or the question was decided.
        reason: why not, in plain words; empty where there is nothing to explain.
        asked: the bound that was to be decided, None for the smallest one.
        tolerance: the relative gap asked for.
        boxes: how many boxes were examined by the search.
        replay: how many boxes the checker examines to decide alpha and the entries: it needs exactly that many, with
            these scales (`lockstep.check.bound.decide`).
        input_scale, output_scale: the diagonals of D_v and D_w.
        entries: where phi has several slopes, a bound of its own for each that is not 0.

    """

    alpha: float
    lower: float
    input_scale: tuple[float, ...]
    output_scale: tuple[float, ...]
    witness: SlopeWitness | None = None
    refuted: bool = False
    converged: bool = True
    reason: str = ""
    asked: float | None = None
    tolerance: float = 0.0
    boxes: int = 0
    entries: tuple[Entry, ...] = ()
    replay: int = 0

    def __post_init__(self) -> None:
        if math.isnan(self.alpha) or math.isnan(self.lower):
            raise ValueError(f"an impossible bound: alpha {self.alpha}, lower {self.lower}")
        if self.lower > self.alpha:
            raise ValueError(f"a slope of {self.lower} was reached above the proved bound {self.alpha}")

    @property
    def proved(self) -> bool:
        """Whether alpha (for `prove_bound`: the alpha asked for) is proved."""
        return self.alpha < math.inf if self.asked is None else self.alpha <= self.asked

    def or_raise(self) -> Bound:
        """Return the bound; raises `BoundNotProved` with the figures if it is not proved."""
        if not self.proved:
            raise BoundNotProved(
                f"the nonlinearity bound is not proved: {self.reason}",
                lower=self.lower,
                witness=self.witness,
                boxes=self.boxes,
            )
        return self
