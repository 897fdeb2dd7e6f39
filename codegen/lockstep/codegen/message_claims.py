"""What can be claimed of a design whose messages are lost or late, as its problem asks, or the part of that that is proved.

`lockstep.lmi.sampled.messages.witnesses` proposes, `lockstep.check.sampled.messages` decides.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from lockstep.check.design_file.messages import MessageClaims
from lockstep.check.numbers import Matrix
from lockstep.check.sampled.controller import HeldController, SampledNetwork
from lockstep.check.sampled.inequality import Witness
from lockstep.check.sampled.links import Messages, MessageWitness
from lockstep.check.sampled.loop import sampled_loop
from lockstep.check.sampled.messages import proves_messages
from lockstep.lmi.document import Stored
from lockstep.lmi.sampled.l2_gain import SampledRho
from lockstep.lmi.sampled.messages.witnesses import certify_messages, message_rho
from lockstep.model.plain_json import plain

HALVINGS = 4
"""Of the part of what is asked for that is certified, where all of it is not."""


@dataclass(frozen=True, eq=False)
class MessageProof:
    """What is claimed with its witnesses, or the remark why nothing is."""

    claims: MessageClaims | None = None
    witness: MessageWitness | None = None
    of_rho: MessageWitness | None = None
    remark: Mapping[str, Any] = field(default_factory=dict)


def prove_messages(
    stored: Stored,
    network: SampledNetwork,
    controllers: tuple[HeldController, ...],
    witness: Witness,
    rho: SampledRho | None,
) -> MessageProof:
    """Prove what the problem asks for, or say that it is not proved.

    Args:
        stored: the design; its witnesses are tried first.
        network, controllers: of the design.
        witness, rho: of the loop whose messages all arrive.
    """
    asked = stored.problem.messages
    if asked is None:
        return MessageProof()
    known = _stated(stored, network, controllers, asked)
    if known is not None:
        return known
    found = certify_messages(network, controllers, asked, witness.P)
    if found is None:
        return MessageProof(remark={"reason": f"{asked.text}: no certificate was found"})
    gain = None
    if rho is not None:
        gain = message_rho(network, controllers, asked, stored.problem.performance, rho)
    claims = MessageClaims(asked, found.witness.decay, None if gain is None else gain[0])
    return MessageProof(claims, found.witness, None if gain is None else gain[1])


def _stated(
    stored: Stored, network: SampledNetwork, controllers: tuple[HeldController, ...], asked: Messages
) -> MessageProof | None:
    claims, proofs, weights = stored.claims.messages, stored.proofs, stored.problem.performance
    loop = sampled_loop(network, controllers, weights.outputs)
    if claims is None or proofs.messages is None or not asked.within(claims.messages):
        return None
    if proofs.messages.decay > claims.decay or not proves_messages(loop, claims.messages, proofs.messages):
        return None
    if claims.rho is not None:
        of_rho = proofs.messages_rho
        if of_rho is None or not proves_messages(loop, claims.messages, of_rho, weights, claims.rho):
            return None
    return MessageProof(claims, proofs.messages, proofs.messages_rho)


def part_of(asked: Messages, part: float) -> Messages:
    """Return so much of what is asked for, whole periods rounded down.

    >>> part_of(Messages(0.5, 3, (0, 2)), 0.5)
    Messages(loss=0.25, burst=1, delay=(0, 1), jitter=0.0)
    """
    low, high = asked.delay
    late = int(part * high)
    return Messages(part * asked.loss, int(part * asked.burst), (min(low, late), late), part * asked.jitter)


def part_certified(
    network: SampledNetwork, controllers: tuple[HeldController, ...], asked: Messages, near: Matrix
) -> dict[str, Any]:
    """Return the remark of what is not carried, and which part of it is."""
    low, high = 0.0, 1.0
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        found = certify_messages(network, controllers, part_of(asked, middle), near)
        low, high = (middle, high) if found is not None else (low, middle)
    carried = plain(part_of(asked, low))
    said = f"{asked.text}: no certificate was found; with {part_of(asked, low).text} there is one"
    return {"reason": said, "certified_up_to": carried}


def said_of_messages(stored: Stored) -> dict[str, str]:
    """Return what is claimed of messages that do not all arrive, and of whom: listeners that hold stamped differences."""
    claimed = stored.claims.messages
    if claimed is None:
        return {}
    one, links = claimed.messages, len(stored.problem.graph().edges)
    whose = "all links the same" if one.alike(links) else "each link its own, which may change"
    parts = [
        f"a link loses a message with a probability of at most {one.loss:g}, {whose}" if one.loss else "",
        f"{'and besides ' * bool(one.loss)}at most {one.burst} are lost in a row" if one.burst else "",
        f"they are at most {one.delay[1]} period{'s' * (one.delay[1] > 1)} late" if one.delay[1] else "",
        f"a reading is taken at most {one.jitter:g} of a period early" if one.jitter else "",
    ]
    faults = ", ".join(part for part in parts if part) or "every message arrives"
    mean = " in the mean square" if one.loss else ""
    gain = "" if claimed.rho is None else f", rho = {claimed.rho:g}"
    said = (
        f"{faults}: all come to agree{gain}{mean}, where differences are stamped as in `generate --messages`;"
        " of a step that holds a message itself nothing is proved"
    )
    return {"messages": said}
