"""The nonlinear closed loop in time: agents (2) under controllers (9), continuous or sampled, as a trajectory.

    x_i' = A x_i + B_i u_i + G phi(H x_i, t) + offset(t) + xi_i

Continuous controllers are integrated with the agents, Delta(t) of (11) included: (12). Sampled ones see y at the
multiples of their period and hold u in between, and are whatever `Stepper` they are.
"""

import casadi as ca
import numpy as np
from jaxtyping import Bool, Float

from lockstep.check.errors import demand
from lockstep.check.system.loop import Gains
from lockstep.model.network import Network
from lockstep.model.simulation.disturbance import Disturbance
from lockstep.model.simulation.divergence import check_bounded
from lockstep.model.simulation.equations import closed_loop, inputs_of
from lockstep.model.simulation.integrate import Integrator, integrator
from lockstep.model.simulation.perturbation import check_sizes
from lockstep.model.simulation.quadrature import Hold
from lockstep.model.simulation.results.trajectory import Trajectory
from lockstep.model.simulation.sampled_controllers import CLIPPED, OK, SampledControllers
from lockstep.model.simulation.scenario import Scenario, whole_number
from lockstep.model.simulation.send_on_change import Senders


def simulate(network: Network, controllers: Gains | SampledControllers, scenario: Scenario) -> Trajectory:
    """Run the loop.

    Args:
        network: the agents on their graph.
        controllers: gains (9), or steppers with their period.
        scenario: start, horizon, disturbance, gain errors, channel, integrator.

    Raises:
        ProblemError: parts that do not fit: a channel for continuous controllers, gain errors for sampled ones, a
            period that is no whole number of steps, ...
        Diverged: a state left all bounds; with time, agent and state.
    """
    found = f"`start` is {scenario.start.shape[0]} x {scenario.start.shape[1]}"
    expected = f"{network.N} x {network.agent.n}, one row per agent"
    demand(scenario.start.shape == (network.N, network.agent.n), found, "scenario", expected)
    demand(controllers.N == network.N, f"{controllers.N} controllers for {network.N} agents", "simulate")
    if isinstance(controllers, Gains):
        return _continuous(network, controllers, scenario)
    return _sampled(network, controllers, scenario)


def rates(network: Network, trajectory: Trajectory) -> Float[np.ndarray, "2 K-1 N n"]:
    """Return x' of a run just after the first instant of each interval and just before its last one.

    Without what is common to all agents in a run that was `pinned`: the disagreement does not see it.
    """
    run = network.agents_alone()
    t, N = trajectory.t, trajectory.N

    def at(end: slice) -> Float[np.ndarray, "K-1 N n"]:
        u, xi = (
            signal[:-1] if hold == "held" else signal[end]
            for signal, hold in ((trajectory.u, trajectory.u_hold), (trajectory.xi, trajectory.xi_hold))
        )
        rows = [part.reshape(len(t) - 1, -1) for part in (trajectory.less_offsets[end], u, xi)]
        found = run(rows[0].T, t[end].reshape(1, -1), np.hstack(rows[1:]).T)
        return np.asarray(found, dtype=float).T.reshape(len(t) - 1, N, -1)

    return np.stack([at(slice(None, -1)), at(slice(1, None))])


def _continuous(network: Network, gains: Gains, scenario: Scenario) -> Trajectory:
    given, expected = "continuous controllers exchange no messages", "no delay, drop or quantisation"
    demand(scenario.channel.is_ideal, given, "channel", expected, "simulate sampled controllers")
    t, xi, errors = scenario.instants, scenario.xi(), scenario.perturbation
    if errors is not None:
        check_sizes(errors, network.N, gains.blocks.shape[1:])
    loop = closed_loop(network, gains, perturbed=errors is not None, pinned=scenario.pinned)
    run = _integrator(loop, scenario)

    def parameters(time: Float[np.ndarray, " M"], since: Float[np.ndarray, " M"]) -> Float[np.ndarray, "M p"]:
        given = [xi.at(time, since), *([errors.at(time, since)] if errors is not None else [])]
        return np.hstack([part.reshape(len(time), -1) for part in given])

    split = scenario.start.size
    # No agent's equation sees the offsets: the loop of x is that of x less them.
    offsets = 0.0 if scenario.offsets is None else scenario.offsets
    start = (scenario.start - offsets).ravel()
    X = run(np.concatenate([start, np.zeros(gains.N * gains.order)]), t, parameters)
    apart = X[:, :split].reshape(len(t), network.N, -1)
    x = apart + offsets
    x_C = X[:, split:].reshape(len(t), gains.N, gains.order)
    check_bounded(t, x, network.agent)
    blocks = np.broadcast_to(gains.blocks, (len(t), *gains.blocks.shape))
    u = inputs_of(network, apart, x_C, blocks if errors is None else blocks + errors.at(t, t))
    return _record(network, scenario, t, x, x_C, u, "smooth")


def _sampled(network: Network, controllers: SampledControllers, scenario: Scenario) -> Trajectory:
    given, remedy = "gain errors of sampled controllers", "simulate the continuous controllers"
    expected = "continuous controllers: (11) is about their gains"
    demand(scenario.perturbation is None, given, "perturbation", expected, remedy)
    per = whole_number(controllers.period / scenario.step, "the period over `step`")
    xi, N, m = scenario.xi(), network.N, network.agent.m
    periods = int(np.ceil((len(scenario.instants) - 1) / per))
    t = np.arange(periods * per + 1) * scenario.step
    run = _integrator(network.agents_alone(pinned=scenario.pinned), scenario)
    program = _Program(network, controllers, scenario, periods)
    x, u = np.empty((len(t), *scenario.start.shape)), np.zeros((len(t), N, m))
    x_C = np.empty((len(t), N, len(controllers.steppers[0].memory)))
    x[0] = scenario.start
    for k in range(periods):
        now = slice(k * per, (k + 1) * per + 1)
        x_C[now] = program.memory
        u[now] = applied = program.step(x[k * per])
        states = run(x[k * per].ravel(), t[now], _Held(applied, xi))
        x[now] = states.reshape(per + 1, *scenario.start.shape)
        check_bounded(t[: now.stop], x[: now.stop], network.agent, per + 1)
    x_C[-1] = program.memory
    counts = (program.faults, program.clipped, program.senders.sent, program.senders.saved)
    return _record(network, scenario, t, x, x_C, u, "held", counts)


def _integrator(f: ca.Function, scenario: Scenario) -> Integrator:
    return integrator(f, scenario.method, substeps=scenario.substeps, tolerance=scenario.tolerance)


class _Held:
    """p = (u, xi) of the agents alone, u held."""

    def __init__(self, u: Float[np.ndarray, "N m"], xi: Disturbance) -> None:
        self._u, self._xi = u.ravel(), xi

    def __call__(
        self, time: Float[np.ndarray, " M"], since: Float[np.ndarray, " M"]
    ) -> Float[np.ndarray, "M p"]:
        xi = self._xi.at(time, since).reshape(len(time), -1)
        return np.hstack([np.broadcast_to(self._u, (len(time), len(self._u))), xi])


class _Program:
    """All agents' steppers with the channel between them."""

    def __init__(
        self, network: Network, controllers: SampledControllers, scenario: Scenario, periods: int
    ) -> None:
        controllers.init()
        self._C, self._all, self._channel = network.agent.lure.C, controllers, scenario.channel
        edges = sum(len(heard) for heard in controllers.sources)
        self._arrivals = iter(self._channel.arrivals(periods, edges))
        self._drawn = np.random.default_rng((self._channel.seed, 1))
        self._sent: list[tuple[np.ndarray, np.ndarray]] = []
        self.senders = Senders(controllers.sources, self._channel.change)
        self._pending = np.zeros((network.N, network.agent.m))
        self.faults = self.clipped = 0

    @property
    def memory(self) -> Float[np.ndarray, "N n_C"]:
        """What the controllers hold before the next step."""
        return np.array([stepper.memory for stepper in self._all.steppers], dtype=float)

    def step(self, x: Float[np.ndarray, "N n"]) -> Float[np.ndarray, "N m"]:
        """Sample, exchange, step; return the inputs that act from now on."""
        real = np.dtype(self._all.real)
        with np.errstate(over="ignore", under="ignore"):
            y = self._channel.quantised(x @ self._C.T + self._noise()).astype(real)
        self._sent = [*self._sent, (y, self.senders.sends(y))][-1 - self._channel.delay :]
        # a message of `delay` periods ago: there is none in the first periods
        heard, there = self._sent[0] if len(self._sent) > self._channel.delay else (None, None)
        arrived, u, first = next(self._arrivals), [], 0
        for i, sources in enumerate(self._all.sources):
            here = arrived[first : first + len(sources)]
            first += len(sources)
            received = 0 if heard is None or there is None else _mask(here & there[list(sources)])
            rows = np.zeros((len(sources), y.shape[1]), real) if heard is None else heard[list(sources)]
            status, out = self._all.steppers[i].step(y[i], rows, received)
            self.faults += status not in (OK, CLIPPED)
            self.clipped += status == CLIPPED
            u.append(np.asarray(out, dtype=float))
        fresh = np.array(u)
        applied, self._pending = (self._pending, fresh) if self._all.delay else (fresh, fresh)
        return applied

    def _noise(self) -> Float[np.ndarray, "N q"] | float:
        noise = self._channel.noise
        return np.array(noise) * self._drawn.standard_normal((self._all.N, len(noise))) if any(noise) else 0.0


def _mask(here: Bool[np.ndarray, " nn"]) -> int:
    return sum(1 << j for j, there in enumerate(here) if there)


def _record(
    network: Network,
    scenario: Scenario,
    t: Float[np.ndarray, " K"],
    x: Float[np.ndarray, "K N n"],
    x_C: Float[np.ndarray, "K N n_C"],
    u: Float[np.ndarray, "K N m"],
    hold: Hold,
    counts: tuple[int, int, int, int] = (0, 0, 0, 0),
) -> Trajectory:
    """Return the run; counts: of steps with a fault, of clipped ones, of outputs sent and saved."""
    agent, xi = network.agent, scenario.xi()
    names, y = (agent.states, agent.inputs, agent.outputs, agent.name), x @ agent.lure.C.T
    signals = (t, x, x_C, u, y, xi.at(t, t))
    return Trajectory(*signals, *names, hold, xi.hold, *counts, offsets=scenario.offsets)
