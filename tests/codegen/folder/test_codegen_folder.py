"""Writing a folder: whole or not at all, and never over someone else's files."""

import os

import pytest
from codegen_cases import arms

from lockstep.check.errors import ProblemError
from lockstep.codegen.emission.emit import emit
from lockstep.codegen.folder import write_folder
from lockstep.codegen.manifest import load_manifest


def tree(folder):
    return {p.relative_to(folder).as_posix(): p.read_text() for p in folder.rglob("*") if p.is_file()}


def test_writes_what_was_emitted_and_nothing_beside_it(tmp_path):
    files = emit(arms())
    assert write_folder(files, tmp_path / "deep" / "out") == tmp_path / "deep" / "out"
    assert tree(tmp_path / "deep" / "out") == files
    assert os.listdir(tmp_path / "deep") == ["out"]
    assert load_manifest(tmp_path / "deep" / "out").name == "arms"


def test_replaces_its_own_folder(tmp_path):
    write_folder(emit(arms()), tmp_path / "out")
    smaller = emit(arms(agents=arms().agents[:1], plants=()))
    write_folder(smaller, tmp_path / "out")
    assert tree(tmp_path / "out") == smaller
    assert os.listdir(tmp_path) == ["out"]


def test_takes_an_empty_folder(tmp_path):
    (tmp_path / "out").mkdir()
    write_folder(emit(arms()), tmp_path / "out")
    assert (tmp_path / "out" / "manifest.json").is_file()


@pytest.mark.parametrize("ours", [False, True])
def test_refuses_to_remove_a_file_that_is_not_its_own(tmp_path, ours):
    out = tmp_path / "out"
    out.mkdir()
    if ours:
        write_folder(emit(arms()), out)
    (out / "thesis.txt").write_text("years of work")
    before = tree(out)
    with pytest.raises(ProblemError, match=r"thesis|not empty"):
        write_folder(emit(arms()), out)
    assert tree(out) == before
    assert os.listdir(tmp_path) == ["out"]


def test_refuses_a_file_and_a_link(tmp_path):
    (tmp_path / "file").write_text("")
    (tmp_path / "link").symlink_to(tmp_path)
    for name in ("file", "link"):
        with pytest.raises(ProblemError, match="plain folder"):
            write_folder(emit(arms()), tmp_path / name)


def test_a_failed_write_leaves_the_old_folder(tmp_path):
    write_folder(emit(arms()), tmp_path / "out")
    before = tree(tmp_path / "out")
    with pytest.raises(ProblemError, match="cannot be written"):
        write_folder({**emit(arms()), "README.md/inside": "a file cannot be a folder"}, tmp_path / "out")
    assert tree(tmp_path / "out") == before
    assert os.listdir(tmp_path) == ["out"]


@pytest.mark.parametrize("text", ["", "{}", "[1]", '{"format": "other"}', "\xff"])
def test_a_manifest_that_is_not_ours_is_bad_input(tmp_path, text):
    (tmp_path / "manifest.json").write_text(text, encoding="latin-1")
    with pytest.raises(ProblemError, match="manifest"):
        load_manifest(tmp_path)


def test_a_missing_manifest_is_bad_input(tmp_path):
    with pytest.raises(ProblemError, match="no manifest"):
        load_manifest(tmp_path / "nowhere")


def test_a_manifest_cannot_point_outside(tmp_path):
    write_folder(emit(arms()), tmp_path / "out")
    path = tmp_path / "out" / "manifest.json"
    path.write_text(path.read_text().replace('"include/arm1.h"', '"../arm1.h"'))
    with pytest.raises(ProblemError, match="leaves the folder"):
        load_manifest(tmp_path / "out")
