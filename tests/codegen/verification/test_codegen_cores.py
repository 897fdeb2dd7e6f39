"""The code of each emulated microcontroller; skipped, and said so, where the packages are missing."""

import dataclasses
import itertools

import numpy as np
import pytest
from codegen_cases import arms, random_controller, shapes

from lockstep.check.errors import ClaimError
from lockstep.codegen.cost.cores import CORES
from lockstep.codegen.emission.emit import emit
from lockstep.codegen.folder import write_folder
from lockstep.codegen.manifest import load_manifest
from lockstep.codegen.spec import CodegenSpec, Controller
from lockstep.verification import targets
from lockstep.verification.machines.emulator import missing_packages
from lockstep.verification.machines.image import build_image, load_image
from lockstep.verification.toolchain import zig
from lockstep.verification.verify import verify_folder

needs_emulator = pytest.mark.skipif(
    zig() is None or bool(missing_packages()), reason="ziglang, unicorn or pyelftools is not installed"
)
M4F = CORES["cortex-m4f"]


@pytest.fixture(autouse=True)
def one_level(request, monkeypatch):
    """Compile at one level, with zig only, where neither is what is tested."""
    if "all_levels" not in request.fixturenames:
        monkeypatch.setattr(targets, "CORE_LEVELS", ("-Os",))
        monkeypatch.setattr(targets, "arm_gcc", lambda: None)


@pytest.fixture
def all_levels():
    """Asked for by tests that are about all levels and compilers."""


def one_arm(**options):
    return arms(agents=arms().agents[:1], plants=(), **options)


def change(folder, old, new):
    source = folder / "src" / "arm1.c"
    text = source.read_text()
    assert old in text
    source.write_text(text.replace(old, new, 1))


@needs_emulator
@pytest.mark.parametrize("optimize", ["speed", "size"])
@pytest.mark.parametrize("group", CORES)
def test_an_arm_is_equal_to_the_bit_on_every_core(tmp_path, group, optimize):
    folder = write_folder(emit(one_arm(optimize=optimize)), tmp_path / "arm")
    report = verify_folder(folder, targets=[group], steps=100, adversarial_steps=400)
    assert report.problems == ()
    (target,) = report.targets
    assert (target.bitwise, target.ram_bytes, target.core) == (True, 36, group)
    # 21 operations of the kernel are the least there can be; soft arithmetic takes about 100 for each
    least, most = (30, 300) if "float32" in CORES[group].hardware else (1500, 6000)
    assert least < target.instructions_per_step < most
    agent = load_manifest(folder).agents[0]
    assert 0 < target.stack_bytes <= agent.stack_budget_bytes[group]
    assert 300 < target.text_bytes <= agent.flash_budget_bytes[group]
    most = target.most_instructions
    # soft arithmetic is bounded at its worst operands, which no run meets in each operation
    loose = 3 if "float32" in CORES[group].hardware else 4
    assert target.instructions_per_step <= most <= agent.instruction_budget[group] < loose * most


@needs_emulator
def test_a_leader_whose_gains_are_all_zero_links(tmp_path):
    """clang clears r = 0 of seven outputs by `__aeabi_memclr4`, which no library brings here."""
    none = np.zeros((0, 0)), np.zeros((0, 7)), np.zeros((2, 0)), np.zeros((2, 7))
    leader = Controller("leader", *none, ())
    folder = write_folder(emit(CodegenSpec((leader,), period=0.01, name="leaders")), tmp_path / "leader")
    (target,) = verify_folder(folder, targets=["cortex-m4f"], steps=20, adversarial_steps=100).targets
    assert target.bitwise


@pytest.mark.slow
@needs_emulator
@pytest.mark.usefixtures("all_levels")
def test_small_leaders_keep_to_the_stated_bounds(tmp_path):
    """What nothing but a constant bounds: a fit to larger shapes had none, and was exceeded twice over."""
    small = itertools.product([0, 1], [1, 2, 3])
    agents = tuple(random_controller(f"c{n}{q}", n, q, 1, neighbours=0, zeros=0.0) for n, q in small)
    folder = write_folder(emit(arms(agents=agents, plants=())), tmp_path / "small")
    assert verify_folder(folder, targets=["rv32imafc"], steps=20, adversarial_steps=50).problems == ()


@needs_emulator
@pytest.mark.slow
@pytest.mark.parametrize("optimize", ["speed", "size"])
@pytest.mark.parametrize("group", CORES)
@pytest.mark.usefixtures("all_levels")
def test_orders_0_to_12_keep_to_the_stated_stack_and_flash(tmp_path, group, optimize):
    spec = shapes([0, 3, 6, 12], [1, 3, 4], [2], optimize=optimize)
    folder = write_folder(emit(spec), tmp_path / "shapes")
    assert verify_folder(folder, targets=[group], steps=20, adversarial_steps=100).problems == ()


@needs_emulator
@pytest.mark.by_hand  # ten builds of as many shapes: twenty minutes
@pytest.mark.slow
@pytest.mark.parametrize("real", ["float32", "float64"])
@pytest.mark.parametrize("group", CORES)
@pytest.mark.usefixtures("all_levels")
def test_many_inputs_and_limits_keep_to_the_stated_stack_and_flash(tmp_path, group, real):
    """clang unrolls what is done for each input, the clipping most of all."""
    for optimize in ("speed", "size"):
        spec = shapes([0, 3], [1], [1, 4, 8], optimize=optimize, real=real)
        limited = [
            dataclasses.replace(agent, limits=np.tile([-0.7, 1.3], (len(agent.inputs), 1)))
            for agent in spec.agents
        ]
        for name, agents in (("free", spec.agents), ("limited", tuple(limited))):
            made = emit(dataclasses.replace(spec, agents=agents))
            folder = write_folder(made, tmp_path / f"{name}_{optimize}")
            assert verify_folder(folder, targets=[group], steps=20, adversarial_steps=100).problems == ()


@needs_emulator
@pytest.mark.slow
@pytest.mark.parametrize(
    ("group", "real"),
    [
        one if one == ("cortex-m4f", "float32") else pytest.param(*one, marks=pytest.mark.by_hand)
        for one in itertools.product(CORES, ("float32", "float64"))
    ],
)
@pytest.mark.usefixtures("all_levels")
def test_shapes_that_no_bound_was_fitted_to_keep_to_the_stated_instructions(tmp_path, group, real):
    """Dense gains beyond and between the fitted shapes, with limits and offsets; the bound is no empty one either."""
    random = np.random.default_rng(17)
    for optimize in ("speed", "size"):
        agents = []
        for k, (n, q, m, nn) in enumerate(
            [(10, 4, 1, 4), (5, 2, 5, 5), (3, 4, 3, 2), (1, 3, 2, 8), (4, 4, 1, 0)]
        ):
            free = random_controller(f"c{k}", n, q, m, neighbours=nn, seed=99, zeros=0.0)
            limits, offsets = np.tile([-0.7, 1.3], (m, 1)), random.normal(size=(nn + 1, q)) if nn else None
            agents.append(free if k % 2 else dataclasses.replace(free, limits=limits, offsets=offsets))
        spec = CodegenSpec(tuple(agents), period=0.01, name="shapes", real=real, optimize=optimize)
        folder = write_folder(emit(spec), tmp_path / optimize)
        report = verify_folder(folder, targets=[group], steps=50, adversarial_steps=400)
        assert report.problems == ()
        for k, agent in enumerate(load_manifest(folder).agents):
            most = max(target.agents[k].most_instructions for target in report.targets)
            # Soft arithmetic is bounded at subnormal operands, fourteen times an ordinary one; r = 0 folds away.
            assert agent.instruction_budget[group] < 6 * most or not agent.neighbours


@needs_emulator
@pytest.mark.slow
@pytest.mark.parametrize("group", CORES)
def test_many_neighbours_take_a_wide_mask(tmp_path, group):
    agents = tuple(random_controller(f"n{nn}", 1, 1, 1, neighbours=nn) for nn in (32, 33, 64))
    folder = write_folder(emit(arms(agents=agents, plants=())), tmp_path / "wide")
    assert verify_folder(folder, targets=[group], steps=20, adversarial_steps=100).problems == ()


@needs_emulator
@pytest.mark.slow
@pytest.mark.parametrize("real", ["float32", pytest.param("float64", marks=pytest.mark.by_hand)])
@pytest.mark.parametrize("optimize", ["speed", "size"])
@pytest.mark.parametrize("group", CORES)
def test_all_shapes_10_000_steps(tmp_path, group, real, optimize):
    folder = write_folder(
        emit(shapes(range(1, 9), [1, 2, 3, 4], [1], real=real, optimize=optimize)), tmp_path / "shapes"
    )
    assert verify_folder(folder, targets=[group]).problems == ()


@needs_emulator
def test_a_changed_gain_is_seen_on_the_target(tmp_path):
    folder = write_folder(emit(arms()), tmp_path / "arms")
    change(folder, "0.9909511f", "0.9909512f")
    report = verify_folder(folder, targets=["cortex-m4f"], run_changed=True, steps=50, adversarial_steps=0)
    assert [a.bitwise for a in report.targets[0].agents] == [False, True, True]


@pytest.mark.slow
@needs_emulator
def test_more_stack_flash_or_instructions_than_stated_are_a_broken_promise(tmp_path):
    folder = write_folder(emit(one_arm()), tmp_path / "arm")
    wasteful = (
        "    volatile float waste[64];\n    uint32_t z;\n\n    for (z = 0u; z < 64u; z++) {\n"
        + "".join(f"        waste[z] = (float)(z + {k}u);\n" for k in range(240))
    )
    change(folder, "    float check;\n\n", f"    float check;\n{wasteful}    }}\n\n")
    report = verify_folder(folder, targets=["cortex-m4f"], run_changed=True, steps=20, adversarial_steps=0)
    assert report.targets[0].bitwise
    assert any("bytes of stack, its header says at most" in problem for problem in report.problems)
    assert any("bytes of flash, its header says at most" in problem for problem in report.problems)
    assert any("instructions in a step, its header says at most" in problem for problem in report.problems)


@needs_emulator
@pytest.mark.parametrize("group", CORES)
def test_float32_code_that_computes_in_double_is_refused(tmp_path, group):
    folder = write_folder(emit(one_arm()), tmp_path / "arm")
    change(folder, "= 0.9909511f * x0", "= (float)(0.9909511 * (double)x0)")
    with pytest.raises(ClaimError, match=r"arm1: the float32 code for .* calls `__\w*d"):
        build_image(load_manifest(folder), folder, CORES[group], zig(), "-O2", tmp_path)


@needs_emulator
def test_the_image_calls_nothing_that_is_not_ours(tmp_path):
    folder = write_folder(emit(one_arm()), tmp_path / "arm")
    image = load_image(build_image(load_manifest(folder), folder, M4F, zig(), "-O2", tmp_path))
    foreign = [
        name
        for name in image.symbols
        if not name.startswith(("arm", "harness_", "mem", "__aeabi_mem", "$", "support"))
    ]
    assert [name for name in foreign if "unwind" not in name] == []


@needs_emulator
def test_a_wild_write_stops_the_core_and_is_reported(tmp_path):
    folder = write_folder(emit(arms()), tmp_path / "arms")
    change(folder, "    float check;\n", "    float check;\n    *(volatile uint32_t *)0x70000000u = 1u;\n")
    report = verify_folder(folder, targets=["cortex-m4f"], run_changed=True, steps=50, adversarial_steps=0)
    assert not report.ok
    assert "the emulated core stopped" in report.targets[0].error


def test_missing_packages_are_named(tmp_path, monkeypatch):
    monkeypatch.setattr(targets, "missing_packages", lambda: ["unicorn"])
    folder = write_folder(emit(arms()), tmp_path / "arms")
    report = verify_folder(folder, targets=list(CORES), steps=5, adversarial_steps=0)
    assert not report.ok
    assert len(report.targets) == len(CORES)
    assert all(t.bitwise is None and "unicorn" in t.skipped for t in report.targets)
