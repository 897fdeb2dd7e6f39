"""What python-control is told of a design: its loop, continuous or as it ships, and the loop opened somewhere."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lockstep.check.loop import Gains
    from lockstep.lmi.document import Stored
    from lockstep.model.control.hybrid import Hybrid
    from lockstep.model.control.ports import PortedLoop
    from lockstep.model.network import Network


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

    def controllers_to_control(self, **sampling: Any) -> list[Any]:
        """Return the controllers (9) for python-control, one `control.ss` per agent, from r_i to u_i.

        Args:
            sampling: `period` in s and `method` ("tustin" or "zoh"), for discrete ones.
        """
        return self.network.controllers_to_control(self.gains, **sampling)

    def loop(self, *, sampled: bool = True, period: float | None = None) -> "PortedLoop":
        """Return the linear part of the loop, to be opened at agents, inputs and links.

        Args:
            sampled: with the controllers as they ship, or the continuous ones.
            period: in s, of sampled controllers; by default that of the problem.
        """
        from lockstep.codegen.sampled_design import sampled_controllers
        from lockstep.model.control.ports import PortedLoop

        if not sampled:
            return PortedLoop(self.network, self.gains)
        table = self.stored.problem.controller
        period = table.period if period is None else period
        return PortedLoop(self.network, sampled_controllers(self.stored, period), period, table.delay)

    def hybrid(self, inputs: list[str] | None = None, outputs: list[str] | None = None) -> "Hybrid":
        """Return the loop of continuous agents and the controllers as they ship: norms and responses between samples.

        Args:
            inputs, outputs: by name; by default xi_d and w_d, and x_d, v_d and u.
        """
        return self.loop().hybrid(inputs or (), outputs or ())
