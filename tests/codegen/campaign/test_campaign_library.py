"""Compiling a campaign's loop: the same bits from every compiler, once, and from a folder of one's own."""

import pytest
from campaign_cases import HORIZON, STEP, continuous_loop, some_runs

from lockstep.campaign.compiled import library
from lockstep.campaign.compiled.lanes import LANES
from lockstep.check.errors import ProblemError
from lockstep.verification import toolchain
from lockstep.verification.toolchain import host_compilers


def test_every_compiler_gives_the_same_bits(sampled, monkeypatch):
    # Nothing is contracted or reordered, so neither the compiler nor the width of the registers shows.
    batch, tables = some_runs(sampled, LANES), []
    for compiler in host_compilers():
        for machine in (library.FOR_THIS_MACHINE, ()):
            monkeypatch.setattr(library, "FOR_THIS_MACHINE", machine)
            path = library.compiled(sampled.source, compiler)
            monkeypatch.setattr(
                "lockstep.campaign.compiled.engine.load", lambda _, path=path: library.function_in(path)
            )
            tables.append(sampled.run(batch, HORIZON).table.tobytes())
    assert len(tables) >= 2
    assert len(set(tables)) == 1


def test_without_a_compiler_it_says_what_to_install(arms_network, monkeypatch):
    source = continuous_loop(arms_network)
    monkeypatch.setattr(toolchain, "host_compilers", list)
    with pytest.raises(ProblemError, match=r"no C compiler.*toolchain"):
        library.compiled(source)


def test_compiled_once_and_whole(arms_network, monkeypatch, tmp_path):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    source = continuous_loop(arms_network)
    first = library.compiled(source)
    stamp = first.stat().st_mtime_ns
    assert library.compiled(source) == first
    assert first.stat().st_mtime_ns == stamp
    assert [path.name for path in first.parent.iterdir()] == [first.name], "nothing half-written is left"
    other = continuous_loop(arms_network, step=2 * STEP)
    assert library.compiled(other) != first
    first.parent.chmod(0o777)
    assert toolchain.own_folder("campaign") != first.parent, "others could put a library there"
