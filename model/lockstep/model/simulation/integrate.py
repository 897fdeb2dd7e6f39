"""Two integrators over a grid of instants: Runge-Kutta's classical one with fixed steps, and an adaptive one.

Both take X' = f(X, t, p(t)) with p continuous within each step of the grid (it may jump between steps), and return X
at the instants. They share nothing but f: RK4 runs in CasADi's virtual machine, four evaluations a step and an error
of order h^4; the adaptive one is SciPy's DOP853 (Dormand and Prince, order 8), restarted at each instant, its error
per step kept below a tolerance. The tests hold them to each other.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol

import casadi as ca
import numpy as np
from jaxtyping import Float

from lockstep.check.errors import ClaimError, ProblemError, demand

Method = Literal["rk4", "adaptive"]

Parameters = Callable[[Float[np.ndarray, " M"], Float[np.ndarray, " M"]], Float[np.ndarray, "M p"]]
"""(t, since) -> p at the times t, each within the step of the grid that begins at `since`."""

CHUNK = 500
"""Steps that one CasADi call runs through: long enough that the calls cost nothing, short enough to build at once."""


class Integrator(Protocol):
    """What a run asks of an integrator."""

    def __call__(
        self, X: Float[np.ndarray, " X"], t: Float[np.ndarray, " K"], parameters: Parameters
    ) -> Float[np.ndarray, "K X"]:
        """Return X at the instants t, the first being the one given."""
        ...


def integrator(f: ca.Function, method: Method, *, substeps: int = 4, tolerance: float = 1e-10) -> Integrator:
    """Return an integrator of X' = f(X, t, p).

    Args:
        f: (X, t, p) -> dX.
        method: "rk4" with `substeps` per step of the grid, or "adaptive" with a relative `tolerance` per step.
    """
    if method == "rk4":
        return FixedSteps(f, substeps)
    if method == "adaptive":
        return Adaptive(f, tolerance)
    raise ProblemError(f"`{method}`", where="integrator", expected='"rk4" or "adaptive"')


class FixedSteps:
    """The classical Runge-Kutta method of order 4, a whole number of steps per step of the grid."""

    def __init__(self, f: ca.Function, substeps: int) -> None:
        demand(substeps >= 1, f"`substeps` is {substeps}", "integrator", "1 or more")
        self._substeps, self._step = substeps, runge_kutta_step(f)
        self._runs: dict[int, ca.Function] = {}

    def __call__(
        self, X: Float[np.ndarray, " X"], t: Float[np.ndarray, " K"], parameters: Parameters
    ) -> Float[np.ndarray, "K X"]:
        """Return X at the instants."""
        s, K = self._substeps, len(t) - 1
        widths = np.repeat(np.diff(t) / s, s)
        since = np.repeat(t[:-1], s)
        begins = since + np.tile(np.arange(s), K) * widths
        stages = [parameters(begins + part * widths, since) for part in (0.0, 0.5, 1.0)]
        columns = np.hstack([begins[:, None], widths[:, None], *stages]).T
        micro = np.empty((K * s + 1, len(X)))
        micro[0] = X
        for first in range(0, K * s, CHUNK):
            last = min(first + CHUNK, K * s)
            states = self._run(last - first)(micro[first], columns[:, first:last])
            micro[first + 1 : last + 1] = np.asarray(states).T
        return micro[::s]

    def _run(self, steps: int) -> ca.Function:
        if steps not in self._runs:
            self._runs[steps] = self._step.mapaccum(steps)
        return self._runs[steps]


def runge_kutta_step(f: ca.Function) -> ca.Function:
    """Return (X, (t, h, p(t), p(t + h/2), p(t + h))) -> X at t + h, to order 4."""
    size = f.size1_in(2)
    X, column = ca.SX.sym("X", f.size1_in(0)), ca.SX.sym("column", 2 + 3 * size)
    t, h, first, middle, last = ca.vertsplit(column, [0, 1, 2, 2 + size, 2 + 2 * size, 2 + 3 * size])
    k_1 = f(X, t, first)
    k_2 = f(X + h / 2 * k_1, t + h / 2, middle)
    k_3 = f(X + h / 2 * k_2, t + h / 2, middle)
    k_4 = f(X + h * k_3, t + h, last)
    ahead = X + h / 6 * (k_1 + 2 * k_2 + 2 * k_3 + k_4)
    return ca.Function("step", [X, column], [ahead], ["X", "column"], ["ahead"])


@dataclass(frozen=True, eq=False)
class Adaptive:
    """DOP853 with a relative tolerance per step, and as much absolutely, in units of each state."""

    f: ca.Function
    tolerance: float

    def __call__(
        self, X: Float[np.ndarray, " X"], t: Float[np.ndarray, " K"], parameters: Parameters
    ) -> Float[np.ndarray, "K X"]:
        """Return X at the instants.

        Raises:
            ClaimError: the step that the tolerance asks for is below what doubles resolve.
        """
        from scipy.integrate import solve_ivp

        found = np.empty((len(t), len(X)))
        found[0] = X
        for k in range(len(t) - 1):
            since = t[k : k + 1]

            def slope(time: float, state: np.ndarray, since: np.ndarray = since) -> np.ndarray:
                return np.asarray(self.f(state, time, parameters(np.array([time]), since)[0])).ravel()

            with np.errstate(all="ignore"):
                done = solve_ivp(
                    slope, t[k : k + 2], found[k], "DOP853", rtol=self.tolerance, atol=self.tolerance
                )
            if not done.success:
                raise ClaimError(
                    f"the integrator stops at t = {done.t[-1]:.6g} s: {done.message}", time=done.t[-1]
                )
            found[k + 1] = done.y[:, -1]
        return found
