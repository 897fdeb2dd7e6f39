"""Trim points and linearisations of a nonlinear agent and of the closed loop, at a point and along a trajectory.

The derivatives are CasADi's, of the very expressions of the model: at (x*, u*, t*)

    d/dt dx = df/dx dx + df/du du,    dy = C dx.

Along a trajectory that is a system for each instant; between them the model is time-varying.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from jaxtyping import Float

from lockstep.check.errors import ProblemError, demand
from lockstep.check.system.loop import Gains
from lockstep.model.control.bridge import network_to_control
from lockstep.model.control.models import AgentLike, NetworkLike, TrajectoryLike

AT_REST = 1e-9
"""Largest |f| that counts as an equilibrium, relative to the size of its terms' slopes."""


@dataclass(frozen=True, eq=False)
class Trim:
    """x, u: an equilibrium, to rounding;  residual: |f(x, u, t)|;  t: the time."""

    x: Float[np.ndarray, " n"]
    u: Float[np.ndarray, " m"]
    residual: float
    t: float = 0.0


def trim(
    agent: AgentLike,
    *,
    states: Mapping[str, float] | None = None,
    inputs: Mapping[str, float] | None = None,
    start: Sequence[float] | None = None,
    t: float = 0.0,
) -> Trim:
    """Return an equilibrium of an agent, f(x, u, t) = 0, with some states and inputs given.

    Args:
        agent: itself.
        states, inputs: what is given, by name; an input that is not named is found if any state is, else it is 0.
        start: of the search, the states.
        t: the time, in s.

    Raises:
        ProblemError: an unknown name, or no equilibrium near the start.

    >>> from lockstep.model import Agent
    >>> arm = Agent.from_expressions("arm", states=["a", "w"], inputs=["u"], outputs={"y": "a"},
    ...                              dynamics={"a": "w", "w": "u - 9.81*sin(a)"})
    >>> round(float(trim(arm, states={"a": 0.5}).u[0] / np.sin(0.5)), 6)
    9.81
    """
    from scipy.optimize import least_squares

    states, inputs = dict(states or {}), dict(inputs or {})
    for what, given, known in (("states", states, agent.states), ("inputs", inputs, agent.inputs)):
        if unknown := set(given) - set(known):
            raise ProblemError(f"{sorted(unknown)}", where=f"trim, {what}", expected=f"some of {list(known)}")
    point = np.concatenate(
        [np.zeros(agent.n) if start is None else np.asarray(start, dtype=float), np.zeros(agent.m)]
    )
    names = [*agent.states, *agent.inputs]
    held = states | (inputs if states else dict.fromkeys(agent.inputs, 0.0) | inputs)
    free = [k for k, name in enumerate(names) if name not in held]
    for name, value in held.items():
        point[names.index(name)] = value
    f, J = _slopes(agent)

    def at(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        whole = point.copy()
        whole[free] = z
        return whole[: agent.n], whole[agent.n :]

    if free:
        found = least_squares(
            lambda z: _dense(f(*at(z), t)).ravel(),
            point[free],
            jac=lambda z: np.hstack([_dense(part) for part in J(*at(z), t)])[:, free],
            method="trf",
            xtol=1e-15,
            ftol=1e-15,
            gtol=1e-15,
        ).x
        point[free] = found
    x, u = at(point[free])
    residual = float(np.linalg.norm(_dense(f(x, u, t))))
    slopes = np.hstack([_dense(part) for part in J(x, u, t)])
    if not residual <= AT_REST * max(1.0, float(np.linalg.norm(slopes * np.abs(point)))):
        raise ProblemError(
            f"|f| is {residual:.3g} at best",
            where="trim",
            expected="an equilibrium with what is given",
            remedy="give other states or inputs, or a `start` nearer to one",
        )
    return Trim(x, u, residual, t)


def linearised_agent(agent: AgentLike, x: Sequence[float], u: Sequence[float], t: float = 0.0) -> Any:
    """Return an agent linearised at a point as a `control.ss`, with the model's names.

    Args:
        agent: itself.
        x: (n,);  u: (m,);  t: in s.

    Raises:
        ProblemError: a point of another size, or one without finite slopes.
    """
    import control

    at, given = np.asarray(x, dtype=float), np.asarray(u, dtype=float)
    found = f"{at.size} states and {given.size} inputs"
    expected = f"{agent.n} and {agent.m}"
    demand(at.shape == (agent.n,) and given.shape == (agent.m,), found, "linearisation", expected)
    A, B = (_dense(part) for part in _slopes(agent)[1](at, given, t))
    _finite(A, B)
    names = {"states": list(agent.states), "inputs": list(agent.inputs), "outputs": list(agent.outputs)}
    return control.ss(A, B, agent.lure.C, np.zeros((agent.q, agent.m)), name=agent.name, **names)


def linearised_loop(
    network: NetworkLike,
    gains: Gains,
    x: Float[np.ndarray, "N n"],
    x_C: Float[np.ndarray, "N n_C"] | None = None,
    t: float = 0.0,
) -> Any:
    """Return the closed loop (12) linearised at states of all agents, with the names of `network_to_control`.

    Args:
        network, gains: the loop, continuous.
        x: the agents' states;  x_C: the controllers', 0 by default;  t: in s.

    Raises:
        ProblemError: states of another shape, or a point without finite slopes.
    """
    return _loop_system(network, gains, network_to_control(network, gains))(x, x_C, t)


def linearised_along(
    network: NetworkLike, gains: Gains, trajectory: TrajectoryLike, *, every: int = 1
) -> tuple[Float[np.ndarray, " K"], list[Any]]:
    """Return instants of a trajectory and the closed loop linearised at each.

    Args:
        network, gains: the loop, continuous.
        trajectory: of it.
        every: how many instants apart.
    """
    system = _loop_system(network, gains, network_to_control(network, gains))
    chosen = range(0, len(trajectory.t), every)
    return trajectory.t[::every], [
        system(trajectory.x[k], trajectory.x_C[k], float(trajectory.t[k])) for k in chosen
    ]


def _loop_system(network: NetworkLike, gains: Gains, named: Any) -> Any:
    import control

    f = network.closed_loop(gains)
    sizes = [f.size1_in(k) for k in range(4)]
    x, x_C, t, xi = (ca.SX.sym(name, size) for name, size in zip(("x", "x_C", "t", "xi"), sizes, strict=True))
    dx, dx_C, u = f(x, x_C, t, xi)
    state, y = ca.vertcat(x, x_C), ca.mtimes(ca.DM(np.kron(np.eye(network.N), network.agent.lure.C)), x)
    move, seen = ca.vertcat(dx, dx_C), ca.vertcat(x, y, u)
    slopes = ca.Function(
        "slopes", [x, x_C, t, xi], [ca.jacobian(move, state), ca.jacobian(move, xi), ca.jacobian(seen, state)]
    )

    def system(at: np.ndarray, memory: np.ndarray | None, time: float) -> Any:
        at, memory = np.ravel(at), np.zeros(sizes[1]) if memory is None else np.ravel(memory)
        if (at.size, memory.size) != (sizes[0], sizes[1]):
            raise ProblemError(
                f"{at.size} and {memory.size} states",
                where="linearisation",
                expected=f"{sizes[0]} and {sizes[1]}",
            )
        A, B, C = (_dense(part) for part in slopes(at, memory, time, np.zeros(sizes[3])))
        _finite(A, B)
        names = {"inputs": named.input_labels, "outputs": named.output_labels, "states": named.state_labels}
        return control.ss(A, B, C, np.zeros((len(C), B.shape[1])), name=named.name, **names)

    return system


def _slopes(agent: AgentLike) -> tuple[ca.Function, ca.Function]:
    """Return f and its derivatives in x and u."""
    symbols = [agent.x, agent.u, agent.t]
    slopes = [ca.jacobian(agent.rhs, agent.x), ca.jacobian(agent.rhs, agent.u)]
    return ca.Function("f", symbols, [agent.rhs]), ca.Function("slopes", symbols, slopes)


def _dense(value: Any) -> np.ndarray:
    return np.asarray(ca.DM(value).full(), dtype=float)


def _finite(*matrices: np.ndarray) -> None:
    if not all(np.isfinite(matrix).all() for matrix in matrices):
        raise ProblemError(
            "a slope that is not finite", where="linearisation", expected="a point where f is smooth"
        )
