"""A folder with messages, and one node of it fed calls one by one, in C and in its reference."""

import numpy as np
from codegen_cases import arms
from export_cases import folder_of

from lockstep.codegen.manifest import load_manifest
from lockstep.codegen.spec import MessageLimits
from lockstep.verification.comparison import compare
from lockstep.verification.messages.events import EXTRA, Events, run_node
from lockstep.verification.messages.network_node import Message, Wire
from lockstep.verification.messages.run import run_nodes_on_host
from lockstep.verification.toolchain import host_compilers

RANGES = {"theta_m": (-7.0, 7.0), "omega_m": (None, 100.0)}


def messages_folder(tmp_path, **options):
    return folder_of(tmp_path, arms(messages=MessageLimits(ranges=RANGES), **options), "messages")


class Script:
    """Calls of arm1, whose neighbour is arm2, sender 2."""

    def __init__(self, folder):
        self.folder, self.manifest = folder, load_manifest(folder)
        self.wire, self.rows = Wire.of(self.manifest), []

    def packed(self, instant, y=(0.5, -0.25), *, number=None, sender=2, wire=None):
        number = instant if number is None else number
        given = np.array(y, self.wire.dtype)
        return (wire or self.wire).pack(Message(sender, number % 2**32, instant % 2**32, given))

    def call(self, operation, argument=0, y=(0.0, 0.0), data=b""):
        self.rows.append((operation, argument % 2**32, y, data))

    def events(self):
        data = np.zeros((len(self.rows), self.wire.length + EXTRA), np.uint8)
        for k, row in enumerate(self.rows):
            data[k, : len(row[3])] = np.frombuffer(row[3], np.uint8)
        operation, argument = (np.array([row[k] for row in self.rows], np.uint64) for k in (0, 1))
        return Events(operation, argument, np.array([row[2] for row in self.rows], self.wire.dtype), data)

    def run(self, tmp_path):
        """Run it in C; the trace, which is the reference's to the bit."""
        first, *others = self.manifest.agents
        events = {first.name: self.events()} | {one.name: self.events() for one in others}
        place = tmp_path / "script"
        place.mkdir()
        runs = run_nodes_on_host(self.manifest, self.folder, events, place, host_compilers()[0], ("-O1",))
        agent, trace, _ = next(iter(runs))
        assert compare(trace, run_node(agent, self.manifest, events[agent.name])).first == ""
        return trace
