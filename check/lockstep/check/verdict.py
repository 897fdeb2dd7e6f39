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

    @classmethod
    def of(cls, said: str, holds: bool | None) -> "Verdict":
        """Return that a claim is proved, or that its witness does not prove it; None where it has no witness."""
        why = "without a witness" if holds is None else "but its witness does not prove it"
        return cls("proved", said) if holds else cls("undecided", f"it is claimed that {said}, {why}")

    @property
    def proved(self) -> bool:
        """Whether it holds."""
        return self.status == "proved"
