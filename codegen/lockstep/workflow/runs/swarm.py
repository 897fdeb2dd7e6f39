"""A run of many agents: the compiled swarm in the place of the simulation that records every signal of every agent."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from lockstep.check.errors import ProblemError
from lockstep.model.problem.weights import amplitudes
from lockstep.model.simulation.from_problem import Changes, channel_of, disturbance_of, step_of
from lockstep.swarm import NeighbourLists, SwarmLoop, SwarmRun, simulate_swarm, swarm_of_design
from lockstep.swarm.disturbances import StreamedNoise
from lockstep.swarm.neighbours import EdgeList
from lockstep.verification.closed_loop.measured_gain import (
    QUADRATURE,
    Measured,
    network_of_design,
    promise,
    storage_of,
)
from lockstep.verification.toolchain import host_compilers
from lockstep.workflow.design_file import Design
from lockstep.workflow.runs.simulation import Simulation
from lockstep.workflow.waiting.progress import Progress

if TYPE_CHECKING:
    from lockstep.lmi.document import Stored
    from lockstep.model.problem import Problem
    from lockstep.model.simulation.disturbance import Disturbance

LARGE = 100
"""Agents from which a run is a swarm's: CasADi would hold the whole loop as one expression."""

LISTED = 1000
"""Agents up to which the answer has the figures of each."""

_INDICES = ("ISE", "IAE", "ITSE", "ITAE")


@dataclass(frozen=True, eq=False, repr=False)
class LargeSimulation(Simulation):
    """A run of many agents: `trajectory` is of the first few, all figures are of all.

    Args:
        swarm: what was found of all agents.
        engine: "compiled", or "numpy" where this machine has no compiler.
    """

    swarm: SwarmRun
    engine: str

    @property
    def agents(self) -> int:
        """How many agents ran."""
        return self.swarm.N

    def document(self) -> dict[str, Any]:
        """Return the contract's keys; above `LISTED` agents those of each agent are summed up."""
        return {**super().document(), "agents": self.swarm.N, "engine": self.engine}

    def remarks(self) -> dict[str, str]:
        """Tell how many agents there are, and what ran them."""
        d = self.swarm.disagreement
        all_of = f"|x_d| of all {d[0]:.4g} at the start, {d[-1]:.4g} at the end; below the first {self.trajectory.N}"
        return {"agents": f"{self.swarm.N}, {self.engine}; {all_of}"}

    def of_each(self) -> dict[str, Any]:
        """Return the figures of each agent, or the mean, the largest and whose it is."""
        run = self.swarm
        if run.N <= LISTED:
            return {
                "indices": [one.document() for one in run.indices()],
                "effort": [one.document() for one in run.effort_indices()],
                "largest_input": run.largest_input.tolist(),
            }
        return {
            "indices": _summed_up(run.index),
            "effort": _summed_up(run.effort),
            "largest_input": {
                "agents": run.N,
                "mean": float(run.largest_input.mean()),
                "largest": float(run.largest_input.max()),
                "agent": int(run.largest_input.argmax()) + 1,
            },
        }


def is_large(
    stored: "Stored", kind: str, changes: Changes, neighbours: NeighbourLists | EdgeList | None
) -> bool:
    """Tell whether a run is a swarm's.

    Raises:
        ProblemError: another graph is given for a run that is none.
    """
    table = stored.problem.simulation
    disturbance = changes.disturbance or table.disturbance.kind
    errors = changes.perturbation or (table.perturbation.kind if table.perturbation else "none")
    why = {
        f"{kind} controllers": kind != "sampled",
        "the adaptive integrator": changes.method != "rk4",
        "the worst disturbance": disturbance == "worst",
        "gain errors": errors != "none",
        "a leader with a reference": stored.problem.reference is not None,
        "a formation": stored.problem.offsets is not None,
        "send on change": changes.change is not None,
        "a channel that loses or delays": not channel_of(table.channel, 0).is_ideal,
    }
    against = [name for name, holds in why.items() if holds]
    if neighbours is not None and against:
        raise ProblemError(
            f"{against[0]} on a graph that is not the design's",
            where="simulate",
            expected="sampled controllers, fixed steps, messages that all arrive",
        )
    return neighbours is not None or (stored.gains.N >= LARGE and not against)


def simulate_large(
    simulated: Design, changes: Changes, neighbours: NeighbourLists | EdgeList | None, progress: Progress
) -> LargeSimulation:
    """Run a design's controllers as a swarm, on its own graph or another one.

    Raises:
        ProblemError: gains that differ, for another graph; a graph without a spanning tree.
        Diverged: a state left all bounds.
    """
    stored = simulated.stored
    problem = stored.problem
    table = problem.simulation
    progress("the graph", 0.1)
    other = neighbours
    if other is not None and not isinstance(other, NeighbourLists):
        other = NeighbourLists.from_graph(other)
    loop = swarm_of_design(stored, other)
    loop.neighbours.check_spanning_tree()
    horizon = table.horizon if changes.horizon is None else changes.horizon
    seed = table.seed if changes.seed is None else changes.seed
    kind = changes.disturbance or table.disturbance.kind
    step = step_of(problem, horizon, held=kind in ("none", "noise"))
    compiled = bool(host_compilers())
    engine = "compiled" if compiled else "NumPy: there is no C compiler, set CC or install gcc or clang"
    progress(f"the closed loop of {loop.N} agents ({engine})", 0.3)
    start = _start(problem, loop.N, seed)
    run = simulate_swarm(
        loop,
        start,
        horizon,
        step=step,
        disturbance=_disturbance(problem, loop, kind, horizon, seed),
        compiled=compiled,
    )
    progress("what is proved", 0.8)
    found = _measured(run, stored, start, own=neighbours is None)
    parts = (simulated, run.trajectory, found, "sampled", kind, seed, step, "rk4")
    return LargeSimulation(*parts, run, "compiled" if compiled else "numpy")  # type: ignore[arg-type]


def _start(problem: "Problem", N: int, seed: int) -> Float[np.ndarray, "N n"]:
    """Return the file's initial states, or random ones where there are other agents."""
    return problem.initial_states(seed) if problem.sizes.N == N else problem.random_states(N, seed)


def _disturbance(
    problem: "Problem", loop: SwarmLoop, kind: str, horizon: float, seed: int
) -> "Disturbance | None":
    table = problem.simulation.disturbance.model_copy(update={"kind": kind})
    N, states, period = loop.N, loop.agent.states, loop.period
    if kind != "noise":
        return disturbance_of(table, N, states, period=period, horizon=horizon, seed=seed)
    stop, sigma = np.inf if table.stop is None else table.stop, amplitudes(table, N, states, period)
    return StreamedNoise(N, len(states), sigma, period, seed, table.start, stop)


def _measured(run: SwarmRun, stored: "Stored", start: Float[np.ndarray, "N n"], *, own: bool) -> Measured:
    """Hold a run on the design's own graph against what is proved of it."""
    energies, problem = run.energies, stored.problem
    output, entered = float(np.sqrt(energies.output[-1])), float(np.sqrt(energies.input[-1]))
    promised = promise(stored, "sampled") if own else None
    storage = 0.0 if energies.at_rest else None
    if storage is None and promised is not None and promised.P is not None:
        storage = storage_of(start, network_of_design(stored), stored, promised.P)
    rho = None if promised is None else promised.rho
    of_all = "whether this graph has the spectrum that the design is proved for is not decided here"
    doubts = {
        of_all if problem.spectrum else "the design is proved for another graph": promised is None,
        "" if promised is None else promised.reason: rho is None,
        "whether all of so many agents stayed in the domain is not recorded": promised is not None
        and promised.scope == "local",
        "rho is a gain from the states named in [design.disturbances], as scaled there, and the run disturbs all": (
            not problem.performance.covers_xi
        ),
        "|z| of so many agents is not in the paper's coordinates": problem.design.coordinates
        != "orthonormal",
        f"{run.faults} steps reported a fault": run.faults > 0,
        f"{run.clipped} steps clipped an input at its limit, and rho is proved without clipping": run.clipped
        > 0,
        "the run starts in disagreement, and this proof has no V(0): let it start in agreement, disturbed": (
            storage is None
        ),
    }
    reason = next((why for why, holds in doubts.items() if holds), None)
    if reason is not None or rho is None or promised is None or storage is None:
        return Measured(output, entered, energies.gain, rho, None, False, reason or "")
    ratio = energies.largest_ratio(rho, storage)
    root = None if ratio is None else float(np.sqrt(ratio))
    off = max(QUADRATURE, energies.off)
    return Measured(output, entered, energies.gain, rho, root, True, promised.reason, off)


def _summed_up(rows: Float[np.ndarray, "N 4"]) -> dict[str, Any]:
    return {
        "agents": len(rows),
        "mean": dict(zip(_INDICES, rows.mean(axis=0).tolist(), strict=True)),
        "largest": dict(zip(_INDICES, rows.max(axis=0).tolist(), strict=True)),
        "agent": dict(zip(_INDICES, (rows.argmax(axis=0) + 1).tolist(), strict=True)),
    }
