"""One step of the record for all agents, compiled: agents side by side in registers, chunks of them on all cores.

Python's threads call the same C function on different chunks; it releases the interpreter's lock. The sums are taken chunk
by chunk, so that the answer does not depend on how many threads there are.
"""

import ctypes
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from jaxtyping import Float

from lockstep.campaign.compiled.lanes import LANES
from lockstep.campaign.compiled.library import compiled
from lockstep.swarm.disturbances import Fields, Pace
from lockstep.swarm.loop import SwarmLoop
from lockstep.swarm.source import CHUNK, FIGURES, swarm_source

_FIELDS = (
    *("first", "source", "weight", "gain", "input", "x", "u", "late", "memory", "y"),
    *("held", "sine", "cosine", "index", "effort", "rows"),
)


class _Swarm(ctypes.Structure):
    _fields_ = (("agents", ctypes.c_int64), *((name, ctypes.c_void_p) for name in _FIELDS))


def processors() -> int:
    """Return how many processors this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class CompiledSwarm:
    """A swarm in C, from `start` at rest.

    Raises:
        ProblemError: there is no C compiler.
    """

    def __init__(
        self,
        loop: SwarmLoop,
        start: Float[np.ndarray, "N n"],
        fields: Fields,
        pace: Pace,
        *,
        threads: int | None = None,
    ) -> None:
        source = swarm_source(loop, pace, held=fields.held, waves=fields.waves)
        library = ctypes.CDLL(str(compiled(source)))
        self._call: Any = library.lockstep_swarm
        self._call.restype = None
        pointer = ctypes.c_void_p
        whole = ctypes.c_int64
        self._call.argtypes = [pointer, whole, whole, whole, ctypes.c_int32, pointer, pointer]
        self._loop, self._fields = loop, fields
        self._instant, self._substeps = pace.instant, pace.substeps
        agent, N = loop.agent, loop.N
        self._blocks = -(-N // LANES)
        self._chunks = -(-self._blocks // CHUNK)
        real = np.dtype(loop.real)

        def zeros(width: int, kind: Any = float) -> np.ndarray:
            return _aligned((self._blocks, width, LANES), kind)

        nothing = np.zeros(1)
        self._arrays: dict[str, np.ndarray] = {
            "first": loop.neighbours.first,
            "source": loop.neighbours.source,
            "weight": loop.weights,
            "gain": self._packed(loop.tables.reshape(N, -1), real) if len(loop.tables) > 1 else nothing,
            "input": self._packed(loop.B.reshape(N, -1)) if len(loop.B) > 1 else nothing,
            "x": self._packed(start),
            "u": zeros(agent.m),
            "late": zeros(agent.m),
            "memory": zeros(max(loop.order, 1), real),
            "y": np.zeros((2, N, agent.q), real),
            "held": self._packed(fields.value) if fields.held else nothing,
            "sine": self._packed(fields.sine) if fields.waves else nothing,
            "cosine": self._packed(fields.cosine) if fields.waves else nothing,
            "index": zeros(4),
            "effort": zeros(5),
            "rows": np.zeros((self._chunks, agent.n + FIGURES)),
        }
        with np.errstate(over="ignore", under="ignore"):
            self._arrays["y"][0] = (start @ agent.lure.C.T).astype(real)
        self._swarm = _Swarm(N, *(self._arrays[name].ctypes.data for name in _FIELDS))
        self._threads = max(1, min(threads or processors(), self._chunks))
        self._pool = ThreadPoolExecutor(self._threads - 1) if self._threads > 1 else None
        ends = np.linspace(0, self._chunks, self._threads + 1).astype(int)
        self._shares = list(zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True))

    def step(self, k: int, mean: Float[np.ndarray, " n"], *, last: bool = False) -> Float[np.ndarray, " f"]:
        """Go from instant k to the next; return sums: x - mean, |e|^2, e' R e, the controllers' cost, faults, strays, clips.

        Args:
            k: counted from 0, one after the other.
            mean: of all agents at this instant.
            last: nothing is integrated, only counted.
        """
        fields, since = self._fields, k * self._instant
        if fields.advance(since):
            self._pack_into(self._arrays["held"], fields.value)
        halves = since + np.arange(2 * self._substeps + 1) * (self._instant / (2 * self._substeps))
        wave = fields.waves_at(halves, since)
        mean = np.ascontiguousarray(mean)
        rest = (k, int(last), mean.ctypes.data, wave.ctypes.data)
        swarm = ctypes.byref(self._swarm)
        waiting = [
            self._pool.submit(self._call, swarm, *share, *rest) for share in self._shares[1:] if self._pool
        ]
        self._call(swarm, *self._shares[0], *rest)
        for one in waiting:
            one.result()
        return np.asarray(self._arrays["rows"].sum(axis=0))

    def states(self, agents: Sequence[int] | np.ndarray) -> Float[np.ndarray, "k n"]:
        """Return the states of some agents."""
        return self._of("x", agents)

    def inputs(self, agents: Sequence[int] | np.ndarray) -> Float[np.ndarray, "k m"]:
        """Return the inputs that act on some agents."""
        return self._of("u", agents)

    def memories(self, agents: Sequence[int] | np.ndarray) -> Float[np.ndarray, "k n_C"]:
        """Return the states of some controllers."""
        return self._of("memory", agents)[:, : self._loop.order].astype(float)

    def figures(self) -> tuple[Float[np.ndarray, "N 4"], Float[np.ndarray, "N 5"]]:
        """Return ISE, IAE, ITSE, ITAE of the disagreements, and of the inputs with the largest |u| behind."""
        everyone = np.arange(self._loop.N)
        return self._of("index", everyone), self._of("effort", everyone)

    def close(self) -> None:
        """Let the threads go."""
        if self._pool is not None:
            self._pool.shutdown()

    def _of(self, name: str, agents: Sequence[int] | np.ndarray) -> np.ndarray:
        chosen = np.asarray(agents)
        return np.asarray(self._arrays[name][chosen // LANES, :, chosen % LANES])

    def _packed(self, rows: Float[np.ndarray, "N k"], kind: Any = float) -> np.ndarray:
        packed = _aligned((self._blocks, rows.shape[1], LANES), kind)
        self._pack_into(packed, rows)
        return packed

    def _pack_into(self, packed: np.ndarray, rows: Float[np.ndarray, "N k"]) -> None:
        whole = len(rows) // LANES
        inner = rows[: whole * LANES].reshape(whole, LANES, rows.shape[1])
        packed[:whole] = inner.transpose(0, 2, 1)
        if whole < self._blocks:
            rest = rows[whole * LANES :]
            packed[whole, :, : len(rest)] = rest.T


def _aligned(shape: tuple[int, ...], kind: Any, to: int = 64) -> np.ndarray:
    """Zeros whose first byte is at a multiple of `to`: registers are loaded from there."""
    kind = np.dtype(kind)
    size = int(np.prod(shape)) * kind.itemsize
    raw = np.zeros(size + to, np.uint8)
    begin = -raw.ctypes.data % to
    return np.asarray(raw[begin : begin + size].view(kind).reshape(shape))
