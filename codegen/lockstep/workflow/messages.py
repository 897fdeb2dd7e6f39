"""How much a network may do to the messages of a design: the largest of each fault that is certified, and what breaks it."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lockstep.check.errors import NotCertified
from lockstep.workflow.design_file import Design, as_design
from lockstep.workflow.output_files import of_file
from lockstep.workflow.waiting.progress import Progress, silent

if TYPE_CHECKING:
    from lockstep.lmi.sampled.messages.largest_faults import FaultLimit


@dataclass(frozen=True)
class MessageReach:
    """The limits of each fault by itself: loss, burst, delay, jitter.

    Args:
        title: of the design.
        limits: by fault.
    """

    title: str
    limits: Mapping[str, "FaultLimit"]

    def document(self) -> dict[str, Any]:
        """Return the contract's keys."""
        return {
            "ok": True,
            "title": self.title,
            "messages": {name: one.document() for name, one in self.limits.items()},
        }


def message_limits(design: Design | Path | str, *, progress: Progress = silent) -> MessageReach:
    """Return how much of each fault a design carries: every limit that is called certified was decided by the checker.

    Args:
        design: itself, its file, or a folder that holds one.
        progress: told what is being tried.

    Raises:
        ProblemError: no design file.
        NotCertified: its sampled loop is not certified when all messages arrive.
    """
    from lockstep.codegen.sampled_design import prove_agreement
    from lockstep.lmi.sampled.messages import largest_faults

    found, path = as_design(design)
    with of_file(path):
        network, controllers, verdict = prove_agreement(found.stored)
        if verdict.witness is None:
            raise NotCertified(
                f"the sampled loop is not certified even if every message arrives: {verdict.reason}"
            )
        entries = found.stored.claims.entries
        near = verdict.witness.P
        said = largest_faults.message_limits(
            network, controllers, near, entries, lambda what: progress(what, 0.0)
        )
    return MessageReach(found.title, said)
