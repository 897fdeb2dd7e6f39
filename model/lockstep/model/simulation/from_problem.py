"""The scenario of a problem file's [simulation], and what of it a caller may change."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar, get_args

import casadi as ca
import numpy as np

from lockstep.check.errors import demand
from lockstep.model.problem import Problem
from lockstep.model.problem.tables.schema import ChannelTable, DisturbanceTable, PerturbationTable
from lockstep.model.problem.weights import amplitudes
from lockstep.model.simulation.disturbance import Disturbance, Driven, Sines, Steps, Sum, noise
from lockstep.model.simulation.integrate import Method
from lockstep.model.simulation.message_channel import MessageChannel
from lockstep.model.simulation.perturbation import PaperPerturbation, Perturbation, random_perturbation
from lockstep.model.simulation.scenario import Scenario

Kinds = TypeVar("Kinds", DisturbanceTable, PerturbationTable)

FINEST = 0.005
"""Longest step of a record in s, up to `LONG`: a longer period is recorded in whole parts."""

LONG = 100_000 * FINEST
"""A horizon in s beyond which steps follow the agent."""


@dataclass(frozen=True)
class Changes:
    """What replaces the file's; None leaves it."""

    horizon: float | None = None
    seed: int | None = None
    disturbance: str | None = None
    method: Method = "rk4"
    perturbation: str | None = None
    change: float | None = None


def scenario_of(problem: Problem, changes: Changes | None = None, *, sampled: bool) -> Scenario:
    """Return the run that [simulation] describes.

    Noise is held for a period; sines get random phases and steps random signs from the seed, since what is the same
    for all agents disturbs no agreement. The record has a whole number of steps per period.
    A leader's reference v is a disturbance B v of its own, which is what proofs take it for.

    Args:
        problem: the problem.
        changes: what to change.
        sampled: whether the controllers are sampled: the channel is theirs, gain errors are the continuous ones'.

    Raises:
        ProblemError: `worst`, which takes a search (`lockstep.model.simulation.worst_disturbance`), or tables that ask for
            what these controllers cannot have.
    """
    changes, table = changes or Changes(), problem.simulation
    horizon = table.horizon if changes.horizon is None else changes.horizon
    seed = table.seed if changes.seed is None else changes.seed
    period, N = problem.controller.period, problem.graph().N
    given = _of_kind(table.disturbance, changes.disturbance, "--disturbance")
    step = step_of(problem, horizon, held=sampled and given.kind in ("none", "noise"))
    errors = _of_kind(table.perturbation or PerturbationTable(), changes.perturbation, "--perturbation")
    perturbation = _perturbation(errors, problem, seed, horizon)
    noise = tuple(problem.sensor_noise)
    channel = replace(channel_of(table.channel, seed), change=changes.change, noise=noise)
    found = "gain errors, but the controllers are sampled"
    expected = "continuous controllers: (11) is about their gains"
    remedy = "use --controllers continuous"
    demand(not sampled or perturbation is None, found, "[simulation.perturbation]", expected, remedy)
    found = "a channel, but the controllers are continuous"
    expected = "sampled controllers: they exchange messages"
    demand(sampled or channel.is_ideal, found, "[simulation.channel]", expected, "use --controllers sampled")
    disturbance = disturbance_of(given, N, problem.agent().states, period=period, horizon=horizon, seed=seed)
    if (v := problem.reference) is not None:
        driven = Driven(v.leader, N, problem.agents_B()[v.leader], v.at)
        disturbance = driven if disturbance is None else Sum((disturbance, driven))
    return Scenario(
        problem.initial_states(seed),
        horizon,
        step,
        disturbance,
        perturbation,
        channel,
        changes.method,
        offsets=problem.offsets,
    )


def step_of(problem: Problem, horizon: float = 0.0, *, held: bool = False) -> float:
    """Return the step of a record in s: the period, or equal parts of one that is longer than `FINEST`.

    Over a horizon beyond `LONG`, parts of up to 0.1 / rate will do where all that acts is `held` for a period and the leader
    is told nothing. The rate is the largest spectral radius of |df/dx|, entry by entry, at the initial states and at 0: it
    bounds every |eigenvalue| there, in any units of the states. Runge-Kutta takes four steps to each.
    """
    period, longest = problem.controller.period, FINEST
    if held and horizon > LONG and problem.reference is None:
        longest = max(FINEST, 0.1 / max(rate_of(problem), 0.1 / period))
    return float(period / np.ceil(period / longest - 1e-9))


def rate_of(problem: Problem) -> float:
    """Return how fast an agent moves by itself where a run begins, in 1/s."""
    agent = problem.agent()
    slope = ca.Function("slope", [agent.x, agent.u, agent.t], [ca.jacobian(agent.rhs, agent.x)])
    points = (*problem.initial_states(), np.zeros(agent.n))
    sizes = [np.abs(np.asarray(slope(x, np.zeros(agent.m), 0.0))) for x in points]
    return max(
        (float(np.abs(np.linalg.eigvals(one)).max()) for one in sizes if np.isfinite(one).all()),
        default=np.inf,
    )


def disturbance_of(
    table: DisturbanceTable, N: int, states: Sequence[str], *, period: float, horizon: float, seed: int
) -> Disturbance | None:
    """Return the disturbance of [simulation.disturbance] for N agents with these states.

    The phases of sines are random, and so are the signs of a step whose amplitude is one for all states.
    """
    stop = np.inf if table.stop is None else table.stop
    generator, size = np.random.default_rng(seed), amplitudes(table, N, states, period)
    if table.kind == "noise":
        whole = noise(N, len(states), interval=period, horizon=horizon, seed=seed, sigma=size)
        t = np.arange(len(whole.values)) * period
        whole.values[(t < table.start - 1e-9) | (t >= stop - 1e-9)] = 0.0
        return whole
    if table.kind == "sine":
        phases = generator.uniform(0, 2 * np.pi, size=size.shape)
        return Sines(size, phases, table.frequency, table.start, stop)
    if table.kind == "step":
        signs = 1.0 if isinstance(table.amplitude, dict) else generator.choice([-1.0, 1.0], size=size.shape)
        return Steps(size * signs, table.start, stop)
    found = "the worst disturbance is the result of a search"
    remedy = "use `lockstep simulate --disturbance worst`, or worst_disturbance"
    demand(table.kind != "worst", found, "[simulation.disturbance]", remedy=remedy)
    return None


def _of_kind(table: Kinds, kind: str | None, option: str) -> Kinds:
    """Return a table with the kind that an option names, if it names one."""
    if kind is None:
        return table
    kinds = get_args(type(table).model_fields["kind"].annotation)
    demand(kind in kinds, f"`{kind}`", option, ", ".join(kinds))
    return table.model_copy(update={"kind": kind})


def _perturbation(
    table: PerturbationTable, problem: Problem, seed: int, horizon: float
) -> Perturbation | None:
    if table.kind == "none":
        return None
    agent, N, where = problem.agent(), problem.graph().N, "[simulation.perturbation]"
    if table.kind == "random":
        found = 'kind = "random" without bounds'
        demand(any(problem.fragility.values()), found, where, "[design.fragility] with bounds of (11)")
        interval = np.inf if table.interval is None else table.interval
        sizes = (problem.order, agent.m, agent.q)
        return random_perturbation(N, sizes, problem.fragility, seed, interval=interval, horizon=horizon)
    found = f"controllers of order {problem.order} with {agent.m} outputs"
    expected = "order 2 and one input of the agent: the paper's Delta(t) is for those"
    demand((problem.order, agent.m) == (2, 1), found, where, expected)
    return PaperPerturbation(N, agent.q, scaled=table.kind == "paper_scaled")


def channel_of(table: ChannelTable | None, seed: int) -> MessageChannel:
    """Return the channel of [simulation.channel]."""
    if table is None:
        return MessageChannel()
    return MessageChannel(table.delay, table.drop, seed, table.bits, table.full_scale)
