"""What a check found: a verdict of the checker's kind, with a value and a witness as plain JSON types."""

from dataclasses import dataclass
from typing import Any

from lockstep.check.verdict import Status


@dataclass(frozen=True)
class CheckFinding:
    """One property of a model.

    name: of the property;  status: "proved", "refuted" (the witness shows it) or "undecided";  figure: what was found, for
    people;  value: the figures that are proved;  witness: what refutes, or what is left open.
    """

    name: str
    status: Status
    figure: str
    value: Any = None
    witness: Any = None

    def document(self) -> dict[str, Any]:
        """Return it as plain JSON types."""
        return {
            "name": self.name,
            "verdict": self.status,
            "value": self.value,
            "witness": self.witness,
            "figure": self.figure,
        }


def numbers(values: Any) -> str:
    """Return a few numbers as text.

    >>> numbers([0.5, -0.0, 1e-9])
    '(0.5, 0, 1e-09)'
    """
    return "(" + ", ".join(f"{float(value) + 0.0:.6g}" for value in values) + ")"
