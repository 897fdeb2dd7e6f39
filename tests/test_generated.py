"""`generated/` is what its committed design gives today, byte for byte; `--update` accepts a change."""

import pytest

from lockstep.cli.files import read_design
from lockstep.cli.generate import generated_files
from lockstep.codegen.folder import write_folder


def test_generated_is_current(root, update):
    folder = root / "generated" / "flexible_joint_arms"
    files = generated_files(*read_design(folder))
    if update:
        write_folder(files, folder)
    kept = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    assert kept == set(files)
    for name, text in files.items():
        kept_text = (folder / name).read_text(encoding="utf-8")
        assert kept_text == text, f"{name} differs: pytest tests/test_generated.py --update accepts it"


def test_a_changed_gain_changes_the_files(root):
    content, stored = read_design(root / "generated" / "flexible_joint_arms")
    before = generated_files(content, stored)
    content["problem"]["controller"]["period"] *= 2
    from lockstep.lmi.document import parse

    after = generated_files(content, parse(content, "design.json"))
    assert before["src/arm1.c"] != after["src/arm1.c"]


@pytest.mark.parametrize("name", ["README.md", "include/arm1.h", "src/arm1.c", "manifest.json"])
def test_no_date_and_no_path_in_it(root, name):
    text = (root / "generated" / "flexible_joint_arms" / name).read_text()
    assert str(root) not in text
    assert "/tmp" not in text
