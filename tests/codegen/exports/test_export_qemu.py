"""QEMU's Cortex-M7 runs the runner of `pil/`: both arithmetics in hardware, equal to the bit; faults are seen."""

import pytest
from codegen_cases import arms, random_controller, shapes
from export_cases import needs

from lockstep.codegen.emission.emit import emit
from lockstep.codegen.folder import write_folder
from lockstep.verification import targets
from lockstep.verification.machines import qemu
from lockstep.verification.toolchain import arm_gcc, zig
from lockstep.verification.verify import verify_folder

pytestmark = pytest.mark.skipif(not (zig() or arm_gcc()), reason="no compiler for Cortex-M")
needs_qemu = needs(qemu.QEMU)
GROUP = qemu.M7.group


@pytest.fixture(autouse=True)
def one_level(monkeypatch):
    """At one level, with one compiler: gcc, which is the quicker one, if it is there."""
    monkeypatch.setattr(targets, "CORE_LEVELS", ("-O2",))
    if arm_gcc():
        monkeypatch.setattr(targets, "zig", lambda: None)


def verified(folder, **options):
    return verify_folder(folder, targets=[GROUP], **{"steps": 200, "adversarial_steps": 800, **options})


@needs_qemu
@pytest.mark.parametrize("real", ["float32", "float64"])
@pytest.mark.parametrize("optimize", ["speed", "size"])
def test_the_arms_are_equal_to_the_bit_in_hardware(tmp_path, real, optimize):
    """No soft arithmetic: of routines, the product may call only those that copy memory."""
    report = verified(write_folder(emit(arms(real=real, optimize=optimize)), tmp_path / "arms"))
    assert report.problems == ()
    (target,) = report.targets
    assert (target.bitwise, target.steps, target.max_abs_error) == (True, 200, 0.0)
    # x, u and the message held: 5 numbers; heard, age, misses and ready: 4 words of 32 bits.
    assert target.ram_bytes == (56 if real == "float64" else 36)
    assert 300 < target.text_bytes < 1500


@pytest.mark.slow
@needs_qemu
def test_other_shapes_and_wide_masks(tmp_path):
    agents = (*shapes([0, 5], [3], [2]).agents, random_controller("n64", 1, 1, 1, neighbours=64))
    spec = arms(agents=agents, plants=(), real="float64")
    assert verified(write_folder(emit(spec), tmp_path / "arms")).problems == ()


@needs_qemu
def test_a_changed_gain_is_seen(tmp_path):
    folder = write_folder(emit(arms()), tmp_path / "arms")
    source = folder / "src" / "arm1.c"
    source.write_text(source.read_text().replace("0.9909511f", "0.9909512f", 1))
    (target,) = verified(folder, run_changed=True).targets
    assert [agent.bitwise for agent in target.agents] == [False, True, True]


@needs_qemu
def test_a_wild_write_stops_it_and_is_reported(tmp_path):
    folder = write_folder(emit(arms()), tmp_path / "arms")
    source = folder / "src" / "arm1.c"
    wild = "    float check;\n    *(volatile uint32_t *)0xA5000000u = 1u;\n"
    source.write_text(source.read_text().replace("    float check;\n", wild, 1))
    report = verified(folder, run_changed=True)
    assert not report.ok
    assert "running arm1 failed" in report.targets[0].error


def test_without_qemu_the_target_is_skipped_by_name(tmp_path, monkeypatch):
    monkeypatch.setattr(targets, "missing", lambda: [qemu.QEMU])
    report = verified(write_folder(emit(arms()), tmp_path / "arms"))
    assert not report.ok
    (target,) = report.targets
    assert (target.bitwise, target.skipped) == (None, "not installed: qemu-system-arm")
    assert target.name == "Cortex-M7 with double precision, QEMU"
