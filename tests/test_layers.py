"""Dependencies point one way, from model to cli, and what draws is report or cli."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LAYERS = {
    "model": ROOT / "model" / "lockstep" / "model",
    "lmi": ROOT / "lmi" / "lockstep" / "lmi",
    "codegen": ROOT / "codegen" / "lockstep" / "codegen",
    "verification": ROOT / "codegen" / "lockstep" / "verification",
    "campaign": ROOT / "codegen" / "lockstep" / "campaign",
    "report": ROOT / "codegen" / "lockstep" / "report",
    "workflow": ROOT / "codegen" / "lockstep" / "workflow",
    "cli": ROOT / "codegen" / "lockstep" / "cli",
}
ABOVE = {name: set(list(LAYERS)[k + 1 :]) for k, name in enumerate(LAYERS)}


def imported(source: str) -> Iterator[str]:
    """Every module that a text imports, within functions too."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module or "."


def unwanted(source: str, layer: str) -> set[str]:
    modules = set(imported(source))
    upwards = {one for one in modules if one.startswith(tuple(f"lockstep.{name}" for name in ABOVE[layer]))}
    drawn = {one for one in modules if one.partition(".")[0] in ("matplotlib", "plotext", "rich", "typer")}
    return upwards | (set() if layer in ("report", "cli") else drawn)


@pytest.mark.parametrize("layer", LAYERS)
def test_no_layer_imports_one_above_it(layer):
    files = sorted(LAYERS[layer].rglob("*.py"))
    assert files
    found = {path.name: unwanted(path.read_text(encoding="utf-8"), layer) for path in files}
    assert {name: modules for name, modules in found.items() if modules} == {}


def test_an_import_upwards_is_seen():
    assert unwanted("def f():\n    from lockstep.report.style import line\n", "codegen") == {
        "lockstep.report.style"
    }
    assert unwanted("import lockstep.lmi.design\n", "model") == {"lockstep.lmi.design"}
    assert unwanted("import matplotlib.figure\n", "codegen") == {"matplotlib.figure"}
    assert unwanted("import matplotlib.figure\nfrom lockstep.codegen.emit import emit\n", "report") == set()


CLOCKS = {
    # a time limit that the user sets: it stops the search, and the design says so
    *(f"lmi/{name}.py" for name in ("search/start", "bmi", "search/interior", "methods/certified")),
    # figures for people
    "cli/progress_lines.py",
    "campaign/campaign.py",
}


def reads_a_clock(source: str) -> bool:
    return bool({"time", "timeit", "datetime"} & set(imported(source)))


def test_no_verdict_depends_on_a_clock():
    """Budgets are counts: what reads a clock is listed, and is neither the proof of a bound nor the checker."""
    found = {
        path.relative_to(folder.parent).as_posix()
        for folder in LAYERS.values()
        for path in folder.rglob("*.py")
        if reads_a_clock(path.read_text(encoding="utf-8"))
    }
    assert found <= CLOCKS
    assert reads_a_clock("def f():\n    import time as clock\n")
    assert not reads_a_clock("def f(time):\n    return time\n")
