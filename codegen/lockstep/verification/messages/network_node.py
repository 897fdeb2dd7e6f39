"""An agent as a node of a network, in NumPy: the twin of `messages/<agent>_node.c`, to the bit.

The listener i keeps its own readings by instant and holds d_j = y_i(s) - y_j(s) of the newest message of j, sampled at s;
it steps its controller with r = 0 + a_1 d_1 + a_2 d_2 + ... Only the manifest is read, and nothing is shared with the
templates: bytes are made by `struct`, checked by `zlib`.
"""

import struct
import zlib
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from jaxtyping import Float

from lockstep.codegen.exports.messages import limits_of, message_bytes, most_outputs, ranges_of, senders
from lockstep.codegen.manifest import AgentEntry, Manifest
from lockstep.verification.reference import NOT_FINITE, Reference

_WORD = 2**32
_HALF = 2**31 - 1
_FORM = 1


class Refusal(IntEnum):
    """Why a message is not used; TAKEN if it is."""

    BAD_LENGTH = 0
    BAD_CHECKSUM = 1
    OTHER_DESIGN = 2
    UNKNOWN_SENDER = 3
    OLD_NUMBER = 4
    FUTURE = 5
    TOO_OLD = 6
    IMPLAUSIBLE = 7
    TAKEN = 8


@dataclass(frozen=True, eq=False)
class Message:
    """sender: its number;  number: of the message;  instant: period of the sample;  y: (q,) outputs."""

    sender: int
    number: int
    instant: int
    y: Float[np.ndarray, " q"]


@dataclass(frozen=True)
class Wire:
    """Messages as bytes: little-endian, with the design's identity and a CRC-32.

    design: the first 8 bytes of its SHA-256;  dtype: of the outputs;  outputs: how many a message has room for.
    """

    design: bytes
    dtype: np.dtype
    outputs: int

    @classmethod
    def of(cls, manifest: Manifest) -> "Wire":
        """Return the wire format of a folder."""
        identity = bytes.fromhex(manifest.identity.design)[:8]
        return cls(identity, manifest.real_type.dtype, most_outputs(manifest))

    @property
    def length(self) -> int:
        """Bytes of a message."""
        return 24 + self.dtype.itemsize * self.outputs

    def pack(self, message: Message) -> bytes:
        """Return a message as bytes."""
        y = np.zeros(self.outputs, self.dtype)
        y[: len(message.y)] = message.y
        head = struct.pack(
            "<BBH8sII",
            _FORM,
            self.dtype.itemsize,
            message.sender,
            self.design,
            message.number,
            message.instant,
        )
        body = head + y.astype(self.dtype.newbyteorder("<")).tobytes()
        return body + struct.pack("<I", zlib.crc32(body))

    def unpack(self, given: bytes) -> Message | Refusal:
        """Return the message in some bytes, or why there is none."""
        if len(given) != self.length:
            return Refusal.BAD_LENGTH
        if struct.unpack("<I", given[-4:])[0] != zlib.crc32(given[:-4]):
            return Refusal.BAD_CHECKSUM
        form, size, sender, design, number, instant = struct.unpack("<BBH8sII", given[:20])
        if (form, size, design) != (_FORM, self.dtype.itemsize, self.design):
            return Refusal.OTHER_DESIGN
        y = np.frombuffer(given[20:-4], self.dtype.newbyteorder("<")).astype(self.dtype)
        return Message(sender, number, instant, y)


@dataclass(eq=False)
class _Neighbour:
    """What a node knows of a neighbour: of its receiver the first four, of its stepper the rest."""

    held: Float[np.ndarray, " q"]
    newest: Message | None = None
    number: int | None = None
    forgetting: bool = False
    waiting: bool = False
    heard: bool = False
    age: int = 0
    shut_out: bool = False
    fresh: bool = False


@dataclass(eq=False)
class ReferenceNode:
    """One agent with its messages.

    controller: of the agent, by its reference;  wire: the folder's;  sender: own number;  sources: the neighbours';
    kept: own readings;  limit: periods to being stale;  low, high: (q,) plausible outputs;  offset: of own outputs.
    """

    controller: Reference
    wire: Wire
    sender: int
    sources: tuple[int, ...]
    kept: int
    limit: int
    low: Float[np.ndarray, " q"]
    high: Float[np.ndarray, " q"]
    offset: Float[np.ndarray, " q"] | None = None
    refused: list[int] = field(init=False)

    def __post_init__(self) -> None:
        self.init()

    @classmethod
    def of(cls, agent: AgentEntry, manifest: Manifest) -> "ReferenceNode":
        """Return the node of an agent of a generated folder."""
        limits, numbers = limits_of(manifest), senders(manifest)
        wire, shifts = Wire.of(manifest), agent.shifts(manifest.real_type)
        assert wire.length == message_bytes(manifest)
        return cls(
            Reference.of(agent, manifest),
            wire,
            numbers[agent.name],
            tuple(numbers[one.source] for one in agent.neighbours),
            limits.kept,
            limits.limit,
            *ranges_of(agent, manifest),
            None if shifts is None else shifts[0],
        )

    def init(self) -> None:
        """Before the first message."""
        self.refused = [0] * Refusal.TAKEN
        self.number, self.sent = 0, None  # type: int, int | None
        self.neighbours: list[_Neighbour] = []
        self.reset()

    def reset(self) -> None:
        """The controller at rest, no reading kept, nothing held; counters and the sender's number stay."""
        self.controller.reset()
        zero = np.zeros(self.controller.outputs, self.controller.M.dtype)
        before = self.neighbours or [_Neighbour(zero) for _ in self.sources]
        self.neighbours = [
            _Neighbour(zero, one.newest, one.number, forgetting=True, waiting=one.waiting) for one in before
        ]
        self.own: dict[int, np.ndarray] = {}
        self.stepped: int | None = None
        self.stale = [False] * len(self.sources)

    def forget(self, j: int) -> None:
        """Hold nothing of neighbour j."""
        if j < len(self.neighbours):
            one = self.neighbours[j]
            one.held = np.zeros_like(one.held)
            one.heard, one.shut_out, one.age, one.forgetting = False, False, 0, True

    def send(self, instant: int, y: Float[np.ndarray, " q"]) -> bytes | None:
        """Return the message with y, sampled at an instant; None if y is not finite, or out of range."""
        if not self._keep(instant, y) or not self._within(self.own[instant]):
            return None
        if self.sent is None:
            self.number = instant
        elif self.sent != instant:
            self.number = (self.number + 1) % _WORD
        self.sent = instant
        return self.wire.pack(Message(self.sender, self.number, instant, self.own[instant]))

    def receive(self, given: bytes) -> Refusal:
        """Take what arrived, for the next step."""
        message = self.wire.unpack(given)
        verdict = message if isinstance(message, Refusal) else self._accept(message)
        self._count(verdict)
        return verdict

    def step(self, instant: int, y: Float[np.ndarray, " q"]) -> tuple[int, Float[np.ndarray, " m"]]:
        """Take a step at an instant; return (status, u)."""
        elapsed = 1 if self.stepped is None else (instant - self.stepped) % _WORD
        back = elapsed > _HALF
        if back:
            self.own.clear()
        there = self._keep(instant, y)
        self.stepped = instant
        for j, one in enumerate(self.neighbours):
            one.fresh = False
            one.age = _WORD - 1 if back else min(one.age + elapsed, _WORD - 1)
            one.forgetting |= one.age > self.limit
            if one.waiting and one.newest is not None:
                one.waiting = False
                self._count(self._take(one, one.newest, instant))
            self.stale[j] = one.age > self.limit
        if not there:
            return NOT_FINITE, self.controller.state.u.copy()
        return self.controller.step_relative(self._relative())

    def _keep(self, instant: int, y: np.ndarray) -> bool:
        """Keep the reading of an instant, unless there is one; of each remainder of instants there is one at a time."""
        if instant in self.own:
            return True
        for other in [s for s in self.own if s % self.kept == instant % self.kept]:
            del self.own[other]
        with np.errstate(all="ignore"):
            reading = y.copy() if self.offset is None else y - self.offset
        if np.isfinite(reading).all():
            self.own[instant] = reading
        return instant in self.own

    def _accept(self, message: Message) -> Refusal:
        if message.sender not in self.sources:
            return Refusal.UNKNOWN_SENDER
        one = self.neighbours[self.sources.index(message.sender)]
        if one.forgetting:
            one.forgetting, one.number = False, None
        if one.number is not None and not 0 < (message.number - one.number) % _WORD <= _HALF:
            return Refusal.OLD_NUMBER
        one.number, one.newest, one.waiting = message.number, message, True
        return Refusal.TAKEN

    def _take(self, one: _Neighbour, message: Message, instant: int) -> Refusal:
        age = (instant - message.instant) % _WORD
        if age > _HALF:
            return Refusal.FUTURE
        if age >= self.kept or message.instant not in self.own or (one.heard and age >= one.age):
            return Refusal.TOO_OLD
        y = message.y[: len(one.held)]
        with np.errstate(all="ignore"):
            d = self.own[message.instant] - y
        one.shut_out = not (np.isfinite(d).all() and self._within(y))
        if one.shut_out:
            return Refusal.IMPLAUSIBLE
        one.held, one.age, one.heard, one.fresh = d, age, True, True
        return Refusal.TAKEN

    def _within(self, y: Float[np.ndarray, " q"]) -> bool:
        return bool((y >= self.low).all() and (y <= self.high).all())

    def _relative(self) -> Float[np.ndarray, " q"]:
        """r = 0 + a_1 d_1 + a_2 d_2 + ..."""
        r = np.zeros(self.controller.outputs, self.controller.M.dtype)
        with np.errstate(all="ignore"):
            for weight, one in zip(self.controller.weights, self.neighbours, strict=True):
                r = r + weight * one.held
        return r

    def _count(self, verdict: Refusal) -> None:
        if verdict != Refusal.TAKEN:
            self.refused[verdict] = min(self.refused[verdict] + 1, _WORD - 1)
