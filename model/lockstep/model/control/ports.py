"""The loop of a network with places where it can be opened: each input, each relative output, each link.

In disagreement coordinates z = (T (x) I) x, T T' = I, T 1 = 0, the linear part of (12) is

    z' = (I (x) A) z + (T (x) I) diag(B_i) (u + e_u) + xi_d + (I (x) G) w_d,
    d_ij = a_ij (y_i - y_j),    r_i = sum_j d_ij,    controller i: r_i + e_r,i + sum_j e_ij -> u_i,

continuous, or with sampled controllers and u held. The e are what is injected: if H is the closed loop from e to the
signal it is added to, S = I + H is the sensitivity there, T = -H, and L = S^-1 - I the loop opened there (negative feedback:
`control.feedback(L, I)` closes it). A link is opened in the difference d_ij, which is zero in agreement: the common motion
stays as it is.

Signals: `<agent><i>_<input>`, `<agent><i>_r_<output>`, `<agent><i>_from_<agent><j>_<output>`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from lockstep.check.errors import ProblemError, demand
from lockstep.check.numbers import as_floats
from lockstep.check.sampled.controller import HeldController
from lockstep.check.system.loop import Gains
from lockstep.model.control.hybrid import Hybrid
from lockstep.model.control.models import NetworkLike
from lockstep.model.control.wiring import joined_systems
from lockstep.model.graphs.orthonormal import orthonormal_factor

INJECTED = "_e"
"""Ends the name of what is added to a signal."""


@dataclass(frozen=True, eq=False)
class PortedLoop:
    """The linear part of a network's closed loop, to be opened.

    Args:
        network: the agents on their graph.
        controllers: gains (9), continuous; or the controllers as they are computed, sampled.
        period: of sampled controllers, in s.
        delay: periods between sampling y and applying u: 0 or 1.
    """

    network: NetworkLike
    controllers: Gains | Sequence[HeldController]
    period: float | None = None
    delay: int = 0

    def __post_init__(self) -> None:
        found = "sampled controllers without a period, or gains with one"
        expected = "gains alone, or sampled controllers with their period in s"
        demand(isinstance(self.controllers, Gains) == (self.period is None), found, "loop", expected)

    @cached_property
    def parts(self) -> tuple[Any, ...]:
        """The agents in disagreement coordinates, then the controllers, as `control.ss` that join by name."""
        return (self._plant(), *(self._controller(i) for i in range(self.network.N)))

    @property
    def disturbances(self) -> list[str]:
        """The names of xi_d and w_d."""
        return [name for name in self.parts[0].input_labels if name.startswith("d")][: self._n_d + self._n_w]

    @property
    def outputs(self) -> list[str]:
        """The names of x_d, v_d and u."""
        plant = self.parts[0].output_labels[: self._n_d + (self.network.N - 1) * len(self.network.plant.H)]
        return [*plant, *(name for part in self.parts[1:] for name in part.output_labels)]

    @property
    def _n_d(self) -> int:
        return (self.network.N - 1) * self.network.agent.n

    @property
    def _n_w(self) -> int:
        return (self.network.N - 1) * int(self.network.plant.G.shape[1])

    def inputs_of(self, agent: int | None = None) -> list[str]:
        """Return the inputs of one agent, from 1, or of all."""
        return [f"{who}_{u}" for who in self._agents(agent) for u in self.network.agent.inputs]

    def relative_outputs_of(self, agent: int | None = None) -> list[str]:
        """Return the relative outputs r_i of one agent, from 1, or of all."""
        return [f"{who}_r_{y}" for who in self._agents(agent) for y in self.network.agent.outputs]

    def link(self, listener: int, source: int) -> list[str]:
        """Return the signals of one link, agents counted from 1.

        Raises:
            ProblemError: no such link.
        """
        (to,), (of,) = self._agents(listener), self._agents(source)
        if source - 1 not in self._heard[listener - 1][0]:
            links = [(i + 1, j + 1) for i, (heard, _) in enumerate(self._heard) for j in heard]
            raise ProblemError(
                f"the link {listener}, {source}", where="loop", expected=f"listener, source among {links}"
            )
        return [f"{to}_from_{of}_{y}" for y in self.network.agent.outputs]

    def links(self) -> list[str]:
        """Return the signals of all links."""
        pairs = [(i, j) for i, (heard, _) in enumerate(self._heard) for j in heard]
        return [name for i, j in pairs for name in self.link(i + 1, j + 1)]

    def transfer(self, inputs: Sequence[str], outputs: Sequence[str]) -> Any:
        """Return the closed loop from some inputs (disturbances, injected signals) to any signals, as a `control.ss`."""
        import control

        if self.period is not None:
            return Hybrid(self.parts, inputs, outputs).sample(name="loop")
        whole = joined_systems(self.parts)
        for what, named, known in (("inputs", inputs, whole.inputs), ("outputs", outputs, whole.outputs)):
            if unknown := [name for name in named if name not in known]:
                raise ProblemError(f"{unknown}", where=f"loop, {what}", expected=f"some of {known}")
        columns, rows = [whole.inputs.index(s) for s in inputs], [whole.outputs.index(s) for s in outputs]
        return control.ss(
            whole.A,
            whole.B[:, columns],
            whole.C[rows],
            whole.D[np.ix_(rows, columns)],
            name="loop",
            inputs=list(inputs),
            outputs=list(outputs),
            states=whole.states,
        )

    def closed(self) -> Any:
        """Return the loop from xi_d and w_d to x_d, v_d and u, with the dt of sampled controllers."""
        return self.transfer(self.disturbances, self.outputs)

    def hybrid(self, inputs: Sequence[str] = (), outputs: Sequence[str] = ()) -> Hybrid:
        """Return the loop with continuous agents and sampled controllers, for what happens between the samples.

        Raises:
            ProblemError: continuous controllers.
        """
        return Hybrid(self.parts, inputs or self.disturbances, outputs or self.outputs)

    def complementary(self, signals: Sequence[str] | str) -> Any:
        """Return T where these signals are opened: minus the closed loop from what is injected to the signal."""
        return _negative(self._injected(signals))

    def sensitivity(self, signals: Sequence[str] | str) -> Any:
        """Return S = I - T where these signals are opened."""
        H = self._injected(signals)
        return _like(H, H.A, H.B, H.C, H.D + np.eye(len(H.D)))

    def opened(self, signals: Sequence[str] | str) -> Any:
        """Return the loop opened at these signals at once, L = S^-1 - I, everything else closed.

        Raises:
            ProblemError: a signal that is none, or that feeds through to itself and cannot be opened.
        """
        H = self._injected(signals)
        through = np.eye(len(H.D)) + H.D
        if np.linalg.cond(through) > 1e12:
            raise ProblemError(
                f"{H.output_labels} cannot be opened", where="loop", expected="I + D invertible"
            )
        R = np.linalg.inv(through)
        # e = s_in - s_out, where s_in is what the rest of the loop gets: H from e becomes -L from s_in.
        return _like(H, H.A - H.B @ R @ H.C, H.B @ R, -R @ H.C, -R @ H.D)

    def _injected(self, signals: Sequence[str] | str) -> Any:
        """Return H, from what is added to signals to the signals."""
        names = [signals] if isinstance(signals, str) else list(signals)
        known = [*self.inputs_of(), *self.relative_outputs_of(), *self.links()]
        if not names or len({*names}) < len(names) or not {*names} <= {*known}:
            raise ProblemError(
                f"{names}", where="loop, signals", expected=f"one or more, each once, of {known}"
            )
        return self.transfer([f"{s}{INJECTED}" for s in names], names)

    def gang_of_four(self, agent: int) -> dict[str, Any]:
        """Return S, T, PS and CS at the inputs of one agent, from 1: P is what its controller C = -K sees.

        S = (I + C P)^-1, T = C P S (inputs x inputs), PS (relative outputs x inputs), CS (inputs x relative outputs).
        """
        u, r = self.inputs_of(agent), self.relative_outputs_of(agent)
        into_r = self.transfer([f"{s}{INJECTED}" for s in r], u)
        return {
            "S": self.sensitivity(u),
            "T": self.complementary(u),
            "PS": self.transfer([f"{s}{INJECTED}" for s in u], r),
            "CS": _negative(into_r),
        }

    def _agents(self, agent: int | None) -> list[str]:
        if agent is not None and not 1 <= agent <= self.network.N:
            raise ProblemError(f"agent {agent}", where="loop", expected=f"1 to {self.network.N}")
        numbers = range(1, self.network.N + 1) if agent is None else (agent,)
        return [f"{self.network.agent.name}{i}" for i in numbers]

    @cached_property
    def _heard(self) -> list[tuple[tuple[int, ...], np.ndarray]]:
        """Of each agent: whom it hears, from 0, and the weights."""
        if not isinstance(self.controllers, Gains):
            return [(one.sources, np.asarray(one.weights, dtype=float)) for one in self.controllers]
        rows = np.asarray(self.network.graph.adjacency, dtype=float)
        return [(tuple(int(j) for j in np.flatnonzero(row)), row[np.flatnonzero(row)]) for row in rows]

    def _plant(self) -> Any:
        import control
        from scipy.linalg import block_diag

        network, agent, N = self.network, self.network.agent, self.network.N
        loop, one = network.loop(0), network.plant
        T = orthonormal_factor(loop.d) @ as_floats(loop.d.T)
        across = np.kron(T.T, agent.lure.C)
        y = [across[i * agent.q : (i + 1) * agent.q] for i in range(N)]
        I = np.eye(N - 1)
        B_u = np.kron(T, np.eye(agent.n)) @ block_diag(*network.B)
        B = np.hstack([B_u, B_u, np.eye(self._n_d), np.kron(I, one.G)])
        d = [[a * (y[i] - y[j]) for j, a in zip(*heard, strict=True)] for i, heard in enumerate(self._heard)]
        none = np.zeros((agent.q, self._n_d))
        r = [sum(rows, start=none) for rows in d]
        C = np.vstack([np.eye(self._n_d), np.kron(I, one.H), *(row for rows in d for row in rows), *r])
        u, names = self.inputs_of(), [f"d{k}_{s}" for k in range(1, N) for s in agent.states]
        return control.ss(
            np.kron(I, agent.lure.A),
            B,
            C,
            np.zeros((C.shape[0], B.shape[1])),
            name=f"{agent.name}_disagreement",
            states=names,
            inputs=[
                *u,
                *(f"{s}{INJECTED}" for s in u),
                *(f"d{k}_xi_{s}" for k in range(1, N) for s in agent.states),
                *_numbered("w", N, one.G.shape[1]),
            ],
            outputs=[*names, *_numbered("v", N, one.H.shape[0]), *self.links(), *self.relative_outputs_of()],
        )

    def _controller(self, i: int) -> Any:
        import control

        gains, who = self.controllers, self._agents(i + 1)[0]
        if isinstance(gains, Gains):
            A, B, C, D = gains.A[i], gains.B[i], gains.C[i], gains.D[i]
        else:
            n, table = gains[i].order, np.asarray(gains[i].table, dtype=float)
            A, B, C, D = table[:n, :n], table[:n, n:], table[n:, :n], table[n:, n:]
        order, m, q = len(A), self.network.agent.m, self.network.agent.q
        states = [f"{who}_controller_x{k + 1}" for k in range(order)]
        if self.delay:
            A = np.block([[A, np.zeros((order, m))], [C, np.zeros((m, m))]])
            B, C, D = np.vstack([B, D]), np.hstack([np.zeros((m, order)), np.eye(m)]), np.zeros((m, q))
            states += [f"{name}_next" for name in self.inputs_of(i + 1)]
        links = [name for j in self._heard[i][0] for name in self.link(i + 1, j + 1)]
        ways = [
            *links,
            *(f"{s}{INJECTED}" for s in links),
            *(f"{s}{INJECTED}" for s in self.relative_outputs_of(i + 1)),
        ]
        spread = np.kron(np.ones((1, len(ways) // q)), np.eye(q))
        return control.ss(
            A,
            B @ spread,
            C,
            D @ spread,
            *([] if self.period is None else [self.period]),
            name=f"{who}_controller",
            states=states,
            inputs=ways,
            outputs=self.inputs_of(i + 1),
        )


def _numbered(letter: str, N: int, size: int) -> list[str]:
    return [f"d{k}_{letter}{j + 1}" for k in range(1, N) for j in range(size)]


def _like(system: Any, A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray) -> Any:
    import control

    names = {"inputs": system.output_labels, "outputs": system.output_labels, "states": system.state_labels}
    return control.ss(A, B, C, D, system.dt, name="loop", **names)


def _negative(system: Any) -> Any:
    """Return minus a system, its names kept."""
    import control

    names = {"inputs": system.input_labels, "outputs": system.output_labels, "states": system.state_labels}
    return control.ss(system.A, system.B, -system.C, -system.D, system.dt, name="loop", **names)
