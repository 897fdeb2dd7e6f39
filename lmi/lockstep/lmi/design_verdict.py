"""What the checker says of a design, for whoever proposes, ships or shows it: `lockstep.check.certify` alone.

A design file is read again by the checker itself; a design that is not in a file yet is given to it as the file it would
be. Nothing is decided here, and nothing is searched for.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lockstep.check import certify as checker
from lockstep.check.design_file.content import parse
from lockstep.check.design_file.problem import ProblemTables
from lockstep.check.system.domain import Scope
from lockstep.check.verdict import Verdict
from lockstep.lmi.document import Stored, with_bound_proof
from lockstep.model.plain_json import plain

FIXED = ("fixed", "fixed_rho", "fixed_radius")
SAMPLED = (
    "controllers_stable_sampled",
    "sampled",
    "sampled_decay",
    "sampled_rho",
    "max_period",
    "limits",
    "limits_gain",
    "clipped",
)
OF_WHAT_SHIPS = ("code", *SAMPLED, "messages", "messages_rho", *FIXED)
"""Claims about the controllers as they ship; all others are about the continuous ones."""


@dataclass(frozen=True)
class ClaimDecisions:
    """What is decided of a design file, claim by claim; the first claim that fails is the last one."""

    stored: Stored
    verdicts: Mapping[str, Verdict]

    def proves(self, name: str) -> bool:
        """Whether a claim was made and is proved."""
        return name in self.verdicts and self.verdicts[name].proved

    @property
    def ok(self) -> bool:
        """Whether every claim is proved."""
        return self.failed is None

    @property
    def failed(self) -> str | None:
        """The claim that is not proved, or None."""
        return next((name for name, one in self.verdicts.items() if not one.proved), None)

    @property
    def certified(self) -> bool:
        """Whether everything that is claimed of the continuous controllers is proved."""
        return self.failed is None or self.failed in OF_WHAT_SHIPS

    @property
    def reason(self) -> str:
        """Which claim fails and by how much, or how the certificate was decided."""
        return self.verdicts[self.failed or "certificate"].reason

    @property
    def figures(self) -> Mapping[str, Any]:
        """What shows that a claim fails."""
        return {} if self.failed is None else self.verdicts[self.failed].figures

    @property
    def scope(self) -> Scope | None:
        """Where the certificate holds: "global", or "local", in the agent's domain; None where none is proved."""
        return (self.stored.claims.scope or "local") if self.certified else None

    @property
    def margin(self) -> float:
        """The smallest eigenvalue of -F scaled to a unit diagonal, in doubles, for information."""
        found = self.verdicts.get("certificate")
        return float("nan") if found is None else float(found.figures.get("margin", "nan"))


def certify(stored: Stored, path: Path | None = None) -> ClaimDecisions:
    """Decide what a design file claims, or a folder of C with its design.

    Args:
        stored: the design.
        path: the file, or the folder of generated C, that it was read from, if it was: the checker reads it for itself.

    Raises:
        ProblemError: the problem in the file cannot be posed: no spanning tree, a domain for no state, ...
    """
    # A file of format 1 does not say how its bound is proved: that is proposed anew, and the checker gets both.
    complete = with_bound_proof(stored)
    if path is not None and complete is stored:
        return ClaimDecisions(stored, checker.certify(path).verdicts)
    problem = plain(stored.problem.document())  # with the gains that it gives, if any
    content = complete.document() | {"problem": problem}
    file = parse(content, "the design", ProblemTables.from_document)
    folder = path if path is not None and path.is_dir() else None
    return ClaimDecisions(stored, checker.certified(file, folder).verdicts)
