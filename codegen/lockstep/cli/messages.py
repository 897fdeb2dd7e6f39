"""What is said of messages that are lost or late: the row of an answer, and the answer of `lockstep check --messages`."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lockstep.check.sampled.links import Messages
from lockstep.cli.console import Answer, progress_display, table


def limits_answer(path: Path) -> Answer:
    """Return what a design carries of each fault, and what breaks it."""
    from lockstep.workflow.messages import message_limits

    with progress_display() as tell:
        found = message_limits(path, progress=tell)
    rows = (
        (name, f"{one.certified:g}", "-" if one.breaks is None else f"{one.breaks:g}", one.how)
        for name, one in found.limits.items()
    )
    headings = ("messages", "certified up to", "breaks at", "how")
    return Answer(found.document(), table(headings, rows, found.title, words=4))


def messages_row(content: Mapping[str, Any]) -> dict[str, str]:
    """Return what is proved where messages are lost or late; nothing where that is not asked for."""
    found = content.get("messages")
    if found is None:
        return {}
    if not found["certified"]:
        return {"messages": f"NO: {found['reason']}"}
    gain = f", rho {found['rho']:.6g}" if found.get("rho") else ""
    alike = ", all links alike" if found.get("alike") else ""
    faults = Messages(*(found[key] for key in ("loss", "burst", "delay", "jitter")))
    return {"messages": f"yes, with {faults.text}{alike}{gain}, proof: {found['proof']}"}
