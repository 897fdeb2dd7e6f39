"""benchmarks/rounding.py: the rounding of the shipped controllers stays within what is claimed of it, and near it."""

import importlib.util
import sys
from dataclasses import replace

import pytest


@pytest.fixture(scope="module")
def benchmark(root):
    spec = importlib.util.spec_from_file_location("rounding", root / "benchmarks" / "rounding.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules["rounding"] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules["rounding"]


def test_a_thousand_steps_of_each_arm(benchmark):
    rows = benchmark.measure(benchmark.DEFAULT, 1000)
    assert {(row.agent, row.part) for row in rows} == {
        (f"arm{i}", part) for i in (1, 2, 3) for part in ("x_C+", "u")
    }
    assert all(row.holds for row in rows), rows


def test_claims_ten_times_smaller_or_larger_are_told(benchmark, monkeypatch):
    honest = benchmark.read_controller

    def scaled(factor):
        def controller(*texts):
            found = honest(*texts)
            real = found.controller.deltas
            found.controller.__dict__["deltas"] = {letter: factor * value for letter, value in real.items()}
            return found

        return controller

    for factor in (0.1, 20.0):
        monkeypatch.setattr(benchmark, "read_controller", scaled(factor))
        assert not any(row.holds for row in benchmark.measure(benchmark.DEFAULT, 400))


@pytest.mark.slow
def test_a_million_steps_of_each_arm(benchmark):
    rows = benchmark.measure(benchmark.DEFAULT, 1_000_000)
    assert all(row.holds and row.steps == 1_000_000 for row in rows), rows


def test_the_verdict_needs_both_sides(benchmark):
    row = benchmark.Row("arm1", "u", 1, 0.5)
    assert row.holds
    assert not replace(row, worst=1.01).holds
    assert not replace(row, worst=0.05).holds
