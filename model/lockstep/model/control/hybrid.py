"""Continuous systems and sampled ones in one loop, each at its own rate: what `control.interconnect` refuses to join.

Signals join by name, as in python-control. Between two instants the continuous parts obey

    x' = A x + B_u u + B_w w,    y = C x + D_u u + D_w w,

with u, the outputs of the sampled parts, held. At a multiple of its dt a sampled part reads its inputs s and moves:

    x_k+ = A_k x_k + B_k s,    u_k = C_k x_k + D_k s.

Where several fire at once the slower goes first, and the next reads what it has just given out. One period of all of them
(the least common multiple of the dt) is an exact zero-order-hold discretisation: e^(A h) between the instants (Chen and
Francis 1995, chapter 3), however many rates there are.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, lru_cache
from math import lcm
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from lockstep.check.errors import ProblemError, demand
from lockstep.model.control.hybrid_norms import h2, l2_gain
from lockstep.model.control.wiring import JoinedSystem, joined_systems

MOST_INTERVALS = 10_000
"""Between the instants of one common period: rates whose ratio is no small number have no useful one."""


class Interval(NamedTuple):
    """Which sampled groups fire, and how long nothing does after that."""

    fires: tuple[int, ...]
    length: float


@dataclass(frozen=True, eq=False)
class Hybrid:
    """A linear loop of continuous and sampled parts.

    Args:
        parts: `control.StateSpace` systems, with dt = 0 or the period in s, or hybrid loops; every output name is given once.
        inputs, outputs: of the whole; by default the inputs that no part gives, and all outputs.

    Raises:
        ProblemError: another kind of system, a name given twice or not at all, no continuous or no sampled part.

    >>> import control
    >>> plant = control.ss(0.0, 1.0, 1.0, 0.0, inputs="u", outputs="y")
    >>> fast = control.ss([], [], [], -2.0, 0.25, inputs="y", outputs="u")
    >>> Hybrid([plant, fast]).poles()                # x+ = x + 0.25 (-2 x)
    array([0.5])
    """

    parts: Sequence[Any]
    inputs: Sequence[str] = ()
    outputs: Sequence[str] = ()

    def __post_init__(self) -> None:
        parts = [one for part in self.parts for one in (part.parts if isinstance(part, Hybrid) else [part])]
        object.__setattr__(self, "parts", parts)
        if strange := [part for part in parts if not hasattr(part, "dt")]:
            raise ProblemError(f"{strange}", where="hybrid loop", expected="control.StateSpace systems")
        rates = {float(part.dt or 0) for part in self.parts}
        if any(part.dt is None or part.dt is True for part in self.parts) or not 0 < len(rates - {0.0}) < len(
            rates
        ):
            raise ProblemError(
                f"the time bases {[part.dt for part in self.parts]}",
                where="hybrid loop",
                expected="continuous parts (dt = 0) and sampled ones, each with its dt in s",
                remedy="join parts of one time base with control.interconnect",
            )
        given = [name for part in self.parts for name in part.output_labels]
        if twice := {name for name in given if given.count(name) > 1}:
            found = f"{sorted(twice)} given by two parts"
            raise ProblemError(found, where="hybrid loop", expected="one each")
        free = dict.fromkeys(s for part in self.parts for s in part.input_labels if s not in given)
        for what, named, known in (("inputs", self.inputs, free), ("outputs", self.outputs, given)):
            if unknown := [name for name in named if name not in known]:
                raise ProblemError(
                    f"{unknown}", where=f"hybrid loop, {what}", expected=f"some of {list(known)}"
                )
        object.__setattr__(self, "inputs", list(self.inputs) or list(free))
        object.__setattr__(self, "outputs", list(self.outputs) or given)

    @cached_property
    def plant(self) -> JoinedSystem:
        """The continuous parts, joined."""
        return joined_systems([part for part in self.parts if not part.dt])

    @cached_property
    def groups(self) -> tuple[JoinedSystem, ...]:
        """The sampled parts of each rate, joined; the slowest first."""
        rates = sorted({part.dt for part in self.parts if part.dt}, reverse=True)
        return tuple(joined_systems([part for part in self.parts if part.dt == rate]) for rate in rates)

    @property
    def dt(self) -> float:
        """The common period in s: the least common multiple of the rates, each taken as its decimals say."""
        return float(self._common)

    @cached_property
    def _common(self) -> Fraction:
        rates = [Fraction(repr(float(group.dt))) for group in self.groups]
        return Fraction(
            lcm(*(rate.numerator * _over(rates) // rate.denominator for rate in rates)), _over(rates)
        )

    @cached_property
    def intervals(self) -> tuple[Interval, ...]:
        """What happens in one common period, from instant 0 on."""
        rates = [Fraction(repr(float(group.dt))) for group in self.groups]
        if sum(self._common / rate for rate in rates) > MOST_INTERVALS:
            raise ProblemError(
                f"rates {[float(rate) for rate in rates]} s with the common period {self.dt:g} s",
                where="hybrid loop",
                expected=f"at most {MOST_INTERVALS} instants in a common period",
            )
        instants = sorted({k * rate for rate in rates for k in range(int(self._common / rate))})
        ends = [*instants[1:], self._common]
        return tuple(
            Interval(tuple(k for k, rate in enumerate(rates) if t % rate == 0), float(end - t))
            for t, end in zip(instants, ends, strict=True)
        )

    # z = (x, then of each group x_k, then of each group u_k): the state with everything that is held.

    @property
    def n(self) -> int:
        """Length of x."""
        return len(self.plant.A)

    @cached_property
    def _places(self) -> tuple[list[slice], list[slice]]:
        """Where x_k and u_k of each group are in z."""
        sizes = [len(group.A) for group in self.groups] + [len(group.outputs) for group in self.groups]
        ends = self.n + np.cumsum(sizes)
        slices = [slice(int(end) - size, int(end)) for end, size in zip(ends, sizes, strict=True)]
        return slices[: len(self.groups)], slices[len(self.groups) :]

    @property
    def held(self) -> slice:
        """The places of all u_k."""
        return slice(self._places[1][0].start, self._places[1][-1].stop)

    def rows(self, names: Sequence[str]) -> tuple[Float[np.ndarray, "k z"], Float[np.ndarray, "k w"]]:
        """Return the matrices from z and w to signals, of any part or outside."""
        of_z, of_w = np.zeros((len(names), self.held.stop)), np.zeros((len(names), len(self.inputs)))
        for row, name in enumerate(names):
            if name in self.inputs:
                of_w[row, list(self.inputs).index(name)] = 1.0
            elif name in self.plant.outputs:
                k = self.plant.outputs.index(name)
                of_z[row, : self.n] = self.plant.C[k]
                for value, source in zip(self.plant.D[k], self.plant.inputs, strict=True):
                    if value:
                        through_z, through_w = self.rows([source])
                        of_z[row] += value * through_z[0]
                        of_w[row] += value * through_w[0]
            else:
                for group, place in zip(self.groups, self._places[1], strict=True):
                    if name in group.outputs:
                        of_z[row, place.start + group.outputs.index(name)] = 1.0
        return of_z, of_w

    def jump(self, fires: Sequence[int]) -> tuple[Float[np.ndarray, "z z"], Float[np.ndarray, "z w"]]:
        """Return z+ = J z + K w where these groups fire, one after the other."""
        J, K = np.eye(self.held.stop), np.zeros((self.held.stop, len(self.inputs)))
        for k in fires:
            group, x, u = self.groups[k], self._places[0][k], self._places[1][k]
            of_z, of_w = self.rows(group.inputs)
            step, fed = np.eye(self.held.stop), np.zeros_like(K)
            step[u] = 0.0
            for rows, state, into in ((x, group.A, group.B), (u, group.C, group.D)):
                step[rows] = into @ of_z
                step[rows, x] += state
                fed[rows] = into @ of_w
            J, K = step @ J, step @ K + fed
        return J, K

    def field(self) -> tuple[Float[np.ndarray, "z z"], Float[np.ndarray, "z w"]]:
        """Return z' = F z + G w between instants."""
        F, G = np.zeros((self.held.stop,) * 2), np.zeros((self.held.stop, len(self.inputs)))
        of_z, of_w = self.rows(self.plant.inputs)
        F[: self.n] = self.plant.B @ of_z
        F[: self.n, : self.n] += self.plant.A
        G[: self.n] = self.plant.B @ of_w
        return F, G

    def flow(self, length: float) -> tuple[Float[np.ndarray, "z z"], Float[np.ndarray, "z w"]]:
        """Return z(t + h) = Phi z(t) + Gamma w with w held (Van Loan 1978)."""
        Phi, Gamma = self._flow(length)
        return Phi, Gamma

    @cached_property
    def _flow(self) -> Any:
        from scipy.linalg import expm

        F, G = self.field()

        @lru_cache(maxsize=64)
        def flow(length: float) -> tuple[np.ndarray, np.ndarray]:
            whole = expm(np.block([[F, G], [np.zeros((G.shape[1], F.shape[0] + G.shape[1]))]]) * length)
            return whole[: len(F), : len(F)], whole[: len(F), len(F) :]

        return flow

    @cached_property
    def _period(self) -> tuple[Float[np.ndarray, "z z"], Float[np.ndarray, "z w"]]:
        """One common period from just before instant 0: z+ = M z + N w."""
        M, N = np.eye(self.held.stop), np.zeros((self.held.stop, len(self.inputs)))
        for fires, length in self.intervals:
            for Phi, Gamma in (self.jump(fires), self.flow(length)):
                M, N = Phi @ M, Phi @ N + Gamma
        return M, N

    def sample(self, *, name: str = "sampled") -> Any:
        """Return one common period as a `control.ss` with its dt, exactly discretised, w held.

        The state is z just before instant 0, without what is held where nothing depends on it; the outputs are taken
        at the instant, after the sampled parts have moved.
        """
        import control

        M, N = self._period
        (J, K), (of_z, of_w) = self.jump(self.intervals[0].fires), self.rows(self.outputs)
        C, D = of_z @ J, of_z @ K + of_w
        kept = [k for k in range(len(M)) if k < self.held.start or M[:, k].any() or C[:, k].any()]
        names = {"inputs": list(self.inputs), "outputs": list(self.outputs), "name": name}
        states = [s for part in (self.plant, *self.groups) for s in part.states]
        states += [f"{s}_held" for group in self.groups for s in group.outputs]
        names["states"] = [states[k] for k in kept]
        return control.ss(M[np.ix_(kept, kept)], N[kept], C[:, kept], D, self.dt, **names)

    def poles(self) -> np.ndarray:
        """Return the eigenvalues of one common period: the loop is stable where all are inside the unit circle."""
        M, _ = self._period
        kept = [k for k in range(len(M)) if k < self.held.start or M[:, k].any()]
        return np.linalg.eigvals(M[np.ix_(kept, kept)])

    def norm(self, p: float | str = "inf") -> float:
        """Return the L2-induced norm (p = "inf") or the H2 norm (p = 2) from w to the outputs, between samples too.

        See `lockstep.model.control.hybrid_norms`. Computed in doubles: a figure, no proof.
        """
        F, G, H = self._strictly_proper()
        pieces = [(self.jump(fires)[0], length) for fires, length in self.intervals]
        return h2(F, G, H, pieces) if p == 2 else l2_gain(F, G, H, pieces)

    def _strictly_proper(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return F, G, H of z' = F z + G w, e = H z, or say why there is no norm."""
        (F, G), (H, through) = self.field(), self.rows(self.outputs)
        sampled = any(self.jump(fires)[1].any() for fires, _ in self.intervals)
        found = "an input that reaches an output, or a sampled part, without a state in between"
        where, expected = "norm of a hybrid loop", "inputs that act on continuous states"
        remedy = "name the inputs and outputs of the loop, or filter these"
        demand(not through.any() and not sampled, found, where, expected, remedy)
        stable = max(abs(self.poles()), default=0.0) < 1
        demand(stable, "the loop is not stable", where, "poles inside the unit circle")
        return F, G, H

    def response(self, t: Float[np.ndarray, " K"], w: Any = 0.0, start: Any = 0.0) -> Any:
        """Return the response at increasing instants t from 0 on as `control.TimeResponseData`, between samples too.

        Args:
            t: in s.
            w: the inputs (k,), or (k, K), held from each instant of t to the next.
            start: x, then the x_k, at 0; the rest of z is 0.
        """
        import control

        t, n_z = np.asarray(t, dtype=float), self.held.stop
        if t.ndim != 1 or len(t) < 2 or t[0] != 0 or not (np.diff(t) > 0).all():
            raise ProblemError(
                "`t` does not increase from 0", where="response", expected="instants in s, 0 first"
            )
        shape = (len(self.inputs), len(t))
        z = np.zeros(n_z)
        try:
            held = np.reshape(w, (-1, 1)) if np.ndim(w) == 1 else np.asarray(w, dtype=float)
            w = np.broadcast_to(held, shape)
            z[: self.held.start] = start
        except ValueError:
            found = f"`w` of the shape {np.shape(w)}, `start` of the shape {np.shape(start)}"
            expected = f"({shape[0]},) or {shape}, and ({self.held.start},)"
            raise ProblemError(found, where="response", expected=expected) from None
        of_z, of_w = self.rows(self.outputs)
        states, outputs = np.zeros((self.held.start, len(t))), np.zeros((len(self.outputs), len(t)))
        events = iter(self._events(t[-1]))
        instant, fires = next(events)
        now = 0.0
        for k, until in enumerate(t):
            while instant <= until + 1e-12 * self.dt:
                # The input of the grid step that the instant is in: the one before, but for its own first instant.
                given = w[:, k if instant >= until - 1e-12 * self.dt else k - 1]
                z = self._moved(z, given if k == 0 else w[:, k - 1], instant - now)
                J, K = self.jump(fires)
                z, now = J @ z + K @ given, instant
                instant, fires = next(events)
            z, now = self._moved(z, w[:, max(k - 1, 0)], until - now), until
            states[:, k], outputs[:, k] = z[: self.held.start], of_z @ z + of_w @ w[:, k]
        labels = [s for part in (self.plant, *self.groups) for s in part.states]
        return control.TimeResponseData(
            t,
            outputs,
            states,
            w,
            input_labels=list(self.inputs),
            output_labels=list(self.outputs),
            state_labels=labels,
            issiso=False,
            title="Response between samples",
        )

    def _moved(self, z: np.ndarray, w: np.ndarray, length: float) -> np.ndarray:
        if length <= 0:
            return z
        Phi, Gamma = self.flow(round(length, 15))
        return np.asarray(Phi @ z + Gamma @ w)

    def _events(self, end: float) -> Any:
        """Yield (instant, who fires), past the end by one."""
        periods, at = 0, 0.0
        while at <= end + self.dt:
            at = periods * self.dt
            for fires, length in self.intervals:
                yield at, fires
                at += length
            periods += 1
        yield np.inf, ()


def _over(rates: Sequence[Fraction]) -> int:
    return lcm(*(rate.denominator for rate in rates))
