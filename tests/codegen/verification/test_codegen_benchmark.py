"""The machinery of benchmarks/cores/instructions.py: equal bits where promised, and verdicts that can fail."""

import importlib.util
import sys
from dataclasses import replace

import pytest

from lockstep.verification.machines.emulator import missing_packages
from lockstep.verification.toolchain import zig


@pytest.fixture(scope="module")
def benchmark(root):
    spec = importlib.util.spec_from_file_location(
        "instructions", root / "benchmarks" / "cores" / "instructions.py"
    )
    module = importlib.util.module_from_spec(spec)
    sys.modules["instructions"] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules["instructions"]


@pytest.mark.slow
@pytest.mark.skipif(
    zig() is None or bool(missing_packages()), reason="the extra `toolchain` is not installed"
)
def test_order_4_keeps_the_promises_at_os(benchmark):
    rows = list(benchmark.measure([zig()], ["-Os"], [4], [2]))
    assert {row.variant for row in rows} == set(benchmark.VARIANTS)
    assert all(row.equal for row in rows if row.variant in ("speed", "size", "hand"))
    (verdict,) = benchmark.verdicts(rows)
    assert verdict.holds, verdict
    assert verdict.speed_at_order_2 is None
    text = benchmark.table(rows)
    assert text.count("\n| 4 | 2 |") == 1
    slower = [
        replace(row, instructions=10 * row.instructions) if row.variant == "speed" else row for row in rows
    ]
    larger = [replace(row, bytes=2 * row.bytes) if row.variant == "size" else row for row in rows]
    assert not benchmark.verdicts(slower)[0].holds
    assert not benchmark.verdicts(larger)[0].holds
