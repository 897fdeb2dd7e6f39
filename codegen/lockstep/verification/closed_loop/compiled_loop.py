"""The compiled C in the simulated loop: a generated folder as a shared library, stepped through ctypes.

Beside the product's own sources the library holds, per agent, three functions that this module writes: the size of
the state, its x as doubles, and a step that takes the mask as 64 bits. Unlike the driver of `verify` it runs in this
process: a library that crashes takes the run with it, so it is built from folders whose files are unchanged only.
"""

import ctypes
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float

from lockstep.check.errors import ClaimError, ProblemError, demand
from lockstep.codegen.emission.rendering import render
from lockstep.codegen.folder.contents import refusals
from lockstep.codegen.manifest import AgentEntry, Manifest, load_manifest
from lockstep.model.simulation.sampled_controllers import SampledControllers
from lockstep.verification.closed_loop.software_in_the_loop import sources_in
from lockstep.verification.harness import layout, product_sources
from lockstep.verification.machines.shared_library import build_library, loaded
from lockstep.verification.toolchain import WARNINGS, Compiler, first_compiler


class CompiledStepper:
    """One agent's C functions and one instance of its state."""

    def __init__(self, library: ctypes.CDLL, agent: AgentEntry, manifest: Manifest) -> None:
        self._real = manifest.real_type.dtype
        self._u = np.zeros(len(agent.inputs), self._real)
        self._shapes = (len(agent.outputs),), (len(agent.neighbours), len(agent.outputs))
        self._x = np.zeros(max(agent.order, 1))
        self._order, name = agent.order, agent.name
        size = getattr(library, f"loop_{name}_size")
        size.restype = ctypes.c_size_t
        # Doubles, so that it is aligned for whatever the struct holds.
        self._state = np.zeros(-(-int(size()) // 8))
        self._init = getattr(library, f"{name}_init")
        self._read = getattr(library, f"loop_{name}_x")
        self._step = getattr(library, f"loop_{name}_step")
        self._read.restype = None
        self._init.restype = self._step.restype = ctypes.c_int
        self._step.argtypes = [ctypes.c_void_p] * 3 + [ctypes.c_uint64, ctypes.c_void_p]
        self._init.argtypes, self._read.argtypes = [ctypes.c_void_p], [ctypes.c_void_p] * 2
        self.init()

    @property
    def memory(self) -> Float[np.ndarray, " nc"]:
        """The controller's state before the next step."""
        self._read(self._state.ctypes.data, self._x.ctypes.data)
        return self._x[: self._order].copy()

    def init(self) -> None:
        """Call `<agent>_init`; raises `ClaimError` if the self-check finds the build or the processor unfit."""
        if self._init(self._state.ctypes.data) != 0:
            raise ClaimError("the self-check of the compiled controller fails: this build computes otherwise")

    def step(
        self, y: Float[np.ndarray, " q"], neighbour_y: Float[np.ndarray, "nn q"], received: int
    ) -> tuple[int, Float[np.ndarray, " m"]]:
        """Call `<agent>_step`; outputs of another type or shape are refused, as C could not."""
        own, rows = (np.ascontiguousarray(given, self._real) for given in (y, neighbour_y))
        found = f"outputs of the shapes {own.shape} and {rows.shape}"
        expected = f"{self._shapes[0]} and {self._shapes[1]}"
        demand((own.shape, rows.shape) == self._shapes, found, "compiled step", expected)
        u = self._u
        status = self._step(
            self._state.ctypes.data, own.ctypes.data, rows.ctypes.data, received, u.ctypes.data
        )
        return int(status), u.copy()


@contextmanager
def compiled_controllers(
    folder: Path | str,
    *,
    delay: Literal[0, 1] = 0,
    compiler: Compiler | None = None,
    flags: Sequence[str] = ("-O2",),
) -> Iterator[SampledControllers]:
    """Compile a generated folder and give its controllers for as long as the context lasts.

    Args:
        folder: what `lockstep generate` wrote.
        delay: periods between sampling y and applying u; the folder does not say.
        compiler: by default the first of this machine.
        flags: for the compiler, besides the warnings that `verify` asks for.

    Raises:
        ProblemError: no folder of ours, a folder that was changed, or no compiler.
        ClaimError: the C does not compile.
    """
    folder = Path(folder)
    manifest = load_manifest(folder)
    if refused := refusals(folder, manifest):
        remedy = "generate the folder again: changed C is not run inside this process"
        raise ProblemError(refused[0], where=str(folder), remedy=remedy)
    with tempfile.TemporaryDirectory(prefix="lockstep-") as temporary:
        chosen = compiler or first_compiler("the compiled controllers")
        library = _library(manifest, folder, chosen, flags, Path(temporary))
        with loaded(library) as functions:
            steppers = [CompiledStepper(functions, agent, manifest) for agent in manifest.agents]
            yield SampledControllers(steppers, sources_in(manifest), manifest.period, delay, manifest.real)


def _library(
    manifest: Manifest, folder: Path, compiler: Compiler, flags: Sequence[str], directory: Path
) -> Path:
    views = [layout(agent, manifest) for agent in manifest.agents]
    glue = directory / "loop.c"
    text = render("compiled_loop.c.j2", agents=views, c_real=manifest.real_type.c_name)
    glue.write_text(text, encoding="utf-8")
    sources = [path.resolve() for path in product_sources(manifest, folder)]
    flags = (*WARNINGS, *flags, f"-I{(folder / 'include').resolve()}")
    return build_library(compiler, flags, [*sources, glue], directory, "the controllers")
