"""`messages/`: each agent as a node of a network, in C: messages as bytes, stamped differences, refusals counted.

A node holds d_j = y_i(s) - y_j(s) of the newest message of neighbour j, sampled at s, and steps its controller with
r = sum_j a_j d_j: two readings of one instant, so that agreement stays agreement whatever the network loses.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from lockstep.codegen.emission.emit import claims, plain
from lockstep.codegen.emission.rendering import render
from lockstep.codegen.exports.view import agent_view
from lockstep.codegen.manifest import FORMAT, AgentEntry, Manifest, MessagesEntry
from lockstep.codegen.spec import MessageLimits

FORM = 1
"""Of the bytes on the wire: the first of them."""
HEAD, TAIL = 20, 4
"""Bytes before the outputs and after them."""


def files(manifest: Manifest, _: Mapping[str, str]) -> dict[str, str]:
    """Return the struct and its bytes, and a node for each agent with its harness for Frama-C."""
    whole = _folder(manifest)
    views = [_view(agent, manifest) for agent in manifest.agents]
    texts = {
        f"messages/{manifest.name}_message.{end}": render(f"exports/messages/message.{end}.j2", **whole)
        for end in ("h", "c")
    }
    for view in views:
        for name in ("node.h", "node.c", "node_eva.c"):
            texts[f"messages/{view['name']}_{name}"] = render(f"exports/messages/{name}.j2", **whole, a=view)
    texts["messages/CMakeLists.txt"] = render("exports/messages/CMakeLists.txt.j2", **whole, agents=views)
    return texts


def limits_of(manifest: Manifest) -> MessagesEntry:
    """Return what the layer is told: the manifest's numbers, or the defaults."""
    usual = MessageLimits()
    return manifest.messages or MessagesEntry(kept=usual.kept, limit=usual.limit, ranges={})


def message_bytes(manifest: Manifest) -> int:
    """Return the length of a message."""
    return HEAD + manifest.real_type.bytes * most_outputs(manifest) + TAIL


def most_outputs(manifest: Manifest) -> int:
    """Return how many outputs a message has room for."""
    return max(len(agent.outputs) for agent in manifest.agents)


def senders(manifest: Manifest) -> dict[str, int]:
    """Return the number of each sender: agents of the folder in their order, from 1, then sources outside of it."""
    names = [agent.name for agent in manifest.agents]
    names += [one.source for agent in manifest.agents for one in agent.neighbours]
    return {name: number for number, name in enumerate(dict.fromkeys(names), start=1)}


def _folder(manifest: Manifest) -> dict[str, Any]:
    real, limits, design = manifest.real_type, limits_of(manifest), manifest.identity.design
    return {
        "format": FORMAT,
        "name": manifest.name,
        "NAME": manifest.name.upper(),
        "title": plain(manifest.title),
        "form": FORM,
        "c_real": real.c_name,
        "real_bytes": real.bytes,
        "bits": f"uint{8 * real.bytes}_t",
        "zero": real.literal(0.0),
        "outputs": most_outputs(manifest),
        "nothing": f"{{{{0u, 0u}}, 0u, 0u, 0u, {{{', '.join([real.literal(0.0)] * most_outputs(manifest))}}}}}",
        "bytes": message_bytes(manifest),
        "design": [f"0x{design[k : k + 8]}u" for k in (0, 8)],
        "kept": limits.kept,
        "limit": limits.limit,
        "ranged": bool(limits.ranges),
        "claimed": [line for line in claims(manifest.certificate) if line.startswith("messages")],
    }


def _view(agent: AgentEntry, manifest: Manifest) -> dict[str, Any]:
    real, numbers = manifest.real_type, senders(manifest)
    weights = agent.weights(real)
    low, high = ranges_of(agent, manifest)
    shifts = agent.shifts(real)
    return agent_view(agent, manifest) | {
        "sender": numbers[agent.name],
        "senders": [f"{numbers[one.source]}u" for one in agent.neighbours],
        "weights": [real.literal(w) for w in weights],
        "unit_weights": bool((weights == 1).all()),
        "lowest": [real.literal(v) for v in low],
        "highest": [real.literal(v) for v in high],
        "offset": [] if shifts is None else [real.literal(c) for c in shifts[0]],
    }


def ranges_of(agent: AgentEntry, manifest: Manifest) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and the highest plausible value of each output, in the target type."""
    dtype, ranges = manifest.real_type.dtype, limits_of(manifest).ranges
    most = float(np.finfo(dtype).max)
    sides = [ranges.get(one.name, (None, None)) for one in agent.outputs]
    low = [-most if side[0] is None else max(side[0], -most) for side in sides]
    high = [most if side[1] is None else min(side[1], most) for side in sides]
    return np.array(low).astype(dtype), np.array(high).astype(dtype)
