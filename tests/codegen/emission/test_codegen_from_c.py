"""All that `emit` prints is read back by the checker; what is told of a folder whose C was changed."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from codegen_cases import arms, random_controller, shapes

from lockstep.check.c_source.reader import read_controller
from lockstep.check.sampled.controller import HeldController
from lockstep.codegen.emission.emit import emit
from lockstep.codegen.folder.as_generated import compared
from lockstep.codegen.manifest import Manifest, load_manifest
from lockstep.codegen.spec import CodegenSpec, Controller, Neighbour
from lockstep.lmi import document


def heard(count, weight):
    sources = tuple(Neighbour(f"peer{j}", weight + j % 2) for j in range(count))
    return Controller(
        f"n{count}", -np.eye(1), np.ones((1, 2)), np.ones((1, 1)), np.array([[0.0, 2.0]]), sources
    )


def silent(order):
    """Gains that are 0 leave x, r or a row of the kernel without a reader or a term."""
    zero = Controller(
        f"z{order}", np.zeros((order, order)), np.zeros((order, 2)), np.zeros((2, order)), np.zeros((2, 2))
    )
    D = np.array([[0.0, 0.0], [0.0, -2.0]])
    return zero, Controller(f"d{order}", zero.A, zero.B, zero.C, D)


SPECS = {
    "arms": arms,
    "shapes": lambda **o: shapes((0, 1, 2, 3, 5, 8), (1, 2, 3), (1, 2), **o),
    "many": lambda **o: CodegenSpec(
        tuple(heard(k, 1.0 + (k == 33)) for k in (1, 32, 33, 64)), 0.01, "zoh", **o
    ),
    "silent": lambda **o: CodegenSpec((*silent(0), *silent(3)), 0.01, "tustin", **o),
    "dense": lambda **o: CodegenSpec((random_controller("big", 20, 4, 3, zeros=0.0),), 0.5, "euler", **o),
}


@pytest.mark.parametrize("name", SPECS)
@pytest.mark.parametrize("optimize", ["speed", "size"])
@pytest.mark.parametrize("real", ["float32", "float64"])
def test_whatever_is_printed_is_read_back(name, optimize, real):
    """The templates print the code and `lockstep.check.c_source.expected` says what it is: this ties the two."""
    files = emit(SPECS[name](optimize=optimize, real=real))
    manifest = Manifest.model_validate_json(files["manifest.json"])
    names = [agent.name for agent in manifest.agents] + [f"peer{j}" for j in range(64)]
    for agent in manifest.agents:
        one = read_controller(
            agent.name, files[f"include/{agent.name}.h"], files[f"src/{agent.name}.c"], names
        )
        found = one.controller
        np.testing.assert_array_equal(found.table, agent.table(manifest.real_type).astype(float))
        np.testing.assert_array_equal(found.weights, agent.weights(manifest.real_type).astype(float))
        assert [names[j] for j in found.sources] == [source.source for source in agent.neighbours]
        assert (one.real, found.order) == (real, agent.order)
        assert one.period == np.dtype(real).type(manifest.period)
        full = HeldController.row_by_row(
            found.table, found.order, found.sources, found.weights, found.precision
        )
        assert (found.roundings <= full.roundings).all()
        assert optimize == "speed" or (found.roundings == full.roundings).all()


GENERATED = Path(__file__).parents[3] / "generated" / "flexible_joint_arms"


@pytest.fixture
def differences(tmp_path):
    """What `compared` says of a copy of the worked example that was changed; the proof itself is not asked for."""

    def of(change):
        folder = tmp_path / "folder"
        shutil.copytree(GENERATED, folder)
        change(folder)
        stored = document.read(folder / "design.json")
        return compared(folder, stored).differences

    return of


def test_a_folder_as_it_was_generated_differs_in_nothing(differences):
    assert differences(lambda _folder: None) == ()


@pytest.mark.parametrize(
    "path", ["src/arm1.h", "include/stdint.h", "include/bits/types.h", "include/arm1.h.gch"]
)
def test_a_header_that_shadows_one_that_was_read_is_told(differences, path):
    """#include "arm1.h" looks beside the source first, <stdint.h> in include/ before the compiler's own."""

    def add(folder):
        (folder / path).parent.mkdir(exist_ok=True)
        (folder / path).write_text("#define x_next x_now\n")

    (line,) = differences(add)
    assert line.startswith(f"{path} was not generated")


def test_agents_in_another_order_are_told(differences):
    """Each agent's C is proved with the inputs B of its place: the places are the design's."""

    def swap(folder):
        manifest = load_manifest(folder)
        second, first, *others = manifest.agents
        turned = manifest.model_copy(update={"agents": (first, second, *others)}).sealed()
        (folder / "manifest.json").write_text(turned.text())

    line, *_ = differences(swap)
    assert "arm2, arm1, arm3" in line
