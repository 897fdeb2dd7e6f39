"""The sampled loop in disagreement coordinates, with every way in for an error of the arithmetic or of the messages.

State x_cl = (x_d, x_C) at the sampling instants, and with a delay of one period the inputs u computed last. All
matrices act on z = (x_cl, e): the state, then the errors

    e_j = Delta_j Y_j z,  |Delta_j| <= delta_j    of the coefficients A, B, C, D of each agent: rounding, in the units
                                                  D_r, D_c of `controller`: D_rj e_j enters, D_cj is part of Y_j;
    zeta_i                                        of the differences d_ij = a_ij (y_i - y_j), from the messages;
    mu_i                                          added to (x_C+, u) of agent i, from underflow, or in counts of integers;
    nu_d                                          the disagreement of the outputs' own noise, where rho is a gain from it.

    d_i = differences + zeta_i,
    x_C+ = A x_C + B sum_j d_ij + D_rA e_A + D_rB e_B + mu,   u = C x_C + D sum_j d_ij + D_rC e_C + D_rD e_D + mu.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import Annotated, Any, NamedTuple

import numpy as np

from lockstep.check.continuous.inequality import LETTERS
from lockstep.check.errors import demand
from lockstep.check.numbers import Matrix, converter, eye, is_exact, zeros
from lockstep.check.sampled.controller import HeldController, SampledNetwork

NO_NOISE = np.zeros(0)


class Way(NamedTuple):
    """One way in for a coefficient error: z holds e = Delta Y z at `place`, with |Delta| <= delta."""

    agent: int
    letter: str
    place: slice
    Y: Matrix
    delta: float


def way_of(controller: HeldController, agent: int, letter: str, place: slice, seen: Matrix) -> Way:
    """Return the way of one letter's errors, given what its coefficients act on: once for each d_j."""
    bound = controller.errors[letter]
    units = converter(is_exact(seen))(np.resize(bound.columns, len(seen)))[:, None]
    return Way(agent, letter, place, units * seen, bound.delta)


@dataclass(frozen=True, eq=False)
class SampledLoop:
    """Matrices on z = (x_cl, e).

    controllers: one per agent, or the one of a mode, with the coefficients of the code, which the loop is assembled from;
    n_d: length of x_d;  n_x: length of x_cl;  into: (n, k), through which the inputs reach one agent;  held: what u_d
    of all copies is during the next period;  advanced: the rest of x_cl after it;  ways: the coefficient errors;
    seen: (x_C, r) of each agent;  messages: the columns of zeta;  underflows: those of mu, next to them;  outputs: those of
    nu_d;  applied, computed: (N m, n_z), what the inputs are during the next period, and what the controllers compute;
    differences: the d_ij of all agents, one below the other.
    """

    network: SampledNetwork
    controllers: tuple[HeldController, ...]
    n_d: int
    n_x: int
    into: Matrix
    held: Matrix
    advanced: Matrix
    ways: tuple[Way, ...]
    seen: tuple[Matrix, ...]
    messages: slice
    underflows: slice
    outputs: slice
    applied: Matrix
    computed: Matrix
    differences: Matrix

    @property
    def n_z(self) -> int:
        """Length of z."""
        return int(self.held.shape[1])

    @property
    def start(self) -> Matrix:
        """a = (x_d, u_d) at the start of a period."""
        x_d = zeros(self.n_d, self.n_z, self.held)
        x_d[:, : self.n_d] = np.eye(self.n_d, dtype=int)
        return np.vstack([x_d, self.held])


def sampled_loop(
    network: SampledNetwork,
    controllers: tuple[HeldController, ...],
    noise: Annotated[np.ndarray, " q"] = NO_NOISE,
) -> SampledLoop:
    """Assemble the loop in the kind of number of the network's plant.

    Args:
        network: agents, coordinates, period and delay.
        controllers: one per agent.
        noise: the scale of each output's own noise; none where nothing asks for it.

    Raises:
        ProblemError: controllers that do not fit the agents or each other.
    """
    _check(network, controllers)
    layout = _Layout(network, controllers, noise)
    rows = [layout.agent_rows(i) for i in range(len(controllers))]
    n_C = controllers[0].order
    states = np.vstack([row[:n_C] for row in rows])
    u = np.vstack([row[n_C:] for row in rows])
    into, spread = inputs_of(network)
    applied, at = layout.at.rows("last") if network.delay else u, layout.at.of
    return SampledLoop(
        network,
        controllers,
        at["x_d"].stop,
        at["last"].stop,
        into,
        spread @ applied,
        np.vstack([states, u]) if network.delay else states,
        layout.ways(),
        tuple(layout.received(i) for i in range(len(controllers))),
        layout.at.span("zeta", len(controllers)),
        layout.at.span("mu", len(controllers)),
        at["nu"],
        applied,
        u,
        np.vstack([layout.differences(i) for i in range(len(controllers))]),
    )


class Columns:
    """Where the parts of z are, by name."""

    def __init__(self, widths: Mapping[Any, int], like: Matrix) -> None:
        ends = [0, *accumulate(widths.values())]
        self.of = {name: slice(*pair) for name, pair in zip(widths, pairwise(ends), strict=True)}
        self.width, self.like = ends[-1], like

    def rows(self, name: Any) -> Matrix:
        """Return the rows that take a part out of z."""
        place = self.of[name]
        rows = zeros(place.stop - place.start, self.width, self.like)
        rows[:, place] = np.eye(len(rows), dtype=int)
        return rows

    def span(self, name: str, agents: int) -> slice:
        """Return the columns of a part that each agent has."""
        return slice(self.of[0, name].start, self.of[agents - 1, name].stop)


def step_rows(
    controller: HeldController, received: Matrix, mu: Matrix, errors: Mapping[str, Matrix]
) -> Matrix:
    """Return (x_C+, u) of a controller that is given (x_C, r); errors: the rows of e of each letter that has some."""
    number, n_C = converter(is_exact(received)), controller.order
    rows: Matrix = number(controller.table) @ received + mu
    for letter, e in errors.items():
        part = slice(0, n_C) if letter in "AB" else slice(n_C, None)
        rows[part] = rows[part] + number(controller.errors[letter].rows)[:, None] * e
    return rows


class _Layout:
    """Where the parts of z are, and what agent i computes from them."""

    def __init__(
        self,
        network: SampledNetwork,
        controllers: tuple[HeldController, ...],
        noise: Annotated[np.ndarray, " q"],
    ) -> None:
        self.network, self.controllers = network, controllers
        self.number = converter(is_exact(network.plant.A))
        n, m, self.q, _, _ = network.plant.sizes
        agents, n_C, noisy = range(len(controllers)), controllers[0].order, np.flatnonzero(noise)
        self.letters = [[k for k in LETTERS if one.deltas[k] > 0] for one in controllers]
        self.scales = self.number(np.diag(noise)[:, noisy])
        widths: dict[Any, int] = {"x_d": n * (network.d.N - 1)} | {(i, "x_C"): n_C for i in agents}
        widths["last"] = m * len(controllers) if network.delay else 0
        widths |= {(i, k): n_C if k in "AB" else m for i in agents for k in self.letters[i]}
        widths |= {(i, "zeta"): self.q * len(controllers[i].sources) for i in agents}
        widths |= {(i, "mu"): n_C + m for i in agents} | {"nu": (network.d.N - 1) * len(noisy)}
        self.at = Columns(widths, network.plant.A)

    def ways(self) -> tuple[Way, ...]:
        """Return the ways in for the coefficient errors."""
        return tuple(
            way_of(
                one, i, k, self.at.of[i, k], self.at.rows((i, "x_C")) if k in "AC" else self.differences(i)
            )
            for i, one in enumerate(self.controllers)
            for k in self.letters[i]
        )

    def differences(self, i: int) -> Matrix:
        """Return d_ij = a_ij (y_i - y_j) + zeta_ij of agent i, one source after the other."""
        one, d = self.controllers[i], self.network.d
        rows = self.at.rows((i, "zeta"))
        for k, (j, a) in enumerate(zip(one.sources, self.number(one.weights), strict=True)):
            across = (a * (d.right[i] - d.right[j]))[None, :]
            part = slice(k * self.q, (k + 1) * self.q)
            rows[part, self.at.of["x_d"]] = np.kron(across, self.network.plant.C)
            if self.scales.size:
                rows[part, self.at.of["nu"]] = np.kron(across, self.scales)
        return rows

    def received(self, i: int) -> Matrix:
        """Return (x_C, r) of agent i, r = sum_j d_ij."""
        d, r = self.differences(i), zeros(self.q, self.at.width, self.network.plant.A)
        for k in range(len(self.controllers[i].sources)):
            r = r + d[k * self.q : (k + 1) * self.q]
        return np.vstack([self.at.rows((i, "x_C")), r])

    def agent_rows(self, i: int) -> Matrix:
        """Return (x_C+, u) of agent i."""
        mu, counts = self.at.rows((i, "mu")), self.controllers[i].counts
        mu = mu if counts is None else self.number(counts)[:, None] * mu
        errors = {k: self.at.rows((i, k)) for k in self.letters[i]}
        return step_rows(self.controllers[i], self.received(i), mu, errors)


def inputs_of(network: SampledNetwork) -> tuple[Matrix, Matrix]:
    """Return B^ = [the different B_i] and the map from all u to u_d, such that (T (x) I) diag(B_i) u = (I (x) B^) u_d."""
    different: list[Matrix] = []
    which = []
    for B in network.plant.B:
        known = [k for k, other in enumerate(different) if (other == B).all()]
        which.append(known[0] if known else len(different))
        different += [] if known else [B]
    T, like = network.d.T, network.plant.A
    place, u = eye(len(different), like), eye(network.plant.B[0].shape[1], like)
    spread = [np.kron(T[:, [i]], np.kron(place[:, [k]], u)) for i, k in enumerate(which)]
    return np.hstack(different), np.hstack(spread)


def _check(network: SampledNetwork, controllers: tuple[HeldController, ...]) -> None:
    _, m, q, _, _ = network.plant.sizes
    N = network.d.N
    demand(len(controllers) == N, f"{len(controllers)} controllers", "sampled loop", f"{N}")
    for i, one in enumerate(controllers, start=1):
        where, order = f"controller {i}", controllers[0].order
        found = f"order {one.order}, {one.inputs} inputs, {one.outputs} outputs"
        fits = (one.order, one.inputs, one.outputs) == (order, m, q)
        demand(fits, found, where, f"order {order}, {m}, {q}")
        found, others = f"it listens to {[j + 1 for j in one.sources]}", {*range(N)} - {i - 1}
        demand(others.issuperset(one.sources), found, where, "other agents")
