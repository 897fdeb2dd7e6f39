"""A run of a swarm: figures of all agents, the record of a few, the disagreement and the energies at every instant."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from lockstep.check.errors import ProblemError, demand
from lockstep.model.simulation.disturbance import Disturbance
from lockstep.model.simulation.divergence import check_bounded
from lockstep.model.simulation.quadrature import Hold, running_integral
from lockstep.model.simulation.results.indices import Indices
from lockstep.model.simulation.results.trajectory import AT_REST, Energies, Trajectory
from lockstep.model.simulation.scenario import whole_number
from lockstep.swarm.disturbances import Fields, Pace
from lockstep.swarm.engine import CompiledSwarm
from lockstep.swarm.loop import SwarmLoop
from lockstep.swarm.numpy_engine import PlainSwarm

RECORDED = 12
"""Agents whose signals are kept, the first ones: two or three hundred kilobytes for each thousand instants."""


@dataclass(frozen=True, eq=False)
class SwarmTrajectory(Trajectory):
    """The record of a few agents of a swarm, and how they stand to all.

    mean: (K, n), of all agents;  apart: (K,), |x_d| of all agents.
    """

    mean: Float[np.ndarray, "K n"] = field(default_factory=lambda: np.zeros((0, 0)))
    apart: Float[np.ndarray, " K"] = field(default_factory=lambda: np.zeros(0))

    def errors(self) -> Float[np.ndarray, "K k n"]:
        """Return e_i = x_i - mean of all agents, of the recorded ones."""
        return np.asarray(self.x - self.mean[:, None])

    def disagreement(self) -> Float[np.ndarray, " K"]:
        """Return |x_d| of all agents."""
        return self.apart


@dataclass(frozen=True, eq=False)
class SwarmRun:
    """What a run of N agents gives.

    trajectory: every signal of the first few agents, on all instants.
    energies: of all agents, with the weights R and Q.
    index: (N, 4), ISE, IAE, ITSE, ITAE of each e_i;  effort: (N, 4), of each u_i;  largest_input: (N,).
    final: (N, n), the states at the end;  faults: steps of controllers that failed;  clipped: steps that met a limit.
    """

    trajectory: SwarmTrajectory
    N: int
    energies: Energies
    index: Float[np.ndarray, "N 4"]
    effort: Float[np.ndarray, "N 4"]
    largest_input: Float[np.ndarray, " N"]
    final: Float[np.ndarray, "N n"]
    faults: int
    clipped: int = 0

    @property
    def disagreement(self) -> Float[np.ndarray, " K"]:
        """|x_d| at each instant."""
        return self.trajectory.apart

    def indices(self) -> tuple[Indices, ...]:
        """Return the indices of the disagreement of every agent."""
        return tuple(Indices(*row) for row in self.index.tolist())

    def effort_indices(self) -> tuple[Indices, ...]:
        """Return the indices of the effort of every agent."""
        return tuple(Indices(*row) for row in self.effort.tolist())


def simulate_swarm(
    loop: SwarmLoop,
    start: Float[np.ndarray, "N n"],
    horizon: float,
    *,
    step: float | None = None,
    substeps: int = 4,
    disturbance: Disturbance | None = None,
    compiled: bool = True,
    threads: int | None = None,
) -> SwarmRun:
    """Run a swarm with its sampled controllers; every message arrives.

    Args:
        loop: the swarm.
        start: (N, n), the agents' states; the controllers start at zero.
        horizon: in s, rounded up to whole periods.
        step: s between the instants of the record; by default the period.
        substeps: steps of the classical Runge-Kutta method from one instant to the next.
        disturbance: one sinusoid, or whatever is held between the instants.
        compiled: in C, by a compiler of this machine; or in NumPy, slower.
        threads: by default one for each processor; the answer is the same.

    Raises:
        ProblemError: parts that do not fit, or no compiler.
        Diverged: a state left all bounds; with time, agent and state.
    """
    start = np.array(start, dtype=float)
    found = f"`start` of {' x '.join(map(str, start.shape))}"
    expected = f"{loop.N} x {loop.agent.n} finite numbers"
    demand(start.shape == (loop.N, loop.agent.n) and np.isfinite(start).all(), found, "swarm", expected)
    per = whole_number(loop.period / (step or loop.period), "the period over `step`")
    instant = loop.period / per
    if not (horizon > 0 and np.isfinite(horizon)) or substeps < 1:
        raise ProblemError(f"a horizon of {horizon!r} s in {substeps} substeps", where="swarm")
    count = per * max(1, int(np.ceil(horizon / loop.period - 1e-9)))
    fields = Fields(disturbance, loop.N, loop.agent.n)
    pace = Pace(instant, per, substeps)
    engine: CompiledSwarm | PlainSwarm = (
        CompiledSwarm(loop, start, fields, pace, threads=threads)
        if compiled
        else PlainSwarm(loop, start, fields, pace)
    )
    try:
        return _Run(loop, engine, fields, start, instant, per, count).go()
    finally:
        engine.close()


class _Run:
    """Goes from instant to instant and keeps what is recorded."""

    def __init__(
        self,
        loop: SwarmLoop,
        engine: CompiledSwarm | PlainSwarm,
        fields: Fields,
        start: Float[np.ndarray, "N n"],
        instant: float,
        per: int,
        count: int,
    ) -> None:
        self._loop, self._engine, self._fields, self._per = loop, engine, fields, per
        self._t = np.arange(count + 1) * instant
        self._watched = np.arange(min(loop.N, RECORDED))
        agent, shape = loop.agent, (count + 1, len(self._watched))
        self._x, self._xi = np.zeros((*shape, agent.n)), np.zeros((*shape, agent.n))
        self._x_C, self._u = np.zeros((*shape, loop.order)), np.zeros((*shape, agent.m))
        self._squares = np.zeros((count + 1, 3))
        self._entered = np.zeros(count + 1)
        self._means = np.zeros((count + 1, agent.n))
        self._means[0] = _mean(start)
        self._faults = self._clipped = 0

    def go(self) -> SwarmRun:
        """Run, and return what was found."""
        engine, watched, n = self._engine, self._watched, self._loop.agent.n
        last = len(self._t) - 1
        self._x[0] = engine.states(watched)
        for k, now in enumerate(self._t):
            sampled = k % self._per == 0
            self._x_C[k] = engine.memories(watched) if sampled else self._x_C[k - 1]
            row = engine.step(k, self._means[k], last=k == last)
            self._u[k] = engine.inputs(watched)
            self._xi[k] = self._fields.of(watched, now)
            self._entered[k] = self._fields.squared_at(now)
            self._squares[k] = row[n : n + 3]
            if not sampled:
                self._squares[k, 2] = self._squares[k - 1, 2]
            self._faults += int(row[n + 3])
            self._clipped += int(row[n + 5])
            if row[n + 4]:
                self._diverged(k)
            if k < last:
                self._means[k + 1] = self._means[k] + row[:n] / self._loop.N
                self._x[k + 1] = engine.states(watched)
        return self._found()

    def _diverged(self, k: int) -> None:
        agent = self._loop.agent
        states = self._engine.states(np.arange(self._loop.N))
        check_bounded(self._t[k + 1 : k + 2], states[None], agent)

    def _found(self) -> SwarmRun:
        agent, loop = self._loop.agent, self._loop
        index, effort = self._engine.figures()
        hold: Hold = "smooth" if self._fields.waves else "held"
        trajectory = SwarmTrajectory(
            *(self._t, self._x, self._x_C, self._u, self._x @ agent.lure.C.T, self._xi),
            *(agent.states, agent.inputs, agent.outputs, agent.name),
            u_hold="held",
            xi_hold=hold,
            faults=self._faults,
            clipped=self._clipped,
            mean=self._means,
            apart=np.sqrt(self._squares[:, 0]),
        )
        output = running_integral(self._squares[:, 1], self._t, "smooth")
        # Trapezoids over every other instant are off by about four times as much.
        coarse, fine = running_integral(self._squares[::2, 1], self._t[::2], "smooth"), output[::2]
        off = float(abs(coarse[-1] / fine[-1] - 1)) if fine[-1] > 0 else 0.0
        output += running_integral(self._squares[:, 2], self._t, "held")
        entered = running_integral(self._entered, self._t, hold)
        at_rest = self._squares[0, 1] <= AT_REST**2 * max(1.0, float(np.abs(loop.R).max()))
        return SwarmRun(
            trajectory,
            loop.N,
            Energies(self._t, output, entered, bool(at_rest), off),
            index,
            effort[:, :4],
            effort[:, 4],
            self._engine.states(np.arange(loop.N)),
            self._faults,
            self._clipped,
        )


def _mean(x: Float[np.ndarray, "N n"]) -> Float[np.ndarray, " n"]:
    """Return the mean, exact where all agents agree."""
    return np.asarray(x[0] + (x - x[0]).mean(axis=0))
