"""The controllers in integers (`fixed/`) on a target, compared with their reference in Python's integers."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from lockstep.check.errors import ClaimError
from lockstep.check.sampled.fixed_point import LARGEST_R, LARGEST_X, SPLIT, FixedController
from lockstep.codegen.cost.cores import Core, registers_of
from lockstep.codegen.emission.calls import Operation
from lockstep.codegen.emission.rendering import render
from lockstep.codegen.exports import exports_of
from lockstep.codegen.exports.fixed_point import controller_of
from lockstep.codegen.manifest import AgentEntry, Manifest
from lockstep.verification.comparison import compare
from lockstep.verification.harness import compile_objects, drive, text_bytes
from lockstep.verification.machines.emulator import Machine, Watch
from lockstep.verification.machines.image import link_image, load_image, machine_flags, undefined_symbols
from lockstep.verification.stimulus import Trace, recorded_outputs
from lockstep.verification.targets import Target
from lockstep.verification.toolchain import Compiler

OK, NOT_READY, CLIPPED, SATURATED = 0, 3, 8, 16

LIBRARY = re.compile(r"mem(cpy|set|move)|__aeabi_(mem\w+|ll?s[lr])|__ashldi3|__lshrdi3|__mulsi3")
"""What integers may call: no arithmetic beyond a product of 32 bits, which a core may lack."""


@dataclass(frozen=True)
class FixedResult:
    """One agent in integers on one target: calls, whether every bit is equal, and what was measured of a step."""

    agent: str
    bitwise: bool
    calls: int
    differing_calls: int
    first_difference: str
    ram_bytes: int
    text_bytes: int | None = None
    instructions_per_step: int | None = None


@dataclass(frozen=True, eq=False)
class Counts:
    """S calls: the operation, the mask, own counts, the neighbours'."""

    operation: np.ndarray
    received: np.ndarray
    y: np.ndarray
    neighbour_y: np.ndarray

    def arrays(self) -> list[bytes]:
        """Return the arrays as the harness reads them."""
        types = (np.uint32, np.uint64, np.int16, np.int16)
        parts = (self.operation, self.received, self.y, self.neighbour_y)
        return [part.astype(kind).tobytes() for part, kind in zip(parts, types, strict=True)] + [b""]


def scaled(value: int, bits: int) -> int:
    """Return floor(value / 2^bits + 1/2), which Python's integers do exactly.

    >>> scaled(-3, 1), scaled(3, 1), scaled(-5, 2)
    (-1, 2, -1)
    """
    return (value + (1 << (bits - 1))) >> bits


def step_of(one: FixedController, x: list[int], total: list[int]) -> tuple[list[int], list[int], int]:
    """Return x+, u and the status, of states x and the sums of differences of counts."""
    r = [min(max(v, -LARGEST_R), LARGEST_R) for v in total]
    saturated, n, found = r != total, len(x), []
    high, low = [v >> SPLIT for v in x], [v & ((1 << SPLIT) - 1) for v in x]
    for a, h, d, g in zip(one.a, one.h, one.d, one.g, strict=True):
        inner = scaled(sum(p * q for p, q in zip(a, low, strict=True)), SPLIT)
        states = scaled(sum(p * q for p, q in zip(a, high, strict=True)) + inner, h) if n else 0
        found.append(states + scaled(sum(p * q for p, q in zip(d, r, strict=True)), g))
    raw = [v + w for v, w in zip(x, found, strict=False)] + found[n:]
    sides = [(-LARGEST_X, LARGEST_X)] * n + list(one.sides)
    held = [min(max(v, low), high) for v, (low, high) in zip(raw, sides, strict=True)]
    clipped = CLIPPED if held[n:] != raw[n:] else OK
    return held[:n], held[n:], SATURATED if saturated or held[:n] != raw[:n] else clipped


def run_reference(agent: AgentEntry, one: FixedController, calls: Counts) -> Trace:
    """Return the trace that the C must reproduce to the bit."""
    S, n, m, q, nn = len(calls.operation), len(one.x), len(one.u), len(one.r), len(agent.neighbours)
    out, most = empty(agent, S), 2**32 - 1
    x, u, held, heard = [0] * n, [0] * m, np.zeros((nn, q), np.int64), [False] * nn
    age, misses = [0] * nn, [0] * nn
    for k in range(S):
        if calls.operation[k] in (Operation.RESET, Operation.STEP_UNREADY):
            x, u, heard, age = [0] * n, [0] * m, [False] * nn, [0] * nn
            held[:] = 0
        status, mask = NOT_READY, int(calls.received[k])
        if calls.operation[k] != Operation.STEP_UNREADY:
            y, total = calls.y[k].astype(np.int64), np.zeros(q, np.int64)
            for j in range(nn):
                if mask >> j & 1:
                    held[j], heard[j], age[j] = calls.neighbour_y[k, j], True, 0
                else:
                    misses[j], age[j] = min(misses[j] + 1, most), min(age[j] + 1, most)
                if heard[j]:
                    total += y - held[j]
            x, u, status = step_of(one, x, total.tolist())
        out.u[k] = u
        if calls.operation[k] == Operation.STEP_UNREADY:
            misses = [0] * nn
        out.status[k], out.x[k], out.held[k], out.age[k], out.misses[k] = status, x, held, age, misses
        out.heard[k] = sum(1 << j for j in range(nn) if heard[j])
    return out


def empty(agent: AgentEntry, S: int) -> Trace:
    """Return the arrays of a trace of S calls."""
    n, m, q, nn = agent.order, len(agent.inputs), len(agent.outputs), len(agent.neighbours)
    shapes: tuple[tuple[Any, tuple[int, ...]], ...] = (
        (np.int32, ()),
        (np.int16, (m,)),
        (np.int32, (n,)),
        (np.int16, (nn, q)),
        (np.uint64, ()),
        (np.uint32, (nn,)),
        (np.uint32, (nn,)),
    )
    return Trace(*(np.zeros((S, *shape), kind) for kind, shape in shapes))


def counts_of(manifest: Manifest, steps: int, adversarial: int) -> dict[str, Counts]:
    """Return calls of each agent: recorded outputs in counts, then any counts, extremes and losses among them."""
    outputs = {a.name: y for a, y in zip(manifest.agents, recorded_outputs(manifest, steps), strict=True)}
    calls = {}
    for i, agent in enumerate(manifest.agents):
        random, nn, q = np.random.default_rng([17, i]), len(agent.neighbours), len(agent.outputs)
        unit = 2.0 ** np.array(controller_of(agent, manifest).r)
        whole = {name: np.clip(np.rint(y * unit), -32768, 32767) for name, y in outputs.items()}
        zeros = np.zeros((steps, q))
        near = [whole.get(one.source, zeros) for one in agent.neighbours]
        size = 2.0 ** random.integers(0, 16, (adversarial, 1 + nn, 1))
        wild = np.rint(size * random.uniform(-1, 1, (adversarial, 1 + nn, q)))
        wild[random.random(wild.shape) < 0.05] = -32768
        wild = np.clip(wild, -32768, 32767)
        lost = (
            random.random((steps + adversarial, nn))
            < np.r_[np.zeros(steps), np.full(adversarial, 0.3)][:, None]
        )
        mask = np.array([sum(1 << j for j in range(nn) if not row[j]) for row in lost], np.uint64)
        draw = random.random(adversarial)
        operation = np.zeros(steps + adversarial)
        operation[steps:][draw < 0.02], operation[steps:][draw < 0.01] = (
            Operation.STEP_UNREADY,
            Operation.RESET,
        )
        calls[agent.name] = Counts(
            operation,
            mask,
            np.concatenate([whole[agent.name], wild[:, 0]]),
            np.concatenate([np.stack(near, axis=1) if nn else np.zeros((steps, 0, q)), wild[:, 1:]]),
        )
    return calls


@lru_cache(maxsize=1)
def _expected(text: str, steps: int, adversarial: int) -> tuple[dict[str, Counts], dict[str, Trace]]:
    """Return the calls and the reference's traces, once for all targets of a folder."""
    manifest = Manifest.model_validate_json(text)
    calls = counts_of(manifest, steps, adversarial)
    return calls, {
        agent.name: run_reference(agent, controller_of(agent, manifest), calls[agent.name])
        for agent in manifest.agents
    }


def compare_fixed(
    target: Target, manifest: Manifest, folder: Path, directory: Path, *, steps: int, adversarial: int
) -> tuple[FixedResult, ...]:
    """Run the controllers in integers, where a folder has them and the target can; raises `ClaimError` as its runner does."""
    if target.built is None or "fixed" not in exports_of(manifest):
        return ()
    calls, expected = _expected(manifest.text(), steps, adversarial)
    compiler, flags, core = target.built
    place = directory / "fixed"
    place.mkdir()
    sources = [folder / "fixed" / f"{agent.name}_fixed.c" for agent in manifest.agents]
    run = _on_host if core is None else _on_core
    results = []
    for agent, (blob, size, instructions) in zip(
        manifest.agents, run(manifest, sources, calls, compiler, flags, core, place), strict=True
    ):
        difference = compare(_trace(agent, len(calls[agent.name].operation), blob), expected[agent.name])
        text = text_bytes(place / f"{agent.name}_fixed.o")
        count = len(calls[agent.name].operation)
        said = (difference.bitwise, count, difference.calls, difference.first)
        results.append(FixedResult(agent.name, *said, size, text, instructions))
    return tuple(results)


Ran = list[tuple[bytes, int, int | None]]


def _on_host(
    manifest: Manifest,
    sources: Sequence[Path],
    calls: dict[str, Counts],
    compiler: Compiler,
    flags: Sequence[str],
    _: Core | None,
    place: Path,
) -> Ran:
    views = [_view(agent) for agent in manifest.agents]
    main = place / "main.c"
    main.write_text(render("host_main.c.j2", agents=views), encoding="utf-8")
    objects = _objects(sources, [*_harnesses(views, place), main], compiler, flags, place)
    given = [(len(calls[a.name].operation), calls[a.name].arrays()) for a in manifest.agents]
    names = [view["name"] for view in views]
    return [(blob, size, None) for blob, size in drive(objects, given, names, compiler, flags, place)]


def _on_core(
    manifest: Manifest,
    sources: Sequence[Path],
    calls: dict[str, Counts],
    compiler: Compiler,
    flags: Sequence[str],
    core: Core | None,
    place: Path,
) -> Ran:
    assert core is not None
    views = [_view(agent) for agent in manifest.agents]
    flags = (*machine_flags(core, compiler), *flags)
    objects = _objects(sources, _harnesses(views, place), compiler, flags, place)
    for path in objects[: len(sources)]:
        if wrong := [name for name in undefined_symbols(path) if not LIBRARY.fullmatch(name)]:
            raise ClaimError(f"{path.stem}: the integers for {core.title} call `{wrong[0]}`")
    support = place / "support.c"
    support.write_text(render("support.c.j2"), encoding="utf-8")
    objects += compile_objects(compiler, (*flags, "-fno-builtin"), [support], place, place)
    image = load_image(link_image(objects, f"harness_{views[0]['name']}", core, compiler, place, bare=False))
    ran: Ran = []
    for agent, view in zip(manifest.agents, views, strict=True):
        given, S = calls[agent.name].arrays(), len(calls[agent.name].operation)
        sizes = [part.nbytes for part in vars(empty(agent, S)).values()]
        watch = Watch(image.symbols[f"{agent.name}_fixed_step"] & ~1, registers_of(core))
        blob, size = Machine(image, core, watch).exchange(f"harness_{view['name']}", S, given, sizes)
        ran.append((blob, size, max(watch.counts, default=None)))
    return ran


def _objects(
    sources: Sequence[Path], harness: Sequence[Path], compiler: Compiler, flags: Sequence[str], place: Path
) -> list[Path]:
    return compile_objects(compiler, flags, [*sources, *harness], sources[0].parent, place)


def _harnesses(views: Sequence[dict[str, Any]], place: Path) -> list[Path]:
    (place / "harness.h").write_text(render("harness.h.j2", agents=views), encoding="utf-8")
    paths = []
    for view in views:
        paths.append(place / f"harness_{view['name']}.c")
        paths[-1].write_text(render("fixed_harness.c.j2", a=view), encoding="utf-8")
    return paths


def _view(agent: AgentEntry) -> dict[str, Any]:
    q, nn = len(agent.outputs), len(agent.neighbours)
    return {
        "name": f"{agent.name}_fixed",
        "agent": agent.name,
        "order": agent.order,
        "q": q,
        "m": len(agent.inputs),
        "nn": nn,
        "bits": 64 if nn > 32 else 32,
        "in_bytes": [4, 8, 2 * q, 2 * nn * q, 0],
        "out_bytes": [part.nbytes for part in vars(empty(agent, 1)).values()],
    }


def _trace(agent: AgentEntry, S: int, blob: bytes) -> Trace:
    parts, at = [], 0
    for part in vars(empty(agent, S)).values():
        found = np.frombuffer(blob, part.dtype, part.size, at).reshape(part.shape)
        parts.append(found)
        at += part.nbytes
    return Trace(*parts)
