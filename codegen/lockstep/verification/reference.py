"""The same controller in NumPy: the same operations, in the same order, each rounded once to the target type.

The C code's contract is equality to the bit with this. It reads only the manifest's coefficients, and shares
nothing with the emission: no CasADi, no templates.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

from lockstep.check.errors import ProblemError
from lockstep.codegen.manifest import AgentEntry, Manifest

OK, NOT_FINITE, OVERFLOW, NOT_READY, CLIPPED = 0, 1, 2, 3, 8
_SATURATED = 2**32 - 1


@dataclass(eq=False)
class State:
    """What `<agent>_state_t` holds."""

    x: Float[np.ndarray, " nc"]
    u: Float[np.ndarray, " m"]
    held: Float[np.ndarray, "nn q"]
    heard: list[bool]
    age: list[int]
    misses: list[int]


@dataclass(eq=False)
class Reference:
    """One agent: its table M = [A B; C D], weights and, where u is clipped, limits in the target type, and its state.

    offsets: of a formation, what is taken from own outputs and from each neighbour's.

    `step` and `step_relative` return (status, u), as the C functions do.
    """

    M: Float[np.ndarray, "nc+m nc+q"]
    weights: Float[np.ndarray, " nn"]
    order: int
    skip_zeros: bool
    limits: Float[np.ndarray, "m 2"] | None = None
    offsets: Float[np.ndarray, "nn+1 q"] | None = None
    state: State = field(init=False)

    def __post_init__(self) -> None:
        self._zero = self.M.dtype.type(0)
        self._skipped = self.M == 0
        self._empty = self._skipped.all(axis=1)
        self.init()

    @classmethod
    def of(cls, agent: AgentEntry, manifest: Manifest) -> "Reference":
        """The reference of one agent of a generated folder."""
        real = manifest.real_type
        skip = manifest.arithmetic.zero_terms == "skipped"
        limits, offsets = agent.sides(real), agent.shifts(real)
        return cls(agent.table(real), agent.weights(real), agent.order, skip, limits, offsets)

    @property
    def memory(self) -> Float[np.ndarray, " nc"]:
        """The controller's state before the next step, in doubles."""
        return self.state.x.astype(float)

    @property
    def outputs(self) -> int:
        """The number q of measured outputs."""
        return int(self.M.shape[1]) - self.order

    def init(self) -> None:
        """The state before the first step."""
        n, nn, dtype = self.order, len(self.weights), self.M.dtype
        self.state = State(
            np.zeros(n, dtype),
            np.zeros(len(self.M) - n, dtype),
            np.zeros((nn, self.outputs), dtype),
            [False] * nn,
            [0] * nn,
            [0] * nn,
        )

    def reset(self) -> None:
        """Back to rest; the counts of misses stay."""
        misses = self.state.misses
        self.init()
        self.state.misses = misses

    def step_unready(self) -> tuple[int, Float[np.ndarray, " m"]]:
        """One step on a state that was never initialised: refused, u = 0; then it is initialised."""
        self.init()
        return NOT_READY, self.state.u.copy()

    def step_relative(self, r: Float[np.ndarray, " q"]) -> tuple[int, Float[np.ndarray, " m"]]:
        """One step with the relative output r (already of the target type)."""
        status = self._clip(self._advance(r, bool(np.isfinite(r).all())))
        return status, self.state.u.copy()

    def applied(self, u: Float[np.ndarray, " m"]) -> tuple[int, Float[np.ndarray, " m"]]:
        """Take what acted in place of u; for agents with limits."""
        if not np.isfinite(u).all():
            return NOT_FINITE, self.state.u.copy()
        self.state.u = u.copy()
        return self._clip(OK), self.state.u.copy()

    def step(
        self, y: Float[np.ndarray, " q"], neighbour_y: Float[np.ndarray, "nn q"], received: int
    ) -> tuple[int, Float[np.ndarray, " m"]]:
        """One step with own and neighbours' outputs; bit j of `received` says that row j arrived; not finite, it did not."""
        arrived = [bool(received >> j & 1) for j in range(len(self.weights))]
        if self.offsets is not None and arrived:
            with np.errstate(all="ignore"):
                y, neighbour_y = y - self.offsets[0], neighbour_y - self.offsets[1:]
        arrived = [
            here and bool(np.isfinite(row).all()) for here, row in zip(arrived, neighbour_y, strict=True)
        ]
        status = self._advance(self._relative(y, neighbour_y, arrived), bool(np.isfinite(y).all()))
        self._remember(neighbour_y, arrived, status)
        return self._clip(status), self.state.u.copy()

    def _clip(self, status: int) -> int:
        """After a good step: u within its limits."""
        if self.limits is None or status != OK:
            return status
        lower, upper = self.limits.T
        u = np.where(self.state.u < lower, lower, np.where(self.state.u > upper, upper, self.state.u))
        clipped = bool((u != self.state.u).any())
        self.state.u = u
        return CLIPPED if clipped else OK

    def _relative(self, y: np.ndarray, neighbour_y: np.ndarray, arrived: list[bool]) -> np.ndarray:
        """r = 0 + a_1 (y - y_1) + a_2 (y - y_2) + ...; a neighbour never heard counts as y."""
        r = np.zeros_like(y)
        with np.errstate(all="ignore"):
            for j, weight in enumerate(self.weights):
                held = self.state.held[j] if self.state.heard[j] else y
                r = r + weight * (y - (neighbour_y[j] if arrived[j] else held))
        return r

    def _advance(self, r: np.ndarray, inputs_are_finite: bool) -> int:
        if not inputs_are_finite:
            return NOT_FINITE
        with np.errstate(all="ignore"):
            next_ = self._table_times(np.concatenate([self.state.x, r]))
        if not np.isfinite(np.concatenate([r, next_])).all():
            return OVERFLOW
        self.state.x, self.state.u = next_[: self.order], next_[self.order :]
        return OK

    def _table_times(self, z: np.ndarray) -> np.ndarray:
        """M z, every row from left to right. A skipped term is -0, IEEE addition's neutral element.

        `add.accumulate` adds strictly in sequence, unlike `sum`, `dot` and `@`.
        """
        terms = self.M * z
        if not self.skip_zeros:
            # the loop starts from +0
            start = np.zeros((len(terms), 1), terms.dtype)
            return np.add.accumulate(np.hstack([start, terms]), axis=1)[:, -1]
        terms[self._skipped] = -self._zero
        total = np.add.accumulate(terms, axis=1)[:, -1]
        total[self._empty] = self._zero
        return total

    def _remember(self, neighbour_y: np.ndarray, arrived: list[bool], status: int) -> None:
        """Keep what arrived, unless the step failed; a message that is not kept is a step older."""
        state = self.state
        for j, here in enumerate(arrived):
            if not here:
                state.misses[j] = min(state.misses[j] + 1, _SATURATED)
            if here and status == OK:
                state.held[j] = neighbour_y[j]
                state.heard[j], state.age[j] = True, 0
            else:
                state.age[j] = min(state.age[j] + 1, _SATURATED)


def references(manifest: Manifest) -> dict[str, Reference]:
    """A fresh reference for every agent of the folder, by name."""
    return {agent.name: Reference.of(agent, manifest) for agent in manifest.agents}


def closed_loop(manifest: Manifest, plant: Any, y0: Float[np.ndarray, "N q"], steps: int) -> list[np.ndarray]:
    """Record each agent's outputs while the references run in the loop with `plant`.

    plant  called as plant(u) with u a list of N input vectors: advances one period and returns the N new
    outputs
    y0     outputs at the first step
    Returns one steps x q array per agent, in the target type: feed it to `verify_folder` as `stimulus`.
    """
    dtype = manifest.real_type.dtype
    agents = references(manifest)
    rows = {agent.name: k for k, agent in enumerate(manifest.agents)}
    sources = [[rows.get(s.source, -1) for s in agent.neighbours] for agent in manifest.agents]
    if any(row < 0 for listened in sources for row in listened):
        raise ProblemError("a neighbour is no agent of this folder", where="closed loop")
    record = [np.empty((steps, len(agent.outputs)), dtype) for agent in manifest.agents]
    y = [np.asarray(row, dtype) for row in y0]
    for k in range(steps):
        u = []
        for i, reference in enumerate(agents.values()):
            record[i][k] = y[i]
            neighbours = np.array([y[j] for j in sources[i]], dtype).reshape(len(sources[i]), len(y[i]))
            u.append(reference.step(y[i], neighbours, 2 ** len(sources[i]) - 1)[1])
        with np.errstate(over="ignore", under="ignore"):
            y = [np.asarray(row).astype(dtype) for row in plant(u)]
    return record
