"""One image for all nodes: what a list gives at run time is what a row of the Laplacian gives in C of its own."""

import json
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from codegen_cases import random_controller

import lockstep
from lockstep.check.c_source.one_image import read_node
from lockstep.check.c_source.reader import read_controller
from lockstep.check.c_source.tokens import tokens_of
from lockstep.check.certify import certify
from lockstep.check.errors import NotCertified, ProblemError
from lockstep.codegen.emission.calls import Operation
from lockstep.codegen.emission.emit import emit
from lockstep.codegen.folder import write_folder
from lockstep.codegen.manifest import Manifest
from lockstep.codegen.one_image import OneImage
from lockstep.codegen.spec import CodegenSpec
from lockstep.verification import targets
from lockstep.verification.one_image import NodeEntry, reference_of, with_nodes
from lockstep.verification.reference import CLIPPED
from lockstep.verification.stimulus import adversarial_calls, limit_calls, run_reference
from lockstep.verification.toolchain import WARNINGS, first_compiler, host_compilers
from lockstep.verification.verify import verify_folder

needs_compiler = pytest.mark.skipif(not host_compilers(), reason="no C compiler here")


@pytest.fixture(autouse=True)
def one_level(monkeypatch):
    monkeypatch.setattr(targets, "LEVELS", ("-O2",))


def image(order=2, outputs=2, inputs=1, cores=1, most=3, table="none", **options):
    """A folder of one image for four nodes, the last of which hears the three others."""
    names = ["c"] if cores == 1 else [f"c{k + 1}" for k in range(cores)]
    agents = tuple(
        random_controller(name, order, outputs, inputs, neighbours=0, seed=k) for k, name in enumerate(names)
    )
    lists = (((1, 0.3),), ((2, 1.0),), ((3, 1.0),), ((0, 0.1), (1, 1.0), (2, 2.5)))
    one = OneImage("c_node", 4, 3, most, table, lists)
    return CodegenSpec(agents, **{"period": 0.01, "name": "cs", "image": one, **options})


def nodes(files, **changed):
    """Read the nodes of an emitted folder, its header or source changed."""
    cores = [agent.name for agent in Manifest.model_validate_json(files["manifest.json"]).agents]
    read = [read_controller(one, files[f"include/{one}.h"], files[f"src/{one}.c"], []) for one in cores]
    header, source = (changed.get(k, files[p]) for k, p in (("h", "include/c_node.h"), ("c", "src/c_node.c")))
    return read_node("c_node", cores, read[-1], header, source)


SHAPES = {
    "two states": {},
    "float64, a table of gains": {"real": "float64", "optimize": "size"},
    "static, one neighbour at most": {"order": 0, "most": 3, "outputs": 1},
    "a mask of 64 bits": {"most": 40},
    "gains by number": {"cores": 3, "inputs": 2},
}


@pytest.mark.parametrize("shape", SHAPES)
def test_what_is_printed_is_read(shape):
    spec = image(**SHAPES[shape])
    assert nodes(emit(spec)) == spec.image.most


@needs_compiler
@pytest.mark.parametrize("shape", SHAPES)
def test_nodes_equal_the_reference_to_the_bit(tmp_path, shape):
    folder = write_folder(emit(image(**SHAPES[shape])), tmp_path / "cs")
    report = verify_folder(folder, steps=300, adversarial_steps=600, targets=["host"])
    assert report.ok, report.problems
    names = {found.agent for found in report.targets[0].agents}
    assert {"c_node"} <= names or {"c_node_0", "c_node_1", "c_node_2"} <= names


@needs_compiler
@pytest.mark.parametrize(
    ("ours", "theirs"),
    [
        ("r[k] = r[k] + term;", "r[k] = term + r[k] * 1.0000001f;"),
        (
            "j < list->count; j++) {\n        const c_node_mask_t",
            "j < 3u; j++) {\n        const c_node_mask_t",
        ),
        ("if (list->count > 3u) {", "if (list->count > 4u) {"),
        ("state->misses[slot] = 0u;", ""),
        ("state->age[j] = 0u;\n        } else", "} else"),
    ],
)
def test_other_code_is_seen_by_running_it_and_by_reading_it(tmp_path, ours, theirs):
    files = emit(image())
    changed = files["src/c_node.c"].replace(ours, theirs)
    assert changed != files["src/c_node.c"]
    with pytest.raises(NotCertified, match=r"c_node\.c is not the C that is generated"):
        nodes(files, c=changed)
    folder = write_folder(files, tmp_path / "cs")
    (folder / "src" / "c_node.c").write_text(changed)
    refused = verify_folder(folder, steps=10, adversarial_steps=0, targets=["host"])
    assert not refused.targets
    ran = verify_folder(folder, steps=300, adversarial_steps=600, targets=["host"], run_changed=True)
    assert any(
        ("c_node" in problem and "differs" in problem) or "error" in problem for problem in ran.problems
    )


@pytest.mark.slow
@pytest.mark.parametrize("part", ["h", "c"])
@pytest.mark.parametrize("cores", [1, 2])
def test_no_token_can_be_left_out(part, cores):
    files = emit(image(cores=cores))
    text = files["include/c_node.h" if part == "h" else "src/c_node.c"]
    tokens = [line for line in tokens_of(_bare(text)) if line]
    signs = {k for k, token in enumerate(tokens) if token == "-" and tokens[k - 1] in ("{", ",")}
    for k in sorted({*range(0, len(tokens), 3)} - signs):  # the known answers are not judged
        with pytest.raises(NotCertified):
            nodes(files, **{part: "\n".join(tokens[:k] + tokens[k + 1 :])})


def _bare(text):
    import re

    return re.sub(r"/\*.*?\*/", " ", text, flags=re.DOTALL)


def test_a_longer_list_than_there_are_bits_is_refused():
    with pytest.raises(ProblemError, match="1 to 64"):
        image(most=65)
    with pytest.raises(ProblemError, match="--max-neighbours 3"):
        image(most=2)


@needs_compiler
def test_the_table_gives_each_node_its_list(tmp_path):
    files = emit(image(table="c"))
    folder = write_folder(files, tmp_path / "cs")
    (tmp_path / "main.c").write_text(
        """#include "c_node_table.h"
#include <stdio.h>
int main(void) {
    uint32_t i, j; c_node_list_t list;
    for (i = 0u; i < 5u; i++) {
        c_node_table_list(i, &list);
        for (j = 0u; j < list.count; j++) {
            (void)printf("%u %u %.9g\\n", i, c_node_table_source[c_node_table_first[i] + j], (double)list.weight[j]);
        }
    }
    return 0;
}
"""
    )
    sources = [*folder.glob("src/*.c"), tmp_path / "main.c"]
    command = [*first_compiler("test").command, *WARNINGS, f"-I{folder / 'include'}", *map(str, sources)]
    subprocess.run([*command, "-o", str(tmp_path / "main")], check=True)
    said = subprocess.run([tmp_path / "main"], check=True, capture_output=True, text=True).stdout
    rows = [tuple(map(float, line.split())) for line in said.splitlines()]
    assert [(i, j) for i, j, _ in rows] == [(0, 1), (1, 2), (2, 3), (3, 0), (3, 1), (3, 2)]
    assert [np.float32(a) for _, _, a in rows] == [np.float32(a) for a in (0.3, 1, 1, 0.1, 1, 2.5)]
    assert "4,1,0.1\n" in emit(image(table="csv"))["nodes.csv"]


def test_own_gains_are_certified_in_one_image(tmp_path, unclipped):
    """The gains of the committed arms by the node's number: the same proof, by the numbers in this C."""
    made = lockstep.generate(unclipped, tmp_path / "arms", one_image=True, max_neighbours=4, table="csv")
    assert {"include/arm_node.h", "src/arm_node.c", "nodes.csv"} <= set(made.files)
    found = certify(tmp_path / "arms").verdicts
    assert found["code"].proved
    assert "in-degree 1 at most, a list holding 4" in found["code"].reason
    assert found["sampled"].proved and found["sampled_rho"].proved
    assert lockstep.certify(tmp_path / "arms").ok
    (tmp_path / "arms" / "nodes.csv").write_text("agent,hears,weight\n1,3,1.0\n")
    changed = lockstep.certify(tmp_path / "arms")
    assert not changed.ok and any("nodes.csv" in line for line in changed.differences)


def test_a_list_too_short_for_the_graph_is_no_proof(tmp_path, unclipped):
    """The checker itself holds the lists' length against the in-degrees: here one image for arms that hear two others."""
    lockstep.generate(unclipped, tmp_path / "arms", one_image=True)
    design = json.loads((tmp_path / "arms" / "design.json").read_text())
    design["problem"]["network"]["edges"].append([1, 3])
    (tmp_path / "arms" / "design.json").write_text(json.dumps(design))
    verdicts = certify(tmp_path / "arms").verdicts
    assert not all(one.proved for one in verdicts.values())


def test_doors_need_neighbours_of_their_own(tmp_path, unclipped):
    with pytest.raises(ProblemError, match="one image, and `--fmu`"):
        lockstep.generate(unclipped, tmp_path / "arms", one_image=True, exports=["fmu"])
    with pytest.raises(ProblemError, match="`--table` with `--per-agent`"):
        lockstep.generate(unclipped, tmp_path / "arms", one_image=False, table="csv")
    with pytest.raises(ProblemError, match="none or csv or c"):
        lockstep.generate(unclipped, tmp_path / "arms", table="yaml")


@pytest.mark.slow
@pytest.mark.parametrize("core", ["cortex-m0", "cortex-m4f", "rv32imac"])
@pytest.mark.parametrize("shape", ["two states", "gains by number"])
def test_nodes_equal_the_reference_on_emulated_cores(tmp_path, core, shape):
    pytest.importorskip("unicorn")
    pytest.importorskip("elftools")
    folder = write_folder(emit(image(**SHAPES[shape])), tmp_path / "cs")
    report = verify_folder(folder, steps=100, adversarial_steps=200, targets=[core])
    if all(target.skipped for target in report.targets):
        pytest.skip(report.targets[0].skipped)
    assert report.ok, report.problems


def clipping(**options):
    """An image whose controllers clip, the first input on both sides and the others above."""
    spec = image(**options)
    sides = np.array([[-0.3, 0.5], [-np.inf, 2.0]])[: len(spec.agents[0].D)]
    return replace(spec, agents=tuple(replace(one, limits=sides) for one in spec.agents))


CLIPPING = {
    "one controller": {"optimize": "size", "real": "float64"},
    "by number": {"cores": 3, "inputs": 2},
}


@pytest.mark.slow
@needs_compiler
@pytest.mark.parametrize("shape", CLIPPING)
def test_nodes_clip_as_their_controllers_do(tmp_path, shape):
    """To the bit with the reference, statuses and applied values among it, and in both kinds of step."""
    files = emit(clipping(**CLIPPING[shape]))
    assert nodes(files) == 3
    folder = write_folder(files, tmp_path / "cs")
    report = verify_folder(folder, steps=300, adversarial_steps=600, targets=["host"])
    assert report.ok, report.problems
    manifest = with_nodes(Manifest.model_validate_json(files["manifest.json"]))
    for node in [one for one in manifest.agents if isinstance(one, NodeEntry)]:
        calls = limit_calls(manifest, node) + adversarial_calls(manifest, node, 600)
        trace = run_reference(reference_of(node, manifest), calls)
        for operation in (Operation.STEP, Operation.STEP_RELATIVE, Operation.APPLIED):
            assert (trace.status[calls.operation == operation] == CLIPPED).any()
        sides = node.sides(manifest.real_type)
        assert ((trace.u >= sides[:, 0]) & (trace.u <= sides[:, 1])).all()


@pytest.mark.parametrize(
    ("ours", "theirs"),
    [
        ("(status == C_NODE_CLIPPED) ? C_NODE_OK : status", "status"),
        ("|| (status == C_NODE_OVERFLOW)", "|| (status == C_NODE_CLIPPED)"),
        ("(status == C_NODE_NOT_FINITE) || ", "(status != C_NODE_OK) || "),
        ("list, y, neighbour_y, usable, r)", "list, y, neighbour_y, received, r)"),
        ("c_applied(&state->controller, u)", "c_step_relative(&state->controller, u, state->u)"),
    ],
)
def test_c_that_takes_clipping_for_something_else_is_refused(ours, theirs):
    files = emit(clipping())
    source = files["src/c_node.c"]
    assert ours in source
    with pytest.raises(NotCertified, match="is not the C that is generated"):
        nodes(files, c=source.replace(ours, theirs))


def test_the_arms_clip_in_one_image(root, tmp_path):
    made = lockstep.generate(root / "generated" / "flexible_joint_arms", tmp_path / "out", one_image=True)
    assert "ARM_NODE_CLIPPED = 8" in made.files["include/arm_node.h"]
    assert certify(tmp_path / "out").proved
    held = json.loads(made.files["manifest.json"])["agents"][0]
    assert held["limits"] is not None
