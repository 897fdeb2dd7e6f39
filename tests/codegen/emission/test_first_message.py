"""A first message moves u by D a_j (y - y_j) and by nothing else: the compiled C, where its header says so."""

from dataclasses import replace

import numpy as np
import pytest
from codegen_cases import arms, random_controller

from lockstep.codegen.emission.calls import Calls, Operation
from lockstep.codegen.emission.emit import emit
from lockstep.codegen.folder import write_folder
from lockstep.codegen.manifest import load_manifest
from lockstep.verification.harness import run_on_host
from lockstep.verification.reference import NOT_READY
from lockstep.verification.toolchain import host_compilers

STEPS, FIRST = 12, 8
EARLY, LATE = 0b01, 0b10
"""Bits of the neighbour that is heard from the start, and of the one that is heard at step `FIRST`."""

pytestmark = pytest.mark.skipif(not host_compilers(), reason="no C compiler here")


@pytest.fixture(params=["speed", "size"])
def folder(request, tmp_path):
    agents = (random_controller("c", 3, 2, 2, neighbours=2, zeros=0.0),)
    spec = arms(agents=agents, plants=(), real="float64", optimize=request.param)
    return write_folder(emit(spec), tmp_path / "c")


def trace_of(folder, calls):
    work = folder.parent / f"work{len(list(folder.parent.iterdir()))}"
    work.mkdir()
    flags = ("-O1", "-std=c99", "-ffp-contract=off")
    ((_, run),) = run_on_host(load_manifest(folder), folder, {"c": calls}, work, host_compilers()[0], flags)
    return run.trace


def heard_late(late):
    """Calls in which the second neighbour is first heard at `FIRST`, with `late` in place of the step's own output."""
    y = np.cos(np.arange(STEPS)[:, None] + np.arange(2.0))
    others = np.stack([np.sin(y), y], axis=1)
    others[FIRST, 1] = late if late is not None else np.nan
    received = np.full(STEPS, EARLY, np.uint64)
    received[FIRST] |= LATE if late is not None else 0
    return Calls(np.full(STEPS, Operation.STEP, np.uint32), received, y, others, np.zeros_like(y))


def test_in_agreement_nothing_moves(folder):
    silent, y = trace_of(folder, heard_late(None)), heard_late(None).y
    agreed = trace_of(folder, heard_late(y[FIRST]))
    assert agreed.heard[FIRST] == EARLY | LATE != silent.heard[FIRST]
    for part in ("u", "x"):
        until = slice(None, FIRST + 1)
        assert getattr(agreed, part)[until].tobytes() == getattr(silent, part)[until].tobytes()


def test_out_of_agreement_u_moves_by_the_direct_term(folder):
    calls = heard_late(np.array([0.75, -1.5]))
    silent, heard = trace_of(folder, heard_late(None)), trace_of(folder, calls)
    (agent,) = load_manifest(folder).agents
    M, weight = agent.table(load_manifest(folder).real_type), agent.neighbours[1].weight
    moved = M[:, 3:] @ (weight * (calls.y[FIRST] - calls.neighbour_y[FIRST, 1]))
    for k in range(FIRST):
        assert heard.u[k].tobytes() == silent.u[k].tobytes()
    np.testing.assert_allclose(heard.x[FIRST] - silent.x[FIRST], moved[:3], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(heard.u[FIRST] - silent.u[FIRST], moved[3:], rtol=1e-9, atol=1e-12)
    assert np.abs(moved[3:]).min() > 0.1


def test_no_message_from_before_a_reset_is_used(folder):
    calls = heard_late(np.array([0.75, -1.5]))
    operation = calls.operation.copy()
    operation[FIRST + 1] = Operation.RESET
    after = slice(FIRST + 2, None)
    received = calls.received.copy()
    received[after] = 0
    found = trace_of(folder, replace(calls, operation=operation, received=received))
    parts = ("operation", "received", "y", "neighbour_y", "r")
    rest = Calls(*(getattr(replace(calls, received=received), part)[after] for part in parts))
    fresh = trace_of(folder, rest)
    assert (found.heard[after] == 0).all()
    assert found.u[after].tobytes() == fresh.u.tobytes()


def test_a_neighbour_taken_for_zero_before_it_is_heard_is_seen(folder):
    source = folder / "src" / "c.c"
    text = source.read_text()
    unheard = "} else if ((state->heard & bit) != 0u) {"
    assert unheard in text
    wrong = text.replace(unheard, "} else if (state->heard <= bit) {")
    source.write_text(wrong)
    calls = heard_late(None)
    # the self-check tries a message that is NaN before any was heard
    assert (trace_of(folder, calls).status == NOT_READY).all()
    source.write_text(wrong.replace("state->ready = 0u;", "(void)status;"))
    agreed = trace_of(folder, heard_late(calls.y[FIRST]))
    assert agreed.u[FIRST].tobytes() != trace_of(folder, calls).u[FIRST].tobytes()
