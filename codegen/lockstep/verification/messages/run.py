"""The nodes of a folder built with a driver, fed events, their traces read back: on this machine and on emulated cores."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lockstep.codegen.cost.cores import Core
from lockstep.codegen.emission.rendering import render
from lockstep.codegen.manifest import AgentEntry, Manifest
from lockstep.verification.harness import compile_objects, drive, product_sources
from lockstep.verification.machines.emulator import Machine
from lockstep.verification.machines.image import check_calls, link_image, load_image, machine_flags
from lockstep.verification.messages.events import EXTRA, WORDS, Events, NodeTrace
from lockstep.verification.messages.network_node import Wire
from lockstep.verification.toolchain import Compiler

Traces = Iterator[tuple[AgentEntry, NodeTrace, int]]
"""An agent, what its node did, and the bytes of a node."""


def run_nodes_on_host(
    manifest: Manifest,
    folder: Path,
    events: Mapping[str, Events],
    directory: Path,
    compiler: Compiler,
    flags: Sequence[str],
) -> Traces:
    """Build once, then feed each agent's node its events; `directory` is a temporary one."""
    objects = _objects(manifest, folder, compiler, flags, directory)
    views = [_view(agent, manifest) for agent in manifest.agents]
    (directory / "main.c").write_text(render("host_main.c.j2", agents=views), encoding="utf-8")
    objects += compile_objects(compiler, flags, [directory / "main.c"], folder / "include", directory)
    given = [(len(events[a.name]), events[a.name].arrays()) for a in manifest.agents]
    blobs = drive(objects, given, [agent.name for agent in manifest.agents], compiler, flags, directory)
    for agent, (blob, size) in zip(manifest.agents, blobs, strict=True):
        yield agent, NodeTrace.empty(agent, manifest, len(events[agent.name])).filled(blob), size


def run_nodes_on_core(
    manifest: Manifest,
    folder: Path,
    events: Mapping[str, Events],
    directory: Path,
    core: Core,
    compiler: Compiler,
    level: str,
) -> Traces:
    """Build an image with all nodes, then feed each its events."""
    flags = (*machine_flags(core, compiler), level)
    objects = _objects(manifest, folder, compiler, flags, directory)
    own = {f"{agent.name}_node" for agent in manifest.agents} | {f"{manifest.name}_message"}
    for path in objects:
        if path.stem in own:
            check_calls(path, manifest.real, core, _of_the_folder(manifest))
    (directory / "support.c").write_text(render("support.c.j2"), encoding="utf-8")
    objects += compile_objects(
        compiler, (*flags, "-fno-builtin"), [directory / "support.c"], folder / "include", directory
    )
    entry = f"harness_{manifest.agents[0].name}_node"
    image = load_image(link_image(objects, entry, core, compiler, directory, bare=False))
    for agent in manifest.agents:
        one = events[agent.name]
        empty = NodeTrace.empty(agent, manifest, len(one))
        blob, size = Machine(image, core).exchange(
            f"harness_{agent.name}_node", len(one), one.arrays(), [part.nbytes for part in empty.parts()]
        )
        yield agent, empty.filled(blob), size


def _of_the_folder(manifest: Manifest) -> str:
    """Return what a node may call besides arithmetic: its controller, and the messages' functions."""
    names = "|".join([manifest.name, *(agent.name for agent in manifest.agents)])
    return rf"({names})_(init|reset|step_relative|pack|unpack|crc32)"


def _objects(
    manifest: Manifest, folder: Path, compiler: Compiler, flags: Sequence[str], directory: Path
) -> list[Path]:
    """Compile the controllers, the nodes and the harnesses; every warning is an error."""
    views = [_view(agent, manifest) for agent in manifest.agents]
    (directory / "harness.h").write_text(render("harness.h.j2", agents=views), encoding="utf-8")
    harnesses = []
    for agent, view in zip(manifest.agents, views, strict=True):
        harnesses.append(directory / f"harness_{agent.name}_node.c")
        text = render("exports/messages/harness.c.j2", a=view | {"name": agent.name}, **_folder(manifest))
        harnesses[-1].write_text(text, encoding="utf-8")
    own = [folder / "messages" / f"{agent.name}_node.c" for agent in manifest.agents]
    own.append(folder / "messages" / f"{manifest.name}_message.c")
    flags = (*flags, f"-I{folder / 'messages'}")
    sources = [*product_sources(manifest, folder), *own, *harnesses]
    return compile_objects(compiler, flags, sources, folder / "include", directory)


def _folder(manifest: Manifest) -> dict[str, Any]:
    room = Wire.of(manifest).length + EXTRA
    return {"NAME": manifest.name.upper(), "c_real": manifest.real_type.c_name, "room": room, "words": WORDS}


def _view(agent: AgentEntry, manifest: Manifest) -> dict[str, Any]:
    one, real = NodeTrace.empty(agent, manifest, 1), manifest.real_type.bytes
    q = len(agent.outputs)
    return {
        "name": f"{agent.name}_node",
        "order": agent.order,
        "q": q,
        "m": len(agent.inputs),
        "nn": len(agent.neighbours),
        "in_bytes": [4, 8, q * real, Wire.of(manifest).length + EXTRA, 0],
        "out_bytes": [int(np.prod(part.shape)) * part.dtype.itemsize for part in one.parts()],
    }
