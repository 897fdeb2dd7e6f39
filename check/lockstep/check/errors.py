"""What can go wrong, as types a caller can act on.

`ProblemError` means the input is bad (the command exits 2 and writes nothing); `ClaimError` and its
children mean that the input is fine but a claim about it does not hold (the command exits 1 and says by how much).
"""

from collections.abc import Mapping
from typing import Any


class LockstepError(Exception):
    """Whatever Lockstep raises on purpose."""


class ProblemError(LockstepError):
    """Bad input: what was found, where, what was expected, and what to do about it.

    >>> str(ProblemError("`order` is -1", where="[design] order", expected="a whole number from 0 to 64",
    ...                  remedy="use 0 for static output feedback"))
    '[design] order: `order` is -1; expected a whole number from 0 to 64; use 0 for static output feedback'
    """

    def __init__(self, found: str, *, where: str = "", expected: str = "", remedy: str = "") -> None:
        self.found, self.where, self.expected, self.remedy = found, where, expected, remedy
        super().__init__(str(self))

    def __str__(self) -> str:
        """Join the parts that are there into one message."""
        head = f"{self.where}: {self.found}" if self.where else self.found
        return "; ".join(filter(None, (head, self.expected and f"expected {self.expected}", self.remedy)))

    def within(self, place: str) -> "ProblemError":
        """Return the same error with an outer place put before its own."""
        where = f"{place}, {self.where}" if self.where else place
        return ProblemError(self.found, where=where, expected=self.expected, remedy=self.remedy)


def demand(holds: Any, found: str, where: str, expected: str = "", remedy: str = "") -> None:
    """Raise a `ProblemError` of these parts unless something holds."""
    if not holds:
        raise ProblemError(found, where=where, expected=expected, remedy=remedy)


class ClaimError(LockstepError):
    """A claim does not hold: which one, and the figures that show by how much."""

    def __init__(self, message: str, **figures: Any) -> None:
        super().__init__(message)
        self.figures: Mapping[str, Any] = figures


class Infeasible(ClaimError):
    """No gains were found that meet the request; the figures say what is reachable."""


class OutOfTime(ClaimError):
    """The time that was given was over before any gains were certified: nothing is known of whether there are some."""


class NotCertified(ClaimError):
    """Gains are given, and no certificate for them was found or theirs does not prove what it claims."""


class BoundNotProved(ClaimError):
    """The nonlinearity bound asked for is false (with a witness) or could not be proved."""
