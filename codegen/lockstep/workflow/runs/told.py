"""What is told of a run, for people: how far apart the agents were, where they settled, and what is proved of such a run."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from lockstep.lmi.analysis.covered_start import times_covered
from lockstep.lmi.analysis.decimals import below
from lockstep.model.simulation.divergence import left_domain
from lockstep.model.simulation.from_problem import channel_of


def rows(run: Any) -> dict[str, str]:
    """Return what is to be told of a `Simulation`, which asks for it, for people, by a word for each."""
    trajectory, found, problem = run.trajectory, run.measured, run.design.problem
    agent = problem.agent()
    table = problem.simulation.disturbance
    drawn = run.disturbance in ("noise", "sine", "step")
    scaled = " in the scales of [design.disturbances]" * found.scaled
    alike = not (trajectory.xi - trajectory.xi[:, :1]).any()
    table = table.model_copy(update={"kind": run.disturbance})
    disturbed = f"{f' of {table.size}' * drawn}, |xi_d| = {found.input:.4g} in L2{scaled}"
    since = None if alike else table.start if drawn else 0.0
    led = " beside the reference" if problem.reference is not None else ""
    told = {
        "controllers": run.controllers,
        **run.remarks(),
        "disturbance": f"{run.disturbance}{led}{'' if alike else disturbed}",
        **{
            f"{name} apart by": _course(trajectory.t, d, agent.shown_units.get(name, ""), since)
            for name, d in zip(agent.states, np.ptp(trajectory.less_offsets, axis=1).T, strict=True)
        },
        "measured gain" if found.gain else "against rho": found.text,
        **_ranges(run),
    }
    if trajectory.x.shape[1] == run.agents:  # of many a record has a few
        ends = zip(agent.states, trajectory.less_offsets.mean(axis=1)[[0, -1]].T, strict=True)
        told["mean"] = "; ".join(f"{name} {a:.4g} at first, {b:.4g} in the end" for name, (a, b) in ends)
    if (asked := problem.messages) is not None:
        delay = "{}:{}".format(*asked.delay)
        named = {"loss": asked.loss, "burst": asked.burst, "delay": delay, "jitter": asked.jitter}
        each = (f"{name}={value}" for name, value in named.items() if value not in (None, 0, "0:0"))
        if (faults := ",".join(each)) and problem.simulation.channel is None:
            nodes = f"`--campaign 100 --faults {faults} -o DIR`"
            told["messages"] = f"each arrives in time in this run; the nodes on such a network: {nodes}"
    claimed = None if run.controllers == "off" else run.design.stored.claims.initial_set
    away = trajectory.errors()[0]
    if claimed is not None and len(away) == run.agents:
        covered = times_covered(claimed.radius, claimed.half_axes, away)
        leads = trajectory.x[:, claimed.leader - 1 : claimed.leader]
        out = {"a leader out of its range": left_domain(trajectory.t, leads, agent, claimed.inner)}
        if 0 < covered < 1:
            said = "that all agents stay in their domain is proved, of the continuous controllers, from"
            told["initial states"] = f"{said} {below(covered, 3)} times this start{_without(run, out)}"
    if problem.reference is not None:
        moved = ", ".join(f"{of} = {text}" for of, text in (problem.simulation.reference or {}).items())
        leader = f"{problem.agent().name}{problem.reference.leader + 1}"
        told["reference"] = (
            f"of {leader}: {moved}, counted as its disturbance: one that lasts may leave the others behind, one that"
            " all are given, in t of [agent.dynamics], does not"
        )
    if trajectory.faults:
        told["faults"] = f"{trajectory.faults} steps with a status other than OK or CLIPPED"
    if trajectory.clipped:
        steps = run.agents * round(trajectory.horizon / problem.controller.period)
        told["clipped"] = f"{trajectory.clipped} of {steps} controller steps met a limit of an input"
    if of := run.messages:
        left = {"agents out of their domain": left_domain(trajectory.t, trajectory.x, agent)}
        less, residual = _without(run, left), of["residual"]
        proved = f"; in the end at most {residual:.4g} apart, which is proved{less}" if residual else ""
        told["send on change"] = f"{of['saved']:.1%} of the messages saved ({of['sent']} sent){proved}"
    return told


def _without(run: Any, besides: Mapping[str, Any]) -> str:
    """Return without what a proof of exact messages and undisturbed agents is, of that and `besides` what the run has."""
    here = {"disturbances": run.trajectory.xi.any(), "clipped inputs": run.trajectory.clipped, **besides}
    table = run.design.problem.simulation.channel
    touched = table is not None and (not channel_of(table, 0).is_ideal or bool(table.noise))
    here["messages that are lost, late, rounded or noisy"] = touched
    without = " and ".join(what for what, there in here.items() if there)
    return f" without {without} (this run has them)" if without else ""


def _course(t: Float[np.ndarray, " K"], d: Float[np.ndarray, " K"], unit: str, since: float | None) -> str:
    """Return where a distance began, where it ended, and its settling time, to 2 % of its largest.

    Of a run that is disturbed `since` some time, there is no settling, but the largest from then on.

    >>> t, d = np.arange(4.0), np.array([3.0, 5.0, 0.2, 0.05])
    >>> _course(t, d, "m", None)
    '3 m at the start, 5 m at most, 0.05 m after 3 s; within 2 % of its largest from 3 s on'
    >>> _course(t, d, "m", 2.0)
    '3 m at the start, 5 m at most, 0.2 m at most from 2 s on, 0.05 m after 3 s'
    """
    most, unit = d.max(), f" {unit}" if unit else ""
    above, settled = np.flatnonzero(d > 0.02 * most), ""
    if since is None and most > 0:
        there = above[-1] + 1 < len(d)
        settled = (
            f"; within 2 % of its largest from {t[above[-1] + 1]:.4g} s on" if there else "; not settled"
        )
    # What is left of a distance that only decays says nothing below the rounding of the states.
    start, most, end = (
        f"{value if value > 1e-12 * most else 0.0:.4g}{unit}" for value in (d[0], most, d[-1])
    )
    later = (
        f"{d[t >= since].max():.4g}{unit} at most from {since:g} s on, " if since and since < t[-1] else ""
    )
    return f"{start} at the start, {most} at most, {later}{end} after {t[-1] - t[0]:g} s{settled}"


def _ranges(run: Any) -> dict[str, str]:
    """Return over what the inputs, and the states of the domain, went: all agents, all instants."""
    problem, x, u = run.design.problem, run.trajectory.x, run.trajectory.u
    agent = problem.agent()
    ranges = (("domain", agent.states, x, agent.box), ("inputs", agent.inputs, u, problem.sides))
    return {
        row: ", ".join(
            f"{name} from {values[..., j].min():.4g} to {values[..., j].max():.4g}"
            + f" within {low:g} to {high:g}" * bool(np.isfinite((low, high)).any())
            for j, (name, (low, high)) in enumerate(zip(names, sides, strict=True))
            if row == "inputs" or np.isfinite((low, high)).any()
        )
        for row, names, values, sides in ranges
        if row == "inputs" or np.isfinite(sides).any()
    }
