"""Formations in what ships: the C and its nodes to the bit, what the checker reads, runs; and a leader's reference."""

import json
from dataclasses import replace

import numpy as np
import pytest
from test_clipped_runs import engine_of, run_from

from cart import cart
from lockstep.campaign.network_faults.faults import NetworkFaults
from lockstep.campaign.network_faults.loop import COLUMNS, network_loop, rows_of
from lockstep.check.c_source.reader import read_controller
from lockstep.check.certify import certify
from lockstep.check.continuous.inequality import Performance
from lockstep.check.errors import NotCertified, ProblemError
from lockstep.codegen.bundle import bundle
from lockstep.codegen.emission.emit import emit
from lockstep.codegen.emission.formation_claims import said_of_leader
from lockstep.codegen.exports import with_exports
from lockstep.codegen.folder import write_folder
from lockstep.codegen.from_design import CodeOptions, specification
from lockstep.codegen.manifest import Manifest
from lockstep.codegen.period_redesign import as_shipped
from lockstep.codegen.spec import CodegenSpec, Controller, Neighbour
from lockstep.lmi.design import design
from lockstep.lmi.document import design_file_of
from lockstep.model.plain_json import to_json
from lockstep.model.problem import Problem
from lockstep.model.simulation import simulate
from lockstep.model.simulation.from_problem import scenario_of
from lockstep.verification import targets
from lockstep.verification.closed_loop.measured_gain import measured, network_of_design, promise
from lockstep.verification.closed_loop.software_in_the_loop import design_controllers
from lockstep.verification.toolchain import host_compilers
from lockstep.verification.verify import verify_folder
from lockstep.workflow.design_file import Design, load
from lockstep.workflow.generate import generated_files

needs_compiler = pytest.mark.skipif(not host_compilers(), reason="no C compiler here")
OFFSETS = np.array([[0.1, 0.0], [-7.3, 0.0], [-15.2, 0.0]])
CARTS = (
    cart("f - 0.2*tanh(v)")
    + """
[network]
agents = 3
edges = [[2, 1], [3, 2], [3, 1, 0.5]]
offsets = OFFSETS
[design]
method = "given"
gains = [GAINS, GAINS, GAINS]
[controller]
period = 0.02
[simulation]
horizon = 30.0
initial = [[0.0, 0.5], [1.0, 0.0], [-2.0, 0.3]]
"""
)
GIVEN = "{ A = [[-3.0]], B = [[1.0, 0.5]], C = [[-0.2]], D = [[-1.5, -2.0]] }"
REFERENCE = '[simulation.reference]\nf = "0.5*sin(0.4*t)"\n'


def carts(more: str = "", offsets=OFFSETS) -> Problem:
    text = CARTS.replace("OFFSETS", str(np.asarray(offsets).tolist())).replace("GAINS", GIVEN)
    return Problem.parse(text + more)


@pytest.fixture(scope="module")
def formation():
    """Three carts in a line: two behind a leader, one of them hearing both others."""
    return as_shipped(design_file_of(design(carts(REFERENCE))))


def apart(x: np.ndarray) -> np.ndarray:
    """States less their offsets, from the leader's."""
    less = x - OFFSETS
    return less - less[..., :1, :]


@pytest.fixture(autouse=True)
def one_level(monkeypatch):
    monkeypatch.setattr(targets, "LEVELS", ("-O2",))


def spec(real="float32", optimize="speed", order=2, limits=False) -> CodegenSpec:
    """Two agents with offsets, of which the second hears both the first and one outside, and a leader."""
    random = np.random.default_rng(4)
    A, B = random.normal(size=(order, order)) - 3 * np.eye(order), random.normal(size=(order, 2))
    C, D = random.normal(size=(1, order)), random.normal(size=(1, 2))
    sides = np.array([[-0.5, 0.7]]) if limits else np.zeros((0, 2))
    rows = 3.7 * random.normal(size=(3, 2))
    heard = {"a": (), "b": (Neighbour("a"),), "c": (Neighbour("a", 0.3), Neighbour("b", 2.0))}
    agents = tuple(
        Controller(name, A, B, C, D, heard[name], limits=sides, offsets=rows[list(places)])
        for name, places in (("a", [0]), ("b", [1, 0]), ("c", [2, 0, 1]))
    )
    return CodegenSpec(agents, 0.01, real=real, optimize=optimize, name="abc")


SHAPES = {
    "unrolled": {},
    "a table, in doubles": {"real": "float64", "optimize": "size"},
    "static, clipped": {"order": 0, "limits": True},
    "a table, clipped": {"optimize": "size", "limits": True},
}


@needs_compiler
@pytest.mark.parametrize("shape", SHAPES)
def test_c_and_nodes_equal_their_references_to_the_bit(tmp_path, shape):
    files = with_exports(emit(spec(**SHAPES[shape])), ["messages"])
    report = verify_folder(
        write_folder(files, tmp_path / "abc"), steps=300, adversarial_steps=1000, targets=["host"]
    )
    assert report.ok, report.problems
    assert all(one.agents for one in report.targets if not one.skipped)


@pytest.mark.slow
@pytest.mark.parametrize("core", ["cortex-m0", "cortex-m4f", "rv32imac", "rv32imafc"])
@pytest.mark.parametrize("shape", ["unrolled", "a table, in doubles"])
def test_stack_and_flash_are_as_the_header_says(tmp_path, core, shape):
    pytest.importorskip("unicorn")
    pytest.importorskip("elftools")
    folder = write_folder(emit(spec(**SHAPES[shape])), tmp_path / "abc")
    report = verify_folder(folder, steps=50, adversarial_steps=100, targets=[core])
    if all(target.skipped for target in report.targets):
        pytest.skip(report.targets[0].skipped)
    assert report.ok, report.problems


@pytest.mark.parametrize("shape", SHAPES)
def test_what_is_printed_is_read(shape):
    given = spec(**SHAPES[shape])
    files = emit(given)
    for agent in given.agents:
        one = read_controller(
            agent.name, files[f"include/{agent.name}.h"], files[f"src/{agent.name}.c"], ["a", "b", "c"]
        )
        expected = agent.offsets.astype(given.real) if agent.neighbours else None
        np.testing.assert_array_equal(one.offsets, expected)


@pytest.mark.parametrize(
    ("ours", "theirs"),
    [
        ("own[k] = y[k] - offset[k]", "own[k] = y[k] + offset[k]"),
        ("offset[((j + 1u) * 2u) + k]", "offset[(j * 2u) + k]"),
        ("c_exchange(state, own, others,", "c_exchange(state, own, neighbour_y,"),
        ("(void)c_exchange(&state", "(void)c_step(&state"),
    ],
)
def test_c_that_subtracts_otherwise_is_refused(ours, theirs):
    files = emit(spec())
    source = files["src/c.c"]
    assert ours in source
    with pytest.raises(NotCertified, match="is not the C that is generated"):
        read_controller("c", files["include/c.h"], source.replace(ours, theirs), ["a", "b", "c"])


def folder_of(stored, tmp_path, **changed):
    files = dict(emit(specification(stored)))
    for path, (ours, theirs) in changed.items():
        name = path.replace("__", "/") + ".c"
        assert ours in files[name]
        files[name] = files[name].replace(ours, theirs)
    design_text = {"design.json": to_json(stored.document()) + "\n"}
    return write_folder(bundle(files, design_text), tmp_path / "made")


def test_the_checker_decides_the_formation_and_the_offsets_in_the_c(formation, tmp_path):
    found = certify(folder_of(formation, tmp_path))
    assert found.proved and found.verdicts["formation"].proved and found.verdicts["sampled"].proved
    changed = folder_of(formation, tmp_path / "other", src__cart3=("-15.2f", "-15.1f"))
    found = certify(changed)
    assert found.verdicts["code"].status == "refuted" and "offsets" in found.verdicts["code"].reason


def test_c_without_the_offsets_of_its_design_is_refused(formation, tmp_path):
    """And C with offsets that its design does not have."""
    design_text = {"design.json": to_json(formation.document()) + "\n"}
    plain = replace(formation, problem=carts(REFERENCE, np.zeros((3, 2))))
    files = emit(specification(plain))
    assert "_exchange" not in files["src/cart2.c"]
    found = certify(write_folder(bundle(files, design_text), tmp_path / "without"))
    assert "offsets" in found.verdicts["code"].reason
    files = emit(specification(formation))
    design_text = {"design.json": to_json(plain.document()) + "\n"}
    found = certify(write_folder(bundle(files, design_text), tmp_path / "with"))
    assert "offsets" in found.verdicts["code"].reason


def test_a_file_whose_offsets_an_equation_sees_is_refused(formation, tmp_path):
    document = formation.document()
    document["problem"]["network"]["offsets"][1][1] = 1e-300
    path = tmp_path / "design.json"
    path.write_text(json.dumps(document))
    with pytest.raises(
        ProblemError, match="agent 2: its offset from agent 1 adds 1e-300 to the derivative of `p`"
    ):
        certify(path)


def test_the_loop_with_offsets_is_the_one_without(formation):
    """From states less the offsets; of sampled controllers to what rounding of the readings makes of it."""
    network = network_of_design(formation)
    scenario = scenario_of(formation.problem, sampled=False)
    plain = replace(scenario, start=scenario.start - OFFSETS, offsets=None)
    gains = formation.gains
    one, other = simulate(network, gains, scenario), simulate(network, gains, plain)
    np.testing.assert_allclose(one.x - OFFSETS, other.x, atol=1e-12)
    np.testing.assert_allclose(one.u, other.u, atol=1e-12)
    np.testing.assert_allclose(one.disagreement(), other.disagreement(), atol=1e-12)
    quiet = replace(scenario, disturbance=None)
    sampled = simulate(network, design_controllers(formation), quiet)
    residual = formation.claims.sampled.residual_per_message_error
    off = 2 * 2.0**-24 * float(np.abs(sampled.y).max())
    assert np.linalg.norm(apart(sampled.x[-1])) < residual * off + 1e-5
    assert sampled.disagreement()[-1] < 1e-4 < sampled.disagreement()[0]
    assert np.ptp(sampled.x[-1, :, 0]) == pytest.approx(15.3, abs=1e-3)


@needs_compiler
def test_a_campaign_runs_the_c_in_formation(formation):
    """Its loop is that of x less the offsets, with the very C: the states of the simulation, to rounding."""
    stored = replace(formation, problem=carts())
    scenario = replace(scenario_of(stored.problem, sampled=True), horizon=5.0)
    run = simulate(network_of_design(stored), design_controllers(stored), scenario)
    start = scenario.start - OFFSETS
    found = run_from(engine_of(stored), start[None], 5.0)
    assert found["disagreement_initial"][0] == pytest.approx(run.disagreement()[0], rel=1e-12)
    assert found["disagreement_final"][0] == pytest.approx(run.disagreement()[-1], abs=2e-5)
    assert found["faults"][0] == 0


@needs_compiler
def test_nodes_on_a_bad_network_come_into_formation(formation):
    """The compiled nodes, a tenth of their messages lost: the disagreement is that of x less the offsets."""
    stored = replace(formation, problem=carts())
    problem = stored.problem
    files = with_exports(emit(specification(stored)), ["messages"])
    weights = Performance(problem.state_weight(2), problem.controller_weight(1))
    loop = network_loop(network_of_design(stored), files, weights)
    start = problem.initial_states() - OFFSETS
    rows = rows_of(NetworkFaults(loss=0.1), 1)
    found = loop.runs(rows, np.array([3], np.uint64), start[None], 40.0)[0]
    first, last, lost = (
        found[COLUMNS.index(name)] for name in ("disagreement_initial", "disagreement_final", "lost")
    )
    e = start - start.mean(axis=0)
    # The first figure is taken after one tenth of a period.
    assert first == pytest.approx(float(np.sqrt((e**2).sum())), rel=1e-2)
    assert lost > 100 and last < 1e-3


def test_a_reference_is_held_against_what_is_proved_and_said(formation):
    """From formation: |z| over |v| stays below the figure of the header."""
    problem = carts(REFERENCE + '[simulation.disturbance]\nkind = "none"\n')
    stored = replace(formation, problem=problem)
    scenario = scenario_of(problem, sampled=True)
    scenario = replace(scenario, start=OFFSETS + np.array([1.0, 0.2]))
    network = network_of_design(stored)
    run = simulate(network, design_controllers(stored), scenario)
    np.testing.assert_allclose(run.xi[:, 0, 1], 0.5 * np.sin(0.4 * run.t), atol=1e-12)
    found = measured(run, scenario, stored, network, promise(stored, "sampled"))
    assert found.covered and found.holds and found.ratio > 0.05
    line = specification(stored).certificate["leader"]
    assert line.startswith(
        "a command v to cart1 alone, which leads, is its disturbance B v: from agreement |z| <= "
    )
    gain = float(line.split("<= ")[1].split()[0])
    squared = 0.25 * np.trapezoid(np.sin(0.4 * run.t) ** 2, run.t)
    assert 0.1 * gain * np.sqrt(squared) < found.output < gain * np.sqrt(squared)
    assert gain == pytest.approx(stored.claims.sampled.rho * np.sqrt(2 / 3), rel=0.1)
    files = emit(specification(stored))
    assert "offset c_1" in files["include/cart3.h"] and "which leads" in files["include/cart3.h"]
    assert "has no incoming edges, so that its own offset is nothing" in files["include/cart1.h"]
    held = Manifest.model_validate_json(files["manifest.json"]).agents[2].offsets
    assert held[0] == (float(np.float32(-15.2)), 0.0)


def test_who_leads_is_said_to_be_no_one_to_command_alone(formation, root):
    """Also of a file that names no reference: whoever drives the leader is told by the header. A cycle has none."""
    led = specification(replace(formation, problem=carts())).certificate["leader"]
    assert led.endswith("not proved: that followers come to agree with it while v lasts")
    cycle = load(root / "generated" / "flexible_joint_arms").stored
    assert "leader" not in specification(cycle).certificate


def test_what_is_said_of_a_leader_is_in_the_scales_of_rho(formation):
    """B = (0, b)': with a scale of 4 for the speed, v is a disturbance of a quarter; with none, rho says nothing of it."""
    said = [
        said_of_leader(replace(formation, problem=carts(f"[design.disturbances]\nstates = {states}\n")))[
            "leader"
        ]
        for states in ("{ p = 1.0, v = 1.0 }", "{ p = 1.0, v = 4.0 }", "{ p = 1.0 }")
    ]
    whole, quarter = (float(one.split("<= ")[1].split()[0]) for one in said[:2])
    assert quarter == pytest.approx(whole / 4, rel=0.1)  # two digits
    assert "<=" not in said[2]


def test_one_image_holds_no_offsets(formation):
    with pytest.raises(ProblemError, match="offsets in one image for all nodes"):
        generated_files(Design.of(formation.document(), "formation"), options=CodeOptions(one_image=True))
