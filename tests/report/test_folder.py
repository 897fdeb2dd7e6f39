"""A folder with figures is written as a whole, can be replaced, and is intact for `verify`."""

import pytest

from lockstep.check.errors import ProblemError
from lockstep.codegen.bundle import bundle
from lockstep.codegen.folder import write_folder
from lockstep.codegen.manifest import changed_files, load_manifest, manifest_is_intact

FIGURES = {"figures/a.png": b"\x89PNG\xff\x00", "figures/a.pdf": b"%PDF"}


def test_figures_are_written_listed_and_replaced(files, tmp_path):
    folder = write_folder(bundle(files, FIGURES), tmp_path / "out")
    manifest = load_manifest(folder)
    assert manifest_is_intact(manifest)
    assert changed_files(folder, manifest) == ()
    assert (folder / "figures/a.png").read_bytes() == FIGURES["figures/a.png"]
    (folder / "figures/a.png").write_bytes(b"changed")
    assert changed_files(folder, manifest) == ("figures/a.png",)
    write_folder(bundle(files, {"figures/b.png": b"new"}), folder)
    assert sorted(path.name for path in (folder / "figures").iterdir()) == ["b.png"]
    assert [path.name for path in tmp_path.iterdir()] == ["out"], "nothing half-written is left"


def test_what_is_not_ours_is_not_lost(files, tmp_path):
    folder = write_folder(bundle(files, FIGURES), tmp_path / "out")
    (folder / "figures" / "mine.txt").write_text("notes")
    with pytest.raises(ProblemError, match=r"mine\.txt"):
        write_folder(bundle(files, FIGURES), folder)
    assert (folder / "figures" / "mine.txt").read_text() == "notes"


def test_an_interruption_leaves_the_old_folder(files, tmp_path):
    folder = write_folder(bundle(files, FIGURES), tmp_path / "out")

    class Interrupting(dict):
        def items(self):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_folder(Interrupting(bundle(files, FIGURES)), folder)
    assert (folder / "figures/a.png").read_bytes() == FIGURES["figures/a.png"]
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
