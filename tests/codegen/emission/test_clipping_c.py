"""C that clips: equal to the bit with its reference, read by the checker, absent where nothing is limited; and the bench."""

import re
import tempfile
from pathlib import Path

import numpy as np
import pytest

from lockstep.check.c_source.reader import read_controller
from lockstep.check.errors import NotCertified, ProblemError
from lockstep.codegen.emission.calls import Operation
from lockstep.codegen.emission.emit import emit
from lockstep.codegen.manifest import Manifest
from lockstep.codegen.spec import CodegenSpec, Controller, Neighbour
from lockstep.verification.harness import run_on_host
from lockstep.verification.reference import CLIPPED, NOT_FINITE, OK, Reference
from lockstep.verification.stimulus import Calls, adversarial_calls, limit_calls, run_reference
from lockstep.verification.toolchain import first_compiler

A = [[-3.0, 1.0], [0.0, -2.0]]
B = [[1.0, 0.5], [0.2, -1.0]]
C = [[-1.0, 0.3], [0.5, 2.0]]
D = [[-1.5, -1.0], [0.7, -40.0]]
LIMITS = [[-0.1, 0.3], [-np.inf, 5.0]]


def spec(real="float32", optimize="speed", limits=LIMITS, alone=False) -> CodegenSpec:
    heard = () if alone else (Neighbour("b"),)
    agents = [Controller("a", A, B, C, D, heard, limits=np.array(limits).reshape(-1, 2))]
    agents += (
        []
        if alone
        else [Controller("b", A, B, C, D, (Neighbour("a", 0.7),), limits=np.array(limits).reshape(-1, 2))]
    )
    return CodegenSpec(tuple(agents), 0.01, real=real, optimize=optimize)


def traces(files: dict[str, str], calls):
    """What the compiled C gives for calls, agent by agent."""
    manifest = Manifest.model_validate_json(files["manifest.json"])
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "made"
        for path, text in files.items():
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (folder / path).write_text(text)
        build = Path(name) / "build"
        build.mkdir()
        compiler = first_compiler("this test")
        flags = ["-O2", "-std=c99", "-ffp-contract=off"]
        return {
            agent.name: run.trace
            for agent, run in run_on_host(
                manifest,
                folder,
                {a.name: calls(manifest, a) for a in manifest.agents},
                build,
                compiler,
                flags,
            )
        }


@pytest.mark.parametrize("alone", [False, True])
@pytest.mark.parametrize("optimize", ["speed", "size"])
@pytest.mark.parametrize("real", ["float32", "float64"])
def test_the_compiled_c_clips_as_its_reference(real, optimize, alone):
    files = emit(spec(real, optimize, alone=alone))
    manifest = Manifest.model_validate_json(files["manifest.json"])
    calls = lambda manifest, agent: limit_calls(manifest, agent) + adversarial_calls(manifest, agent, 2000)  # noqa: E731
    found = traces(files, calls)
    for agent in manifest.agents:
        reference = run_reference(Reference.of(agent, manifest), calls(manifest, agent))
        trace = found[agent.name]
        for name in ("status", "x", "u"):
            np.testing.assert_array_equal(getattr(trace, name), getattr(reference, name), err_msg=name)
        assert (trace.status == CLIPPED).sum() > 10
        sides = agent.sides(manifest.real_type)
        assert (trace.u >= sides[:, 0]).all()
        assert (trace.u <= sides[:, 1]).all()
        assert (trace.u == sides[0, 1]).any(axis=0)[0]


def test_the_limits_are_rounded_towards_zero_and_none_is_the_largest_number():
    files = emit(spec())
    manifest = Manifest.model_validate_json(files["manifest.json"])
    (low, high), (free, most) = manifest.agents[0].sides(manifest.real_type).astype(float)
    assert (low > -0.1, high <= 0.3, free, most) == (True, True, -float(np.finfo(np.float32).max), 5.0)
    assert float(np.nextafter(np.float32(low), np.float32(-1))) < -0.1
    assert "CLIPPED" in files["include/a.h"]


@pytest.mark.parametrize("optimize", ["speed", "size"])
@pytest.mark.parametrize("limits", [[], [[-np.inf, np.inf]] * 2])
def test_without_limits_the_c_is_what_it_was(optimize, limits):
    """No word of clipping in any file, and none in the manifest."""
    files = emit(spec(optimize=optimize, limits=limits))
    code = {path: text for path, text in files.items() if not path.startswith("proof/")}
    assert not [path for path, text in code.items() if re.search("clip|limits|applied", text, re.IGNORECASE)]


def test_what_was_applied_is_held_within_the_limits():
    files = emit(spec(alone=True))
    manifest = Manifest.model_validate_json(files["manifest.json"])
    one = Reference.of(manifest.agents[0], manifest)
    before = one.state.x.copy()
    assert one.applied(np.array([0.2, -7.0], np.float32))[0] == OK
    assert one.applied(np.array([9.0, 9.0], np.float32))[0] == CLIPPED
    np.testing.assert_allclose(one.state.u, [0.3, 5.0], rtol=1e-6)
    assert one.applied(np.array([np.nan, 0.0], np.float32))[0] == NOT_FINITE
    np.testing.assert_allclose(one.state.u, [0.3, 5.0], rtol=1e-6)
    np.testing.assert_array_equal(one.state.x, before, err_msg="the state follows from r alone")
    assert one.step_relative(np.array([np.nan, 0.0], np.float32))[0] == NOT_FINITE
    np.testing.assert_allclose(one.state.u, [0.3, 5.0], rtol=1e-6, err_msg="a fault repeats what was applied")


@pytest.mark.parametrize("optimize", ["speed", "size"])
def test_the_checker_reads_the_limits_and_refuses_other_code(optimize):
    files = emit(spec(optimize=optimize))
    header, source = files["include/a.h"], files["src/a.c"]
    read = read_controller("a", header, source, ["a", "b"])
    np.testing.assert_array_equal(
        read.limits,
        np.array([[-0.09999999403953552, 0.29999998211860657], [-3.4028234663852886e38, 5]]) * 1.0,
    )
    for old, new in (
        ("state->u[k] < lower[k]", "state->u[k] > lower[k]"),
        ("status = a_clip(state, status);", ""),
        ("static const float upper[2]", "static float upper[2]"),
        ("state->u[k] = upper[k];", "state->u[k] = lower[k];"),
    ):
        if old in source:
            with pytest.raises(NotCertified):
                read_controller("a", header, source.replace(old, new, 1), ["a", "b"])
    with pytest.raises(NotCertified):
        read_controller("a", header.replace("A_CLIPPED = 8", "A_CLIPPED = 1"), source, ["a", "b"])
    plain = emit(spec(optimize=optimize, limits=[]))
    with pytest.raises(NotCertified):
        read_controller("a", plain["include/a.h"], source, ["a", "b"])
    assert read_controller("a", plain["include/a.h"], plain["src/a.c"], ["a", "b"]).limits is None


@pytest.mark.parametrize("limits", [[[0.0, 1.0], [-1.0, 1.0]], [[-1.0, 1e-30], [-1.0, 1.0]], [[-1.0, 1.0]]])
def test_limits_that_are_none(limits):
    with pytest.raises(ProblemError):
        spec(limits=limits)


def bench(files: dict[str, str], period: float, r: float = 0.01) -> dict[str, np.ndarray]:
    """u of each controller for 60 s of a constant relative output, and 10 s of none: the compiled C."""
    on, off = round(60 / period), round(10 / period)

    def calls(manifest, agent):
        q, nn, S = len(agent.outputs), len(agent.neighbours), on + off
        given = np.zeros((S, q), manifest.real_type.dtype)
        given[:on] = r
        none = np.zeros((S, nn, q), manifest.real_type.dtype)
        return Calls(
            np.full(S, Operation.STEP_RELATIVE, np.uint32), np.zeros(S, np.uint64), 0 * given, none, given
        )

    found = {}
    for name, trace in traces(files, calls).items():
        assert np.isin(trace.status, [OK, CLIPPED]).all(), "no overflow"
        found[name] = trace.u
    return found


def check_bench(found: dict[str, np.ndarray], largest: float) -> None:
    """Bounded, and back at 1e-6 within 10 s."""
    for name, u in found.items():
        assert np.abs(u).max() <= largest, name
        assert np.abs(u[-1]).max() <= 1e-6, name


def test_a_controller_that_is_stable_by_itself_recovers_on_the_bench():
    """|u| stays below |D - C A^-1 B| r, overshoot aside; an unstable one does not."""
    gain = np.linalg.norm(np.array(D) - np.array(C) @ np.linalg.solve(A, B), np.inf)
    check_bench(bench(emit(spec(alone=True)), 0.01), 2 * gain * 0.01)
    unstable = Controller("a", [[1.0]], [[1.0, 0.0]], [[1.0]], [[0.0, 0.0]])
    with pytest.raises(AssertionError):
        check_bench(bench(emit(CodegenSpec((unstable,), 0.01)), 0.01), 1.0)
