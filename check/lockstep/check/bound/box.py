"""The set on which a bound is claimed."""

from __future__ import annotations

import math
from dataclasses import dataclass

from lockstep.check.errors import demand

EVERY_TIME = (-math.inf, math.inf)


@dataclass(frozen=True)
class Box:
    """lower <= v <= upper, each side finite or infinite.

    >>> Box.everywhere(2).lower
    (-inf, -inf)
    """

    lower: tuple[float, ...]
    upper: tuple[float, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "lower", tuple(float(x) for x in self.lower))
        object.__setattr__(self, "upper", tuple(float(x) for x in self.upper))
        found = f"{len(self.lower)} lower and {len(self.upper)} upper limits"
        demand(len(self.lower) == len(self.upper), found, "the domain", "one of each per component")
        for i, (low, high) in enumerate(zip(self.lower, self.upper, strict=True)):
            _check_range(low, high, f"the domain, component {i + 1}")

    @classmethod
    def everywhere(cls, size: int) -> Box:
        """Return the whole space of that many components."""
        return cls((-math.inf,) * size, (math.inf,) * size)

    @property
    def size(self) -> int:
        """The number of components."""
        return len(self.lower)


def check_time(time: tuple[float, float]) -> tuple[float, float]:
    """Return the range of t as floats; raises `ProblemError` if it is not one."""
    low, high = float(time[0]), float(time[1])
    _check_range(low, high, "the range of t")
    return low, high


def _check_range(low: float, high: float, where: str) -> None:
    holds, said = low <= high and low < math.inf and high > -math.inf, f"the range is [{low}, {high}]"
    demand(holds, said, where, "a lower limit that is not above the upper one, neither of them NaN")
