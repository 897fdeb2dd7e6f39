"""Linear agents from python-control systems."""

import re
from typing import Any

import casadi as ca
import numpy as np
from jaxtyping import Float

from lockstep.check.errors import demand
from lockstep.model.agents.agent import Agent


def agent_from_control(system: Any, *, name: str = "") -> Agent:
    """Return a linear agent with the matrices of a `control.StateSpace`, double by double.

    Characters that no name here may have become underscores: python-control's own `x[0]` is `x_0`.

    Args:
        system: continuous, with D = 0: outputs of an agent are linear in its states (2).
        name: the agent's name; by default the system's.

    Raises:
        ProblemError: another kind of system, a discrete one, a D that is not zero, or names that clash.
    """
    import control

    found = f"a {type(system).__name__}"
    expected = "a control.StateSpace"
    remedy = "control.ss makes one; a nonlinear agent is built from its equations, with Agent"
    demand(isinstance(system, control.StateSpace), found, "agent_from_control", expected, remedy)
    found = f"a discrete system with dt = {system.dt}"
    demand(system.isctime(), found, "agent_from_control", "a continuous one, as in (2)")
    demand(not np.any(system.D), "D is not zero", "agent_from_control", "y = C x, as in (2)")
    x, u = ca.SX.sym("x", system.nstates), ca.SX.sym("u", system.ninputs)
    return Agent(
        name=name or _plain(system.name),
        x=x,
        u=u,
        rhs=_times(system.A, x) + _times(system.B, u),
        y=_times(system.C, x),
        states=tuple(map(_plain, system.state_labels)),
        inputs=tuple(map(_plain, system.input_labels)),
        outputs=tuple(map(_plain, system.output_labels)),
    )


def _plain(label: str) -> str:
    return re.sub(r"[^A-Za-z0-9]+", "_", label).strip("_")


def _times(matrix: Float[np.ndarray, "_ _"], vector: ca.SX) -> ca.SX:
    return ca.mtimes(ca.SX(ca.DM(matrix)), vector)
