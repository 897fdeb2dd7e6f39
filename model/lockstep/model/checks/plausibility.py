"""Checks of what is seldom meant: a period too long for the plant, units, degrees, a start outside of the domain.

A rule of thumb for the period T of a sampled controller is 0.2 to 0.6 rad of the fastest oscillation in each period, w T, or
4 to 10 periods in a time constant where nothing oscillates (Astrom and Wittenmark, Computer-Controlled Systems, 3rd ed.,
1997, on the choice of the sampling rate; there of the closed loop, here of the agent by itself). From w T = pi on the samples
cannot show the oscillation at all (Shannon, Communication in the presence of noise, Proceedings of the IRE 37, 1949). None of
this is proved, and nothing rests on it.
"""

import ast
import math
from collections.abc import Iterator

import casadi as ca
import numpy as np
from jaxtyping import Float

from lockstep.check.errors import ProblemError
from lockstep.check.system.loop import Gains
from lockstep.model.agents.agent import Agent
from lockstep.model.agents.state_sizes import middle, state_sizes
from lockstep.model.checks.proved.dimensions import check_units, dimension
from lockstep.model.checks.report import CheckRow
from lockstep.model.graphs.graph import Graph
from lockstep.model.loop_transformation.natural_units import step_response
from lockstep.model.network import Network
from lockstep.model.problem import Problem
from lockstep.model.problem.tables.schema import AgentTable
from lockstep.model.simulation.divergence import Diverged, left_domain
from lockstep.model.simulation.from_problem import rate_of, step_of
from lockstep.model.simulation.run import simulate
from lockstep.model.simulation.scenario import Scenario

LONG = 0.6
"""Rad of the fastest oscillation in a period: the long end of the rule."""

SHORT = 2e-4
"""Of the shortest time constant of an agent that integrates nothing: a period below that is seldom meant. No field or problem
of the benchmark is below 0.003; a mass without a spring has no time of its own."""

FAR = 1e6
"""Sizes of states further apart than this are seldom meant to weigh alike: by time alone, 1e5 rad/s are 1e5 apart."""

MOST_STEPS = 1e5
"""Of a run in which a leader is looked at: a few seconds of work."""

TURN = 2 * math.pi

RADIANS, DEGREES = ("rad", "radian", "radians"), ("deg", "degree", "degrees", "\N{DEGREE SIGN}")

TEMPERATURES = ("K", "kelvin"), ("degC", "celsius", "\N{DEGREE SIGN}C")

_ANGLES = (ca.OP_SIN, ca.OP_COS, ca.OP_TAN)


def period(problem: Problem) -> CheckRow:
    """Hold the period against the fastest mode that is there to be controlled: one that swings or grows."""
    T = problem.controller.period
    reason = "a controller cannot act on what happens between its samples: 0.2 to 0.6 rad a period is the usual range"
    modes = _modes(problem)
    fastest = max((s for s in modes if s.real >= -abs(s.imag)), key=abs, default=0j)
    w, sizes = abs(fastest), [abs(s) for s in modes] or [0.0]
    if min(sizes) > 0 and (quick := max(sizes)) * T < SHORT:
        figure = f"{T:g} s is {quick * T:.2g} of the agent's shortest time constant, {1 / quick:.3g} s: is it in s?"
        return CheckRow("period", "note", figure, reason)
    if w == 0.0:
        said = "the open-loop agent has no oscillatory or unstable mode at the start or in the middle of the domain"
        if (slow := min(sizes)) * T <= 1.0:
            return CheckRow("period", "ok", f"{T:g} s; {said}", reason)
        usual = f"{0.1 / slow:.2g} to {0.25 / slow:.2g} s is usual (Astrom and Wittenmark 1997)"
        moved = f"{T:g} s is {slow * T:.3g} times the longest time constant of the agent by itself, {1 / slow:.3g} s"
        return CheckRow("period", "note", f"{moved}: it has settled between two samples; {usual}", reason)
    of, unit = ("rad", "rad/s") if fastest.imag else ("time constants", "1/s")
    figure = f"{T:g} s is {w * T:.3g} {of} of the agent's fastest mode that swings or grows, {w:.3g} {unit}"
    if w * T <= LONG:
        return CheckRow("period", "ok", figure, reason)
    blind = bool(fastest.imag) and w * T > math.pi
    unseen = ", which the samples cannot show at all (Shannon 1949)" if blind else ": long for that mode"
    usual = f"{0.2 / w:.2g} to {LONG / w:.2g} s is usual (Astrom and Wittenmark 1997)"
    return CheckRow("period", "note", f"{figure}{unseen}; {usual}", reason)


WRONG_SIGN = "; a wrong sign?"


def unstable_alone(problem: Problem) -> Iterator[CheckRow]:
    """Yield a row where an agent by itself moves away: a wrong sign of a damping shows here, and else in no figure."""
    fastest = max((s.real for s in _modes(problem)), default=0.0)
    if fastest > 0:
        reason = "controllers see differences only: what all agents do together stays what each does alone"
        figure = f"unstable in open loop ({fastest:.3g} 1/s): consensus stabilises neither the common motion nor a leader"
        grows = fastest * problem.simulation.horizon > 1  # by e within the run
        yield CheckRow("open-loop agent", "note", figure + WRONG_SIGN * grows, reason)


def _modes(problem: Problem) -> list[complex]:
    """Return the modes of an agent in 1/s, where the run starts and in the middle of the domain.

    One with Re s < -|Im s| (damping above 0.7) dies out by itself, however fast.
    """
    from scipy.linalg import matrix_balance

    agent, found = problem.agent(), list[complex]()
    J = agent.dynamics.factory("J", ["x", "u", "t"], ["jac:dx:x"])
    for x in (middle(agent), *np.clip(problem.initial_states(), agent.box[:, 0], agent.box[:, 1])):
        slopes = np.asarray(J(x, np.zeros(agent.m), 0.0))
        if np.isfinite(slopes).all():
            # A multiple eigenvalue 0 is off by the root of a rounding: no oscillation. What integrates never settles, and
            # what swings without damping does not grow by one.
            # Balanced: beside 3e9 Pa/m a resonance of 46 rad/s is no rounding.
            slopes = matrix_balance(slopes)[0]
            noise = 1e-6 * max(1.0, float(np.abs(slopes).max()))
            poles = np.linalg.eigvals(slopes)
            found += [
                complex(s.real * (abs(s.real) > noise), s.imag) if abs(s) > noise else 0j for s in poles
            ]
    return found


def units(problem: Problem, *, refuse: bool = False) -> Iterator[CheckRow]:
    """Yield a row where [agent.units] contradict the formulas, degrees of what sin, cos or tan is taken of by name, or where
    states count in units far apart.

    Raises:
        ProblemError: where they contradict the formulas, if asked to `refuse` that.
    """
    agent, reason = problem.agent(), "a formula whose units do not fit is seldom the plant"
    in_degrees = [j for j in sorted(angles(agent)) if agent.units.get(agent.states[j]) in DEGREES]
    off = list[tuple[str, str]]()
    try:
        check_units(problem.file.agent)
        off += _not_one(problem.file.agent)
    except ProblemError as error:
        wrong = _degrees(agent.states[in_degrees[0]]) if in_degrees else error
        if refuse:
            raise wrong from None
        yield CheckRow("units", "note", f"{wrong}; `check` and `build` refuse it", reason)
    kelvin, celsius = (
        [x for x, unit in problem.file.agent.units.items() if unit in of] for of in TEMPERATURES
    )
    if kelvin and celsius:
        figure = f"{kelvin[0]} is in K and {celsius[0]} in degC: 0 degC is 273.15 K, but formulas take them as one unit"
        reason = "of a difference of temperatures they are; a temperature that is 273 off is seldom the plant"
        yield CheckRow("units", "note", figure, reason)
    for name, said in off:
        figure = f"{name} = {said}: to convert units it would have to be 1"
        yield CheckRow("units", "note", figure, "a factor of ten between units fits every dimension")
    if factors := ", ".join(f"{one:g}" for one in sorted(_powers_of_ten(problem.file.agent))):
        figure = f"{factors} in the formulas: taken as pure numbers; what converts a unit is checked if it is a parameter"
        hides = "a factor between units that is forgotten, or stands where none is due, hides among numbers"
        yield CheckRow("units", "note", f'{figure} (mm = 1000.0, in "mm/m")', hides)
    sizes = dict(zip(agent.states, state_sizes(agent), strict=True))
    least, most = min(reversed(sizes), key=sizes.__getitem__), max(sizes, key=sizes.__getitem__)
    if sizes[most] > FAR * sizes[least] and problem.design.weights.state == 1.0:
        moved = f"{most} moves by numbers about {sizes[most] / sizes[least]:.0e} times those of {least}"
        figure = f"{moved}: count them in units in which they are alike (mm, bar)"
        yield CheckRow("units", "note", figure, "|x_d|, a radius, and rho without weights add their squares")


def _not_one(table: AgentTable) -> Iterator[tuple[str, str]]:
    """Yield parameters that are powers of ten in a unit such as mm/m, a ratio of one kind, without being the number 1."""
    for name, unit in table.units.items():
        powers, value = dimension(unit, name), table.parameters.get(name, 0.0)
        if "/" in unit and {*powers} == {"10"} and value > 0 and _is_power_of_ten(value):
            number = float(f"{value * 10 ** powers['10']:.6g}")
            if number != 1:
                yield name, f"{value:g} {unit} is {number:g}"


def _is_power_of_ten(value: float) -> bool:
    return f"{value:.9e}".startswith("1.000000000e")


def _powers_of_ten(table: AgentTable) -> set[float]:
    """Return the numbers of the dynamics, and parameters in "1", that look like factors between units, where all have one."""
    if not table.parameters or not table.parameters.keys() <= table.units.keys():
        return set()
    trees = (ast.parse(text.strip(), mode="eval") for text in table.dynamics.values())
    numbers = (node.value for tree in trees for node in ast.walk(tree) if isinstance(node, ast.Constant))
    pure = [value for name, value in table.parameters.items() if table.units[name] == "1"]
    sizes = {float(one) for one in (*numbers, *pure) if isinstance(one, int | float) and one > 0}
    return {one for one in sizes if not 0.02 < one < 50 and _is_power_of_ten(one)}


def _degrees(state: str) -> ProblemError:
    expected, remedy = f"sin, cos and tan of {state} in radians", f"write {state}*pi/180, or give it in rad"
    return ProblemError("degrees", where=f"[agent.units] {state}", expected=expected, remedy=remedy)


def initial_deviations(problem: Problem) -> Float[np.ndarray, "N n"] | None:
    """Return x_i(0) - mean of the initial states that the file names, less offsets; None without such, or beyond doubles."""
    if isinstance(problem.simulation.initial, str) or problem.spectrum:
        return None
    with np.errstate(over="ignore", invalid="ignore"):
        x = problem.initial_states() - (0.0 if problem.offsets is None else problem.offsets)
        away: Float[np.ndarray, "N n"] = x - x.mean(axis=0)
    return away if math.isfinite(math.hypot(*away.ravel())) else None


def initial(problem: Problem) -> Iterator[CheckRow]:
    """Yield a row where [simulation] starts look like degrees, or are outside of the domain that the bound is proved on."""
    agent, starts = problem.agent(), problem.initial_states()
    name, reason = "initial states", "a run from states that were not meant shows nothing of the design"
    drawn = problem.simulation.initial == "random"
    in_radians = {j for j, state in enumerate(agent.states) if agent.units.get(state) in RADIANS}
    for j in sorted(angles(agent) | in_radians):
        i, state = int(np.abs(starts[:, j]).argmax()), agent.states[j]
        value = float(starts[i, j])
        if abs(value) > TURN:
            meant = problem.simulation.spread if drawn else value
            found = f"`spread` is {meant:g}" if drawn else f"{state} of agent {i + 1} is {value:g}"
            why = f"[agent.units] has {state} in rad"
            if j not in in_radians:
                why = f"sin, cos and tan of {state} take radians"
            yield CheckRow(
                name, "note", f"{found}, and {why}: {meant:g} degrees are {math.radians(meant):.4g}", reason
            )
    yield from list(_left_alone(agent, starts, problem.controller.period)) or _leave_together(problem)
    where = np.argwhere((starts < agent.box[:, 0]) | (starts > agent.box[:, 1]))
    if len(where):
        i, j = where[0]
        low, high = agent.box[j]
        found = f"{agent.states[j]} of agent {i + 1} is {starts[i, j]:.4g}, outside of [agent.domain]"
        figure = f"{found}, {low:g} <= {agent.states[j]} <= {high:g}"
        yield CheckRow(
            name, "note", figure, "what is proved on a domain says nothing of a run that starts outside of it"
        )


def _left_alone(agent: Agent, starts: Float[np.ndarray, "N n"], T: float) -> Iterator[CheckRow]:
    """Yield a row where an agent with u = 0, linear about a start in its domain, moves by more than that within a period."""
    f = agent.dynamics.factory("f", ["x", "u", "t"], ["dx", "jac:dx:x"])
    low, high = agent.box.T
    for x in starts[((low <= starts) & (starts <= high)).all(axis=1)]:
        dx, J = (np.asarray(one) for one in f(x, np.zeros(agent.m), 0.0))
        with np.errstate(all="ignore"):
            moved = np.ravel(step_response(T, J, dx))
        for j in np.flatnonzero(np.isfinite(high - low) & (np.abs(moved) > high - low))[:1]:
            figure = f"with u = 0 {agent.states[j]} moves by {moved[j]:.3g} in the first {T:g} s, and [agent.domain] is"
            why = "of agents that leave their domain by themselves nothing is proved"
            figure += f" {high[j] - low[j]:g} wide: is a number of [agent] wrong?"
            yield CheckRow("initial states", "note", figure, why)
            return


def _leave_together(problem: Problem) -> Iterator[CheckRow]:
    """Yield a row where a leader, of which u = 0 unless it has a reference, leaves its domain within the run.

    Without a leader: where one agent with u = 0 does from the mean of the starts. Agents that agree there all do so.
    """
    leads = np.flatnonzero(problem.graph().in_degrees == 0)[:1]
    if problem.spectrum or problem.reference or not np.isfinite(problem.agent().box).any():
        return
    two, t = Network(problem.agent(), Graph.topology("path", 2)), problem.simulation.horizon
    step, rate = step_of(problem, t, held=True), rate_of(problem)
    parts = max(4, math.ceil(min(step * rate, MOST_STEPS)))  # a fast mode that dies out does not diverge
    t = min(t, step * max(1.0, 4 * MOST_STEPS // parts))
    idle = Gains.from_blocks(np.zeros((2, two.agent.m, two.agent.q)), 0)
    start = problem.initial_states()[leads if len(leads) else slice(None)].mean(axis=0, keepdims=True)
    start = np.repeat(start, 2, axis=0)
    try:
        run = simulate(two, idle, Scenario(start, t, step, substeps=parts))
        left = left_domain(run.t, run.x[:, :1], two.agent)
    except Diverged as error:
        left = error.figures["left"] or f"diverges at {error.figures['time']:.4g} s"
    left = left.removeprefix(f"{two.agent.name}1 ")
    if left:
        figure = f"from where all are on average one agent with u = 0 {left}: all that agree do the same"
        if len(leads):
            figure = f"agent {leads[0] + 1} leads and gets no u: by itself it {left}"
        why = "the others go with it; of agents that leave their domain by themselves nothing is proved"
        yield CheckRow("initial states", "note", figure, why)


def angles(agent: Agent) -> set[int]:
    """Return the states of which sin, cos or tan is taken as they are, or of their sums and differences, counted from 0.

    >>> from lockstep.model.agents.agent import Agent
    >>> x, u = ca.SX.sym("x", 3), ca.SX.sym("u")
    >>> sorted(angles(Agent(name="a", x=x, u=u, rhs=ca.vertcat(ca.sin(x[1] - 0.1), ca.cos(3 * x[0]), u), y=x[0])))
    [1]
    """
    found, seen, waiting = set[int](), set[int](), list(ca.vertsplit(agent.rhs))
    while waiting:
        one = waiting.pop()
        if one.element_hash() in seen:
            continue
        seen.add(one.element_hash())
        parts = [one.dep(k) for k in range(one.n_dep())]
        waiting += parts
        if parts and one.op() in _ANGLES:
            slopes = ca.jacobian(parts[0], agent.x)
            if slopes.is_constant():
                found |= {j for j in range(agent.n) if abs(float(slopes[j])) == 1.0}
    return found
