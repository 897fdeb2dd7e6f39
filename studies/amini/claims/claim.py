"""A claim of the paper, the verdict on it, and the measurement the verdict rests on."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

ClaimVerdict = Literal["proved", "reproduced", "refuted", "underdetermined"]
"""proved: by exact arithmetic or algebra;  reproduced: the figure is met numerically;  refuted: a counterexample is
computed;  underdetermined: the paper does not give what a verdict needs."""


@dataclass(frozen=True)
class Finding:
    """What a run found: the figure, and whether it bears the verdict out."""

    figure: str
    supports: bool | np.bool_


@dataclass(frozen=True)
class PaperClaim:
    """One claim: a name for the command line, its place, what it says in our words, the verdict, the measurement."""

    name: str
    where: str
    claim: str
    verdict: ClaimVerdict
    measure: Callable[[], Finding]


@dataclass(frozen=True)
class ClaimRow:
    """A claim with what was measured this time; `verdict` is None where the run does not bear it out."""

    name: str
    where: str
    claim: str
    expected: ClaimVerdict
    verdict: ClaimVerdict | None
    figure: str

    @property
    def how(self) -> str:
        """The command that shows it."""
        return f"lockstep reproduce {self.name}"

    def document(self) -> dict[str, str | None]:
        """Return the row as plain JSON types."""
        return {
            "name": self.name,
            "where": self.where,
            "claim": self.claim,
            "verdict": self.verdict,
            "expected": self.expected,
            "figure": self.figure,
            "how": self.how,
        }


def settle(claim: PaperClaim) -> ClaimRow:
    """Measure a claim."""
    found = claim.measure()
    verdict = claim.verdict if found.supports else None
    return ClaimRow(claim.name, claim.where, claim.claim, claim.verdict, verdict, found.figure)
