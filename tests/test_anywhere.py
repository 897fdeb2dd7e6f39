"""The tests hold on any machine: their examples are fixed unless asked otherwise, and no assertion reads a clock."""

import ast
from pathlib import Path

from hypothesis import settings

CLOCKS = {"monotonic", "perf_counter", "process_time", "time", "monotonic_ns", "perf_counter_ns"}


def test_examples_are_the_same_everywhere_unless_asked_otherwise(request):
    asked = request.config.getoption("--hypothesis-profile")
    assert settings().deadline is None
    assert settings().derandomize == (asked != "random")
    assert settings().print_blob or settings().derandomize, "what chance found can be repeated"


def assertions_on_a_clock(source: str) -> list[int]:
    """Lines of assertions that call time.monotonic() or its like."""
    return [
        node.lineno
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Assert)
        for call in ast.walk(node)
        if isinstance(call, ast.Attribute) and call.attr in CLOCKS and isinstance(call.value, ast.Name)
        if call.value.id == "time"
    ]


def test_no_assertion_reads_a_clock():
    files = sorted(Path(__file__).parent.rglob("*.py"))
    found = {path.name: assertions_on_a_clock(path.read_text(encoding="utf-8")) for path in files}
    assert {name: lines for name, lines in found.items() if lines} == {}
    assert assertions_on_a_clock("import time\nassert time.monotonic() - start < 5\n") == [2]
