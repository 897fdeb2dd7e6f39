"""Whether the sampled controllers carry what a design file says, and its problem asks, of messages that are lost or late."""

from collections.abc import Iterator

from lockstep.check.continuous.inequality import Performance
from lockstep.check.design_file.messages import MessageClaims
from lockstep.check.design_file.proofs import Proofs
from lockstep.check.sampled.links import Messages, MessageWitness
from lockstep.check.sampled.loop import SampledLoop
from lockstep.check.sampled.messages import proves_messages
from lockstep.check.verdict import Verdict


def decide_messages(
    asked: Messages | None,
    claimed: MessageClaims | None,
    proofs: Proofs,
    loop: SampledLoop,
    weights: Performance,
) -> Iterator[tuple[str, Verdict]]:
    """Yield the verdict of what is claimed, of rho with it, or of what is asked for and not claimed.

    Args:
        asked: by the problem;  claimed, proofs: by the file.
        loop: of the sampled controllers, with the outputs' own noise where rho is a gain from it.
        weights: of rho.
    """
    if asked is not None and not (claimed and asked.within(claimed.messages)):
        yield "messages", Verdict("undecided", "[network.messages] asks for more than is claimed, or other")
    elif claimed is not None:
        alike = claimed.messages.alike(len(loop.differences) // len(loop.network.plant.C))
        text = f"with {claimed.messages.text}{', all links losing alike' if alike else ''}"
        yield "messages", _said(loop, claimed, proofs.messages, text)
        if claimed.rho is not None:
            said = f"rho {claimed.rho:g} from the disturbances {text}"
            yield "messages_rho", _said(loop, claimed, proofs.messages_rho, said, weights, claimed.rho)


def _said(
    loop: SampledLoop,
    claimed: MessageClaims,
    witness: MessageWitness | None,
    text: str,
    weights: Performance | None = None,
    rho: float | None = None,
) -> Verdict:
    within = witness is not None and (rho is not None or witness.decay <= claimed.decay)
    if witness is None or not within or not proves_messages(loop, claimed.messages, witness, weights, rho):
        return Verdict("undecided", f"{text}: no witness proves it")
    return Verdict("proved", text)
