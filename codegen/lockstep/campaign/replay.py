"""One run of a campaign again, step by step, by its index: the same code on the same numbers."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from lockstep.campaign.compiled.engine import Engine
from lockstep.campaign.compute import RunTable, columns_of, compute, excused
from lockstep.campaign.disturbance import disturbance
from lockstep.campaign.draw import FAMILIES, draw
from lockstep.campaign.plan import Plan
from lockstep.check.errors import ProblemError, demand
from lockstep.model.agents.agent import Agent
from lockstep.model.simulation.results.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Replay:
    """A run: its campaign and index, its row of the table, and its trajectory up to where it is finite."""

    plan: Plan
    index: int
    columns: tuple[str, ...]
    row: Float[np.ndarray, " columns"]
    trajectory: Trajectory

    def __getitem__(self, name: str) -> float:
        """Return one figure of the run."""
        return float(self.row[self.columns.index(name)])

    @property
    def ok(self) -> bool:
        """Whether the run is finite, without a fault, and below the bound if the certificate covers it; see `Campaign.ok`."""
        own = RunTable(self.columns, self.row[None])
        failed = not excused(self.plan, own).any() if self["diverged"] else self["faults"] > 0
        return not failed and not (self["covered"] and self["ratio"] > 1)

    def document(self) -> dict[str, Any]:
        """Return the run's figures as plain JSON types."""
        figures: dict[str, Any] = {name: self[name] for name in self.columns if name not in ("run", "family")}
        figures |= {name: bool(figures[name]) for name in ("covered", "diverged")}
        return {
            "ok": self.ok,
            "identity": self.plan.identity,
            "run": self.index,
            "family": FAMILIES[int(self["family"])],
            **figures,
        }


def replay(plan: Plan, agent: Agent, run: int) -> Replay:
    """Run one of a campaign's runs again.

    Args:
        plan: the campaign's.
        agent: of the network, for the names of the signals and y = C x.
        run: the index, as in the table.

    Raises:
        ProblemError: an index below 0, or a run that is not finite from its first step on.
    """
    demand(run >= 0, f"run {run}", "replay", "an index of the campaign's table, 0 or more")
    layout = plan.source.layout
    batch = draw(plan, run, run + 1).batch
    signals = dict(Engine(plan.source).trace(batch, plan.horizon))
    signals["xi"] = disturbance(batch, 0, layout.periods(plan.horizon))
    finite = np.all(
        [np.isfinite(value).reshape(len(value), -1).all(axis=1) for value in signals.values()], axis=0
    )
    end = len(finite) if finite.all() else int(np.argmin(finite))
    if end < 2:
        raise ProblemError(f"run {run} is not finite from its first step on", where="replay")
    t, x, x_C, u, xi = (signals[name][:end] for name in ("t", "x", "x_C", "u", "xi"))
    trajectory = Trajectory(
        *(t, x, x_C, u, x @ agent.lure.C.T, xi, agent.states, agent.inputs, agent.outputs, agent.name),
        u_hold="held" if layout.sampled else "smooth",
        xi_hold="smooth",
    )
    return Replay(plan, run, columns_of(plan), compute(plan, run, run + 1)[0], trajectory)
