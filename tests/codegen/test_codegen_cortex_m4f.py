"""The ARM code under emulation; skipped, and said so, where its packages are missing."""

import pytest
from codegen_cases import arms, shapes

from lockstep.codegen import targets
from lockstep.codegen.emit import emit
from lockstep.codegen.emulator import MACHINE, build_image, load_image, missing_packages
from lockstep.codegen.folder import write_folder
from lockstep.codegen.manifest import load_manifest
from lockstep.codegen.toolchain import zig
from lockstep.codegen.verify import verify_folder
from lockstep.model.errors import ClaimError

needs_emulator = pytest.mark.skipif(
    zig() is None or bool(missing_packages()), reason="ziglang, unicorn or pyelftools is not installed"
)


@needs_emulator
@pytest.mark.parametrize("optimize", ["speed", "size"])
def test_the_arms_are_equal_to_the_bit_within_the_stated_stack(tmp_path, optimize):
    folder = write_folder(emit(arms(optimize=optimize)), tmp_path / "arms")
    report = verify_folder(folder, targets=["cortex-m4f"], steps=300, adversarial_steps=800)
    assert report.problems == ()
    for target in report.targets:
        assert target.bitwise and target.ram_bytes == 32
        assert (
            30 < target.instructions_per_step < 300
        )  # 21 operations of the kernel are the least there can be
        assert 0 < target.stack_bytes <= load_manifest(folder).agents[0].stack_budget_bytes


@needs_emulator
@pytest.mark.slow
@pytest.mark.parametrize("optimize", ["speed", "size"])
def test_orders_0_to_12_are_equal_to_the_bit_within_the_stated_stack(tmp_path, optimize):
    spec = shapes([0, 5, 12], [1, 4], [2], optimize=optimize)
    folder = write_folder(emit(spec), tmp_path / "shapes")
    assert verify_folder(folder, targets=["cortex-m4f"], steps=50, adversarial_steps=200).problems == ()


@needs_emulator
def test_a_changed_gain_is_seen_on_the_target(tmp_path):
    folder = write_folder(emit(arms()), tmp_path / "arms")
    source = folder / "src" / "arm1.c"
    source.write_text(source.read_text().replace("0.9909511f", "0.9909512f"))
    report = verify_folder(folder, targets=["cortex-m4f"], steps=50, adversarial_steps=0)
    assert [a.bitwise for a in report.targets[0].agents] == [False, True, True]


@needs_emulator
def test_an_image_with_double_arithmetic_does_not_link(tmp_path):
    folder = write_folder(emit(arms()), tmp_path / "arms")
    source = folder / "src" / "arm1.c"
    source.write_text(source.read_text().replace("= 0.9909511f * x0", "= (float)(0.9909511 * (double)x0)"))
    with pytest.raises(ClaimError, match="__aeabi_"):
        build_image(load_manifest(folder), folder, zig(), "-O2", tmp_path)


@needs_emulator
def test_the_image_calls_nothing_that_is_not_ours(tmp_path):
    folder = write_folder(emit(arms()), tmp_path / "arms")
    image = load_image(build_image(load_manifest(folder), folder, zig(), "-O2", tmp_path))
    foreign = [
        name for name in image.symbols if not name.startswith(("arm", "harness_", "mem", "$", "support"))
    ]
    assert [name for name in foreign if "unwind" not in name] == []
    assert "cortex_m4" in " ".join(MACHINE)


@needs_emulator
def test_a_write_through_a_null_pointer_stops_the_core_and_is_reported(tmp_path):
    folder = write_folder(emit(arms()), tmp_path / "arms")
    source = folder / "src" / "arm1.c"
    wild = "    float check;\n    *(volatile uint32_t *)0x70000000u = 1u;\n"
    source.write_text(source.read_text().replace("    float check;\n", wild, 1))
    report = verify_folder(folder, targets=["cortex-m4f"], steps=50, adversarial_steps=0)
    assert not report.ok and "the emulated core stopped" in report.targets[0].error


def test_missing_packages_are_named(tmp_path, monkeypatch):
    monkeypatch.setattr(targets, "missing_packages", lambda: ["unicorn"])
    folder = write_folder(emit(arms()), tmp_path / "arms")
    report = verify_folder(folder, targets=["cortex-m4f"], steps=5, adversarial_steps=0)
    assert not report.ok
    assert all(t.bitwise is None and "unicorn" in t.skipped for t in report.targets)


@needs_emulator
@pytest.mark.slow
@pytest.mark.parametrize("real", ["float32", "float64"])
@pytest.mark.parametrize("optimize", ["speed", "size"])
def test_all_shapes_10_000_steps(tmp_path, real, optimize):
    folder = write_folder(
        emit(shapes(range(9), [1, 2, 3, 4], [1, 2], real=real, optimize=optimize)), tmp_path / "shapes"
    )
    assert verify_folder(folder, targets=["cortex-m4f"]).problems == ()
