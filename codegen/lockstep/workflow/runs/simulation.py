"""A simulated run, what it is held against, and what is told of it."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from lockstep.lmi.analysis.covered_start import times_covered
from lockstep.lmi.analysis.decimals import below
from lockstep.model.html_table import html_table
from lockstep.model.simulation.divergence import left_domain
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
        l2 = {
            "output": found.output,
            "disturbance": found.input,
            **{one: getattr(found, one) for one in same},
        }
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
        trajectory, found, problem = self.trajectory, self.measured, self.design.problem
        agent = problem.agent()
        table = problem.simulation.disturbance
        drawn = self.disturbance in ("noise", "sine", "step")
        scaled = " in the scales of [design.disturbances]" * found.scaled
        alike = not (trajectory.xi - trajectory.xi[:, :1]).any()
        table = table.model_copy(update={"kind": self.disturbance})
        disturbed = f"{f' of {table.size}' * drawn}, |xi_d| = {found.input:.4g} in L2{scaled}"
        since = None if alike else table.start if drawn else 0.0
        led = " beside the reference" if problem.reference is not None else ""
        told = {
            "controllers": self.controllers,
            **self.remarks(),
            "disturbance": f"{self.disturbance}{led}{'' if alike else disturbed}",
            **{
                f"{name} apart by": _course(trajectory.t, d, agent.shown_units.get(name, ""), since)
                for name, d in zip(agent.states, np.ptp(trajectory.less_offsets, axis=1).T, strict=True)
            },
            "measured gain" if found.gain else "against rho": found.text,
            **_ranges(self),
        }
        if (asked := problem.messages) is not None:
            delay = "{}:{}".format(*asked.delay)
            named = {"loss": asked.loss, "burst": asked.burst, "delay": delay, "jitter": asked.jitter}
            each = (f"{name}={value}" for name, value in named.items() if value not in (None, 0, "0:0"))
            if (faults := ",".join(each)) and problem.simulation.channel is None:
                nodes = f"`--campaign 100 --faults {faults} -o DIR`"
                told["messages"] = f"each arrives in time in this run; the nodes on such a network: {nodes}"
        claimed = None if self.controllers == "off" else self.design.stored.claims.initial_set
        away, covered = trajectory.errors()[0], 0.0
        if claimed is not None and len(away) == self.agents:  # of many a record has a few
            covered = times_covered(claimed.radius, claimed.half_axes, away)
        if 0 < covered < 1:
            said = "that all agents stay in their domain is proved, of the continuous controllers, from"
            told["initial states"] = f"{said} {below(covered, 3)} times this start"
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
            steps = self.agents * round(trajectory.horizon / problem.controller.period)
            told["clipped"] = f"{trajectory.clipped} of {steps} controller steps met a limit of an input"
        if of := self.messages:
            besides = {"disturbances": trajectory.xi.any(), "clipped inputs": trajectory.clipped}
            besides |= {"messages that are lost, late or rounded": problem.simulation.channel is not None}
            besides |= {"agents out of their domain": left_domain(trajectory.t, trajectory.x, agent)}
            without = " and ".join(what for what, there in besides.items() if there)
            less, residual = f" without {without} (this run has them)" if without else "", of["residual"]
            proved = f"; in the end at most {residual:.4g} apart, which is proved{less}" if residual else ""
            told["send on change"] = f"{of['saved']:.1%} of the messages saved ({of['sent']} sent){proved}"
        return told

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


def _ranges(run: Simulation) -> dict[str, str]:
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
