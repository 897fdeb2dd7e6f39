"""What a simulated run is told as, for people: a word and a line for each."""

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from lockstep.lmi.initial_set import below

if TYPE_CHECKING:
    from lockstep.workflow.runs.simulate import Simulation


def rows(run: "Simulation") -> dict[str, str]:
    """Return what is to be told of the run, for people, by a word for each."""
    trajectory, found, problem = run.trajectory, run.measured, run.design.problem
    agent, start = problem.agent(), float(trajectory.disagreement()[0])
    table = problem.simulation.disturbance
    drawn = run.disturbance in ("noise", "sine", "step")
    size = f" of amplitude {table.amplitude:g} on every state, in its unit per second" * drawn
    disturbed = f"{size if table.intensity is None else ''}, |xi_d| = {found.input:.4g} in L2"
    told = {
        "controllers": run.controllers,
        **run.remarks(),
        "disturbance": f"{run.disturbance}{disturbed if found.input else ''}",
        **{
            f"{name} apart by": _course(trajectory.t, d, agent.units.get(name, ""), found.input == 0)
            for name, d in zip(agent.states, np.ptp(trajectory.less_offsets, axis=1).T, strict=True)
        },
        "measured gain" if found.gain else "against rho": found.text,
        **_ranges(run),
    }
    claimed = run.design.stored.claims.initial_set
    if claimed is not None and start > claimed.radius:
        told["initial states"] = (
            f"{start:.4g} from agreement; that all agents stay in their domain is proved from {below(claimed.radius)},"
            " of the continuous controllers"
        )
    if problem.reference is not None:
        moved = ", ".join(f"{name} = {text}" for name, text in (problem.simulation.reference or {}).items())
        leader = f"{problem.agent().name}{problem.reference.leader + 1}"
        told["reference"] = f"of {leader}: {moved}, counted as its disturbance"
    if trajectory.faults:
        told["faults"] = f"{trajectory.faults} steps with a status other than OK or CLIPPED"
    if trajectory.clipped:
        steps = run.agents * round(trajectory.horizon / problem.controller.period)
        told["clipped"] = f"{trajectory.clipped} of {steps} controller steps met a limit of an input"
    if of := run.messages:
        besides = {"disturbances": trajectory.xi.any(), "clipped inputs": trajectory.clipped}
        without = " and ".join(what for what, there in besides.items() if there)
        less, residual = f" without {without} (this run has them)" if without else "", of["residual"]
        proved = f"; in the end at most {residual:.4g} apart, which is proved{less}" if residual else ""
        told["send on change"] = f"{of['saved']:.1%} of the messages saved ({of['sent']} sent){proved}"
    return told


def _course(t: Float[np.ndarray, " K"], d: Float[np.ndarray, " K"], unit: str, undisturbed: bool) -> str:
    """Return where a distance began, where it ended, and its settling time, to 2 % of its largest.

    >>> _course(np.arange(4.0), np.array([0.0, 5.0, 0.2, 0.05]), "m", True)
    '0 m at the start, 5 m at most, 0.05 m after 3 s; within 2 % of its largest from 3 s on'
    """
    most, above = d.max(), np.flatnonzero(d > 0.02 * d.max())
    known = undisturbed and most > 0 and above[-1] + 1 < len(d)
    settled = f"; within 2 % of its largest from {t[above[-1] + 1]:.4g} s on" if known else ""
    shown = [f"{value:.4g}{f' {unit}' if unit else ''}" for value in (d[0], most, d[-1])]
    return f"{shown[0]} at the start, {shown[1]} at most, {shown[2]} after {t[-1] - t[0]:g} s{settled}"


def _ranges(run: "Simulation") -> dict[str, str]:
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
