"""The reference: against a slow twin of scalars, and its policies for lost, strange and huge values."""

import numpy as np
import pytest
from codegen_cases import arms, shapes

from lockstep.check.errors import ProblemError
from lockstep.codegen.emission.emit import emit
from lockstep.codegen.manifest import Manifest
from lockstep.verification.reference import NOT_FINITE, OK, OVERFLOW, Reference, closed_loop
from lockstep.verification.stimulus import recorded_outputs


def manifest_of(spec):
    return Manifest.model_validate_json(emit(spec)["manifest.json"])


def slow_row(row, z, skip):
    """One sum, scalar by scalar, left to right, as the generated C spells it."""
    terms = [a * v for a, v in zip(row, z, strict=True) if a != 0 or not skip]
    if not terms or not skip:
        terms = [row.dtype.type(0), *terms]  # the loop starts from +0
    total = terms[0]
    for term in terms[1:]:
        total = total + term
    return total


@pytest.mark.parametrize("real", ["float32", "float64"])
@pytest.mark.parametrize("optimize", ["speed", "size"])
def test_equals_a_slow_twin_to_the_bit(real, optimize):
    manifest = manifest_of(shapes([0, 1, 4], [1, 3], [1, 2], real=real, optimize=optimize))
    random = np.random.default_rng(0)
    dtype = manifest.real_type.dtype
    for agent in manifest.agents:
        reference = Reference.of(agent, manifest)
        for _ in range(20):
            r = random.normal(size=reference.outputs).astype(dtype)
            z = np.concatenate([reference.state.x, r])
            expected = np.array([slow_row(row, z, optimize == "speed") for row in reference.M])
            status, u = reference.step_relative(r)
            assert status == OK
            assert np.concatenate([reference.state.x, u]).tobytes() == expected.tobytes()


@pytest.fixture
def reference():
    manifest = manifest_of(arms())
    return Reference.of(manifest.agents[0], manifest)


def f32(*values):
    return np.array(values, np.float32)


def test_the_laplacian_row_is_the_sum_of_weighted_differences():
    manifest = manifest_of(shapes([2], [2], [1], real="float64"))
    by_step, by_r = (Reference.of(manifest.agents[0], manifest) for _ in range(2))
    y, others = np.array([1.0, -2.0]), np.array([[0.25, 0.5]])
    expected = manifest.agents[0].neighbours[0].weight * (y - others[0])
    assert by_step.step(y, others, 1)[1].tolist() == by_r.step_relative(expected)[1].tolist()


def test_a_neighbour_never_heard_adds_nothing(reference):
    status, u = reference.step(f32(1, 2), f32(np.nan, np.nan)[None], 0)
    assert (status, u.tolist()) == (OK, [0.0])
    assert (reference.state.age, reference.state.misses) == ([1], [1])


def test_a_lost_message_repeats_the_last_one_and_is_counted(reference):
    reference.step(f32(1, 2), f32(0.5, 0.5)[None], 1)
    twin = Reference(reference.M, reference.weights, 2, True)
    twin.step(f32(1, 2), f32(0.5, 0.5)[None], 1)
    lost, heard = reference.step(f32(1, 1), f32(9, 9)[None], 0), twin.step(f32(1, 1), f32(0.5, 0.5)[None], 1)
    assert lost[1].tobytes() == heard[1].tobytes()
    assert (reference.state.age, reference.state.misses, twin.state.misses) == ([1], [1], [0])
    reference.step(f32(1, 1), f32(0, 0)[None], 1)
    assert (reference.state.age, reference.state.misses) == ([0], [1])


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_strange_input_changes_nothing(reference, bad):
    _, last = reference.step(f32(1, 2), f32(0.5, 0.5)[None], 1)
    before = reference.state.x.copy()
    for call in (
        lambda: reference.step(f32(bad, 0), f32(0, 0)[None], 1),
        lambda: reference.step_relative(f32(bad, 0)),
    ):
        status, u = call()
        assert (status, u.tolist()) == (NOT_FINITE, last.tolist())
        assert reference.state.x.tolist() == before.tolist() and reference.state.held.tolist() == [[0.5, 0.5]]


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_strange_message_is_one_that_is_missing(reference, bad):
    """Else one dead sensor freezes every agent that hears it."""
    twin = Reference(reference.M, reference.weights, 2, True)
    for _ in range(2):  # before it was heard, and after
        for one, mask in ((reference, 1), (twin, 0)):
            assert one.step(f32(1, 2), f32(0, bad)[None], mask)[0] == OK
        assert vars(reference.state) | {"x": 0, "u": 0, "held": 0} == vars(twin.state) | {
            "x": 0,
            "u": 0,
            "held": 0,
        }
        assert reference.state.age[0] > 0
        np.testing.assert_array_equal(reference.state.u, twin.state.u)
        np.testing.assert_array_equal(reference.state.held, twin.state.held)
        for one in (reference, twin):
            one.step(f32(1, 2), f32(0.5, 0.5)[None], 1)


def test_finite_inputs_that_overflow_change_nothing(reference):
    huge = np.finfo(np.float32).max
    assert reference.step(f32(huge, 0), f32(-huge, 0)[None], 1)[0] == OVERFLOW
    assert reference.state.x.tolist() == [0, 0] and reference.state.heard == [False]
    assert reference.step(f32(huge / 4, 0), f32(-huge / 4, 0)[None], 1)[0] == OK


def test_reset_keeps_the_misses_and_init_does_not(reference):
    reference.step(f32(1, 2), f32(0, 0)[None], 0)
    reference.reset()
    assert (reference.state.misses, reference.state.age) == ([1], [0])
    reference.init()
    assert reference.state.misses == [0]


def test_the_plants_close_the_loop_and_the_arms_come_together():
    """The paper's point on the linear part: disagreement falls; without the controllers it does not."""
    manifest = manifest_of(arms(real="float64"))
    y = np.stack(recorded_outputs(manifest, 4000), axis=1)

    def disagreement(row):
        return np.abs(row - row.mean(axis=0)).max()

    assert disagreement(y[-1]) < 0.01 * disagreement(y[0])
    still = closed_loop(manifest, lambda _: y[0], y[0], 10)
    assert disagreement(np.stack(still, axis=1)[-1]) == disagreement(y[0])


def test_a_loop_needs_every_neighbour():
    manifest = manifest_of(shapes([1], [1], [1]))
    with pytest.raises(ProblemError, match="no agent"):
        closed_loop(manifest, lambda _: [[0.0]], np.zeros((1, 1)), 3)
