"""A folder is what its design says: each way to make it say or compile something else is refused, hashes mended or not.

The attacker may do anything but break the proof: all hashes and the digest of manifest.json are made to fit again.
"""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from lockstep.cli.main import app
from lockstep.codegen.emit import emit
from lockstep.codegen.folder import write_folder
from lockstep.codegen.folder.bundle import bundle
from lockstep.codegen.from_design import specification
from lockstep.codegen.manifest import load_manifest, sha256
from lockstep.lmi.document import parse
from lockstep.verification.toolchain import host_compilers
from lockstep.verification.verify import verify_folder

GENERATED = Path(__file__).parents[2] / "generated" / "flexible_joint_arms"
FIGURES = {"report.html": "<p>rho</p>", "report.md": "# rho", "figures/singular-values.png": b"\x89PNG"}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return Path(shutil.copytree(GENERATED, tmp_path / "c"))


def certify(folder: Path) -> tuple[int, dict]:
    result = CliRunner().invoke(app, ["certify", str(folder), "--json"])
    return result.exit_code, json.loads(result.stdout)


def reseal(folder: Path) -> None:
    """List every file with its hash as it is now, and sign the manifest again: anyone can."""
    manifest = load_manifest(folder)
    present = [path for path in sorted(folder.rglob("*")) if path.is_file() and path.name != "manifest.json"]
    order = {path: k for k, path in enumerate(manifest.files)}
    named = {path.relative_to(folder).as_posix(): sha256(path.read_bytes()) for path in present}
    files = dict(sorted(named.items(), key=lambda item: order.get(item[0], len(order))))
    (folder / "manifest.json").write_text(manifest.model_copy(update={"files": files}).sealed().text())


def replaced(path: str, old: str, new: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        text = (folder / path).read_text()
        assert old in text
        (folder / path).write_text(text.replace(old, new))

    return change


def written(path: str) -> Callable[[Path], None]:
    def add(folder: Path) -> None:
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text("typedef double float32_t;\n")

    return add


def linked(path: str) -> Callable[[Path], None]:
    def link(folder: Path) -> None:
        outside = folder.parent / "outside"
        shutil.copy(folder / path, outside)
        (folder / path).unlink()
        (folder / path).symlink_to(outside)

    return link


def another_gain(folder: Path) -> None:
    """The same controllers, a different design: what is proved of the C would still be true."""
    design = folder / "design.json"
    content = json.loads(design.read_text())
    content["problem"]["title"] = "Three other arms"
    design.write_text(json.dumps(content))


def regenerated(edges: list[list[float]]) -> Callable[[Path], None]:
    """C, header, README and manifest as the generator itself writes them for another graph, beside the same design."""

    def change(folder: Path) -> None:
        content = json.loads((folder / "design.json").read_text())
        turned = json.loads(json.dumps(content))
        turned["problem"]["network"]["edges"] = edges
        files = emit(specification(parse(turned, "design.json")))
        write_folder(bundle(files, {"design.json": (folder / "design.json").read_text()}), folder)

    return change


def less_noise(folder: Path) -> None:
    """The design file claims a smaller residual than is proved, and the header with it."""
    design = folder / "design.json"
    content = json.loads(design.read_text())
    content["claims"]["sampled"]["residual_per_message_error"] = 1e-30
    design.write_text(json.dumps(content))


def signed_title(folder: Path) -> None:
    manifest = load_manifest(folder)
    (folder / "manifest.json").write_text(
        manifest.model_copy(update={"title": "Proved arms"}).sealed().text()
    )


ATTACKS = {
    "a header that claims a smaller rho": (replaced("include/arm1.h", "rho = 3.344", "rho = 0.001"), "include/arm1.h"),
    "flags that change the arithmetic": (
        replaced("CMakeLists.txt", "project(", "add_compile_options(-ffast-math -Dfloat=double)\nproject("),
        "CMakeLists.txt",
    ),
    "a README that says more": (replaced("README.md", "# ", "# Safe for flight: "), "README.md"),
    "a harness that proves nothing": (replaced("proof/arm2_eva.c", "arm2_step", "arm2_stop"), "proof/arm2_eva.c"),
    "another design's design.json": (another_gain, "include/arm1.h"),
    "an agent rewired": (regenerated([[1, 3], [2, 3], [3, 1]]), "include/arm1.h"),
    "another weight": (regenerated([[1, 2, 1.001], [2, 3], [3, 1]]), "src/arm1.c"),
    "a residual of nothing": (less_noise, "residual_per_message_error"),
    "a title signed again": (signed_title, "manifest.json"),
    "a precompiled header": (written("src/arm1.h.gch/c99"), "src/arm1.h.gch"),
    "a header of the compiler's": (written("include/stdint.h"), "include/stdint.h"),
    "presets of CMake": (written("CMakePresets.json"), "CMakePresets.json"),
    "an empty folder": (lambda folder: (folder / "src" / "arm1.h.gch").mkdir(), "src/arm1.h.gch/"),
    "a source that is a link": (linked("src/arm1.c"), "src/arm1.c"),
    "a README that is a link": (linked("README.md"), "README.md"),
}  # fmt: skip


def test_the_folder_untouched_is_certified(folder):
    code, answer = certify(folder)
    assert (code, answer["ok"], answer["differences"], answer["not_proved"]) == (0, True, [], [])


def test_sealing_it_again_changes_nothing(folder):
    before = (folder / "manifest.json").read_bytes()
    reseal(folder)
    assert (folder / "manifest.json").read_bytes() == before


@pytest.mark.parametrize("name", ATTACKS)
def test_an_attack_is_refused(folder, name):
    attack, expected = ATTACKS[name]
    attack(folder)
    if "link" not in name:
        reseal(folder)
    code, answer = certify(folder)
    assert code in (1, 2)
    assert not answer["ok"]
    said = [*answer.get("differences", []), answer.get("error", {}).get("message", "")]
    assert any(expected in line for line in said), said


def test_an_older_generator_is_told_apart_and_to_be_generated_again(folder):
    replaced("include/arm2.h", "WHAT IT COSTS", "WHAT IT TAKES")(folder)
    reseal(folder)
    code, answer = certify(folder)
    assert code == 1
    (line,) = [line for line in answer["differences"] if line.startswith("include/arm2.h")]
    assert "WHAT IT TAKES" in line and "generate the folder again" in line
    assert answer["certified"], "what is proved of the numbers in the C still is"


def test_drawings_and_measurements_are_named_and_not_proved(folder):
    files = {path: (folder / path).read_text() for path in ["manifest.json", *load_manifest(folder).files]}
    write_folder(bundle(files, FIGURES), folder)
    code, answer = certify(folder)
    assert code == 0, answer["differences"]
    assert answer["not_proved"] == sorted(FIGURES)
    written("figures/arm1.h")(folder)
    reseal(folder)
    assert certify(folder)[0] == 1


@pytest.mark.parametrize(
    "name", ["a precompiled header", "a header of the compiler's", "a source that is a link"]
)
def test_verify_compiles_nothing_of_it(folder, name, monkeypatch):
    monkeypatch.setattr("lockstep.verification.verify._run_target", lambda *_given: pytest.fail("it was run"))
    ATTACKS[name][0](folder)
    if "link" not in name:
        reseal(folder)
    report = verify_folder(folder, targets=["host"], steps=5, adversarial_steps=0)
    assert not report.ok
    assert report.targets == ()
    assert ATTACKS[name][1] in report.problems[0]
    assert "--run-changed" in report.problems[-1]


def test_verify_refuses_what_the_reader_of_c_rejects_before_it_is_compiled(folder, monkeypatch):
    monkeypatch.setattr("lockstep.verification.verify._run_target", lambda *_given: pytest.fail("it was run"))
    replaced("src/arm1.c", "    float check;\n", "    float check;\n    system_call();\n")(folder)
    reseal(folder)
    report = verify_folder(folder, targets=["host"], steps=5, adversarial_steps=0)
    assert report.changed_files == (), "the hashes fit"
    assert "src/arm1.c is not the C that is generated" in report.problems[0]


@pytest.mark.skipif(not host_compilers(), reason="no C compiler here")
def test_verify_says_that_it_runs_code_and_stops_at_changed_files_unless_told(folder):
    def verify(*more: str):
        return CliRunner().invoke(
            app, ["verify", str(folder), "--steps", "5", "--target", "host", "--json", *more]
        )

    result = verify()
    assert result.exit_code == 0
    assert "compiles the C of the folder and runs it" in result.stderr.splitlines()[0]
    replaced("README.md", "# ", "# My ")(folder)
    result = verify()
    answer = json.loads(result.stdout)
    assert (result.exit_code, answer["changed_files"], answer["targets"]) == (1, ["README.md"], [])
    result = verify("--run-changed")
    answer = json.loads(result.stdout)
    assert (result.exit_code, answer["changed_files"]) == (1, ["README.md"])
    assert all(target["bitwise"] for target in answer["targets"] if not target["skipped"])
