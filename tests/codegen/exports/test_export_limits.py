"""Inputs that are clipped, in every export: the bits of the reference, `CLIPPED` with them, and `_applied`."""

import dataclasses

import numpy as np
import pytest
import test_export_arduino
import test_export_fmu
import test_export_rust
from codegen_cases import arms
from export_cases import folder_of, log_of, needs, needs_compiler

from lockstep.codegen.emission.calls import Operation
from lockstep.codegen.exports.vectors import vectors
from lockstep.codegen.manifest import load_manifest
from lockstep.verification.messages.events import RECEIVE, faulty_events, run_node
from lockstep.verification.messages.events import STEP as NODE_STEP
from lockstep.verification.reference import CLIPPED, OK, Reference
from lockstep.verification.stimulus import run_reference
from lockstep.verification.verify import verify_folder, verify_log

LIMITS = np.array([[-0.125, 0.25]])


def limited(**options):
    """The arms, of whose ordinary steps a good part asks for more than these limits."""
    spec = arms(**options)
    agents = tuple(dataclasses.replace(agent, limits=LIMITS) for agent in spec.agents)
    return dataclasses.replace(spec, agents=agents)


def test_the_vectors_clip_and_apply(tmp_path):
    manifest = load_manifest(folder_of(tmp_path, limited()))
    for agent in manifest.agents[:2]:  # the third's gains are small
        calls = vectors(agent, manifest)
        trace = run_reference(Reference.of(agent, manifest), calls)
        assert (calls.operation[:100] == Operation.STEP).all()
        assert (trace.status[:100] == CLIPPED).sum() > 5
        assert {OK, CLIPPED} <= set(trace.status[calls.operation == Operation.APPLIED].tolist())
        assert (trace.u >= LIMITS[:, 0].astype(np.float32)).all() and (trace.u <= LIMITS[:, 1]).all()


@needs_compiler
@pytest.mark.parametrize("options", [{}, {"optimize": "size"}, {"real": "float64"}])
def test_a_log_of_a_board(tmp_path, options):
    folder = folder_of(tmp_path, limited(**options), "pil")
    log = log_of(folder, tmp_path)
    assert verify_log(folder, log).problems == ()
    source = folder / "src" / "arm1.c"
    source.write_text(source.read_text().replace("found = ARM1_CLIPPED", "found = ARM1_OK"))
    agents = verify_log(folder, log_of(folder, tmp_path)).targets[0].agents
    assert [one.bitwise for one in agents] == [False, True, True]


@needs("avr-gcc", "avr-g++", "simavr")
def test_on_avr(tmp_path):
    folder = folder_of(tmp_path, limited(), "pil", "arduino")
    log = test_export_arduino.log_of(folder, tmp_path, "arms", ["arm1", "arm2", "arm3"])
    assert verify_log(folder, log).problems == ()


@pytest.mark.slow
@needs("cargo", "rustc", "cc", "ar")
def test_in_rust(tmp_path):
    folder = folder_of(tmp_path, limited(), "rust")
    said = (folder / "rust" / "src" / "lib.rs").read_text()
    assert "`OK` or `CLIPPED`, or why" in said
    assert test_export_rust.compared(folder, tmp_path) == 0


@needs_compiler
def test_as_a_unit(tmp_path):
    pytest.importorskip("fmpy")
    from lockstep.codegen.emission.emit import emit
    from lockstep.codegen.exports import with_exports
    from lockstep.codegen.folder import write_folder
    from lockstep.verification.fmu import units

    texts = with_exports(emit(limited()), ["fmu"])
    manifest = load_manifest(write_folder(texts, tmp_path / "arms"))
    archive = tmp_path / "arm1.fmu"
    archive.write_bytes(units(texts)["fmu/arm1.fmu"])
    agent = manifest.agents[0]
    unit, reference = test_export_fmu.Unit(archive, tmp_path), Reference.of(agent, manifest)
    calls, period = vectors(agent, manifest), manifest.period
    seen = set()
    for k in range(100):
        unit.fmu.setUInt32([unit.reference["received"]], [int(calls.received[k])])
        unit.step(k * period, period, y=calls.y[k], neighbour_y=calls.neighbour_y[k])
        status, u = reference.step(calls.y[k], calls.neighbour_y[k], int(calls.received[k]))
        assert (unit.status, unit.get("u[0]")) == (status, float(u[0]))
        seen.add(status)
    assert seen == {OK, CLIPPED}


@pytest.mark.slow
@needs_compiler
def test_as_nodes_of_a_network(tmp_path):
    folder = folder_of(tmp_path, limited(), "messages")
    manifest = load_manifest(folder)
    trace = run_node(manifest.agents[0], manifest, events := faulty_events(manifest, manifest.agents[0], 100))
    assert (trace.status[events.operation == NODE_STEP] == CLIPPED).sum() > 10
    assert (events.operation == RECEIVE).any()
    report = verify_folder(folder, targets=["host"], steps=50, adversarial_steps=500)
    assert report.problems == ()
