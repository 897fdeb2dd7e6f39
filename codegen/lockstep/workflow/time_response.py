"""Time responses of the nonlinear loop from its compiled C, as python-control has them."""

from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from lockstep.check.errors import ProblemError, demand
from lockstep.model.real_numbers import reals
from lockstep.model.simulation.disturbance import MOST_INSTANTS

if TYPE_CHECKING:
    from lockstep.campaign.compiled.engine import Engine
    from lockstep.lmi.document import Stored
    from lockstep.model.network import Network
    from lockstep.model.simulation.results.trajectory import Trajectory


def compiled_run(
    stored: "Stored", network: "Network", horizon: float, start: Any = None, xi: Any = 0.0, step: float = 1e-3
) -> "Trajectory":
    """Run the nonlinear loop with the continuous controllers (12) as compiled C: RK4, the same right-hand side.

    Args:
        stored: the design.
        network: of it.
        horizon: in s, rounded up to whole periods of [controller].
        start: (N, n), the agents' states; 0 by default. The controllers start at 0.
        xi: the disturbance: constant, what broadcasts to (N, n); or (periods, N n), held for a period each.
        step: the longest step of the integration, in s.

    Raises:
        ProblemError: shapes that do not fit, no compiler, or a run that does not stay finite.
    """
    from lockstep.campaign.compiled.engine import Batch
    from lockstep.model.simulation.results.trajectory import Trajectory

    agent, N = network.agent, network.N
    given = (horizon, "horizon"), (step, "step")
    horizon, step = (reals(value, what, "response", single=True).item() for value, what in given)
    period = stored.problem.controller.period
    if not (step > 0 and 0 < horizon <= MOST_INSTANTS * min(period, step)):
        posed = f"a horizon of {horizon:g} s in steps of {step:g} s"
        raise ProblemError(posed, where="response", expected=f"both above 0, at most {MOST_INSTANTS} steps")
    engine = _engine(_Key(stored, network), step)
    layout = engine.layout
    periods, states = layout.periods(horizon), N * agent.n
    start = np.zeros((N, agent.n)) if start is None else reals(start, "start", "response")
    demand(start.size == states, f"`start` has {start.size} numbers", "response", f"{N} x {agent.n}")
    xi = reals(xi, "xi", "response")
    held = xi.ndim == 2 and xi.shape == (periods, states)
    try:
        given = xi.reshape(N, agent.n) if xi.size == states else xi
        constant = np.broadcast_to(0.0 if held else given, (N, agent.n))
    except ValueError:
        posed, expected = f"`xi` of the shape {xi.shape}", f"({N}, {agent.n}), or ({periods}, {states})"
        raise ProblemError(posed, where="response", expected=expected) from None
    rows = np.repeat(xi if held else np.tile(constant.ravel(), (periods, 1)), layout.substeps, axis=0)
    sequences = xi[None] if held else np.zeros((1, periods, states))
    batch = Batch.at_rest(layout, 1, sequences=sequences, x=start.ravel(), bias=constant.ravel())
    found = engine.trace(batch, horizon)
    if not all(np.isfinite(value).all() for value in found.values()):
        raise ProblemError("the run does not stay finite", where="response", remedy="take a shorter horizon")
    recorded = np.vstack([rows, rows[-1:]]).reshape(-1, N, agent.n)
    t, x, x_C, u = (found[name] for name in ("t", "x", "x_C", "u"))
    gains, r = stored.gains, network.graph.laplacian @ x[-1] @ agent.lure.C.T
    # The trace's last u is that of the step before.
    u[-1] = [gains.C[i] @ x_C[-1, i] + gains.D[i] @ r[i] for i in range(N)]
    y = x @ agent.lure.C.T
    return Trajectory(t, x, x_C, u, y, recorded, agent.states, agent.inputs, agent.outputs, agent.name)


class _Key:
    """A design and its network, told apart by which objects they are."""

    def __init__(self, stored: "Stored", network: "Network") -> None:
        self.stored, self.network = stored, network

    def __hash__(self) -> int:
        return id(self.network)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Key) and other.network is self.network


@lru_cache(maxsize=8)
def _engine(key: _Key, step: float) -> "Engine":
    """Return the compiled loop; its C is written once for each design."""
    from lockstep.campaign.compiled.engine import Engine
    from lockstep.campaign.compiled.layout import Features
    from lockstep.campaign.compiled.source import continuous_source

    stored, network, problem = key.stored, key.network, key.stored.problem
    source = continuous_source(
        network,
        stored.gains,
        problem.performance,
        period=stored.problem.controller.period,
        step=step,
        features=Features(sequences=True),
    )
    return Engine(source)
