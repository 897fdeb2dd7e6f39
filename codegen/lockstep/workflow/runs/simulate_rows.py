"""What a simulated run is told as, for people: a word and a line for each."""

from typing import TYPE_CHECKING

import numpy as np

from lockstep.lmi.initial_set import below

if TYPE_CHECKING:
    from lockstep.workflow.runs.simulate import Simulation


def rows(run: "Simulation") -> dict[str, str]:
    """Return what is to be told of the run, for people, by a word for each."""
    trajectory, found, problem = run.trajectory, run.measured, run.design.problem
    d = trajectory.disagreement()
    states = zip(problem.agent().states, trajectory.disagreement_by_state().T, strict=True)
    each = [f"{name} {one[0]:.4g}, {one.max():.4g}, {one[-1]:.4g}" for name, one in states]
    told = {
        "controllers": run.controllers,
        "disturbance": f"{run.disturbance}, |xi_d| = {found.input:.4g} in L2",
        "disagreement": f"{d[0]:.4g} at the start, {d.max():.4g} at most, {d[-1]:.4g} after {trajectory.horizon:g} s",
        **({"by state": "; ".join(each)} if len(each) > 1 else {}),
        "measured gain" if found.gain else "against rho": found.text,
        **_ranges(run),
    }
    claimed = run.design.stored.claims.initial_set
    if claimed is not None and d[0] > claimed.radius:
        told["initial states"] = (
            f"{d[0]:.4g} from agreement; that all agents stay in their domain is proved from {below(claimed.radius)},"
            " of the continuous controllers"
        )
    if problem.reference is not None:
        moved = ", ".join(f"{name} = {text}" for name, text in (problem.simulation.reference or {}).items())
        leader = f"{problem.agent().name}{problem.reference.leader + 1}"
        told["reference"] = f"of {leader}: {moved}, counted as its disturbance"
    if trajectory.faults:
        told["faults"] = f"{trajectory.faults} steps with a status other than OK or CLIPPED"
    if trajectory.clipped:
        told["clipped"] = f"{trajectory.clipped} controller steps met a limit of an input"
    if of := run.messages:
        besides = {"disturbances": trajectory.xi.any(), "clipped inputs": trajectory.clipped}
        without = " and ".join(what for what, there in besides.items() if there)
        less, residual = f" without {without} (this run has them)" if without else "", of["residual"]
        proved = f"; in the end at most {residual:.4g} apart, which is proved{less}" if residual else ""
        told["send on change"] = f"{of['saved']:.1%} of the messages saved ({of['sent']} sent){proved}"
    return told


def _ranges(run: "Simulation") -> dict[str, str]:
    """Return over what the states of the domain, and the limited inputs, went: all agents, all instants."""
    problem, x, u = run.design.problem, run.trajectory.x, run.trajectory.u
    agent = problem.agent()
    ranges = (("domain", agent.states, x, agent.box), ("limits", agent.inputs, u, problem.sides))
    return {
        row: ", ".join(
            f"{name} from {values[..., j].min():.4g} to {values[..., j].max():.4g} within {low:g} to {high:g}"
            for j, (name, (low, high)) in enumerate(zip(names, sides, strict=True))
            if np.isfinite((low, high)).any()
        )
        for row, names, values, sides in ranges
        if np.isfinite(sides).any()
    }
