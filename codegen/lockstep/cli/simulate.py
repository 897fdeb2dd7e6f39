"""`lockstep simulate`: the nonlinear closed loop in time, against what is proved of it."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from lockstep.check.errors import ProblemError
from lockstep.cli.console import Answer, errors, of_file, progress_display, respond, two_columns, write_text
from lockstep.cli.files import check_writable, read_design
from lockstep.cli.simulate_options import Many, Options, conflict

if TYPE_CHECKING:
    from rich.console import RenderableType

    from lockstep.check.loop import Gains
    from lockstep.lmi.document import Stored
    from lockstep.model.network import Network
    from lockstep.model.simulation import SampledControllers, Scenario, Trajectory
    from lockstep.model.simulation.from_problem import Changes
    from lockstep.verification.measured import Kind, Measured

KINDS = ("continuous", "sampled", "compiled")

WORST_SAMPLES = 500
"""Samples of a disturbance that is searched for, at most about: enough for loops of some rad/s over tens of seconds."""


def run(path: Path, options: Options, many: Many, *, as_json: bool) -> None:
    """Simulate a design: one run, or a campaign of them (see `lockstep.cli.campaign`)."""
    from lockstep.cli import campaign

    wrong = conflict(options, many)
    if wrong is not None:
        respond(as_json, lambda: _refuse(wrong))
    seed = options.seed
    found: dict[str, Any] = {"controllers": options.controllers, "horizon": options.horizon}
    if many.replay is not None:
        campaign.run_replay(path, many.replay, many.output, seed, as_json, **found)
    elif many.campaign is not None and many.output is not None:
        campaign.run(path, many.campaign, many.output, many.scheduler, many.jobs, seed, as_json, **found)
    else:
        respond(as_json, lambda: _simulate(path, many.output, options, as_json=as_json))


def _refuse(error: ProblemError) -> Answer:
    raise error


def _simulate(path: Path, output: Path | None, options: Options, *, as_json: bool) -> Answer:
    from lockstep.cli.folders import check_folder, write_files
    from lockstep.model.simulation import simulate
    from lockstep.verification.measured import measured, network_of_design, promise

    kind, changes = _checked(options)
    check_writable(output, path)
    if options.figures is not None:
        check_folder(options.figures)
    stored = read_design(path)
    with of_file(path), progress_display() as tell:
        tell("what is proved", 0.1)
        network, promised = network_of_design(stored), promise(stored, kind)
        tell("what disturbs", 0.3)
        scenario = _scenario(stored, network, kind, changes)
        tell("the closed loop", 0.6)
        with _controllers(path, stored, kind) as controllers:
            trajectory = simulate(network, controllers, scenario)
        found = measured(trajectory, scenario, stored, network, promised)
    drawn = {} if options.figures is None else _drawn(trajectory, stored)
    if options.figures is not None:
        write_files(options.figures, drawn)
    if output is not None:
        from lockstep.model.simulation.table import to_csv

        write_text(output, to_csv(trajectory))
    document = _document(trajectory, scenario, found, kind, changes, stored)
    plot = _plotted(trajectory, as_json) if options.plot else ""
    disturbed = str(document["disturbance"])
    return Answer(document, _tables(trajectory, found, kind, disturbed, stored, plot), found.holds)


def _drawn(trajectory: "Trajectory", stored: "Stored") -> dict[str, bytes]:
    """Return the states, the disagreement and the effort as PNG and PDF."""
    from lockstep.report.export import pdf, png
    from lockstep.report.figures import disagreement_figure, effort_figure, states_figure

    units = dict(stored.problem.agent().units)
    figures = {
        "states": states_figure(trajectory, units=units),
        "disagreement": disagreement_figure({stored.problem.title: trajectory}),
        "effort": effort_figure(trajectory, units=units),
    }
    ways = (("png", png), ("pdf", pdf))
    return {f"{name}.{end}": way(figure, name) for name, figure in figures.items() for end, way in ways}


def _plotted(trajectory: "Trajectory", as_json: bool) -> str:
    """Return the plot; beside JSON it goes to standard error instead."""
    from lockstep.cli.terminal_plot import terminal_plot

    text = terminal_plot(trajectory, colour=sys.stdout.isatty() and not as_json)
    if as_json:
        errors.print(text, markup=False)
        return ""
    return text


def _checked(options: Options) -> "tuple[Kind, Changes]":
    from lockstep.model.simulation.from_problem import Changes
    from lockstep.model.simulation.integrate import Method

    kind = options.controllers or "sampled"
    if kind not in KINDS:
        raise ProblemError(f"`{kind}`", where="--controllers", expected=" or ".join(KINDS))
    if options.integrator not in get_args(Method):
        raise ProblemError(
            f"`{options.integrator}`", where="--integrator", expected=" or ".join(get_args(Method))
        )
    method: Any = options.integrator
    changes = Changes(options.horizon, options.seed, options.disturbance, method, options.perturbation)
    return kind, changes  # type: ignore[return-value]


def _scenario(stored: "Stored", network: "Network", kind: "Kind", changes: "Changes") -> "Scenario":
    """Return the run; the worst disturbance starts from agreement, whatever the file's initial states."""
    from lockstep.model.simulation.from_problem import scenario_of

    asked = changes.disturbance or stored.problem.simulation.disturbance.kind
    if asked != "worst":
        return scenario_of(stored.problem, changes, sampled=kind != "continuous")
    quiet = scenario_of(stored.problem, replace(changes, disturbance="none"), sampled=kind != "continuous")
    return _worst(stored, network, quiet, changes)


def _worst(stored: "Stored", network: "Network", quiet: "Scenario", changes: "Changes") -> "Scenario":
    from lockstep.model.simulation.agreement import weakest_agreement
    from lockstep.model.simulation.worst import worst_disturbance
    from lockstep.verification.measured import weights_of_design

    seed = stored.problem.simulation.seed if changes.seed is None else changes.seed
    weights = weights_of_design(stored, network)
    weakest, _ = weakest_agreement(network, stored.gains, weights, seed=seed)
    # Two thirds of the run are disturbed, so that what the disturbance leaves behind is counted too.
    disturbed = quiet.horizon * 2 / 3
    step = quiet.step * max(1, round(disturbed / WORST_SAMPLES / quiet.step))
    found = worst_disturbance(
        network,
        stored.gains,
        weights,
        horizon=max(disturbed, step),
        step=step,
        common=[0 * weakest, weakest],
        seed=seed,
    )
    return replace(quiet, start=found.start, disturbance=found.disturbance, pinned=True)


@contextmanager
def _controllers(path: Path, stored: "Stored", kind: "Kind") -> "Iterator[Gains | SampledControllers]":
    from lockstep.cli.certify import is_generated
    from lockstep.codegen.c_certificate import problem_fits
    from lockstep.codegen.manifest import load_manifest
    from lockstep.verification.in_the_loop import design_controllers, reference_controllers

    if kind == "continuous":
        yield stored.gains
        return
    delay = stored.problem.controller.delay
    if not is_generated(path):
        if kind == "compiled":
            raise ProblemError(
                "there is no C to compile",
                where=str(path),
                expected="a folder of generated C for --controllers compiled",
                remedy="make one with `lockstep generate`",
            )
        yield design_controllers(stored)
        return
    manifest = load_manifest(path)
    problem_fits(stored, manifest)
    if kind == "sampled":
        yield reference_controllers(manifest, delay=delay)
        return
    from lockstep.verification.compiled_loop import compiled_controllers

    with compiled_controllers(path, delay=delay) as controllers:
        yield controllers


def _document(
    trajectory: "Trajectory",
    scenario: "Scenario",
    found: "Measured",
    kind: "Kind",
    changes: "Changes",
    stored: "Stored",
) -> dict[str, Any]:
    import numpy as np

    from lockstep.model.simulation import effort_indices, indices

    d = trajectory.disagreement()
    simulation = stored.problem.simulation
    return {
        "ok": found.holds,
        "controllers": kind,
        "disturbance": changes.disturbance or simulation.disturbance.kind,
        "horizon": trajectory.horizon,
        "step": scenario.step,
        "seed": simulation.seed if changes.seed is None else changes.seed,
        "integrator": scenario.method,
        "disagreement_initial": float(d[0]),
        "disagreement_final": float(d[-1]),
        "disagreement_max": float(d.max()),
        "indices": [one.document() for one in indices(trajectory)],
        "effort": [one.document() for one in effort_indices(trajectory)],
        "largest_input": [float(np.abs(trajectory.u[:, i]).max()) for i in range(trajectory.N)],
        "faults": trajectory.faults,
        "l2": {
            "output": found.output,
            "disturbance": found.input,
            "gain": found.gain,
            "rho": found.rho,
            "ratio": found.ratio,
            "covered": found.covered,
            "reason": found.reason,
        },
        **(
            {}
            if found.holds
            else {
                "error": {"kind": "ClaimError", "message": _excess(found), "figures": {"ratio": found.ratio}}
            }
        ),
    }


def _tables(
    trajectory: "Trajectory",
    found: "Measured",
    kind: "Kind",
    disturbance: str,
    stored: "Stored",
    plot: str,
) -> "RenderableType":
    from rich import box
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    from lockstep.model.simulation import effort_indices, indices

    d = trajectory.disagreement()
    rows = {
        "controllers": kind,
        "disturbance": disturbance,
        "disagreement": f"{d[0]:.4g} at the start, {d[-1]:.4g} after {trajectory.horizon:g} s",
        "measured gain": _gain_text(found),
    }
    if trajectory.faults:
        rows["faults"] = f"{trajectory.faults} steps with a status other than OK"
    # Three digits and folded cells: in 80 columns a figure that is cut says nothing.
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    headings = ("agent", "ISE", "IAE", "ITSE", "ITAE", "of u: ISE", "IAE", "ITSE", "ITAE")
    for heading in headings:
        table.add_column(heading, justify="right", overflow="fold")
    pairs = zip(indices(trajectory), effort_indices(trajectory), strict=True)
    for i, (error, effort) in enumerate(pairs, start=1):
        cells = [*error.document().values(), *effort.document().values()]
        table.add_row(f"{trajectory.agent}{i}", *[f"{value:.3g}" for value in cells])
    parts: list[RenderableType] = [two_columns(stored.problem.title, rows), table]
    return Group(*parts, *([Text.from_ansi(plot)] if plot else []))


def _gain_text(found: "Measured") -> str:
    if not found.covered or found.ratio is None:
        return f"not held against a proof: {found.reason}" if found.reason else "nothing came in"
    share = f"{100 * found.ratio:.4g} % of what rho = {found.rho:.4g} allows"
    gain = "" if found.gain is None else f"{found.gain:.4g}, "
    return f"{gain}{share}" if found.holds else _excess(found)


def _excess(found: "Measured") -> str:
    return (
        f"the run exceeds rho = {found.rho:.6g}, which is proved: by {100 * ((found.ratio or 0) - 1):.3g} %"
    )
