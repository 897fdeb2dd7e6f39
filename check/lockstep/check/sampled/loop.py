"""The sampled loop in disagreement coordinates, with every way in for an error of the arithmetic or of the messages.

State xi = (x_d, x_C) at the sampling instants, and with a delay of one period the inputs u computed last. All
matrices act on z = (xi, e): the state, then the errors

    e_j = Delta_j Y_j z,  |Delta_j| <= delta_j    of the coefficients A, B, C, D of each agent: rounding, in the units
                                                  R, S of `controller`: R_j e_j is what enters, S_j is part of Y_j;
    nu_i                                          of the differences d_ij = a_ij (y_i - y_j), from the messages;
    mu_i                                          added to (x_C+, u) of agent i, from underflow, or in counts of integers;
    n_d                                           the disagreement of the outputs' own noise, where rho is a gain from it.

    d_i = differences + nu_i,
    x_C+ = A x_C + B sum_j d_ij + R_A e_A + R_B e_B + mu,   u = C x_C + D sum_j d_ij + R_C e_C + R_D e_D + mu.
"""

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from lockstep.check.continuous.inequality import LETTERS
from lockstep.check.errors import demand
from lockstep.check.numbers import Matrix, converter, is_exact, zeros
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
    """Matrices on z = (xi, e).

    n_d: length of x_d;  n_xi: length of xi;  into: (n, k), through which the inputs reach one agent;  held: what v
    of all copies is during the next period;  advanced: the rest of xi after it;  ways: the coefficient errors;
    seen: (x_C, r) of each agent;  messages: the columns of nu;  underflows: those of mu, next to them;  outputs: those of
    n_d;  applied, computed: (N m, n_z), what the inputs are during the next period, and what the controllers compute;
    differences: the d_ij of all agents, one below the other.
    """

    network: SampledNetwork
    n_d: int
    n_xi: int
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
    def noise(self) -> slice:
        """The columns of nu and mu."""
        return slice(self.messages.start, self.underflows.stop)

    @property
    def n_z(self) -> int:
        """Length of z."""
        return int(self.held.shape[1])

    @property
    def start(self) -> Matrix:
        """a = (x_d, v) at the start of a period."""
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
    applied = layout.last_inputs if network.delay else u
    return SampledLoop(
        network,
        layout.n_d,
        layout.n_xi,
        into,
        spread @ applied,
        np.vstack([states, u]) if network.delay else states,
        layout.ways,
        tuple(layout.received(i) for i in range(len(controllers))),
        slice(layout.first_noise, layout.first_underflow),
        slice(layout.first_underflow, layout.first_output),
        slice(layout.first_output, layout.n_z),
        applied,
        u,
        np.vstack([layout.differences(i) for i in range(len(controllers))]),
    )


class _Layout:
    """Where the parts of z are, and what agent i computes from them."""

    def __init__(
        self,
        network: SampledNetwork,
        controllers: tuple[HeldController, ...],
        noise: Annotated[np.ndarray, " q"],
    ) -> None:
        self.network, self.controllers = network, controllers
        n, m, q, _, _ = network.plant.sizes
        N, n_C = len(controllers), controllers[0].order
        self.n_d, self.m, self.q, self.n_C = n * (N - 1), m, q, n_C
        self.n_xi = self.n_d + n_C * N + (m * N if network.delay else 0)
        sizes = {(i, k): self._width(k) for i in range(N) for k in LETTERS if controllers[i].deltas[k] > 0}
        place = self.n_xi
        self.places: dict[tuple[int, str], slice] = {}
        for key, width in sizes.items():
            self.places[key] = slice(place, place + width)
            place += width
        self.first_noise = place
        for i, one in enumerate(controllers):
            self.places[i, "nu"] = slice(place, place + q * len(one.sources))
            place += q * len(one.sources)
        self.first_underflow = place
        for i in range(N):
            self.places[i, "mu"] = slice(place, place + n_C + m)
            place += n_C + m
        self.number = converter(is_exact(network.plant.A))
        self.first_output, noisy = place, np.flatnonzero(noise)
        self.scales = self.number(np.diag(noise)[:, noisy])
        self.n_z = place + (N - 1) * len(noisy)
        self.ways = tuple(way_of(controllers[i], i, k, self.places[i, k], self._seen(i, k)) for i, k in sizes)

    def _width(self, letter: str) -> int:
        return self.n_C if letter in "AB" else self.m

    def _select(self, place: slice) -> Matrix:
        width = place.stop - place.start
        rows = zeros(width, self.n_z, self.network.plant.A)
        rows[:, place] = np.eye(width, dtype=int)
        return rows

    def _state(self, i: int) -> Matrix:
        return self._select(slice(self.n_d + i * self.n_C, self.n_d + (i + 1) * self.n_C))

    def _seen(self, i: int, letter: str) -> Matrix:
        return self._state(i) if letter in "AC" else self.differences(i)

    @property
    def last_inputs(self) -> Matrix:
        """u as it was computed one period ago."""
        N = len(self.controllers)
        return self._select(slice(self.n_d + self.n_C * N, self.n_xi))

    def differences(self, i: int) -> Matrix:
        """Return d_ij = a_ij (y_i - y_j) + nu_ij of agent i, one source after the other."""
        one, d = self.controllers[i], self.network.d
        rows = self._select(self.places[i, "nu"])
        for k, (j, a) in enumerate(zip(one.sources, self.number(one.weights), strict=True)):
            across = a * (d.right[i] - d.right[j])
            part = slice(k * self.q, (k + 1) * self.q)
            rows[part, : self.n_d] = np.kron(across[None, :], self.network.plant.C)
            if self.scales.shape[1]:
                rows[part, self.first_output :] = np.kron(across[None, :], self.scales)
        return rows

    def received(self, i: int) -> Matrix:
        """Return (x_C, r) of agent i, r = sum_j d_ij."""
        d, r = self.differences(i), zeros(self.q, self.n_z, self.network.plant.A)
        for k in range(len(self.controllers[i].sources)):
            r = r + d[k * self.q : (k + 1) * self.q]
        return np.vstack([self._state(i), r])

    def agent_rows(self, i: int) -> Matrix:
        """Return (x_C+, u) of agent i."""
        n_C, table = self.n_C, self.number(self.controllers[i].table)
        mu, counts = self._select(self.places[i, "mu"]), self.controllers[i].counts
        if counts is not None:
            mu = self.number(counts)[:, None] * mu
        rows: Matrix = table @ self.received(i) + mu
        for letter in LETTERS:
            if (i, letter) in self.places:
                part = slice(0, n_C) if letter in "AB" else slice(n_C, None)
                units = self.number(self.controllers[i].errors[letter].rows)[:, None]
                rows[part] = rows[part] + units * self._select(self.places[i, letter])
        return rows


def inputs_of(network: SampledNetwork) -> tuple[Matrix, Matrix]:
    """Return B^ = [the different B_i] and the map from all u to v, such that (T (x) I) diag(B_i) u = (I (x) B^) v."""
    different: list[Matrix] = []
    which = []
    for B in network.plant.B:
        known = [k for k, other in enumerate(different) if (other == B).all()]
        which.append(known[0] if known else len(different))
        different += [] if known else [B]
    N, m, width = network.d.N, network.plant.B[0].shape[1], len(different)
    spread = zeros((N - 1) * width * m, N * m, network.plant.A)
    for i, k in enumerate(which):
        for copy in range(N - 1):
            for channel in range(m):
                spread[(copy * width + k) * m + channel, i * m + channel] = network.d.T[copy, i]
    return np.hstack(different), spread


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
