"""What a problem file says of a network's messages, what a design file claims of them, and the witnesses of that."""

from dataclasses import dataclass
from typing import Any

from lockstep.check import json_text as read
from lockstep.check.errors import demand
from lockstep.check.sampled.links import Messages, MessageWitness

KEYS = ("loss", "burst", "delay", "jitter")
ASKED = "[network.messages]"


@dataclass(frozen=True)
class MessageClaims:
    """What is claimed of the sampled loop whose messages are lost, late or jittered.

    messages: what may happen to them at most (more is better);  decay: V shrinks by it from sample to sample, in the mean
    square where chance loses messages (smaller is better);  rho: the gain from the disturbances then, the outputs' noise
    included (smaller is better), or None.
    """

    messages: Messages
    decay: float
    rho: float | None = None


def messages_of(table: Any, where: str = ASKED) -> Messages:
    """Read the table; a key that is absent says that nothing of the kind happens."""
    read.only(table, KEYS, where)
    table = {key: one for key, one in table.items() if one is not None}
    loss, jitter = (read.not_negative(table.get(key, 0.0), f"{where} {key}") for key in ("loss", "jitter"))
    demand(loss < 1, f"{loss!r}", f"{where} loss", "a probability from 0 up, below 1")
    demand(jitter < 1, f"{jitter!r}", f"{where} jitter", "a part of the period from 0 up, below 1")
    delay = table.get("delay", [0, 0])
    pair = isinstance(delay, list | tuple) and len(delay) == 2
    demand(pair, f"{delay!r}", f"{where} delay", "the least and the most periods, such as [0, 2]")
    burst, low, high = (
        read.whole(0, 1000, of=" of periods")(one, where) for one in (table.get("burst", 0), *delay)
    )
    demand(low <= high, f"{delay!r}", f"{where} delay", "the least first")
    return Messages(loss, burst, (low, high), jitter)


def message_claims_of(value: Any, where: str) -> MessageClaims:
    """Read `claims.messages`."""
    read.only(value, (*KEYS, "decay", "rho"), where)
    rho = read.or_none(read.above_zero)(value.get("rho"), f"{where}, `rho`")
    decay = read.above_zero(value.get("decay"), f"{where}, `decay`")
    return MessageClaims(messages_of({key: value.get(key) for key in KEYS}, where), decay, rho)


def message_witness_of(value: Any, where: str) -> MessageWitness:
    """Read a witness; whether its sizes fit is decided with the loop."""
    forms = dict.fromkeys(("P", "Gamma", "X", "X_jitter"), read.matrix())
    numbers = dict.fromkeys(("decay", "kappa", "kappa_mu"), read.number)
    seconds = dict.fromkeys(("X_chance", "X_change", "X_sum"), read.or_none(read.matrix()))
    readers = {**forms, "m": read.vector(), "t": read.vector(), **numbers, **seconds}
    return MessageWitness(*read.record(value, where, readers))
