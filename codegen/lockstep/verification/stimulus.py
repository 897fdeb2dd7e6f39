"""What the controllers are fed in the comparison: closed-loop outputs, and data meant to break them.

Every call is one operation with its arguments; the C harness and the reference read the same arrays.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from jaxtyping import Float, Int, UInt

from lockstep.check.errors import demand
from lockstep.codegen.emission.calls import Calls, Operation
from lockstep.codegen.manifest import AgentEntry, Manifest, PlantEntry
from lockstep.verification.reference import Reference, closed_loop

_SEED = 20_260_101


@dataclass(frozen=True, eq=False)
class Trace:
    """What came out of S calls: the status, u, and the whole state after each."""

    status: Int[np.ndarray, " S"]
    u: Float[np.ndarray, "S m"]
    x: Float[np.ndarray, "S nc"]
    held: Float[np.ndarray, "S nn q"]
    heard: UInt[np.ndarray, " S"]
    age: UInt[np.ndarray, "S nn"]
    misses: UInt[np.ndarray, "S nn"]


def run_reference(reference: Reference, calls: Calls) -> Trace:
    """The trace that the C code must reproduce to the bit."""
    S, nn, q, n = len(calls), len(reference.weights), reference.outputs, reference.order
    dtype = reference.M.dtype
    out = Trace(
        np.zeros(S, np.int32),
        np.zeros((S, len(reference.M) - n), dtype),
        np.zeros((S, n), dtype),
        np.zeros((S, nn, q), dtype),
        np.zeros(S, np.uint64),
        np.zeros((S, nn), np.uint32),
        np.zeros((S, nn), np.uint32),
    )
    for k in range(S):
        out.status[k], out.u[k] = _call(reference, calls, k)
        state = reference.state
        out.x[k], out.held[k], out.age[k], out.misses[k] = state.x, state.held, state.age, state.misses
        out.heard[k] = sum(1 << j for j, heard in enumerate(state.heard) if heard)
    return out


def _call(reference: Reference, calls: Calls, k: int) -> tuple[int, np.ndarray]:
    operation = int(calls.operation[k])
    if operation == Operation.RESET:
        reference.reset()
        return 0, reference.state.u
    if operation == Operation.STEP_UNREADY:
        return reference.step_unready()
    if operation == Operation.APPLIED:
        return reference.applied(np.resize(calls.r[k], len(reference.M) - reference.order))
    if operation == Operation.STEP_RELATIVE:
        return reference.step_relative(calls.r[k])
    return reference.step(calls.y[k], calls.neighbour_y[k], int(calls.received[k]))


def _neighbour_rows(manifest: Manifest, agent: AgentEntry, outputs: Sequence[np.ndarray]) -> np.ndarray:
    """Each neighbour's outputs at each step; one outside the folder sends this agent's at other times."""
    by_name = {a.name: y for a, y in zip(manifest.agents, outputs, strict=True)}
    own = by_name[agent.name]
    rows = [by_name.get(s.source, np.roll(own, 7 * (j + 1), axis=0)) for j, s in enumerate(agent.neighbours)]
    return np.stack(rows, axis=1) if rows else np.zeros((len(own), 0, own.shape[1]), own.dtype)


def closed_loop_calls(manifest: Manifest, outputs: Sequence[Float[np.ndarray, "S q"]]) -> dict[str, Calls]:
    """Ordinary operation on recorded outputs: every message arrives, and then one in ten is lost.

    The last fifth of the record is played with losses, so that both are covered by closed-loop data.
    """
    calls = {}
    for agent, y in zip(manifest.agents, outputs, strict=True):
        S, nn = len(y), len(agent.neighbours)
        random = np.random.default_rng(_SEED)
        lost = (random.random((S, nn)) < 0.1) & (np.arange(S)[:, None] >= S - S // 5)
        operation, r = np.zeros(S, np.uint32), np.zeros_like(y)
        calls[agent.name] = Calls(operation, _mask(~lost), y, _neighbour_rows(manifest, agent, outputs), r)
    return calls


def _mask(arrived: np.ndarray) -> np.ndarray:
    mask = np.zeros(len(arrived), np.uint64)
    for j in range(arrived.shape[1]):
        mask |= arrived[:, j].astype(np.uint64) << np.uint64(j)
    return mask


def recorded_outputs(manifest: Manifest, steps: int) -> list[Float[np.ndarray, "S q"]]:
    """Closed-loop outputs: of the manifest's plants with the references, else decaying oscillations."""
    plants = [agent.plant for agent in manifest.agents]
    if all(plants):
        return _plant_outputs(manifest, [plant for plant in plants if plant is not None], steps)
    random = np.random.default_rng(_SEED)
    t = np.arange(steps)[:, None] / max(steps, 1)
    outputs = []
    for agent in manifest.agents:
        amplitude, rate, phase = (random.uniform(0.2, 2.0, len(agent.outputs)) for _ in range(3))
        wave = amplitude * np.exp(-5 * rate * t) * np.cos(300 * rate * t + 6 * phase)
        outputs.append((wave + 1e-6 * random.standard_normal(wave.shape)).astype(manifest.real_type.dtype))
    return outputs


def _plant_outputs(manifest: Manifest, plants: list[PlantEntry], steps: int) -> list[np.ndarray]:
    """x' = A x + B u, y = C x with u held over each period, started at x0."""
    matrices, states = [], []
    for plant in plants:
        A, B, C = (np.array(M, dtype=np.float64) for M in (plant.A, plant.B, plant.C))
        block = np.block([[A, B], [np.zeros((B.shape[1], A.shape[0] + B.shape[1]))]])
        both = scipy.linalg.expm(block * manifest.period)[: len(A)]
        matrices.append((both[:, : len(A)], both[:, len(A) :], C))
        states.append(np.array(plant.x0))

    def advance(u: list[np.ndarray]) -> list[np.ndarray]:
        with np.errstate(all="ignore"):
            for i, (A_d, B_d, C) in enumerate(matrices):
                states[i] = A_d @ states[i] + B_d @ u[i].astype(np.float64)
                yield_[i] = C @ states[i]
        return yield_

    yield_ = [C @ x for (_, _, C), x in zip(matrices, states, strict=True)]
    return closed_loop(manifest, advance, np.array(yield_), steps)


def given_outputs(
    manifest: Manifest, stimulus: Sequence[np.ndarray] | np.ndarray, steps: int
) -> list[Float[np.ndarray, "S q"]]:
    """Check a caller's record (one S x q array per agent, or an S x N x q array) and cut it to `steps`."""
    stacked = isinstance(stimulus, np.ndarray) and stimulus.ndim == 3
    each = [np.asarray(y) for y in (np.moveaxis(np.asarray(stimulus), 1, 0) if stacked else stimulus)]
    wanted = [len(agent.outputs) for agent in manifest.agents]
    fits = [y.shape[1:] for y in each] == [(q,) for q in wanted] and min(len(y) for y in each) >= steps
    expected = f"at least {steps} rows and {wanted} columns, one array per agent"
    demand(fits, f"the shapes are {[y.shape for y in each]}", "stimulus", expected)
    return [y[:steps].astype(manifest.real_type.dtype) for y in each]


def fault_calls(manifest: Manifest, agent: AgentEntry) -> Calls:
    """Every fault once, each between two good steps: what `verify` feeds however few steps it is asked for.

    NaN, both infinities and the largest number in each entry of y, of each message (its bit set, and clear) and of r; a
    step of a state that was never initialised; a reset.
    """
    q, nn, dtype = len(agent.outputs), len(agent.neighbours), manifest.real_type.dtype
    width = (2 + nn) * q
    values = np.array([np.nan, np.inf, -np.inf, np.finfo(dtype).max], dtype)
    place, value = (part.ravel() for part in np.meshgrid(np.arange(width), values, indexing="ij"))
    own = (place >= q + nn * q).astype(np.uint32) * Operation.STEP_RELATIVE
    heard = np.flatnonzero((place >= q) & (place < q + nn * q))
    kinds = np.concatenate(
        [own, np.full(len(heard), Operation.STEP), [Operation.STEP_UNREADY, Operation.RESET]]
    ).astype(np.uint32)
    S = 2 * len(kinds) + 1
    wave = np.cos(np.arange(S)[:, None] + np.arange(width)).astype(dtype)
    arrived = np.ones((S, nn), bool)
    operation = np.zeros(S, np.uint32)
    operation[1::2] = kinds
    faulty = 2 * np.arange(len(place)) + 1
    wave[faulty, place] = value
    silent = 2 * (len(place) + np.arange(len(heard))) + 1
    wave[silent, place[heard]] = value[heard]
    arrived[silent, (place[heard] - q) // q] = False
    return _calls_of(operation, _mask(arrived), wave, nn)


def limit_calls(manifest: Manifest, agent: AgentEntry) -> Calls:
    """What meets every limit from both sides, each call by itself; no calls where u is not clipped.

    Relative outputs along the rows of D that ask for less and for more than it; applied values beyond it, at it, next to
    it, and not finite.
    """
    real, q, nn = manifest.real_type, len(agent.outputs), len(agent.neighbours)
    sides, D = agent.sides(real), agent.table(real)[agent.order :, agent.order :]
    rows: list[np.ndarray] = []
    kinds: list[int] = []
    with np.errstate(all="ignore"):
        for ends, row in zip(np.zeros((0, 2)) if sides is None else sides, D, strict=False):
            along = row.astype(np.float64) / max(float(row @ row), float(np.finfo(real.dtype).tiny))
            asked = [along * float(end) * part for part in (0.5, 0.999, 1.0, 1.001, 3.0) for end in ends]
            near = [np.nextafter(end, end.dtype.type(to)) for end in ends for to in (-np.inf, np.inf)]
            given = [np.full(q, value) for value in (*ends, *near, -np.inf, np.inf, np.nan, 0.0)]
            rows += [*asked, *given]
            kinds += [Operation.STEP_RELATIVE] * len(asked) + [Operation.APPLIED] * len(given)
        r = np.array(rows, dtype=np.float64).reshape(len(rows), q).astype(real.dtype)
    y, others = np.zeros_like(r), np.zeros((len(r), nn, q), real.dtype)
    return Calls(np.array(kinds, np.uint32), np.zeros(len(r), np.uint64), y, others, r)


def adversarial_calls(manifest: Manifest, agent: AgentEntry, steps: int) -> Calls:
    """Subnormal, huge, signed-zero, alternating, non-finite values; lost messages; resets; overlap.

    The kind changes every 50 calls, so that subnormal states live among subnormals and huge ones overflow.
    """
    q, nn = len(agent.outputs), len(agent.neighbours)
    random = np.random.default_rng([_SEED, *agent.name.encode()])
    values = _adversarial_values(random, steps, (2 + nn) * q, manifest.real_type.dtype)
    kinds = list(Operation)[: Operation.APPLIED]
    operation = random.choice(kinds, steps, p=[0.685, 0.2, 0.01, 0.1, 0.005])
    arrived = random.random((steps, nn)) < random.choice([0.0, 0.5, 0.9, 1.0], (steps, 1))
    mask = _mask(arrived)
    if nn < 32:  # a bit beyond the neighbours
        mask |= random.integers(0, 2, steps).astype(np.uint64) << np.uint64(31)
    return _calls_of(operation.astype(np.uint32), mask, values, nn)


def _calls_of(
    operation: UInt[np.ndarray, " S"], mask: UInt[np.ndarray, " S"], values: np.ndarray, nn: int
) -> Calls:
    """Return the calls whose values are, row by row, those of y, of each message and of r."""
    rows = values.reshape(len(values), 2 + nn, values.shape[1] // (2 + nn))
    y, messages, r = np.split(rows, [1, 1 + nn], axis=1)
    return Calls(operation, mask, y[:, 0].copy(), messages.copy(), r[:, 0].copy())


def _adversarial_values(random: np.random.Generator, steps: int, width: int, dtype: np.dtype) -> np.ndarray:
    limits = np.finfo(dtype)
    shape = (steps, width)
    sign = random.choice([-1.0, 1.0], shape)
    alternating = np.where((np.arange(steps)[:, None] + np.arange(width)) % 2 == 0, 1.0, -1.0)
    with np.errstate(all="ignore"):
        kinds = [
            sign * random.random(shape) * float(limits.tiny),
            sign * random.random(shape) * float(limits.max),
            sign * 0.0,
            alternating * 10.0 ** random.integers(-3, 4, shape),
            sign * 2.0 ** random.uniform(np.log2(float(limits.tiny)), np.log2(float(limits.max)), shape),
            sign * random.random(shape),
            sign * float(limits.smallest_subnormal) * random.integers(0, 4, shape),
        ]
        rare = random.random(shape) < 0.01
        odd = random.choice([np.nan, np.inf, -np.inf, -np.nan], shape)
        kinds.append(np.where(rare, odd, sign * random.random(shape)))
        kind = np.repeat(random.permutation(np.arange(-(-steps // 50)) % len(kinds)), 50)[:steps]
        return np.choose(kind[:, None], kinds).astype(dtype)
