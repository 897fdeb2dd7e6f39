"""The message layer: what is refused and counted, what is held, and every bit of it against its reference."""

import json
import struct
import subprocess
import zlib

import numpy as np
import pytest
from codegen_cases import arms, shapes
from export_cases import folder_of, generated, needs_compiler
from message_cases import Script, messages_folder
from typer.testing import CliRunner

from lockstep.check.errors import ProblemError
from lockstep.cli.main import app
from lockstep.codegen.emission.emit import emit
from lockstep.codegen.exports import with_exports
from lockstep.codegen.from_design import specification
from lockstep.codegen.manifest import Manifest, load_manifest
from lockstep.codegen.spec import MessageLimits
from lockstep.lmi.document import parse
from lockstep.verification.comparison import compare
from lockstep.verification.messages.events import (
    FORGET,
    INIT,
    RECEIVE,
    RESET,
    SEND,
    STEP,
    faulty_events,
    run_node,
)
from lockstep.verification.messages.network_node import Message, ReferenceNode, Refusal, Wire
from lockstep.verification.messages.run import run_nodes_on_host
from lockstep.verification.reference import Reference
from lockstep.verification.toolchain import host_compilers
from lockstep.verification.verify import verify_folder

pytestmark = needs_compiler
FRESH, STALE, SHUT_OUT, HEARD = 0, 2, 4, 6
"""Places of a node's masks in the words of its trace."""


@pytest.fixture
def script(tmp_path):
    return Script(messages_folder(tmp_path))


def counted(trace, verdict):
    return int(trace.words[-1, 8 + verdict])


def test_the_bytes_are_as_the_header_says():
    """Laid out by hand here; the CRC of "123456789" is the published check value of CRC-32 (IEEE 802.3)."""
    wire = Wire(bytes(range(8)), np.dtype("float32"), 2)
    packed = wire.pack(Message(0x0102, 0x03040506, 0x0708090A, np.array([1.0, -2.0], np.float32)))
    assert packed[:20].hex() == "01040201" + "0001020304050607" + "06050403" + "0a090807"
    assert packed[20:28] == struct.pack("<ff", 1.0, -2.0)
    assert packed[28:] == struct.pack("<I", zlib.crc32(packed[:28]))
    assert zlib.crc32(b"123456789") == 0xCBF43926


def test_a_message_with_any_one_bit_flipped_is_refused_and_counted(script, tmp_path):
    good = script.packed(7)
    for bit in range(8 * len(good)):
        flipped = bytearray(good)
        flipped[bit // 8] ^= 1 << bit % 8
        script.call(RECEIVE, len(good), data=bytes(flipped))
    script.call(RECEIVE, len(good), data=good)
    trace = script.run(tmp_path)
    assert (trace.status[:-1] == Refusal.BAD_CHECKSUM).all()
    assert trace.status[-1] == Refusal.TAKEN
    assert counted(trace, Refusal.BAD_CHECKSUM) == 8 * len(good)


def test_another_design_a_stranger_and_any_other_length_are_refused_and_counted(script, tmp_path):
    own = script.wire
    others = [Wire(own.design[:7] + bytes([own.design[7] ^ 1]), own.dtype, own.outputs)]
    others += [Wire(bytes([own.design[0] ^ 0x80]) + own.design[1:], own.dtype, own.outputs)]
    for wire in others:
        script.call(RECEIVE, own.length, data=script.packed(7, wire=wire))
    double = Wire(own.design, np.dtype("float64"), 1)  # as long as ours
    script.call(RECEIVE, own.length, data=double.pack(Message(2, 7, 7, np.array([1.0]))))
    for sender in (0, 1, 3, 0x0102, 0xFFFF):
        script.call(RECEIVE, own.length, data=script.packed(7, sender=sender))
    for length in (*range(own.length), own.length + 1, own.length + 4, 2**32 - 1):
        script.call(RECEIVE, length, data=script.packed(7))
    trace = script.run(tmp_path)
    assert trace.status.tolist()[:3] == [Refusal.OTHER_DESIGN] * 3
    assert trace.status.tolist()[3:8] == [Refusal.UNKNOWN_SENDER] * 5
    assert (trace.status[8:] == Refusal.BAD_LENGTH).all()
    assert [counted(trace, one) for one in (Refusal.OTHER_DESIGN, Refusal.UNKNOWN_SENDER)] == [3, 5]
    assert counted(trace, Refusal.BAD_LENGTH) == own.length + 3


def test_old_and_repeated_numbers_are_refused_also_where_they_pass_2_to_the_32(script, tmp_path):
    numbers = [2**32 - 2, 2**32 - 2, 2**32 - 1, 2**32 - 2, 0, 2**32 - 1, 1, 2**31, 2**31 + 1, 0, 1]
    for number in numbers:
        script.call(RECEIVE, script.wire.length, data=script.packed(7, number=number))
    T, old = Refusal.TAKEN, Refusal.OLD_NUMBER
    # 2^31 is 2^31 - 1 after 1, the farthest that counts as newer; from 2^31 + 1 on, 0 is 2^31 - 1 ahead, and 1 after it.
    assert script.run(tmp_path).status.tolist() == [T, old, T, old, T, old, T, T, T, T, T]


def test_what_is_sampled_ahead_too_early_or_where_no_reading_is_kept_is_refused_and_counted(script, tmp_path):
    for instant in range(100, 120):
        script.call(STEP, instant, (1.0, 2.0) if instant != 110 else (np.nan, 2.0))
    number = 1000
    for sampled in (121, 104, 110, 105, 105, 104, 119):
        number += 1
        script.call(RECEIVE, script.wire.length, data=script.packed(sampled, number=number))
        script.call(STEP, 120, (1.0, 2.0))
    trace = script.run(tmp_path)
    # 105 is 15 old, and the readings of 105 to 120 are kept; of 110 there is none; 105 again is no newer than what is held.
    assert counted(trace, Refusal.FUTURE) == 1
    assert counted(trace, Refusal.TOO_OLD) == 4
    assert trace.words[21::2, FRESH].tolist() == [0, 0, 0, 1, 0, 0, 1]
    assert trace.age[-1].tolist() == [1]


def test_an_implausible_row_shuts_out_its_neighbour_and_not_the_controller(script, tmp_path):
    rows = [(np.nan, 0), (0, np.inf), (7.5, 0), (-7.5, 0), (0, 100.5), (0, -1e30), (7.0, 100.0)]
    for k, y in enumerate(rows):
        script.call(RECEIVE, script.wire.length, data=script.packed(k, y))
        script.call(STEP, k, (1.0, 2.0))
    trace = script.run(tmp_path)
    assert (trace.status[1::2] == 0).all()
    assert trace.words[1::2, SHUT_OUT].tolist() == [1, 1, 1, 1, 1, 0, 0]  # omega_m has no lower bound
    assert trace.words[1::2, FRESH].tolist() == [0, 0, 0, 0, 0, 1, 1]
    assert counted(trace, Refusal.IMPLAUSIBLE) == 5
    assert trace.held[-1, 0].tolist() == [1.0 - 7.0, 2.0 - 100.0]


def test_a_difference_that_overflows_is_no_difference(script, tmp_path):
    script.call(RECEIVE, script.wire.length, data=script.packed(1, (0.0, -3e38)))
    script.call(STEP, 1, (0.0, 3e38))
    trace = script.run(tmp_path)
    assert counted(trace, Refusal.IMPLAUSIBLE) == 1
    assert trace.held[-1].tolist() == [[0.0, 0.0]]


def test_ages_count_in_faults_and_say_who_is_stale(script, tmp_path):
    script.call(RECEIVE, script.wire.length, data=script.packed(0))
    for instant in range(20):
        script.call(STEP, instant, (1.0, 2.0) if instant < 5 else (np.nan, 2.0))
    trace = script.run(tmp_path)
    assert trace.age[1:, 0].tolist() == list(range(20))
    assert trace.status[6:].tolist() == [1] * 15
    assert trace.words[1:, STALE].tolist() == [0] * 16 + [1] * 4
    assert trace.held[-1].tolist() == [[0.5, 2.25]], "it stays held: that is what is proved of losses"


def test_forgetting_holds_nothing_and_takes_any_number_next(script, tmp_path):
    for instant in (5, 6):
        script.call(RECEIVE, script.wire.length, data=script.packed(instant, number=50))
        script.call(STEP, instant, (1.0, 2.0))
        script.call(FORGET, 0)
    trace = script.run(tmp_path)
    assert trace.held[:, 0, 0].tolist() == [0, 0.5, 0, 0, 0.5, 0]
    assert counted(trace, Refusal.OLD_NUMBER) == 0


def test_a_neighbour_that_was_silent_beyond_the_limit_may_count_anew(script, tmp_path):
    script.call(RECEIVE, script.wire.length, data=script.packed(0, number=1000))
    for instant in range(18):
        script.call(STEP, instant, (1.0, 2.0))
        if instant in (14, 17):
            script.call(RECEIVE, script.wire.length, data=script.packed(instant, number=3))
    script.call(STEP, 18, (1.0, 2.0))
    trace = script.run(tmp_path)
    assert counted(trace, Refusal.OLD_NUMBER) == 1, "at 14 the number 1000 still counts"
    assert trace.words[-1, FRESH] == 1


def test_numbers_of_a_node_that_was_restarted_are_newer_and_a_repeated_send_repeats_the_bytes(
    script, tmp_path
):
    for instant in (2**32 - 2, 2**32 - 1, 2**32 - 1, 0, 3):
        script.call(SEND, instant, (1.0, 2.0))
    script.call(INIT)
    for instant in (9, 10):
        script.call(SEND, instant, (1.0, 2.0))
    script.call(SEND, 11, (np.nan, 2.0))
    trace = script.run(tmp_path)
    sent = [
        script.wire.unpack(row.tobytes()) for row, done in zip(trace.sent, trace.status, strict=True) if done
    ]
    assert [one.number for one in sent] == [2**32 - 2, 2**32 - 1, 2**32 - 1, 0, 1, 9, 10]
    assert (trace.sent[1] == trace.sent[2]).all()
    assert trace.status[-1] == 0


def test_a_clock_that_goes_back_makes_all_stale_until_the_next_message(script, tmp_path):
    for instant in (100, 101, 50):
        script.call(RECEIVE, script.wire.length, data=script.packed(instant, number=100 + instant))
        script.call(STEP, instant, (1.0, 2.0))
    script.call(RECEIVE, script.wire.length, data=script.packed(51, number=1))
    script.call(STEP, 51, (1.0, 2.0))
    trace = script.run(tmp_path)
    # The message of 50 has an old number; it is told to forget at that step, and that of 51 is taken.
    assert trace.status[4] == Refusal.OLD_NUMBER
    assert trace.words[1::2, STALE].tolist() == [0, 0, 1, 0]
    assert trace.age[-1].tolist() == [0]


def test_agents_that_agree_have_a_relative_output_of_zero_whatever_is_lost(script, tmp_path):
    """y(s) is the same for both, moves fast, and messages come late, in any order, or not: u stays 0 to the bit."""
    random, late = np.random.default_rng(3), []
    for instant in range(400):
        y = (float(np.float32(3 * np.sin(0.3 * instant))), float(np.float32(60 * np.cos(0.3 * instant))))
        if random.random() < 0.5:
            late.append((instant + int(random.integers(8)), script.packed(instant, y)))
        arriving = [data for when, data in late if when == instant]
        for k in random.permutation(len(arriving)):
            script.call(RECEIVE, script.wire.length, data=arriving[k])
        script.call(STEP, instant, y)
    trace = script.run(tmp_path)
    assert trace.words[-1, HEARD] == 1
    assert not trace.held.any()
    assert not trace.u.any()


@pytest.mark.parametrize("real", ["float32", "float64"])
def test_with_every_message_in_time_a_node_computes_what_the_controller_does(real):
    """r of held differences has the bits of r of present outputs, so what is claimed of the controller holds."""
    spec = shapes([2], [1, 2], [1], real=real)
    manifest = Manifest.model_validate_json(emit(spec)["manifest.json"])
    for agent in manifest.agents:
        node, plain = ReferenceNode.of(agent, manifest), Reference.of(agent, manifest)
        q, random = len(agent.outputs), np.random.default_rng(5)
        for instant in range(50):
            y, *others = random.normal(size=(1 + len(node.sources), q)).astype(real)
            for sender, other in zip(node.sources, others, strict=True):
                node.receive(node.wire.pack(Message(sender, instant, instant, other)))
            expected = plain.step(y, np.array(others, real).reshape(-1, q), 2 ** len(others) - 1)
            status, u = node.step(instant, y)
            assert (status, u.tobytes()) == (expected[0], expected[1].tobytes())


def test_a_folder_without_ranges_says_nothing_of_messages_in_its_manifest():
    """A present folder stays as it was, byte for byte: `messages` is absent rather than null."""
    assert '"messages"' not in emit(arms())["manifest.json"]
    told = Manifest.model_validate_json(emit(arms(messages=MessageLimits(kept=32)))["manifest.json"])
    assert told.messages is not None
    assert told.messages.kept == 32


def test_the_range_of_the_problem_file_is_in_the_c(root):
    document = json.loads((root / "generated" / "flexible_joint_arms" / "design.json").read_text())
    document["problem"]["agent"]["output_range"] = {"y1": [-3.5, None]}
    files = with_exports(emit(specification(parse(document, "design"))), ["messages"])
    assert "lowest[2] = {-3.5f, -3.4028235e+38f}" in files["messages/arm1_node.c"]
    assert "infinite or out of range: that neighbour" in files["messages/arm1_node.h"]
    without = with_exports(emit(arms()), ["messages"])["messages/arm1_node.h"]
    assert "infinite: that neighbour" in without, "no range is checked, so none is promised"
    for wrong, said in (({"speed": [0, 1]}, "no output"), ({"y1": [1, 1]}, "lower below")):
        document["problem"]["agent"]["output_range"] = wrong
        with pytest.raises(ProblemError, match=said):
            parse(document, "design")


def test_a_reading_out_of_its_range_is_not_sent_and_the_sender_is_told(script, tmp_path):
    """Listeners would shut it out; without the check its sender went on, and nobody told it."""
    for instant, y in enumerate([(7.0, 100.0), (7.5, 0.0), (0.0, 101.0), (0.0, -1e6)], start=1):
        script.call(SEND, instant, y)
        script.call(STEP, instant, y)
    trace = script.run(tmp_path)
    assert trace.status[::2].tolist() == [1, 0, 0, 1], "theta_m is in [-7, 7], omega_m at most 100"
    assert not trace.status[1::2].any(), "the step takes what it is given"


@pytest.mark.parametrize(
    ("flag", "builds"), [("-O2", True), ("-ffast-math", False), ("-ffinite-math-only", False)]
)
def test_a_node_refuses_shortcuts_as_its_controller_does(tmp_path, flag, builds):
    """Built so, a node takes NaN for a reading, sends it, and stops those that listen."""
    folder, compiler = messages_folder(tmp_path), host_compilers()[0]
    places = [f"-I{folder / 'include'}", f"-I{folder / 'messages'}"]
    node = [str(folder / "messages" / "arm1_node.c"), "-o", str(tmp_path / "node.o")]
    command = [*compiler.command, "-std=c99", flag, *places, "-c", *node]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode == 0) == builds, done.stderr
    assert ("#error" in done.stderr) != builds


@pytest.mark.slow
def test_certify_renders_the_message_layer_again(root, tmp_path):
    folder = generated(root, tmp_path / "arms", "--messages")
    assert CliRunner().invoke(app, ["certify", str(folder)]).exit_code == 0
    path = folder / "messages" / "arm1_node.c"
    path.write_text(path.read_text().replace("own[k] - other[k]", "other[k] - own[k]"))
    assert CliRunner().invoke(app, ["certify", str(folder)]).exit_code == 1


def test_reset_keeps_the_counters_and_drops_readings(script, tmp_path):
    script.call(STEP, 1, (1.0, 2.0))
    script.call(RECEIVE, 3, data=b"abc")
    script.call(RESET)
    script.call(RECEIVE, script.wire.length, data=script.packed(1))
    script.call(STEP, 2, (1.0, 2.0))
    trace = script.run(tmp_path)
    assert counted(trace, Refusal.BAD_LENGTH) == 1
    assert counted(trace, Refusal.TOO_OLD) == 1, "the reading of 1 is no longer kept"


@pytest.mark.slow
@pytest.mark.parametrize("options", [{}, {"real": "float64"}, {"optimize": "size"}])
def test_bitwise_on_this_machine_with_losses_in_the_stimulus(tmp_path, options):
    folder = messages_folder(tmp_path, **options)
    report = verify_folder(folder, steps=20, adversarial_steps=2000, targets=["sanitizers"])
    assert report.ok, report.problems
    ran = [target for target in report.targets if not target.skipped]
    assert ran
    for target in ran:
        assert [node.bitwise for node in target.nodes] == [True] * 3
        assert all(node.events > 400 for node in target.nodes)


def test_every_refusal_and_mask_occurs_in_the_stimulus(tmp_path):
    manifest = load_manifest(messages_folder(tmp_path))
    trace = run_node(manifest.agents[0], manifest, faulty_events(manifest, manifest.agents[0], 1000))
    assert (trace.words[:, 8:].max(axis=0) > 0).all()
    for mask in (FRESH, STALE, SHUT_OUT, HEARD):
        assert set(trace.words[:, mask].tolist()) == {0, 1}
    assert (trace.age > 15).any()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("age < node->age[j]", "age <= node->age[j]"),
        ("(age < 16u)", "(age < 15u)"),
        ("- 1u) < HALF_OF_ALL", "- 1u) <= HALF_OF_ALL"),
        ("node->number = instant;", "node->number = instant + 1u;"),
        ("d[k] = own[k] - other[k];", "d[k] = other[k] - own[k];"),
    ],
)
def test_a_node_that_computes_otherwise_is_found(tmp_path, old, new):
    folder = messages_folder(tmp_path)
    path = folder / "messages" / "arm1_node.c"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    manifest = load_manifest(folder)
    events = {agent.name: faulty_events(manifest, agent, 2000) for agent in manifest.agents}
    place = tmp_path / "place"
    place.mkdir()
    runs = run_nodes_on_host(manifest, folder, events, place, host_compilers()[0], ("-O1",))
    differing = [
        agent.name
        for agent, trace, _ in runs
        if not compare(trace, run_node(agent, manifest, events[agent.name])).bitwise
    ]
    assert differing == ["arm1"]


@pytest.mark.slow
@pytest.mark.parametrize("options", [{}, {"real": "float64"}])
def test_bitwise_on_every_target(tmp_path, options):
    for spec in (arms(**options), shapes([0, 2], [1, 3], [1, 2], **options)):
        folder = folder_of(tmp_path, spec, "messages")
        report = verify_folder(folder, steps=20, adversarial_steps=3000)
        for target in report.targets:
            if not target.skipped and "QEMU" not in target.name:
                assert all(node.bitwise for node in target.nodes) and target.nodes, target.name


@pytest.mark.parametrize("kept", [0, 1, 3, 12, 8192])
def test_the_readings_kept_are_a_power_of_two(kept):
    with pytest.raises(ProblemError, match="power of 2"):
        MessageLimits(kept=kept)
