"""The compiled loop against the simulation of the model layer, and against itself in other company."""

import ctypes
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from codegen_cases import TABLE_1, random_controller

from lockstep.codegen.campaign import library
from lockstep.codegen.campaign.disturbance import DROPS, NOISE, disturbance, gaussians, random_unit
from lockstep.codegen.campaign.engine import Batch, Engine
from lockstep.codegen.campaign.functions import Weights
from lockstep.codegen.campaign.lanes import LANES, lanes_header
from lockstep.codegen.campaign.layout import Features
from lockstep.codegen.campaign.source import continuous_source, sampled_source
from lockstep.codegen.campaign.statements import lane_function
from lockstep.codegen.emit import emit
from lockstep.codegen.in_the_loop import reference_controllers
from lockstep.codegen.manifest import FILE_NAME, Manifest
from lockstep.codegen.spec import CodegenSpec, Controller, Neighbour
from lockstep.codegen.toolchain import host_compilers, run
from lockstep.model.agent import Agent
from lockstep.model.errors import ProblemError
from lockstep.model.graph import Graph
from lockstep.model.loop import Gains
from lockstep.model.network import Network
from lockstep.model.problem import load_problem
from lockstep.model.simulation.disturbance import Samples, Sines, Steps, Sum
from lockstep.model.simulation.indices import indices
from lockstep.model.simulation.perturbation import HeldPerturbation
from lockstep.model.simulation.run import simulate
from lockstep.model.simulation.scenario import Scenario

STEP, PERIOD, HORIZON = 1e-3, 5e-3, 1.0
WEIGHTS = Weights(np.diag([1.0, 0.5, 2.0, 1.0]), np.array([[2.0, 0.3], [0.3, 1.0]]))
DELTA = {"A": 0.5, "B": 0.2, "C": 0.2, "D": 0.2}
PUBLISHED = Gains(*(tuple(np.array(agent[k]) for agent in TABLE_1) for k in range(4)))

# Both are RK4 with the same steps; sums are taken in another order, and the loop amplifies what rounding leaves.
SAME = 1e-10
# Messages are rounded to float32 (6e-8): where rounding to double falls on the other side of a float32's boundary
# the messages differ by that, of angles and rates up to 10.
SAME_MESSAGES = 2e-5


@pytest.fixture(scope="module")
def arms(examples) -> Network:
    problem = load_problem(examples / "flexible_joint_arms.toml")
    return Network(problem.agent(), problem.graph(), problem.agents_B())


def emitted(gains: Gains, graph: Graph, **options) -> dict[str, str]:
    heard = [[Neighbour(f"arm{j}", w) for i, j, w in graph.edges if i == k] for k in range(1, gains.N + 1)]
    agents = [
        Controller(f"arm{i + 1}", gains.A[i], gains.B[i], gains.C[i], gains.D[i], tuple(heard[i]))
        for i in range(gains.N)
    ]
    return emit(CodegenSpec(tuple(agents), PERIOD, name="arms", **options))


@pytest.fixture(scope="module")
def continuous(arms):
    features = Features(waves=True, noise=True, sequences=True, uncertain=True)
    source = continuous_source(
        arms, PUBLISHED, WEIGHTS, period=PERIOD, step=STEP, fragility=DELTA, features=features
    )
    return Engine(source)


@pytest.fixture(scope="module")
def sampled(arms):
    features = Features(waves=True, noise=True, sequences=True, drops=True)
    return Engine(sampled_source(arms, emitted(PUBLISHED, arms.graph), WEIGHTS, step=STEP, features=features))


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


def scenario(start, xi, **more):
    return Scenario(start, HORIZON, STEP, xi, substeps=1, **more)


def parts(engine: Engine, seed: int = 3):
    """A batch of one run, and its disturbance for the model layer: held samples, a sine and a constant."""
    random, N, n = np.random.default_rng(seed), 3, 4
    start, a, b, c = random.normal(size=(4, N, n))
    held = random.normal(size=(1, engine.layout.periods(HORIZON), N * n))
    on, off, hertz = 0.2, 0.8, 1.7
    values, phases = np.hypot(a, b), np.arctan2(a, b) - 2 * np.pi * hertz * -on
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
    xi = Sum((Samples(held[0].reshape(-1, N, n), PERIOD), Sines(values, phases, hertz, on, off), Steps(c)))
    return start, batch, xi


def test_continuous_controllers_with_errors_of_their_gains(arms, continuous):
    start, batch, xi = parts(continuous)
    E = np.random.default_rng(5).normal(size=(3, 3, 4)) * 0.1
    letters = [E[:, :2, :2], E[:, :2, 2:], E[:, 2:, :2], E[:, 2:, 2:]]
    flat = np.concatenate([block[i].ravel() for i in range(3) for block in letters])
    place = continuous.layout.places["delta"]
    batch.rows[0, place] = np.concatenate([flat, np.zeros_like(flat)])
    expected = simulate(arms, PUBLISHED, scenario(start, xi, perturbation=HeldPerturbation(E[None])))
    found = continuous.run(batch, HORIZON)
    assert_same_run(found, expected, SAME)
    assert found["effort_peak"][0] == pytest.approx(np.abs(expected.u[:-1]).max(), rel=SAME)
    x_C = np.einsum("kia,ab,kib->k", expected.x_C, WEIGHTS.Q, expected.x_C)
    z = np.trapezoid(on_disagreement(expected.x, WEIGHTS.R) + x_C, expected.t)
    assert found["z_squared"][0] == pytest.approx(z, rel=1e-4), "(omega h)^2 / 12 with omega up to 20 rad/s"
    batch.rows[0, place] = 0.0
    assert continuous.run(batch, HORIZON).states[0] != pytest.approx(expected.x[-1], rel=1e-4)


def test_a_delta_that_turns(arms, continuous):
    # Delta(t) = cos(nu t) E_1 + sin(nu t) E_2 against the same errors as a function of time.
    E = np.random.default_rng(6).normal(size=(2, 3, 3, 4)) * 0.1

    class Turning:
        def at(self, t, since):  # noqa: ARG002
            c, s = np.cos(7.0 * t), np.sin(7.0 * t)
            return c[:, None, None, None] * E[0] + s[:, None, None, None] * E[1]

    start, batch, xi = parts(continuous)
    blocks = [[e[:, :2, :2], e[:, :2, 2:], e[:, 2:, :2], e[:, 2:, 2:]] for e in E]
    flat = [block[i].ravel() for one in blocks for i in range(3) for block in one]
    batch.rows[0, continuous.layout.places["delta"]] = np.concatenate(flat)
    batch.rows[0, continuous.layout.places["nu"]] = 7.0
    expected = simulate(arms, PUBLISHED, scenario(start, xi, perturbation=Turning()))
    assert_same_run(continuous.run(batch, HORIZON), expected, SAME)


def test_the_c_that_ships(arms, sampled):
    start, batch, xi = parts(sampled)
    manifest = Manifest.model_validate_json(emitted(PUBLISHED, arms.graph)[FILE_NAME])
    expected = simulate(arms, reference_controllers(manifest), scenario(start, xi))
    found = sampled.run(batch, HORIZON)
    assert_same_run(found, expected, SAME_MESSAGES)
    # What the sampled certificate charges: x_C at the sampling instants, held for a period.
    x_C = expected.x_C[:-1:5]
    charged = PERIOD * np.einsum("kia,ab,kib->", x_C, WEIGHTS.Q, x_C)
    z = np.trapezoid(on_disagreement(expected.x, WEIGHTS.R), expected.t) + charged
    assert found["z_squared"][0] == pytest.approx(z, rel=1e-4)
    other = simulate(arms, PUBLISHED, scenario(start, xi))
    assert found.states[0] != pytest.approx(other.x[-1], rel=1e-6), "continuous controllers differ"


@pytest.mark.parametrize("options", [{"real": "float64"}, {"optimize": "size"}])
def test_other_kinds_of_emitted_c(arms, options):
    files = emitted(PUBLISHED, arms.graph, **options)
    engine = Engine(
        sampled_source(arms, files, WEIGHTS, step=STEP, features=Features(waves=True, sequences=True))
    )
    start, batch, xi = parts(engine)
    manifest = Manifest.model_validate_json(files[FILE_NAME])
    expected = simulate(arms, reference_controllers(manifest), scenario(start, xi))
    tolerance = SAME if "real" in options else SAME_MESSAGES
    assert_same_run(engine.run(batch, HORIZON), expected, tolerance)


def test_one_period_late(arms):
    files, features = emitted(PUBLISHED, arms.graph), Features(waves=True, sequences=True)
    late = Engine(sampled_source(arms, files, WEIGHTS, step=STEP, delay=1, features=features))
    start, batch, xi = parts(late)
    controllers = reference_controllers(Manifest.model_validate_json(files[FILE_NAME]), delay=1)
    found = late.run(batch, HORIZON)
    assert_same_run(found, simulate(arms, controllers, scenario(start, xi)), SAME_MESSAGES)
    prompt = Engine(sampled_source(arms, files, WEIGHTS, step=STEP, features=features)).run(batch, HORIZON)
    assert found.states != pytest.approx(prompt.states, rel=1e-4)


def test_static_controllers_and_a_leader_of_other_agents():
    # Order 0, two inputs, an agent that hears nobody, weights of their own, a domain that is left.
    agent = Agent.from_expressions(
        "cart",
        states=["p", "v"],
        inputs=["f", "g"],
        outputs={"y1": "p", "y2": "v"},
        dynamics={"p": "v + 0.1*g", "v": "f - tanh(p)*exp(-v**2) + if_else(p > 1, 0.5, 0)*cos(t)"},
        domain={"p": (-1.5, 1.5)},
    )
    graph = Graph.from_edges(3, [(2, 1, 0.7), (3, 2, 1.3), (3, 1, 1.0)])
    network = Network(agent, graph)
    D = np.random.default_rng(0).normal(size=(2, 2)) - 2 * np.eye(2)
    gains = Gains(*((np.zeros(shape),) * 3 for shape in ((0, 0), (0, 2), (2, 0))), (D,) * 3)
    files = emitted(gains, graph, real="float64")
    weights = Weights(np.eye(2), np.zeros((0, 0)))
    engine = Engine(sampled_source(network, files, weights, step=STEP, features=Features()))
    start = np.array([[2.0, 0.1], [-0.3, 0.2], [0.4, -0.5]])
    found = engine.run(Batch.at_rest(engine.layout, 1, x=start.ravel()), HORIZON)
    controllers = reference_controllers(Manifest.model_validate_json(files[FILE_NAME]))
    expected = simulate(network, controllers, Scenario(start, HORIZON, STEP, substeps=1))
    assert found.states[0] == pytest.approx(expected.x[-1], rel=SAME)
    assert found["outside"][0] == np.sum(np.abs(expected.x[:-1, :, 0]).max(axis=1) > 1.5) > 0
    inside = Batch.at_rest(engine.layout, 1, x=start.ravel() / 2)
    assert engine.run(inside, HORIZON)["outside"][0] == 0


@pytest.mark.parametrize("kind", ["continuous", "sampled"])
def test_a_run_does_not_depend_on_its_company(kind, request):
    engine = request.getfixturevalue(kind)
    batch = some_runs(engine, 2 * LANES + 3)
    together = engine.run(batch, HORIZON).table
    assert np.isfinite(together).all()
    assert len(np.unique(together[:, 1])) == len(batch), "the runs differ, so mixing them up would show"
    for k in (0, LANES - 1, LANES, len(batch) - 1):
        alone = engine.run(batch.part(k, k + 1), HORIZON).table
        assert alone.tobytes() == together[k : k + 1].tobytes(), f"run {k}"
    assert engine.run(batch, HORIZON, threads=2).table.tobytes() == together.tobytes()


def test_every_compiler_gives_the_same_bits(sampled, monkeypatch):
    # Nothing is contracted or reordered, so neither the compiler nor the width of the registers shows.
    batch, tables = some_runs(sampled, LANES), []
    for compiler in host_compilers():
        for machine in (library.FOR_THIS_MACHINE, ()):
            monkeypatch.setattr(library, "FOR_THIS_MACHINE", machine)
            path = library.compiled(sampled.source, compiler)
            monkeypatch.setattr(
                "lockstep.codegen.campaign.engine.load", lambda _, path=path: library.function_in(path)
            )
            tables.append(sampled.run(batch, HORIZON).table.tobytes())
    assert len(tables) >= 2
    assert len(set(tables)) == 1


def test_noise_is_of_its_seed(sampled):
    layout, periods = sampled.layout, sampled.layout.periods(HORIZON)
    seeds = np.array([7, 7, 8], np.uint64)
    noisy = sampled.run(Batch.at_rest(layout, 3, seeds=seeds, sigma=0.3), HORIZON)
    assert noisy.table[0].tobytes() == noisy.table[1].tobytes()
    assert noisy.states[0] != pytest.approx(noisy.states[2], rel=1e-2)
    given = 0.3 * gaussians(7, periods, 12)[None]
    told = sampled.run(Batch.at_rest(layout, 1, sequences=given), HORIZON)
    # NumPy's and C's logarithm may differ in the last bit.
    assert noisy.states[0] == pytest.approx(told.states[0], rel=SAME_MESSAGES)
    assert noisy["w_squared"][0] == pytest.approx(told["w_squared"][0], rel=1e-12)


def test_the_noise_is_white_and_gaussian():
    found = gaussians(3, 20_000, 5)
    count = found.size
    # Six standard errors: mean 1, variance 2, third moment 15, fourth 96 per sample.
    assert abs(found.mean()) < 6 / np.sqrt(count)
    assert abs(found.var() - 1) < 6 * np.sqrt(2 / count)
    assert abs((found**3).mean()) < 6 * np.sqrt(15 / count)
    assert abs((found**4).mean() - 3) < 6 * np.sqrt(96 / count)
    correlation = np.corrcoef(np.hstack([found[:-1], found[1:]]).T) - np.eye(10)
    assert np.abs(correlation).max() < 6 / np.sqrt(len(found))
    place = np.arange(1000, dtype=np.uint64)
    assert abs(np.corrcoef(random_unit(1, NOISE, place), random_unit(1, DROPS, place))[0, 1]) < 6 / np.sqrt(
        1000
    )


def test_messages_that_do_not_arrive(sampled):
    random = np.random.default_rng(2)
    start = random.normal(size=12)
    rates = [0.0, 0.0, 0.5, 0.5, 1.0]
    seeds = np.array([1, 2, 1, 2, 1], np.uint64)
    found = sampled.run(Batch.at_rest(sampled.layout, 5, x=start, seeds=seeds, drop=np.array(rates)), HORIZON)
    assert found.table[0].tobytes() == found.table[1].tobytes(), "nothing is drawn of nothing"
    assert found["disagreement_final"][2] != found["disagreement_final"][3]
    # Nobody is ever heard: r = 0, and the controllers, which start at zero, do nothing.
    assert found["effort_peak"][4] == 0
    assert found["effort_peak"][0] > 0


def test_a_trace_is_the_run(sampled):
    batch = some_runs(sampled, 3)
    whole, layout = sampled.run(batch, HORIZON), sampled.layout
    trace = sampled.trace(batch.part(1, 2), HORIZON)
    assert trace["x"].shape == (1001, 3, 4)
    assert trace["t"][-1] == pytest.approx(HORIZON)
    assert trace["x"][-1].tobytes() == whole.states[1].tobytes()
    assert np.abs(trace["u"][:-1]).max() == whole["effort_peak"][1]
    xi = disturbance(batch, 1, layout.periods(HORIZON))
    assert xi.shape == (1001, 3, 4)
    e = trace["x"] - trace["x"].mean(axis=1, keepdims=True)
    assert np.sqrt((e**2).sum(axis=(1, 2))).max() == pytest.approx(whole["disagreement_peak"][1], rel=1e-12)


def test_divergence_is_seen_and_stays_with_its_run(arms):
    wild = Gains(PUBLISHED.A, PUBLISHED.B, PUBLISHED.C, tuple(-40 * D for D in PUBLISHED.D))
    source = continuous_source(arms, wild, WEIGHTS, period=PERIOD, step=STEP, features=Features())
    start = np.zeros((LANES, 12))
    start[2, 0] = start[5, 0] = 1.0
    found = Engine(source).run(Batch.at_rest(source.layout, LANES, x=start), 20.0)
    assert found.diverged.tolist() == [k in (2, 5) for k in range(LANES)]
    assert 0 < found["ended"][2] <= 20.0
    assert (found["disagreement_peak"][[0, 1, 3]] == 0).all()


def test_a_step_divides_the_period(arms):
    for step, substeps in ((1e-3, 5), (0.0011, 5), (0.02, 1), (0.0007, 8)):
        source = continuous_source(arms, PUBLISHED, WEIGHTS, period=PERIOD, step=step, features=Features())
        assert source.layout.substeps == substeps
        assert source.layout.step <= step
    with pytest.raises(ProblemError, match="step is -1"):
        continuous_source(arms, PUBLISHED, WEIGHTS, period=PERIOD, step=-1.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda b: {"rows": b.rows[:, 1:]}, "rows"),
        (lambda b: {"which": b.which + 3}, "names sequence"),
        (lambda b: {"sequences": b.sequences[:, :, 1:]}, "sequences"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(sampled, change, message):
    batch = some_runs(sampled, 4)
    fields = {name: getattr(batch, name) for name in ("layout", "rows", "seeds", "which", "sequences")}
    assert len(Batch(**fields)) == 4
    with pytest.raises(ProblemError, match=message):
        Batch(**{**fields, **change(batch)})


def test_what_does_not_fit_together_is_refused(arms, sampled):
    files = emitted(PUBLISHED, arms.graph)
    with pytest.raises(ProblemError, match="Delta"):
        sampled_source(arms, files, WEIGHTS, step=STEP, features=Features(uncertain=True))
    with pytest.raises(ProblemError, match="dropped"):
        continuous_source(arms, PUBLISHED, WEIGHTS, period=PERIOD, step=STEP, features=Features(drops=True))
    other = emit(CodegenSpec((random_controller("c", 2, 2, 1, neighbours=0),), PERIOD, name="other"))
    with pytest.raises(ProblemError, match="1 controllers"):
        sampled_source(arms, other, WEIGHTS, step=STEP)
    with pytest.raises(ProblemError, match="200 periods"):
        sampled.run(some_runs(sampled, 1), 2 * HORIZON)
    with pytest.raises(ProblemError, match="no parameter"):
        Batch.at_rest(sampled.layout, 1, delta=0.1)


def test_without_a_compiler_it_says_what_to_install(arms, monkeypatch):
    source = continuous_source(arms, PUBLISHED, WEIGHTS, period=PERIOD, step=STEP, features=Features())
    monkeypatch.setattr(library, "host_compilers", list)
    with pytest.raises(ProblemError, match=r"no C compiler.*toolchain"):
        library.compiled(source)


def test_compiled_once_and_whole(arms, monkeypatch, tmp_path):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    source = continuous_source(arms, PUBLISHED, WEIGHTS, period=PERIOD, step=STEP, features=Features())
    first = library.compiled(source)
    stamp = first.stat().st_mtime_ns
    assert library.compiled(source) == first
    assert first.stat().st_mtime_ns == stamp
    assert [path.name for path in first.parent.iterdir()] == [first.name], "nothing half-written is left"
    other = continuous_source(arms, PUBLISHED, WEIGHTS, period=PERIOD, step=2 * STEP, features=Features())
    assert library.compiled(other) != first
    first.parent.chmod(0o777)
    assert library.cache_folder() != first.parent, "others could put a library there"


TRY = """
#include "campaign-lanes.h"
{function}
void try_it(const double *in, double *out);
void try_it(const double *in, double *out)
{{
    v x[{n}], y[{m}];
    memcpy(x, in, sizeof x);
    f(x, y);
    memcpy(out, y, sizeof y);
}}
"""


def by_lanes(x: ca.SX, y: ca.SX, values: np.ndarray, directory: Path) -> np.ndarray:
    """Evaluate y(x) on lanes: values (any, LANES, n) to (any, LANES, m)."""
    f = lane_function("f", [x], [y], "x y")
    body = "\n".join(["static void f(" + f.signature + ")", "{", *f.lines, "}"])
    (directory / "campaign-lanes.h").write_text(lanes_header())
    (directory / "try.c").write_text(TRY.format(function=body, n=x.numel(), m=y.numel()))
    flags = [flag for flag in library.FLAGS if not flag.startswith("-W")]
    run([*host_compilers()[0].command, *flags, "try.c", "-o", "try.so", "-lm"], directory, "compiling", 60)
    try_it = ctypes.CDLL(str(directory / "try.so")).try_it
    found = np.empty((len(values), y.numel(), LANES))
    for out, row in zip(found, values, strict=True):
        given = np.ascontiguousarray(row.T)
        try_it(given.ctypes.data_as(ctypes.c_void_p), out.ctypes.data_as(ctypes.c_void_p))
    return found.transpose(0, 2, 1)


def test_sine_and_cosine(tmp_path):
    x = ca.SX.sym("x", 25)
    random, shape = np.random.default_rng(0), (20, LANES, 25)
    values = random.uniform(-4, 4, shape)
    values[5:15] = (
        np.pi / 2 * random.integers(-1000, 1000, (10, LANES, 25)) + random.normal(size=(10, LANES, 25)) * 1e-8
    )
    values[15:] = random.uniform(-2e6, 2e6, (5, LANES, 25))
    values[0, 0, :4], values[0, 1, 0] = [np.inf, -np.inf, np.nan, -0.0], 1e300
    found = by_lanes(x, ca.vertcat(ca.sin(x), ca.cos(x)), values, tmp_path)
    with np.errstate(invalid="ignore"):
        expected = np.concatenate([np.sin(values), np.cos(values)], axis=2)
    # One rounding of the result, one of the reduced angle, and NumPy's own: each half an ulp of 1, a little more.
    assert np.allclose(found, expected, rtol=0, atol=3 * 2.0**-53, equal_nan=True)
    assert not np.isfinite(found[0, 0, :3]).any()
    assert np.isfinite(found[1:]).all()


def test_every_function_that_a_problem_may_hold(tmp_path):
    x = ca.SX.sym("x", 3)
    a, b, c = ca.vertsplit(x)
    u = ca.tanh(a) * 0.9
    y = ca.vertcat(
        *(ca.tan(a), ca.asin(u), ca.acos(u), ca.atan(b), ca.atan2(a, b), ca.sinh(a), ca.cosh(b), ca.tanh(c)),
        *(
            ca.exp(a),
            ca.log(ca.fabs(b)),
            ca.sqrt(ca.fabs(c)),
            ca.fmin(a, b),
            ca.fmax(a, b),
            ca.sign(a),
            ca.sign(0 * a),
        ),
        *(ca.if_else(a < b, c, -c), ca.if_else(ca.logic_and(a <= b, b >= c), a, b), ca.if_else(a == a, 1, 2)),
        *(
            ca.fabs(a) ** 1.7,
            ca.fabs(a) ** b,
            a**2,
            a**3,
            1 / b,
            a / c,
            ca.floor(a),
            ca.ceil(a),
            ca.fmod(a, 0.3),
        ),
        *(
            ca.logic_or(a > 0, b > 0),
            ca.logic_not(a > 0),
            a != b,
            ca.erf(a),
            ca.copysign(a, b),
            2.5 - a,
            -a,
            a + a,
        ),
        *(ca.asinh(a), ca.acosh(1 + b * b), ca.atanh(u), ca.log1p(b * b), ca.expm1(a), ca.hypot(a, b)),
    )
    values = np.random.default_rng(1).normal(size=(LANES, 3)) * 2
    expected = np.array([np.array(ca.Function("f", [x], [y])(row)).ravel() for row in values])
    assert np.isfinite(expected).all()
    # The same operations from the same C library, but for sin and cos.
    assert by_lanes(x, y, values[None], tmp_path)[0] == pytest.approx(expected, rel=1e-14, abs=1e-15)
    with pytest.raises(ProblemError, match="operation"):
        lane_function(
            "f", [x], [ca.SX.remainder(a, b) if hasattr(ca.SX, "remainder") else ca.remainder(a, b)], "x y"
        )
