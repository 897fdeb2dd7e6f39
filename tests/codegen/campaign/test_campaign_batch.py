"""Batches of runs: each is the run it would be alone, and what does not fit together is refused."""

from dataclasses import replace

import numpy as np
import pytest
from campaign_cases import HORIZON, PERIOD, PUBLISHED, continuous_loop, emitted, sampled_loop, some_runs
from codegen_cases import random_controller

from lockstep.campaign.compiled.engine import Batch, Engine
from lockstep.campaign.compiled.lanes import LANES
from lockstep.campaign.compiled.layout import Features
from lockstep.campaign.disturbance import disturbance
from lockstep.check.errors import ProblemError
from lockstep.check.system.loop import Gains
from lockstep.codegen.emission.emit import emit
from lockstep.codegen.spec import CodegenSpec


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


@pytest.mark.parametrize("kind", ["continuous", "sampled"])
def test_a_trace_is_the_beginning_of_a_longer_one(kind, request):
    """At its last instant too, where u is that of the controllers there and not the one before."""
    engine = request.getfixturevalue(kind)
    batch = some_runs(engine, 1)
    twice = replace(batch, sequences=np.concatenate([batch.sequences] * 2, axis=1))
    short, long = engine.trace(batch, HORIZON), engine.trace(twice, 2 * HORIZON)
    for name, values in short.items():
        assert values.tobytes() == long[name][: len(values)].tobytes(), name
    assert (short["u"][-1] != short["u"][-2]).any()


def test_divergence_is_seen_and_stays_with_its_run(arms_network):
    wild = Gains(PUBLISHED.A, PUBLISHED.B, PUBLISHED.C, tuple(-40 * D for D in PUBLISHED.D))
    source = continuous_loop(arms_network, wild)
    start = np.zeros((LANES, 12))
    start[2, 0] = start[5, 0] = 1.0
    found = Engine(source).run(Batch.at_rest(source.layout, LANES, x=start), 20.0)
    assert found.diverged.tolist() == [k in (2, 5) for k in range(LANES)]
    assert 0 < found["ended"][2] <= 20.0
    assert (found["disagreement_peak"][[0, 1, 3]] == 0).all()


def test_a_step_divides_the_period(arms_network):
    for step, substeps in ((1e-3, 5), (0.0011, 5), (0.02, 1), (0.0007, 8)):
        source = continuous_loop(arms_network, step=step)
        assert source.layout.substeps == substeps
        assert source.layout.step <= step
    with pytest.raises(ProblemError, match="step is -1"):
        continuous_loop(arms_network, step=-1.0)


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


def test_what_does_not_fit_together_is_refused(arms_network, sampled):
    files = emitted(arms_network.graph)
    with pytest.raises(ProblemError, match="Delta"):
        sampled_loop(arms_network, files, Features(uncertain=True))
    with pytest.raises(ProblemError, match="dropped"):
        continuous_loop(arms_network, features=Features(drops=True))
    other = emit(CodegenSpec((random_controller("c", 2, 2, 1, neighbours=0),), PERIOD, name="other"))
    with pytest.raises(ProblemError, match="1 controllers"):
        sampled_loop(arms_network, other)
    with pytest.raises(ProblemError, match="200 periods"):
        sampled.run(some_runs(sampled, 1), 2 * HORIZON)
    with pytest.raises(ProblemError, match="no parameter"):
        Batch.at_rest(sampled.layout, 1, delta=0.1)
