"""What python-control is told of a design: its loop, continuous or as it ships, and the loop opened somewhere."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from lockstep.model.html_table import html_table

if TYPE_CHECKING:
    from lockstep.check.system.loop import Gains
    from lockstep.lmi.document import Stored
    from lockstep.lmi.robustness import DiskMargin, GainPeak
    from lockstep.model.control.bridge import Method
    from lockstep.model.control.hybrid import Hybrid
    from lockstep.model.control.ports import PortedLoop
    from lockstep.model.network import Network


@dataclass(frozen=True, eq=False)
class Margins:
    """Disk margins of a loop, by what is perturbed at once."""

    rows: "Mapping[str, DiskMargin]"

    def document(self) -> dict[str, Any]:
        """Return the figures."""
        return {name: one.document() for name, one in self.rows.items()}

    def table(self) -> list[tuple[str, ...]]:
        """Return heads and lines, for people."""
        heads = ("perturbed at once", "alpha", "gain", "phase", "at rad/s", "proved")
        lines = []
        for name, one in self.rows.items():
            proved = "not asked for" if one.proved is None else f"alpha {one.proved:.4g}"
            gain = f"{one.gain[0]:.3g} to {one.gain[1]:.3g}"
            lines.append(
                (name, f"{one.alpha:.4g}", gain, f"{one.phase:.3g} deg", f"{one.frequency:.4g}", proved)
            )
        return [heads, *lines]

    def __repr__(self) -> str:
        """Say the margins, line by line."""
        return "\n".join("  ".join(cell.ljust(18) for cell in line).rstrip() for line in self.table())

    def _repr_html_(self) -> str:
        """Return a table, for a notebook."""
        heads, *lines = self.table()
        return html_table(lines, heads=heads)


class Analysis:
    """The part of `lockstep.Design` that analyses: everything here is computed in doubles, and nothing of it is proved."""

    stored: "Stored"

    if TYPE_CHECKING:

        @property
        def gains(self) -> "Gains":
            """(9)."""

        @property
        def network(self) -> "Network":
            """The agents on their graph."""

    def to_control(self, *, linear: bool = False, sampled: bool = False) -> Any:
        """Return the closed loop (12) for python-control: inputs xi_i, outputs x_i, y_i, u_i, by the model's names.

        Args:
            linear: leave phi out: the linear part (15), in disagreement coordinates.
            sampled: that linear part with the controllers as they ship, sampled and rounded, and u held: exactly
                discretised, a `control.ss` with its dt; xi_d is held too. `hybrid` has what is between the samples.
        """
        if sampled:
            return self.loop().closed()
        return self.network.to_control(self.gains, linear=linear)

    def controllers_to_control(
        self, period: float | None = None, method: "Method | None" = None
    ) -> list[Any]:
        """Return the controllers (9) for python-control, one `control.ss` per agent, from r_i to u_i.

        Args:
            period: in s, of discrete ones; by default they are continuous.
            method: "tustin" or "zoh", of discrete ones; by default the rule of the problem's [controller].
        """
        rule = None if period is None else self.stored.problem.controller.discretization
        return self.network.controllers_to_control(self.gains, period=period, method=method or rule)

    def loop(self, *, sampled: bool = True, period: float | None = None) -> "PortedLoop":
        """Return the linear part of the loop, to be opened at agents, inputs and links.

        Args:
            sampled: with the controllers as they ship, or the continuous ones.
            period: in s, of sampled controllers; by default that of the problem.
        """
        from lockstep.codegen.sampled_modes import sampled_controllers
        from lockstep.model.control.ports import PortedLoop

        if not sampled:
            return PortedLoop(self.network, self.gains)
        table = self.stored.problem.controller
        period = table.period if period is None else period
        return PortedLoop(self.network, sampled_controllers(self.stored, period), period, table.delay)

    def hybrid(self, inputs: list[str] | None = None, outputs: list[str] | None = None) -> "Hybrid":
        """Return the loop of continuous agents and the controllers as they ship: norms and responses between samples.

        Args:
            inputs: by name; by default xi_d and w_d.
            outputs: by name; by default x_d, v_d and u.
        """
        return self.loop().hybrid(inputs or (), outputs or ())

    def margins(self, *, sampled: bool = True, skew: float = 0.0, prove: bool = False) -> Margins:
        """Return the disk margins of the linear loop: the inputs of each agent, of all agents, all links.

        Args:
            sampled: of the loop with the controllers as they ship.
            skew: of the disk.
            prove: also look for margins that are proved at every frequency, for the doubles of the loop's matrices.
        """
        from lockstep.lmi.robustness import disk_margin

        loop = self.loop(sampled=sampled)
        name = loop.network.agent.name
        places = {f"{name}{i}": loop.inputs_of(i) for i in range(1, loop.network.N + 1)}
        places |= {"all inputs": loop.inputs_of(), "all links": loop.links()}
        found = {what: disk_margin(loop.opened(at), skew, prove=prove) for what, at in places.items()}
        return Margins(found)

    def mu(self, agent: int | None = None, *, sampled: bool = True) -> "GainPeak":
        """Return the peak of mu for multiplicative errors (I + Delta_i) of the inputs, a full block for each agent.

        The linear loop is stable for all |Delta_i| < 1 / mu.

        Args:
            agent: of one, from 1; by default of all at once.
            sampled: of the loop with the controllers as they ship.
        """
        from lockstep.lmi.robustness import peak

        loop = self.loop(sampled=sampled)
        signals, m = loop.inputs_of(agent), loop.network.agent.m
        return peak(loop.complementary(signals), [(m, m)] * (len(signals) // m))

    def response(self, horizon: float, start: Any = None, xi: Any = 0.0, *, step: float = 1e-3) -> Any:
        """Return the nonlinear loop with the continuous controllers in time, as `control.TimeResponseData`.

        From compiled C, RK4: what `control.input_output_response` returns of `to_control()`, in milliseconds.

        Args:
            horizon: in s, rounded up to whole periods.
            start: (N, n), the agents' states; 0 by default.
            xi: the disturbance, constant (N, n), or (periods, N n), held for a period each.
            step: the longest step of the integration, in s.
        """
        from lockstep.model.simulation.results.exchange import to_time_response
        from lockstep.workflow.time_response import compiled_run

        return to_time_response(compiled_run(self.stored, self.network, horizon, start, xi, step))

    def linearise(self, x: Any = None, x_C: Any = None, t: float = 0.0) -> Any:
        """Return the closed loop (12) linearised at states (N, n), (N, n_C) and a time, as a `control.ss`."""
        import numpy as np

        from lockstep.model.control.operating_points import linearised_loop

        at = np.zeros((self.network.N, self.network.agent.n)) if x is None else x
        return linearised_loop(self.network, self.gains, at, x_C, t)

    def plot(self, what: str = "graph", **options: Any) -> Any:
        """Return a matplotlib figure: "graph" (who hears whom), "poles" or "margins" of the loop as it ships.

        Args:
            what: which.
            options: of `loop`, for "poles" and "margins".

        Raises:
            ProblemError: another word.
        """
        from lockstep.check.errors import ProblemError
        from lockstep.report.figures import graph_figure
        from lockstep.report.loop_figures import margins_figure, poles_figure

        if what == "graph":
            return graph_figure(self.network.graph)
        loop = self.loop(**options)
        if what == "poles":
            system = loop.closed()
            return poles_figure(system.poles(), system.dt or None)
        if what == "margins":
            return margins_figure({f"{a}": loop.sensitivity([a]) for a in loop.inputs_of()})
        raise ProblemError(f"`{what}`", where="plot", expected='"graph", "poles" or "margins"')
