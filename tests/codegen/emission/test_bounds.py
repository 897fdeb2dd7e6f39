"""Bounds of header and manifest: what they must hold at the least, and code of many shapes held to them by `verify`."""

import dataclasses

import numpy as np
import pytest
from codegen_cases import random_controller
from export_cases import folder_of
from test_fixed import one_agent

from lockstep.check.c_source.kernel import Shape
from lockstep.codegen.arithmetic import RealType
from lockstep.codegen.cost.bounds import bounds, integer_budgets, operations
from lockstep.codegen.cost.budget import Extent, state_bytes
from lockstep.codegen.cost.cores import CORES
from lockstep.codegen.emission.emit import emit
from lockstep.codegen.folder import write_folder
from lockstep.codegen.spec import CodegenSpec
from lockstep.verification import targets
from lockstep.verification.machines.emulator import missing_packages
from lockstep.verification.toolchain import zig
from lockstep.verification.verify import verify_folder

needs_emulator = pytest.mark.skipif(
    zig() is None or bool(missing_packages()), reason="ziglang, unicorn or pyelftools is not installed"
)
WAYS = [(RealType(real), optimize) for real in ("float32", "float64") for optimize in ("speed", "size")]
SHAPES = [Shape(0, 1, 1, 0), Shape(2, 2, 1, 1), Shape(0, 4, 12, 5), Shape(12, 4, 1, 8), Shape(16, 3, 2, 40)]


@pytest.mark.parametrize(("real", "optimize"), WAYS)
@pytest.mark.parametrize("shape", SHAPES)
def test_no_bound_falls_as_a_dimension_grows(real, optimize, shape):
    """Also not at the 9th, 17th and 33rd neighbour; only the first neighbour changes the C's form."""
    for more in (Extent(shape, True), Extent(shape, False, True)):
        larger, smaller = bounds(more, real, optimize), bounds(Extent(shape), real, optimize)
        assert all(larger[what][core] >= smaller[what][core] for what in larger for core in CORES)
    for name in Shape._fields:
        before = bounds(Extent(shape), real, optimize)
        for size in range(getattr(shape, name) + 1, 41):
            after = bounds(Extent(shape._replace(**{name: size})), real, optimize)
            if (name, size) != ("neighbours", 1):
                assert all(after[what][core] >= before[what][core] for what in after for core in CORES)
            before = after


@pytest.mark.parametrize(("real", "optimize"), WAYS)
@pytest.mark.parametrize("shape", SHAPES)
def test_a_bound_holds_what_the_c_must_take(real, optimize, shape):
    """The self-check's state is on the stack, its answers are in flash; each product takes a load and a sum too."""
    most = bounds(Extent(shape), real, optimize)
    entries = shape.neighbours * shape.outputs
    for core in CORES:
        assert most["stack"][core] > state_bytes(shape, real) + real.bytes * (shape.order + shape.inputs)
        assert most["flash"][core] > 2 * real.bytes * (shape.order + shape.inputs) + 4 * shape.terms
        products = shape.terms if shape.neighbours else 0  # without neighbours r is 0
        assert most["instructions"][core] > 2 * products + 3 * entries
        soft = real.name not in CORES[core].hardware
        assert not soft or most["instructions"][core] > 30 * (products + entries)
    assert all(most > 2 * shape.terms + 3 * entries for most in integer_budgets(shape).values())


def test_operations_are_those_of_the_c():
    """Two products and a sum in each of two rows, two more of each with offsets; r by hand, and what is checked: the
    kernel's result, own outputs, and a neighbour's row, twice as clang does."""
    # x+ = a x + b r, u = c x + d r; r = 0 + w (y - z): a difference, a product, a sum
    sums, itself, _, products, compared = operations(Extent(Shape(1, 1, 1, 1)))
    assert (products, sums, itself, compared) == (4 + 1, 4 + 2, 2 + 1 + 1, 2 + 2)
    more = operations(Extent(Shape(1, 1, 1, 1), True, True))
    assert (more[0] - sums, more[4] - compared) == (2, 2)


def spec_of(shapes, real, optimize):
    """Dense gains; every second one with limits, every third with offsets."""
    random, agents = np.random.default_rng(17), []
    for k, (n, q, m, nn) in enumerate(shapes):
        agent = random_controller(f"c{k}", n, q, m, neighbours=nn, seed=40 + k, zeros=0.0)
        if k % 2:
            agent = dataclasses.replace(agent, limits=np.tile([-0.7, 1.3], (m, 1)))
        if k % 3 == 2 and nn:
            agent = dataclasses.replace(agent, offsets=random.normal(size=(nn + 1, q)))
        agents.append(agent)
    return CodegenSpec(tuple(agents), period=0.01, name="shapes", real=real, optimize=optimize)


@pytest.mark.slow
@needs_emulator
@pytest.mark.parametrize("group", ["cortex-m0", "cortex-m4f", "rv32imafc"])
def test_a_leader_and_many_neighbours_keep_to_the_bounds(tmp_path, monkeypatch, group):
    """Where the bounds of the first grid, 0 to 3 neighbours, were exceeded: a leader of order 0, and from 5 neighbours on."""
    monkeypatch.setattr(targets, "CORE_LEVELS", ("-O2",))
    monkeypatch.setattr(targets, "arm_gcc", lambda: None)
    shapes = [(0, 1, 1, 0), (12, 1, 1, 5), (12, 4, 2, 6), (1, 2, 12, 9), (0, 3, 1, 40)]
    folder = write_folder(emit(spec_of(shapes, "float32", "speed")), tmp_path / "shapes")
    assert verify_folder(folder, targets=[group], steps=20, adversarial_steps=60).problems == ()


@needs_emulator
@pytest.mark.by_hand
@pytest.mark.slow
@pytest.mark.parametrize("optimize", ["speed", "size"])
@pytest.mark.parametrize("real", ["float32", "float64"])
@pytest.mark.parametrize("group", CORES)
def test_random_shapes_keep_to_the_bounds(tmp_path, group, real, optimize):
    random = np.random.default_rng(1717)
    sizes = ([0, 17], [1, 5], [1, 13], [0, 41])
    shapes = [tuple(int(random.integers(*ends)) for ends in sizes) for _ in range(6)]
    folder = write_folder(emit(spec_of(shapes, real, optimize)), tmp_path / "shapes")
    assert verify_folder(folder, targets=[group], steps=20, adversarial_steps=60).problems == ()


@needs_emulator
@pytest.mark.slow
@pytest.mark.parametrize(
    "group",
    [name if name == "cortex-m0" else pytest.param(name, marks=pytest.mark.by_hand) for name in CORES],
)
def test_integers_keep_to_the_bound_of_their_instructions(tmp_path, monkeypatch, group):
    """With many neighbours, and none; code that wastes some is a broken promise."""
    monkeypatch.setattr(targets, "CORE_LEVELS", ("-O2",))
    for shape in [(0, 1, 1, 0), (3, 2, 2, 9), (1, 1, 1, 40)]:
        folder = folder_of(tmp_path / f"n{shape[-1]}", one_agent(*shape), "fixed")
        assert verify_folder(folder, targets=[group], steps=20, adversarial_steps=60).problems == ()
    path = folder / "fixed" / "c1_fixed.c"
    waste = "    volatile uint32_t waste;\n\n    for (waste = 0u; waste < 10000u; waste++) {\n    }\n"
    start = "    if (state->ready == C1_FIXED_DESIGN_WORD) {\n        int32_t sum"
    text = path.read_text()
    assert start in text
    text = text.replace("    uint32_t k;\n\n" + start, "    uint32_t k;\n" + waste + start)
    path.write_text(text)
    report = verify_folder(folder, targets=[group], steps=3, adversarial_steps=0, run_changed=True)
    assert any("c1 in integers takes" in problem for problem in report.problems)
