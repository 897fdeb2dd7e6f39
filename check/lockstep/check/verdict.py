"""What a decision says: proved, refuted by something named, or undecided."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

Status = Literal["proved", "refuted", "undecided"]


@dataclass(frozen=True)
class Verdict:
    """One decision; only "proved" supports a claim.

    status: "proved", "refuted" (a witness shows that it is false) or "undecided" (neither, within the stored budget);
    reason: one sentence, for people;  figures: what shows it, as plain JSON types.
    """

    status: Status
    reason: str
    figures: Mapping[str, Any] = field(default_factory=dict)

    @property
    def proved(self) -> bool:
        """Whether it holds."""
        return self.status == "proved"
