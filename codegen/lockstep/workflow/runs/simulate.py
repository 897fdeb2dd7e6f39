"""The nonlinear closed loop in time, against what is proved of it."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, get_args

from lockstep.check.errors import demand
from lockstep.workflow.design_file import Design, as_design
from lockstep.workflow.output_files import check_writable, of_file, write_text
from lockstep.workflow.output_folders import check_folder, is_generated, write_files
from lockstep.workflow.runs.simulation import Simulation
from lockstep.workflow.waiting.progress import Progress, silent

if TYPE_CHECKING:
    from lockstep.check.system.loop import Gains
    from lockstep.lmi.document import Stored
    from lockstep.model.network import Network
    from lockstep.model.simulation import SampledControllers, Scenario
    from lockstep.model.simulation.from_problem import Changes
    from lockstep.model.simulation.integrate import Method
    from lockstep.swarm.neighbours import EdgeList, NeighbourLists
    from lockstep.verification.closed_loop.measured_gain import Kind

KINDS = ("continuous", "sampled", "compiled", "off")

WORST_SAMPLES = 500
"""Samples of a disturbance that is searched for, at most about: enough for loops of some rad/s over tens of seconds."""


def simulate(
    design: Design | Path | str,
    *,
    controllers: str | None = None,
    horizon: float | None = None,
    seed: int | None = None,
    disturbance: str | None = None,
    perturbation: str | None = None,
    integrator: str = "rk4",
    output: Path | str | None = None,
    figures: Path | str | None = None,
    neighbours: "NeighbourLists | EdgeList | None" = None,
    send_on_change: float | None = None,
    progress: Progress = silent,
) -> Simulation:
    """Simulate the nonlinear closed loop of a design, and hold the run against what is proved of it.

    Args:
        design: itself, its file, or a folder that holds one.
        controllers: "continuous", "sampled" (the arithmetic that ships: the default), "compiled" (the C of a folder), or
            "off", u = 0, to compare with.
        horizon: s; by default the problem's, as are seed, disturbance and perturbation.
        seed: of all that is random.
        disturbance: "none", "noise", "sine", "step" or "worst" (searched for).
        perturbation: gain errors of continuous controllers: "none", "paper", "paper_scaled" or "random".
        integrator: "rk4" or "adaptive".
        output: where to write the trajectory (CSV), if anywhere.
        figures: a folder in which to draw the run as PNG and PDF, if any.
        neighbours: another graph than the design's, of any size, for controllers that are all the same.
        send_on_change: c: an agent sends only where some output differs from the one last sent by more than this.
        progress: told what is being done and the part of it that is done.

    Raises:
        ProblemError: bad input, or an output that cannot be written.
    """
    from lockstep.model.simulation import simulate as run
    from lockstep.model.simulation.from_problem import Changes
    from lockstep.model.simulation.send_on_change import SendOnChange
    from lockstep.verification.closed_loop.measured_gain import measured, network_of_design, promise
    from lockstep.workflow.runs.swarm import is_large, simulate_large

    kind, method = _checked(controllers or "sampled", integrator)
    if kind == "off":
        known = perturbation in (None, "none") and send_on_change is None
        demand(known, "`off`, which has no gains and no messages", "--controllers", "no errors of them")
        perturbation = "none"
    changes = Changes(horizon, seed, disturbance, method, perturbation, send_on_change)
    written, drawn = (None if one is None else Path(one) for one in (output, figures))
    check_writable(written, None if isinstance(design, Design) else Path(design))
    if drawn is not None:
        check_folder(drawn)
    simulated, path = as_design(design)
    stored = simulated.stored
    if is_large(stored, kind, changes, neighbours):
        with of_file(path):
            made: Simulation = simulate_large(simulated, changes, neighbours, progress)
        return _kept(made, drawn, written)
    stored.problem.demand_one_graph("to simulate")
    with of_file(path):
        progress("what is proved", 0.1)
        network, promised = network_of_design(stored), promise(stored, kind)
        progress("what disturbs", 0.3)
        scenario = _scenario(stored, network, kind, changes)
        progress("the closed loop", 0.6)
        with _controllers(path, stored, kind) as running:
            trajectory = run(network, running, scenario)
        found = measured(trajectory, scenario, stored, network, promised)
    table = stored.problem.simulation
    made = Simulation(
        simulated,
        trajectory,
        found,
        kind,
        changes.disturbance or table.disturbance.kind,
        table.seed if changes.seed is None else changes.seed,
        scenario.step,
        scenario.method,
        on_change=None if changes.change is None else SendOnChange(changes.change, promised.residual),
    )
    return _kept(made, drawn, written)


def _kept(made: Simulation, drawn: Path | None, written: Path | None) -> Simulation:
    """Write figures and trajectory where they are asked for."""
    pictures = {} if drawn is None else made.figures()
    if drawn is not None:
        write_files(drawn, pictures)
    if written is not None:
        from lockstep.model.simulation.results.table import to_csv

        write_text(written, to_csv(made.trajectory))
    return made


def _checked(controllers: str, integrator: str) -> "tuple[Kind, Method]":
    from lockstep.model.simulation.integrate import Method

    demand(controllers in KINDS, f"`{controllers}`", "--controllers", " or ".join(KINDS))
    demand(integrator in get_args(Method), f"`{integrator}`", "--integrator", " or ".join(get_args(Method)))
    return controllers, integrator  # type: ignore[return-value]


def _scenario(stored: "Stored", network: "Network", kind: "Kind", changes: "Changes") -> "Scenario":
    """Return the run; the worst disturbance starts from agreement, whatever the file's initial states.

    It is no larger than what is proved to keep all agents in their domain, and inputs off their limits; where nothing is
    proved of a domain, so small that the loop is linear. A run beyond would be held against nothing.
    """
    from lockstep.model.simulation.from_problem import scenario_of
    from lockstep.model.simulation.message_channel import MessageChannel

    asked = changes.disturbance or stored.problem.simulation.disturbance.kind
    drawn = changes if asked != "worst" else replace(changes, disturbance="none")
    made = scenario_of(stored.problem, drawn, sampled=kind != "continuous")
    made = replace(made, channel=MessageChannel()) if kind == "off" else made
    return made if asked != "worst" else _worst(stored, network, made, changes)


def _worst(stored: "Stored", network: "Network", quiet: "Scenario", changes: "Changes") -> "Scenario":
    from lockstep.model.simulation.weakest_agreement import weakest_agreement
    from lockstep.model.simulation.worst_disturbance import ENERGIES, worst_disturbance
    from lockstep.verification.closed_loop.measured_gain import weights_of_design

    seed = stored.problem.simulation.seed if changes.seed is None else changes.seed
    weights = weights_of_design(stored, network)
    weakest, _ = weakest_agreement(network, stored.gains, weights, seed=seed)
    # Two thirds of the run are disturbed, so that what the disturbance leaves behind is counted too.
    disturbed = quiet.horizon * 2 / 3
    step = quiet.step * max(1, round(disturbed / WORST_SAMPLES / quiet.step))
    claims, local = stored.claims, stored.claims.scope == "local"
    inside = math.sqrt(claims.initial_set.energy) if claims.initial_set else ENERGIES[0 if local else -1]
    most = min(inside, claims.sampled.limits_gain or inside)
    found = worst_disturbance(
        network,
        stored.gains,
        weights,
        horizon=max(disturbed, step),
        step=step,
        energies=sorted({min(energy, most) for energy in ENERGIES}),
        # Half way to the edge of its domain, where a leader is taken to stay, and others have room too.
        common=[0 * weakest, weakest / 2 if local else weakest],
        seed=seed,
    )
    offsets = 0.0 if quiet.offsets is None else quiet.offsets
    return replace(quiet, start=found.start + offsets, disturbance=found.disturbance, pinned=True)


@contextmanager
def _controllers(path: Path | None, stored: "Stored", kind: "Kind") -> "Iterator[Gains | SampledControllers]":
    from lockstep.codegen.folder.as_generated import problem_fits
    from lockstep.codegen.manifest import load_manifest
    from lockstep.verification.closed_loop.software_in_the_loop import (
        design_controllers,
        reference_controllers,
    )

    if kind in ("continuous", "off"):
        gains = stored.gains
        yield gains if kind == "continuous" else gains.from_blocks(0 * gains.blocks, gains.order)
        return
    delay, wanted = stored.problem.controller.delay, kind == "compiled"
    where, expected = (
        str(path or "the design"),
        "a folder of C with neighbours of its own for --controllers compiled",
    )
    manifest = load_manifest(path) if path is not None and is_generated(path) else None
    if manifest is not None:
        problem_fits(stored, manifest)
    if path is None or manifest is None or manifest.image is not None:
        remedy = "use --controllers sampled, which steps the same arithmetic, or generate with --per-agent"
        found = "one image, whose nodes are given their neighbours at run time"
        demand(not wanted or manifest is None, found, where, expected, remedy)
        demand(not wanted, "there is no C to compile", where, expected, "make one with `lockstep generate`")
        yield design_controllers(stored)
    elif kind == "sampled":
        yield reference_controllers(manifest, delay=delay)
    else:
        from lockstep.verification.closed_loop.compiled_loop import compiled_controllers

        with compiled_controllers(path, delay=delay) as controllers:
            yield controllers
