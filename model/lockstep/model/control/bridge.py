"""Agents, networks and controllers as python-control systems.

States, inputs, outputs and systems carry the model's names; signal `s` of agent i is `<agent><i>_<s>`, so
that `control.interconnect([network, *controllers])` joins a network and its controllers by their names. What
a controller hears is `<agent><i>_r_<output>`, r_i = sum_j l_ij y_j; a disturbance is `<agent><i>_xi_<state>`.
In disagreement coordinates `d<k>` takes the place of `<agent><i>`.

python-control is imported when it is used: that takes seconds.
"""

from collections.abc import Sequence
from typing import Any, Literal

import casadi as ca
import numpy as np
from jaxtyping import Float

from lockstep.check.errors import ProblemError, demand
from lockstep.check.numbers import as_floats
from lockstep.check.system.loop import Gains
from lockstep.model.control.models import AgentLike, NetworkLike
from lockstep.model.graphs.orthonormal import orthonormal_factor

System = Any
"""A `control.StateSpace` or `control.NonlinearIOSystem`; python-control has no types of its own to check."""

Method = Literal["tustin", "zoh"]


def agent_to_control(agent: AgentLike, *, linear: bool = False) -> System:
    """Return x' = f(x, u, t), y = C x as a `control.nlsys`, or (A, B, C, 0) as a `control.ss`.

    With `centre` the linear part holds the middle of the nonlinearity's slopes.
    """
    import control

    names = {
        "name": agent.name,
        "states": list(agent.states),
        "inputs": list(agent.inputs),
        "outputs": list(agent.outputs),
    }
    lure, f = agent.lure, agent.dynamics
    if linear:
        return control.ss(lure.A, lure.B, lure.C, np.zeros((agent.q, agent.m)), **names)
    return control.nlsys(lambda t, x, u, _: _vector(f(x, u, t)), lambda _t, x, _u, _p: lure.C @ x, **names)


def network_to_control(
    network: NetworkLike, gains: Gains | None = None, *, linear: bool = False, period: float | None = None
) -> System:
    """Return a network as one system.

    Args:
        network: the agents on their graph.
        gains: the controllers (9) to close it with. Without them the inputs are the u_i, then the xi_i, and
            the outputs the y_i, then the relative outputs r_i. With them: inputs xi_i, outputs x_i, y_i, u_i.
        linear: leave phi and the offset out. With gains this gives (15) in disagreement coordinates,
            orthonormal ones unless the network's are the rows of L: inputs xi_d and w_d, which takes the
            place of phi_d, and outputs x_d, v_d = (I (x) H) x_d and u; G and H as in `network.plant`.
        period: in s: the linear part without gains, its inputs held, exactly discretised, for `control.interconnect`
            with sampled controllers.

    Raises:
        ProblemError: a period and gains: `lockstep.model.control.ports` has the sampled loop.
    """
    if period is not None:
        found = "a period and gains"
        expected = "a period for the network without controllers"
        remedy = "PortedLoop(network, controllers, period) is the sampled loop"
        demand(gains is None, found, "network_to_control", expected, remedy)
        return _held(_open_linear(network), period)
    if gains is None:
        return _open_linear(network) if linear else _open(network)
    return _reduced(network, gains) if linear else _closed(network, gains)


def controllers_to_control(
    agent: AgentLike, gains: Gains, *, period: float | None = None, method: Method | None = None
) -> list[System]:
    """Return the controllers (9) as one `control.ss` per agent, from r_i to u_i.

    Args:
        agent: gives the names of the signals.
        gains: continuous gains; those of sampled controllers if `period` is given and `method` is not.
        period: the dt of sampled controllers, in s.
        method: sample continuous gains with this method, by python-control.

    Raises:
        ProblemError: gains that do not fit the agent, or a method without a period.
    """
    found = f"`D` is {gains.D[0].shape[0]} x {gains.D[0].shape[1]}"
    expected = f"{agent.m} x {agent.q}, inputs by outputs of the agent"
    demand(gains.D[0].shape == (agent.m, agent.q), found, "gains", expected)
    if method is not None and period is None:
        raise ProblemError(f"method {method} without a period", where="controllers_to_control")
    found, expected = f"a period of {period} s", "above 0"
    demand(period is None or 0 < period < np.inf, found, "controllers_to_control", expected)
    return [_controller(agent, gains, i, period, method) for i in range(gains.N)]


def _controller(
    agent: AgentLike, gains: Gains, i: int, period: float | None, method: Method | None
) -> System:
    import control

    blocks = (gains.A[i], gains.B[i], gains.C[i], gains.D[i])
    names = {
        "name": f"{agent.name}{i + 1}_controller",
        "states": _controller_states(agent, gains.order, i),
        "inputs": _signals(agent, i, agent.outputs, "r_"),
        "outputs": _signals(agent, i, agent.inputs),
    }
    if period is None:
        return control.ss(*blocks, **names)
    if method is None or gains.order == 0:
        return control.ss(*blocks, period, **names)
    sampled = control.sample_system(
        control.ss(*blocks), period, method="bilinear" if method == "tustin" else method
    )
    return control.ss(sampled.A, sampled.B, sampled.C, sampled.D, period, **names)


def _open(network: NetworkLike) -> System:
    import control

    f, C, names = network.agents_alone(), _output_map(network), _open_names(network.agent, network.N)
    return control.nlsys(lambda t, x, u, _: _vector(f(x, t, u)), lambda _t, x, _u, _p: C @ x, **names)


def _open_linear(network: NetworkLike) -> System:
    import control
    from scipy.linalg import block_diag

    N, lure = network.N, network.agent.lure
    A, C = np.kron(np.eye(N), lure.A), _output_map(network)
    B = np.hstack([block_diag(*network.B), np.eye(A.shape[0])])
    return control.ss(A, B, C, np.zeros((C.shape[0], B.shape[1])), **_open_names(network.agent, N))


def _held(system: System, period: float) -> System:
    """Return a linear system with its inputs held, at the instants."""
    import control

    held = control.sample_system(system, period, method="zoh")
    names = {"inputs": system.input_labels, "outputs": system.output_labels, "states": system.state_labels}
    return control.ss(held.A, held.B, held.C, held.D, period, name=system.name, **names)


def _output_map(network: NetworkLike) -> Float[np.ndarray, "outputs states"]:
    """Return [I (x) C; L (x) C], from the states to y and r."""
    C = network.agent.lure.C
    return np.vstack([np.kron(np.eye(network.N), C), np.kron(network.graph.laplacian, C)])


def _closed(network: NetworkLike, gains: Gains) -> System:
    import control

    agent, N = network.agent, network.N
    f, split = network.closed_loop(gains), N * agent.n
    C, rest = np.kron(np.eye(N), agent.lure.C), np.zeros(split)

    def update(t: float, x: np.ndarray, xi: np.ndarray, _: Any) -> np.ndarray:
        dx, dx_C, _u = f(x[:split], x[split:], t, xi)
        return np.concatenate([_vector(dx), _vector(dx_C)])

    def output(t: float, x: np.ndarray, _xi: np.ndarray, _: Any) -> np.ndarray:
        u = f(x[:split], x[split:], t, rest)[2]
        return np.concatenate([x[:split], C @ x[:split], _vector(u)])

    states = _all(agent, N, agent.states)
    return control.nlsys(
        update,
        output,
        name=f"{agent.name}_network",
        states=states + [s for i in range(N) for s in _controller_states(agent, gains.order, i)],
        inputs=_all(agent, N, agent.states, "xi_"),
        outputs=states + _all(agent, N, _outputs_beside_states(agent)) + _all(agent, N, agent.inputs),
    )


def _reduced(network: NetworkLike, gains: Gains) -> System:
    """(15) with z = F x_d, F'F = S: then z' z is the squared disagreement, and E, E (I (x) G) keep their form."""
    import control
    from scipy.linalg import block_diag

    agent, loop = network.agent, network.loop(gains.order)
    n, N, order = agent.n, network.N, gains.order
    F, kept = np.kron(orthonormal_factor(loop.d), np.eye(n)), np.eye(N * order)
    to_z, back = block_diag(F, kept), block_diag(np.linalg.inv(F), kept)
    H = np.kron(np.eye(N - 1), network.plant.H)
    v_d = np.hstack([H, np.zeros((H.shape[0], N * order))])
    x_d = np.eye(n * (N - 1), loop.n_x)
    u = np.vstack([(gains.blocks[i] @ as_floats(loop.Y[i]))[order:] for i in range(N)]) @ back
    r, v = network.plant.G.shape[1], network.plant.H.shape[0]
    B = np.hstack([as_floats(loop.E), as_floats(loop.E @ np.kron(np.eye(N - 1), network.plant.G))])
    C = np.vstack([x_d, v_d, u])
    disagreements = [f"d{k}_{s}" for k in range(1, N) for s in agent.states]
    return control.ss(
        to_z @ as_floats(loop.A_cl(gains.blocks)) @ back,
        B,
        C,
        np.zeros((C.shape[0], B.shape[1])),
        name=f"{agent.name}_disagreement",
        states=disagreements + [s for i in range(N) for s in _controller_states(agent, order, i)],
        inputs=[f"d{k}_xi_{s}" for k in range(1, N) for s in agent.states] + _numbered("w", N, r),
        outputs=disagreements + _numbered("v", N, v) + _all(agent, N, agent.inputs),
    )


def _open_names(agent: AgentLike, N: int) -> dict[str, Any]:
    return {
        "name": f"{agent.name}_network",
        "states": _all(agent, N, agent.states),
        "inputs": _all(agent, N, agent.inputs) + _all(agent, N, agent.states, "xi_"),
        "outputs": _all(agent, N, agent.outputs) + _all(agent, N, agent.outputs, "r_"),
    }


def _signals(agent: AgentLike, i: int, names: Sequence[str], prefix: str = "") -> list[str]:
    return [f"{agent.name}{i + 1}_{prefix}{name}" for name in names]


def _all(agent: AgentLike, N: int, names: Sequence[str], prefix: str = "") -> list[str]:
    return [signal for i in range(N) for signal in _signals(agent, i, names, prefix)]


def _controller_states(agent: AgentLike, order: int, i: int) -> list[str]:
    return _signals(agent, i, [f"controller_x{k + 1}" for k in range(order)])


def _numbered(letter: str, N: int, size: int) -> list[str]:
    return [f"d{k}_{letter}{j + 1}" for k in range(1, N) for j in range(size)]


def _outputs_beside_states(agent: AgentLike) -> list[str]:
    """Return the outputs' names; one that is a state's name too gets `y_` in front."""
    return [f"y_{name}" if name in agent.states else name for name in agent.outputs]


def _vector(value: ca.DM) -> Float[np.ndarray, " n"]:
    return np.asarray(value, dtype=float).ravel()
