"""`generated/` is what its committed design gives today, byte for byte; `--update` accepts a change."""

import json

import pytest

from lockstep.codegen.emission.emit import emit
from lockstep.codegen.folder import write_folder
from lockstep.codegen.from_design import specification
from lockstep.lmi.document import parse
from lockstep.workflow.design_file import Design, load
from lockstep.workflow.generate import generated_files


def test_generated_is_current(root, update):
    folder = root / "generated" / "flexible_joint_arms"
    files = generated_files(load(folder))
    if update:
        write_folder(files, folder)
    kept = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    assert kept == set(files)
    for name, text in files.items():
        kept_text = (folder / name).read_text(encoding="utf-8")
        assert kept_text == text, f"{name} differs: pytest tests/test_generated.py --update accepts it"


def test_what_the_headers_claim_is_wrapped(root):
    """At 110: of all lines between `WHAT IS CLAIMED` and what follows; and wrapping loses no word of the manifest's."""
    folder = root / "generated" / "flexible_joint_arms"
    proved = json.loads((folder / "manifest.json").read_text())["certificate"]["proved"]
    for header in sorted((folder / "include").glob("arm?.h")):
        claimed = header.read_text().split("WHAT IS CLAIMED")[1].split("WHAT IT COSTS")[0]
        assert max(map(len, claimed.splitlines())) <= 110
        assert proved in " ".join(claimed.replace(" * ", " ").split())


def test_a_changed_period_changes_the_files(root):
    """Without this, the test above would also pass for a generator that ignores its design."""
    folder = root / "generated" / "flexible_joint_arms"
    content = json.loads((folder / "design.json").read_text())
    content["problem"]["controller"]["period"] *= 2
    stored = parse(content, "design.json")
    spec = specification(stored)
    source = emit(spec)["src/arm1.c"]
    assert source != (folder / "src" / "arm1.c").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ["README.md", "include/arm1.h", "src/arm1.c", "manifest.json"])
def test_no_date_and_no_path_in_it(root, name):
    text = (root / "generated" / "flexible_joint_arms" / name).read_text()
    assert str(root) not in text
    assert "/tmp" not in text


@pytest.mark.parametrize(("key", "claimed"), [("rho", 3.0), ("max_period", 0.5)])
def test_what_a_design_file_says_of_its_sampled_controllers_is_not_believed(root, key, claimed):
    folder = root / "generated" / "flexible_joint_arms"
    content = json.loads((folder / "design.json").read_text())
    proved = content["claims"]["sampled"][key]
    content["claims"]["sampled"][key] = claimed
    files = generated_files(Design.of(content, "design.json"))
    said = json.loads(files["design.json"])["claims"]["sampled"][key]
    assert said != claimed
    assert said == pytest.approx(proved, rel=0.02)  # found anew, from other pair weights


def test_the_header_prints_both_rhos(root):
    """The sampled one is of the C below it, the continuous one of the gains it was sampled from."""
    folder = root / "generated" / "flexible_joint_arms"
    design = json.loads((folder / "design.json").read_text())["claims"]
    header = (folder / "include" / "arm1.h").read_text()
    assert f"rho: {design['rho']!r}\n" in header
    assert f"rho_sampled: {design['sampled']['rho']!r}\n" in header
    certificate = json.loads((folder / "manifest.json").read_text())["certificate"]
    assert (certificate["rho"], certificate["rho_sampled"]) == (design["rho"], design["sampled"]["rho"])
