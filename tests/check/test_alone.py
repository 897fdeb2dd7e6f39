"""The checker stands alone: the standard library, numpy, flint and itself, imports within functions and for types counted."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2] / "check" / "lockstep" / "check"
ALLOWED = {*sys.stdlib_module_names, "numpy", "flint"} - {"importlib"}

NOT_YET: dict[str, set[str]] = {}
"""What is still to go. Nothing is ever added here, and what is clean is taken off."""


def imported(source: str) -> Iterator[str]:
    """Every module that a text imports; a relative import, and a module that is found by a name, count as themselves."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield "." * node.level + (node.module or "")
            if node.module == "lockstep":
                yield from (f"lockstep.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Name) and node.id in ("__import__", "exec", "eval"):
            yield node.id


def unwanted(source: str) -> set[str]:
    return {
        one
        for one in imported(source)
        if one.partition(".")[0] not in ALLOWED
        and one != "lockstep.check"
        and not one.startswith("lockstep.check.")
    }


def test_the_checker_imports_nothing_else():
    files = sorted(ROOT.rglob("*.py"))
    assert len(files) > 30
    found = {path.relative_to(ROOT).as_posix(): unwanted(path.read_text(encoding="utf-8")) for path in files}
    assert {name: modules for name, modules in found.items() if modules} == NOT_YET


def test_what_is_not_allowed_is_seen():
    assert unwanted("def f():\n    from scipy.linalg import expm\n") == {"scipy.linalg"}
    assert unwanted("if TYPE_CHECKING:\n    from lockstep.model.graphs.graph import Graph\n") == {
        "lockstep.model.graphs.graph"
    }
    assert unwanted("import lockstep.checked\n") == {"lockstep.checked"}
    assert "lockstep.lmi" in unwanted("from lockstep import lmi\n")
    assert unwanted("from ..lmi import design\n") == {"..lmi"}
    assert unwanted("import importlib\n") == {"importlib"}
    assert unwanted("__import__('cvxpy')\n") == {"__import__"}
    assert (
        unwanted(
            "import math, numpy.linalg\nfrom flint import fmpq\nfrom lockstep.check.system.loop import Loop\n"
        )
        == set()
    )


def test_a_reader_that_has_had_enough_changes_no_verdict(root):
    """`lockstep-check DIR | head -1`: the pipe is closed before anything is written."""
    command = [sys.executable, "-m", "lockstep.check", str(root / "generated" / "flexible_joint_arms")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as run:
        assert run.stdout is not None and run.stderr is not None
        run.stdout.close()
        assert run.stderr.read() == b""
    assert run.returncode == 0
