"""`generate --messages --dbc`: what cantools decodes by the description is what the C packed, bit by bit."""

import ctypes
import json
import struct
from dataclasses import replace

import cantools
import numpy as np
import pytest
from codegen_cases import arms, random_controller
from export_cases import folder_of, generated, needs_compiler, run
from typer.testing import CliRunner

from lockstep.check.errors import ProblemError
from lockstep.cli.main import app
from lockstep.codegen.emission.emit import emit
from lockstep.codegen.exports import with_exports
from lockstep.codegen.manifest import load_manifest
from lockstep.codegen.spec import CodegenSpec, MessageLimits, Signal
from lockstep.verification.toolchain import host_compilers

EXPORTS = ("messages", "dbc")
LENGTHS = (8, 12, 16, 20, 24, 32, 48, 64)
"""ISO 11898-1: bytes of a CAN FD frame from 8 on."""


def packer(folder, manifest, tmp_path):
    """The C's own `pack`: (sender, number, instant, outputs) -> bytes."""
    library = tmp_path / "message.so"
    source = folder / "messages" / f"{manifest.name}_message.c"
    run([*host_compilers()[0].command, "-shared", "-fPIC", source, "-o", library], tmp_path)
    most = max(len(agent.outputs) for agent in manifest.agents)
    real = ctypes.c_float if manifest.real == "float32" else ctypes.c_double

    class Message(ctypes.Structure):
        _fields_ = [
            ("design", ctypes.c_uint32 * 2),
            *((name, ctypes.c_uint32) for name in ("sender", "number", "instant")),
            ("outputs", real * most),
        ]

    def packed(sender, number, instant, outputs):
        words = [int(manifest.identity.design[k : k + 8], 16) for k in (0, 8)]
        values = (real * most)(*outputs)
        message = Message((ctypes.c_uint32 * 2)(*words), sender, number, instant, values)
        into = (ctypes.c_uint8 * (24 + ctypes.sizeof(values)))()
        getattr(ctypes.CDLL(str(library)), f"{manifest.name}_pack")(ctypes.byref(message), into)
        return bytes(into)

    return packed


def with_outputs(count, real):
    one = random_controller("c1", 1, count, 1, neighbours=0)
    return CodegenSpec((one,), period=0.01, name="wide", real=real)


@needs_compiler
@pytest.mark.parametrize(
    ("real", "outputs"),
    [("float32", 1), ("float32", 2), ("float32", 3), ("float32", 10), ("float64", 2), ("float64", 5)],
)
def test_cantools_decodes_what_the_c_packs(tmp_path, real, outputs):
    spec = arms(real=real) if outputs == 2 else with_outputs(outputs, real)
    folder = folder_of(tmp_path, spec, *EXPORTS)
    manifest = load_manifest(folder)
    database = cantools.database.load_file(folder / "dbc" / f"{manifest.name}.dbc")
    packed, random = packer(folder, manifest, tmp_path), np.random.default_rng(4)
    for sender, agent in enumerate(manifest.agents, start=1):
        frame = database.get_message_by_name(agent.name)
        assert (frame.frame_id, frame.is_extended_frame, frame.is_fd) == (0x10000 + sender, True, True)
        assert frame.length in LENGTHS
        for _ in range(50):
            number, instant = (int(v) for v in random.integers(2**32, size=2))
            y = (random.normal(size=outputs) * 10.0 ** random.integers(-30, 30)).astype(real)
            data = packed(sender, number, instant, y.tolist())
            padded = data.ljust(frame.length, b"\0")
            found = frame.decode(padded)
            assert [found[one.name] for one in agent.outputs] == y.tolist()
            assert (found["message_sender"], found["message_number"]) == (sender, number)
            assert found["message_instant"] == instant
            assert (found["message_form"], found["message_real_bytes"]) == (1, y.itemsize)
            design = f"{found['message_design_0']:08x}{found['message_design_1']:08x}"
            assert design == manifest.identity.design[:16]
            assert struct.pack("<I", found["message_crc"]) == data[-4:]
            # No bit of a message is outside of the signals, and no two signals share one.
            assert frame.encode(found) == padded


def test_names_units_and_listeners_are_those_of_the_problem(tmp_path):
    folder = folder_of(tmp_path, arms(), *EXPORTS)
    database = cantools.database.load_file(folder / "dbc" / "arms.dbc")
    assert [node.name for node in database.nodes] == ["arm1", "arm2", "arm3"]
    frame = database.get_message_by_name("arm2")
    assert frame.senders == ["arm2"]
    assert {signal.name: signal.unit for signal in frame.signals if signal.unit} == {
        "theta_m": "rad",
        "omega_m": "rad/s",
    }
    assert all(signal.receivers == ["arm1"] for signal in frame.signals)


def test_ranges_of_outputs_are_those_of_the_problem(tmp_path):
    ranges = {"theta_m": (-7.0, 7.5), "omega_m": (None, 100.0)}
    folder = folder_of(tmp_path, arms(messages=MessageLimits(ranges=ranges)), *EXPORTS)
    frame = cantools.database.load_file(next((folder / "dbc").iterdir())).get_message_by_name("arm1")
    angle, speed = (frame.get_signal_by_name(name) for name in ("theta_m", "omega_m"))
    assert (angle.minimum, angle.maximum) == (-7.0, 7.5)
    assert speed.maximum in (None, 0), "one end alone is none in a DBC"


def test_signals_of_a_formation_are_said_to_be_less_the_offsets():
    apart = replace(random_controller("c1", 1, 2, 1, neighbours=0), offsets=np.array([[0.5, 0.0]]))
    for one, said in ((apart, True), (random_controller("c1", 1, 2, 1, neighbours=0), False)):
        files = with_exports(emit(CodegenSpec((one,), period=0.01, name="c", real="float32")), EXPORTS)
        assert ("less the sender's offsets" in files["dbc/c.dbc"]) is said


def test_what_does_not_fit_is_refused_in_one_message():
    for count, real, most in ((11, "float32", 10), (6, "float64", 5)):
        with pytest.raises(ProblemError, match=f"the longest CAN FD frame: {most} outputs in {real}"):
            with_exports(emit(with_outputs(count, real)), EXPORTS)
    for name in ("message_crc", "SG_", "a" * 33):
        agent = random_controller("c1", 1, 1, 1, neighbours=0)
        agent = type(agent)("c1", agent.A, agent.B, agent.C, agent.D, (), (Signal(name),))
        with pytest.raises(ProblemError, match=f"`{name}` is no name in it"):
            with_exports(emit(CodegenSpec((agent,), period=0.01, name="named")), EXPORTS)
    with pytest.raises(ProblemError, match="no `--messages`"):
        with_exports(emit(arms()), ["dbc"])


def test_certify_renders_it_again(root, tmp_path):
    folder = generated(root, tmp_path / "arms", "--messages", "--dbc")
    assert CliRunner().invoke(app, ["certify", str(folder)]).exit_code == 0
    (path,) = (folder / "dbc").glob("*.dbc")
    path.write_text(path.read_text().replace("160|32@1-", "192|32@1-"))
    done = CliRunner().invoke(app, ["certify", str(folder), "--json"])
    assert done.exit_code == 1
    assert path.name in json.dumps(json.loads(done.stdout))
