"""What a node is fed in the comparison: a network that loses, delays, repeats, reorders and corrupts, and hostile bytes.

An event is one call of the node with its arguments; the C and the reference read the same arrays.
"""

from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Float, Int, UInt, UInt8

from lockstep.codegen.manifest import AgentEntry, Manifest
from lockstep.verification.messages.network_node import Message, ReferenceNode, Refusal, Wire

STEP, SEND, RECEIVE, FORGET, RESET, INIT = range(6)
"""Operations. The argument is the instant of STEP and SEND, the length of RECEIVE, the neighbour of FORGET."""

EXTRA = 4
"""Bytes that a datagram may be longer than a message."""
WORDS = 8 + int(Refusal.TAKEN)
"""Of a node: four masks of 64 bits (fresh, stale, shut out, heard), low half first, and the counters."""

_SEED = 20_261_122
_START = 2**32 - 50
"""The first instant: it passes 2^32 on the way."""


@dataclass(frozen=True, eq=False)
class Events:
    """S events: operation, argument, own outputs, bytes that arrive."""

    operation: UInt[np.ndarray, " S"]
    argument: UInt[np.ndarray, " S"]
    y: Float[np.ndarray, "S q"]
    data: UInt8[np.ndarray, "S room"]

    def __len__(self) -> int:
        return len(self.operation)

    def arrays(self) -> list[bytes]:
        """Return what the harness reads, in its order; the last is not read."""
        parts = (self.operation.astype(np.uint32), self.argument.astype(np.uint64), self.y, self.data)
        return [*(np.ascontiguousarray(part).tobytes() for part in parts), b""]


@dataclass(frozen=True, eq=False)
class NodeTrace:
    """What came out of S events: the returned number, u, bytes sent, and the node after each."""

    status: Int[np.ndarray, " S"]
    u: Float[np.ndarray, "S m"]
    sent: UInt8[np.ndarray, "S bytes"]
    x: Float[np.ndarray, "S nc"]
    held: Float[np.ndarray, "S nn q"]
    age: UInt[np.ndarray, "S nn"]
    words: UInt[np.ndarray, "S words"]

    @classmethod
    def empty(cls, agent: AgentEntry, manifest: Manifest, count: int) -> "NodeTrace":
        """Return a trace of zeros, in the types and shapes of the harness."""
        real, nn, q = manifest.real_type.dtype, len(agent.neighbours), len(agent.outputs)
        return cls(
            np.zeros(count, np.int32),
            np.zeros((count, len(agent.inputs)), real),
            np.zeros((count, Wire.of(manifest).length), np.uint8),
            np.zeros((count, agent.order), real),
            np.zeros((count, nn, q), real),
            np.zeros((count, nn), np.uint32),
            np.zeros((count, WORDS), np.uint32),
        )

    def parts(self) -> list[np.ndarray]:
        """Return the arrays in the order of the harness."""
        return [getattr(self, part.name) for part in fields(self)]

    def filled(self, blob: bytes) -> "NodeTrace":
        """Return the trace in the bytes that a harness wrote, one array after the other."""
        read, offset = [], 0
        for part in self.parts():
            read.append(np.frombuffer(blob, part.dtype, part.size, offset).reshape(part.shape))
            offset += part.nbytes
        return NodeTrace(*read)


def run_node(agent: AgentEntry, manifest: Manifest, events: Events) -> NodeTrace:
    """Return the trace that the C must reproduce to the bit."""
    node, trace = ReferenceNode.of(agent, manifest), NodeTrace.empty(agent, manifest, len(events))
    for k in range(len(events)):
        trace.u[k] = node.controller.state.u
        trace.status[k] = _apply(node, events, k, trace)
        trace.x[k] = node.controller.state.x
        masks = [
            [one.fresh for one in node.neighbours],
            node.stale,
            [one.shut_out for one in node.neighbours],
            [one.heard for one in node.neighbours],
        ]
        for j, one in enumerate(node.neighbours):
            trace.held[k, j], trace.age[k, j] = one.held, one.age
        words = [sum(1 << j for j, on in enumerate(mask) if on) for mask in masks]
        halves = (half for word in words for half in (word & 0xFFFFFFFF, word >> 32))
        trace.words[k] = [*halves, *node.refused]
    return trace


def _apply(node: ReferenceNode, events: Events, k: int, trace: NodeTrace) -> int:
    operation, argument, y = int(events.operation[k]), int(events.argument[k]), events.y[k]
    if operation == STEP:
        status, trace.u[k] = node.step(argument, y)
        return status
    if operation == SEND:
        sent = node.send(argument, y)
        if sent is not None:
            trace.sent[k] = np.frombuffer(sent, np.uint8)
        return int(sent is not None)
    if operation == RECEIVE:
        return int(node.receive(events.data[k].tobytes()[:argument]))
    if operation == FORGET:
        node.forget(argument)
    elif operation == RESET:
        node.reset()
    else:
        node.init()
    return 0


def faulty_events(manifest: Manifest, agent: AgentEntry, periods: int) -> Events:
    """Return the events of a node on a bad network, of about seven per period and neighbour.

    Each neighbour sends at every instant. A quarter of its messages are lost, and silences longer than any limit come on top;
    the others arrive up to `kept` + 2 periods late in any order, some twice; some come corrupted, cut short, from another
    design, from a stranger, from the future, again for an earlier instant, with NaN or a huge value. The node itself loses
    periods, gets NaN, is reset, forgets, restarts, and its clock once goes back.
    """
    builder = _Builder(manifest, agent)
    random = builder.random
    instant = _START
    for period in range(periods):
        instant += 1 + (2 if random.random() < 0.01 else 0)
        if period == periods // 2:
            instant -= 40
        builder.neighbours_send(instant, silent=period % 100 > 70, last=period % 100 == 70)
        for data in builder.due(instant):
            builder.add(RECEIVE, len(data), data=data)
        builder.step(instant)
    return builder.events()


class _Builder:
    """Events as they are made, and the messages under way."""

    def __init__(self, manifest: Manifest, agent: AgentEntry) -> None:
        self.random = np.random.default_rng([_SEED, *agent.name.encode()])
        self.node, self.wire = ReferenceNode.of(agent, manifest), Wire.of(manifest)
        self.dtype, self.q = manifest.real_type.dtype, len(agent.outputs)
        self.rows: list[tuple[int, int, np.ndarray, bytes]] = []
        self.under_way: list[tuple[int, bytes]] = []
        self.number = {source: int(self.random.integers(2**32)) for source in self.node.sources}

    def value(self) -> np.ndarray:
        """Return outputs: ordinary ones, now and then signed zeros, subnormal or huge ones."""
        scale = self.random.choice([1.0, 0.0, 1e-40, 1e30], p=[0.94, 0.02, 0.02, 0.02])
        y: np.ndarray = (scale * self.random.normal(size=self.q)).astype(self.dtype)
        return y

    def add(self, operation: int, argument: int, y: np.ndarray | None = None, data: bytes = b"") -> None:
        """Append an event."""
        own = np.zeros(self.q, self.dtype) if y is None else y
        self.rows.append((operation, argument % 2**32, own, data))

    def neighbours_send(self, instant: int, *, silent: bool, last: bool) -> None:
        """Put this instant's messages on their way; the last ones before a silence come just in time, or just too late."""
        for source in self.node.sources:
            if self.random.random() < 0.02:  # it was restarted, and counts from anywhere
                jumps = (int(self.random.integers(2**32)), 2**31 - 2, 2**31 - 1)
                self.number[source] += jumps[self.random.integers(3)]
            self.number[source] = (self.number[source] + 1) % 2**32
            if silent or self.random.random() < 0.25:
                continue
            data = self.message(source, instant)
            for _ in range(2 if self.random.random() < 0.1 else 1):
                far = int(self.random.integers(self.node.kept + 3))
                late = (0, 0, 0, 0, 0, 1, 1, 2, 2, far)[self.random.integers(10)]
                if last:
                    late = self.node.kept - int(self.random.integers(2))
                self.under_way.append((instant + late, data))

    def message(self, source: int, instant: int) -> bytes:
        """Return a message, one in ten with something wrong."""
        chance, y = self.random.random(), self.value()
        sender, when, wire = source, instant, self.wire
        if chance < 0.02:
            sender = int(self.random.integers(2**16))
        elif chance < 0.04:
            when = instant + int(self.random.choice([1, 2, 1000, 2**31 - 1, 2**31]))
        elif chance < 0.06:
            y[self.random.integers(self.q)] = self.random.choice(
                [np.nan, np.inf, -np.inf, np.finfo(self.dtype).max]
            )
        elif chance < 0.08:
            when = instant - 1  # of an instant that there was a message of already
        elif chance < 0.1:
            wire = Wire(bytes(8), wire.dtype, wire.outputs)
        data = wire.pack(Message(sender, self.number[source], when % 2**32, y))
        if chance > 0.98:
            return data[: self.random.integers(len(data))] if chance > 0.99 else data + bytes(EXTRA)
        if chance > 0.95:
            flipped = bytearray(data)
            flipped[self.random.integers(len(data))] ^= 1 << int(self.random.integers(8))
            return bytes(flipped)
        return data

    def due(self, instant: int) -> list[bytes]:
        """Return what arrives now, in any order."""
        arrived = [data for when, data in self.under_way if when <= instant]
        self.under_way = [one for one in self.under_way if one[0] > instant]
        return [arrived[k] for k in self.random.permutation(len(arrived))]

    def step(self, instant: int) -> None:
        """Send and step, in this order or without sending, and now and then what else a node may be told."""
        y, chance = self.value(), self.random.random()
        if chance < 0.02:
            y[self.random.integers(self.q)] = self.random.choice([np.nan, np.inf])
        if chance < 0.9:
            self.add(SEND, instant, y)
        if 0.1 < chance < 0.12:
            self.add(SEND, instant, self.value())  # again: the same bytes
        self.add(STEP, instant, y)
        if chance > 0.99:
            self.add(FORGET, int(self.random.integers(len(self.node.sources) + 1)))
        elif chance > 0.985:
            self.add(RESET, 0)
        elif chance > 0.98:
            self.add(INIT, 0)

    def events(self) -> Events:
        """Return all of them."""
        room = self.wire.length + EXTRA
        data = np.zeros((len(self.rows), room), np.uint8)
        for k, row in enumerate(self.rows):
            data[k, : len(row[3])] = np.frombuffer(row[3], np.uint8)
        operation, argument = (np.array([row[k] for row in self.rows], np.uint64) for k in (0, 1))
        return Events(operation, argument, np.array([row[2] for row in self.rows], self.dtype), data)
