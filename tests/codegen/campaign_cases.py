"""The paper's arms as compiled loops, batches for them, and what their runs are held against."""

from dataclasses import dataclass

import numpy as np
import pytest
from codegen_cases import TABLE_1

from lockstep.campaign.compiled.engine import Batch, Engine
from lockstep.campaign.compiled.functions import Performance
from lockstep.campaign.compiled.layout import Features
from lockstep.campaign.compiled.source import CampaignSource, continuous_source, sampled_source
from lockstep.check.system.loop import Gains
from lockstep.codegen.emission.emit import emit
from lockstep.codegen.manifest import FILE_NAME, Manifest
from lockstep.codegen.spec import CodegenSpec, Controller, Neighbour
from lockstep.model.graphs.graph import Graph
from lockstep.model.network import Network
from lockstep.model.problem import load_problem
from lockstep.model.simulation.disturbance import Samples, Sines, Steps, Sum
from lockstep.model.simulation.results.indices import indices
from lockstep.model.simulation.scenario import Scenario
from lockstep.verification.closed_loop.software_in_the_loop import reference_controllers

STEP, PERIOD, HORIZON = 1e-3, 5e-3, 1.0
WEIGHTS = Performance(np.diag([1.0, 0.5, 2.0, 1.0]), np.array([[2.0, 0.3], [0.3, 1.0]]))
DELTA = {"A": 0.5, "B": 0.2, "C": 0.2, "D": 0.2}
PUBLISHED = Gains(*(tuple(np.array(agent[k]) for agent in TABLE_1) for k in range(4)))
BARE = Features()

# Both are RK4 with the same steps; sums are taken in another order, and the loop amplifies what rounding leaves.
SAME = 1e-10
# Messages are rounded to float32 (6e-8): where rounding to double falls on the other side of a float32's boundary
# the messages differ by that, of angles and rates up to 10.
SAME_MESSAGES = 2e-5


def arms_of(examples) -> Network:
    problem = load_problem(examples / "flexible_joint_arms.toml")
    return Network(problem.agent(), problem.graph(), problem.agents_B())


def continuous_loop(network: Network, gains: Gains = PUBLISHED, features=BARE, **more) -> CampaignSource:
    given = {"period": PERIOD, "step": STEP, "features": features, **more}
    return continuous_source(network, gains, WEIGHTS, **given)


def sampled_loop(network: Network, files: dict[str, str], features=BARE, **more) -> CampaignSource:
    return sampled_source(network, files, WEIGHTS, **{"step": STEP, "features": features, **more})


def emitted(graph: Graph, gains: Gains = PUBLISHED, **options) -> dict[str, str]:
    heard = [[Neighbour(f"arm{j}", w) for i, j, w in graph.edges if i == k] for k in range(1, gains.N + 1)]
    agents = [
        Controller(f"arm{i + 1}", gains.A[i], gains.B[i], gains.C[i], gains.D[i], tuple(heard[i]))
        for i in range(gains.N)
    ]
    return emit(CodegenSpec(tuple(agents), PERIOD, name="arms", **options))


def reference(files: dict[str, str], delay=0):
    """The controllers of a folder's C for the simulation of the model layer."""
    return reference_controllers(Manifest.model_validate_json(files[FILE_NAME]), delay=delay)


def some_runs(engine: Engine, count: int, seed: int = 1) -> Batch:
    """Runs that differ in everything a run can differ in."""
    random, layout = np.random.default_rng(seed), engine.layout
    rows = layout.rows(count)
    for place in layout.places.values():
        rows[:, place] = random.normal(size=(count, place.stop - place.start))
    rows[:, layout.places["start"]] = random.uniform(0, 0.3, (count, 1))
    rows[:, layout.places["stop"]] = random.uniform(0.5, 0.9, (count, 1))
    rows[:, layout.places["hann"]] = random.integers(0, 2, (count, 1))
    if "drop" in layout.places:
        rows[:, layout.places["drop"]] = random.uniform(0, 0.5, (count, 1))
    sequences = random.normal(size=(3, layout.periods(HORIZON), layout.N * layout.n))
    seeds = random.integers(0, 2**63, count).astype(np.uint64)
    return Batch(layout, rows, seeds, random.integers(-1, 3, count), sequences)


@dataclass(frozen=True)
class OneRun:
    """A batch of one run, and the same for the model layer: held samples, a sine and a constant."""

    batch: Batch
    start: np.ndarray
    xi: Sum

    def scenario(self, **more) -> Scenario:
        return Scenario(self.start, HORIZON, STEP, self.xi, substeps=1, **more)


def one_run(engine: Engine) -> OneRun:
    random, N, n = np.random.default_rng(3), 3, 4
    start, a, b, c = random.normal(size=(4, N, n))
    held = random.normal(size=(1, engine.layout.periods(HORIZON), N * n))
    on, off, hertz = 0.2, 0.8, 1.7
    batch = Batch.at_rest(
        engine.layout,
        1,
        sequences=held,
        x=start.ravel(),
        bias=c.ravel(),
        cosine=a.ravel(),
        sine=b.ravel(),
        omega=2 * np.pi * hertz,
        start=on,
        stop=off,
    )
    values, phases = np.hypot(a, b), np.arctan2(a, b) - 2 * np.pi * hertz * -on
    sines = Sines(values, phases, hertz, on, off)
    return OneRun(batch, start, Sum((Samples(held[0].reshape(-1, N, n), PERIOD), sines, Steps(c))))


def on_disagreement(signal, R):
    """sum_i e_i' R e_i with e_i = signal_i - mean, at each instant."""
    e = signal - signal.mean(axis=1, keepdims=True)
    return np.einsum("kia,ab,kib->k", e, R, e)


def assert_same_run(found, trajectory, tolerance):
    assert found.states[0] == pytest.approx(trajectory.x[-1], rel=tolerance, abs=tolerance)
    d = trajectory.disagreement()
    assert found["disagreement_initial"][0] == pytest.approx(d[0], rel=1e-12)
    assert found["disagreement_final"][0] == pytest.approx(d[-1], rel=tolerance, abs=tolerance)
    assert found["disagreement_peak"][0] == pytest.approx(d.max(), rel=tolerance)
    for one, expected in zip(found.indices[0], indices(trajectory), strict=True):
        assert one == pytest.approx(list(expected.document().values()), rel=tolerance)
    # Simpson's rule of the steps against the trapezoidal one: (omega h)^2 / 12 with omega some 20 rad/s.
    entered = on_disagreement(trajectory.xi, np.eye(4))
    assert found["w_squared"][0] == pytest.approx(np.trapezoid(entered, trajectory.t), rel=2e-3), (
        "xi jumps at the ends of the window: the trapezoidal rule is off by half a step there"
    )
