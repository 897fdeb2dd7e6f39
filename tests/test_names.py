"""One public class name has one meaning: it is defined in one module, and imported from there."""

import ast
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).parents[1]
ROOTS = ("check", "model", "lmi", "codegen", "studies")


def defined(folders: list[Path]) -> dict[str, list[str]]:
    """Public classes, name -> modules that define one; what a facade imports is not defined there."""
    found = defaultdict(list)
    for folder in folders:
        for path in sorted(folder.rglob("*.py")):
            for node in ast.parse(path.read_text(encoding="utf-8")).body:
                if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                    found[node.name].append(path.relative_to(folder.parent).as_posix())
    return found


def test_no_class_name_is_defined_in_two_modules():
    found = defined([ROOT / root for root in ROOTS])
    assert len(found) > 100
    assert {name: places for name, places in found.items() if len(places) > 1} == {}


def test_a_second_meaning_is_found(tmp_path):
    (tmp_path / "one.py").write_text("class Design: ...\nclass _Own: ...\n")
    (tmp_path / "two.py").write_text("class Design: ...\nclass _Own: ...\n")
    (tmp_path / "facade.py").write_text("from one import Design as Design\n")
    assert [name for name, places in defined([tmp_path]).items() if len(places) > 1] == ["Design"]
