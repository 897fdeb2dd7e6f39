"""The compiled C in the simulated loop: equal to its reference to the last bit, whatever the channel does to it."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
from codegen_cases import random_controller

from lockstep.check.errors import ProblemError
from lockstep.codegen.emission.emit import emit
from lockstep.codegen.folder import write_folder
from lockstep.codegen.manifest import load_manifest
from lockstep.codegen.spec import CodegenSpec, Neighbour
from lockstep.lmi.document import read
from lockstep.model.network import Network
from lockstep.model.simulation import simulate
from lockstep.model.simulation.from_problem import Changes, scenario_of
from lockstep.model.simulation.message_channel import MessageChannel
from lockstep.verification.closed_loop.compiled_loop import compiled_controllers
from lockstep.verification.closed_loop.software_in_the_loop import design_controllers, reference_controllers
from lockstep.verification.toolchain import host_compilers

needs_compiler = pytest.mark.skipif(not host_compilers(), reason="no C compiler")


@pytest.fixture(scope="module")
def arms(root):
    folder = root / "generated" / "flexible_joint_arms"
    stored = read(folder / "design.json")
    problem = stored.problem
    network = Network(problem.agent(), problem.graph(), problem.agents_B())
    scenario = scenario_of(problem, Changes(horizon=1.0, disturbance="noise"), sampled=True)
    return folder, stored, network, scenario


def leader_and_two(order, real) -> CodegenSpec:
    """A leader without incoming edges, one that hears it, one that hears both."""
    heard = ((), (Neighbour("a", 0.7),), (Neighbour("a", 1.3), Neighbour("b")))
    agents = tuple(
        replace(random_controller(name, order, 2, 2, seed=k), neighbours=sources)
        for k, (name, sources) in enumerate(zip("abc", heard, strict=True))
    )
    return CodegenSpec(agents, period=0.01, discretization="zoh", name="led", real=real)


def equal(a, b) -> bool:
    return all(np.array_equal(getattr(a, letter), getattr(b, letter)) for letter in ("x", "x_C", "u"))


@needs_compiler
@pytest.mark.parametrize(
    "channel",
    [MessageChannel(), MessageChannel(delay=2, drop=0.3, seed=1), MessageChannel(bits=12, full_scale=64.0)],
    ids=["ideal", "late and lossy", "coarse"],
)
@pytest.mark.parametrize("delay", [0, 1])
def test_it_is_the_reference_to_the_last_bit(arms, channel, delay):
    folder, _, network, scenario = arms
    scenario = replace(scenario, channel=channel)
    reference = simulate(network, reference_controllers(load_manifest(folder), delay=delay), scenario)
    with compiled_controllers(folder, delay=delay) as controllers:
        compiled = simulate(network, controllers, scenario)
        again = simulate(network, controllers, scenario)
    assert equal(compiled, reference)
    assert equal(compiled, again), "each run starts from init"
    assert compiled.u.any()


def test_the_folder_is_what_the_design_would_be(arms):
    folder, stored, network, scenario = arms
    of_folder = simulate(network, reference_controllers(load_manifest(folder)), scenario)
    assert equal(simulate(network, design_controllers(stored), scenario), of_folder)


def test_one_last_bit_of_one_gain_is_seen(arms):
    """Were the comparison blind, this would pass too."""
    folder, stored, network, scenario = arms
    changed = design_controllers(stored)
    M = changed.steppers[1].M
    M[2, 2] = np.nextafter(M[2, 2], np.float32(np.inf))
    of_folder = simulate(network, reference_controllers(load_manifest(folder)), scenario)
    assert not equal(simulate(network, changed, scenario), of_folder)


@needs_compiler
@pytest.mark.parametrize("compiler", host_compilers(), ids=lambda one: one.name)
def test_every_compiler_at_every_level(arms, compiler):
    folder, _, network, scenario = arms
    short = replace(scenario, horizon=0.1)
    reference = simulate(network, reference_controllers(load_manifest(folder)), short)
    for level in ("-O0", "-O3"):
        with compiled_controllers(folder, compiler=compiler, flags=(level,)) as controllers:
            assert equal(simulate(network, controllers, short), reference)


@needs_compiler
def test_changed_c_is_not_run(arms, tmp_path):
    folder = tmp_path / "changed"
    shutil.copytree(arms[0], folder)
    with compiled_controllers(folder):
        pass
    source = folder / "src" / "arm2.c"
    source.write_text(source.read_text() + "\n")
    with pytest.raises(ProblemError, match=r"src/arm2\.c"), compiled_controllers(folder):
        pass


@needs_compiler
@pytest.mark.parametrize("order", [0, 3])
@pytest.mark.parametrize("real", ["float32", "float64"])
def test_other_orders_and_types(order, real, tmp_path):
    folder = write_folder(emit(leader_and_two(order, real)), tmp_path / "led")
    manifest = load_manifest(folder)
    generator = np.random.default_rng(0)
    reference = reference_controllers(manifest)
    with compiled_controllers(folder) as compiled:
        for _ in range(50):
            for i, heard in enumerate(compiled.sources):
                y = generator.normal(size=len(manifest.agents[i].outputs)).astype(real)
                rows = generator.normal(size=(len(heard), len(y))).astype(real)
                received = int(generator.integers(0, 2 ** len(heard)))
                mine, theirs = compiled.steppers[i], reference.steppers[i]
                assert np.array_equal(mine.memory, theirs.memory)
                assert mine.memory.shape == (order,)
                status, u = mine.step(y, rows, received)
                expected, wanted = theirs.step(y, rows, received)
                assert status == expected == 0
                assert np.array_equal(u, wanted)


@needs_compiler
def test_a_fault_is_reported_and_the_output_held(arms):
    with compiled_controllers(arms[0]) as controllers:
        one = controllers.steppers[0]
        _, before = one.step(np.ones(2, np.float32), np.zeros((1, 2), np.float32), 1)
        status, u = one.step(np.array([np.nan, 0], np.float32), np.zeros((1, 2), np.float32), 1)
        assert status != 0
        assert np.array_equal(u, before)
        with pytest.raises(ProblemError, match="shapes"):
            one.step(np.ones(3, np.float32), np.zeros((1, 2), np.float32), 1)
