"""A simulated run, what it is held against, and what is told of it."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from lockstep.model.html_table import html_table
from lockstep.workflow.design_file import Design

if TYPE_CHECKING:
    from lockstep.model.simulation import Trajectory
    from lockstep.model.simulation.send_on_change import SendOnChange
    from lockstep.verification.closed_loop.measured_gain import Kind, Measured


@dataclass(frozen=True, eq=False)
class Simulation:
    """One run, and how it compares with what is proved.

    Args:
        design: what was run.
        trajectory: t, x, x_C, u, y, xi of all agents.
        measured: |z|, |xi_d|, and the rho they are held against.
        controllers: "continuous", "sampled", "compiled" or "off".
        disturbance: of the run, as it was asked for.
        seed: of what is random in the run.
        step: s, between the instants of the run.
        integrator: "rk4" or "adaptive".
        on_change: its threshold and what is proved of it, None where every period is sent.
    """

    design: Design
    trajectory: "Trajectory"
    measured: "Measured"
    controllers: "Kind"
    disturbance: str
    seed: int
    step: float
    integrator: str
    on_change: "SendOnChange | None" = field(default=None, kw_only=True)

    @property
    def ok(self) -> bool:
        """Whether the run keeps to what is proved of it, or nothing is."""
        return self.measured.holds

    def document(self) -> dict[str, Any]:
        """Return the contract's keys."""
        trajectory, found = self.trajectory, self.measured
        d = trajectory.disagreement()
        same = ("gain", "rho", "ratio", "covered", "reason")
        l2 = {"output": found.output, "disturbance": found.input, **{k: getattr(found, k) for k in same}}
        error = {"kind": "ClaimError", "figures": {"ratio": found.ratio}}
        return {
            "ok": found.holds,
            "controllers": self.controllers,
            "disturbance": self.disturbance,
            "horizon": trajectory.horizon,
            "step": self.step,
            "seed": self.seed,
            "integrator": self.integrator,
            "disagreement_initial": float(d[0]),
            "disagreement_final": float(d[-1]),
            "disagreement_max": float(d.max()),
            **self.of_each(),
            "faults": trajectory.faults,
            "clipped": trajectory.clipped,
            **({"messages": self.messages} if self.messages else {}),
            "l2": l2,
            **({} if found.holds else {"error": {**error, "message": found.excess}}),
        }

    @property
    def messages(self) -> dict[str, Any]:
        """What send on change saved, and the residual that it costs; nothing without it."""
        on = self.on_change
        return {} if on is None else on.cost(self.trajectory, self.design.problem.controller.real)

    @property
    def agents(self) -> int:
        """How many agents ran."""
        return self.trajectory.N

    def remarks(self) -> dict[str, str]:
        """Tell what is to be known of the figures; of few agents nothing."""
        return {}

    def of_each(self) -> dict[str, Any]:
        """Return the figures of each agent: `indices`, `effort`, `largest_input`."""
        from lockstep.model.simulation import effort_indices, indices

        trajectory = self.trajectory
        return {
            "indices": [one.document() for one in indices(trajectory)],
            "effort": [one.document() for one in effort_indices(trajectory)],
            "largest_input": [float(np.abs(trajectory.u[:, i]).max()) for i in range(trajectory.N)],
        }

    def to_control(self) -> Any:
        """Return the run as `control.TimeResponseData`, with the names of `Design.to_control`."""
        from lockstep.model.simulation.results.exchange import to_time_response

        return to_time_response(self.trajectory)

    def to_pandas(self) -> Any:
        """Return the run as a `pandas.DataFrame` by t, a column for each signal (extra `notebook`)."""
        from lockstep.model.simulation.results.exchange import to_pandas

        return to_pandas(self.trajectory)

    def plot(self, what: str = "states") -> Any:
        """Return a matplotlib figure of the run: "states", "disagreement", "effort", or "phase" of two states.

        Raises:
            ProblemError: another word.
        """
        from lockstep.report.figures import run_figure

        return run_figure(self.trajectory, what, self.design.problem.agent().shown_units)

    def rows(self) -> dict[str, str]:
        """Return what is to be told of the run, for people, by a word for each."""
        from lockstep.workflow.runs.told import rows

        return rows(self)

    def __repr__(self) -> str:
        """Say how far apart the agents were and are, and what the run is held against."""
        d, ratio = self.trajectory.disagreement(), self.measured.ratio
        held = "held against nothing proved" if ratio is None else f"at {ratio:.3g} of what is proved"
        return (
            f"<Simulation of {self.design.title!r}: {self.controllers} controllers, {self.trajectory.horizon:g} s, "
            f"disagreement {d[0]:.3g} to {d[-1]:.3g}, {held}>"
        )

    def _repr_html_(self) -> str:
        """Return what is to be told of it in a table, for a notebook."""
        return html_table(self.rows().items(), title=self.design.title)

    def figures(self) -> dict[str, bytes]:
        """Return the states, the disagreement and the effort as PNG and PDF: file name -> bytes."""
        from lockstep.report.export import as_files
        from lockstep.report.figures import run_figure

        units, files = self.design.problem.agent().shown_units, dict[str, bytes]()
        for what in ("states", "disagreement", "effort"):
            drawn = as_files(run_figure(self.trajectory, what, units), what)
            files |= {f"{what}.{end}": content for end, content in drawn.items()}
        return files
