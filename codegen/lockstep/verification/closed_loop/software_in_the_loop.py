"""The shipped arithmetic in the simulated loop: the bit-exact reference as the simulation's steppers.

`lockstep.model.simulation` steps anything; what is stepped here is `reference.Reference`, the twin of the C, with the
coefficients that a design's C has or that a generated folder states.
"""

from typing import Literal

import numpy as np

from lockstep.check.errors import demand
from lockstep.check.sampled.discretise import clipped_at, measured_offsets
from lockstep.codegen.manifest import FILE_NAME, Manifest
from lockstep.lmi.document import Stored
from lockstep.model.simulation.sampled_controllers import SampledControllers
from lockstep.verification.reference import Reference, references


def reference_controllers(manifest: Manifest, *, delay: Literal[0, 1] = 0) -> SampledControllers:
    """Return the controllers of a generated folder in the arithmetic of its C.

    Args:
        manifest: of the folder.
        delay: periods between sampling y and applying u; the folder does not say.
    """
    steppers = list(references(manifest).values())
    return SampledControllers(steppers, sources_in(manifest), manifest.period, delay, manifest.real)


def design_controllers(stored: Stored) -> SampledControllers:
    """Return the controllers that the C of a design would be: sampled, rounded, in the arithmetic of [controller]."""
    from lockstep.codegen.sampled_modes import sampled_controllers

    table = stored.problem.controller
    held = sampled_controllers(stored, table.period)
    dtype = np.dtype(table.real)
    sides = stored.problem.sides
    limits = clipped_at(table.real, sides).astype(dtype) if np.isfinite(sides).any() else None
    seen = measured_offsets(stored.problem.agent().exact, stored.problem.offsets, table.real)
    shifts = [None if seen is None else seen[[i, *one.sources]].astype(dtype) for i, one in enumerate(held)]
    steppers = [
        Reference(one.table.astype(dtype), one.weights.astype(dtype), one.order, True, limits, shift)
        for one, shift in zip(held, shifts, strict=True)
    ]
    return SampledControllers(
        steppers, tuple(one.sources for one in held), table.period, table.delay, table.real
    )


def sources_in(manifest: Manifest) -> tuple[tuple[int, ...], ...]:
    """Return whom each agent of a folder hears, counted from 0, in the order of its mask bits.

    Raises:
        ProblemError: a neighbour that is no agent of the folder, or one image, whose nodes are given theirs at run time.
    """
    found = "one image, whose nodes are given their neighbours at run time"
    remedy = "simulate the design, or generate with --per-agent"
    demand(manifest.image is None, found, FILE_NAME, "agents with neighbours of their own", remedy)
    rows = {agent.name: k for k, agent in enumerate(manifest.agents)}
    for agent in manifest.agents:
        for source in agent.neighbours:
            found = f"`{agent.name}` hears `{source.source}`, which is no agent of this folder"
            remedy = "generate all agents of the network into one folder"
            demand(source.source in rows, found, FILE_NAME, remedy=remedy)
    return tuple(tuple(rows[source.source] for source in agent.neighbours) for agent in manifest.agents)
