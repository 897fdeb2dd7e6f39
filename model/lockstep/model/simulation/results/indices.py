"""The performance indices of Table 2, per agent.

For a signal e(t) of one agent, |e| its Euclidean norm and t the time since the start of the run,

    ISE = int |e|^2 dt,   IAE = int |e| dt,   ITSE = int t |e|^2 dt,   ITAE = int t |e| dt.

The paper takes them of the "controllers' effort", so of u_i, and says neither the horizon nor the initial states;
with lasting noise all four grow with the horizon. `indices` takes them of the disagreement of each agent,
e_i = x_i - mean of all x_j, which is what consensus is about; `effort_indices` of u_i, for comparison with Table 2.
"""

from dataclasses import asdict, dataclass

import numpy as np
from jaxtyping import Float

from lockstep.model.simulation.quadrature import Hold, running_integral
from lockstep.model.simulation.results.trajectory import Trajectory


@dataclass(frozen=True)
class Indices:
    """The four indices of one agent's signal."""

    ISE: float
    IAE: float
    ITSE: float
    ITAE: float

    def document(self) -> dict[str, float]:
        """Return them by name."""
        return asdict(self)


def indices(trajectory: Trajectory) -> tuple[Indices, ...]:
    """Return the indices of the disagreement e_i = x_i - mean of every agent."""
    return indices_of(trajectory.t, trajectory.errors())


def effort_indices(trajectory: Trajectory) -> tuple[Indices, ...]:
    """Return the indices of the control effort u_i of every agent: those of Table 2."""
    return indices_of(trajectory.t, trajectory.u, hold=trajectory.u_hold)


def indices_of(
    t: Float[np.ndarray, " K"], signal: Float[np.ndarray, "K N k"], *, hold: Hold = "smooth"
) -> tuple[Indices, ...]:
    """Return the indices of any signal, one per agent.

    Args:
        t: instants in s; time counts from the first.
        signal: K x N x k.
        hold: "smooth" for the trapezoidal rule; "held" for row k on [t_k, t_k+1), integrated exactly.

    >>> t = np.linspace(0.0, 1.0, 1001)
    >>> one = indices_of(t, np.ones((1001, 1, 1)))[0]
    >>> round(one.ISE, 6), round(one.ITAE, 6)
    (1.0, 0.5)
    """
    since = t - t[0]
    norm = np.sqrt((signal**2).sum(axis=2))

    def integral(values: Float[np.ndarray, "K N"], timed: bool) -> Float[np.ndarray, " N"]:
        if not timed:
            return np.asarray(running_integral(values, since, hold)[-1])
        if hold == "held":
            # t dt is d(t^2 / 2): exact for values that are held.
            return np.asarray(running_integral(values, since**2 / 2, hold)[-1])
        return np.asarray(running_integral(values * since[:, None], since, hold)[-1])

    columns = [integral(norm**power, timed) for timed in (False, True) for power in (2, 1)]
    return tuple(Indices(*(float(column[i]) for column in columns)) for i in range(norm.shape[1]))
