"""A folder is what its design says: each way to make it say or compile something else is refused, hashes mended or not.

The attacker may do anything but break the proof: all hashes and the digest of manifest.json are made to fit again.
"""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

import lockstep
from lockstep.cli.main import app
from lockstep.codegen.bundle import bundle
from lockstep.codegen.emission.emit import emit
from lockstep.codegen.folder import write_folder
from lockstep.codegen.folder.contents import differs
from lockstep.codegen.from_design import specification
from lockstep.codegen.manifest import load_manifest, sha256
from lockstep.lmi.document import parse
from lockstep.verification.toolchain import host_compilers
from lockstep.verification.verify import verify_folder
from lockstep.workflow.design_file import Design

GENERATED = Path(__file__).parents[3] / "generated" / "flexible_joint_arms"
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
    "a header that claims a smaller rho": (replaced("include/arm1.h", "   rho: ", "   rho: 0."), "include/arm1.h"),
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


def manifest_with(**update) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        manifest = load_manifest(folder)
        (folder / "manifest.json").write_text(manifest.model_copy(update=update).sealed().text())

    return change


def all_of(*changes: Callable[[Path], None]) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        for one in changes:
            one(folder)

    return change


def signs_of_the_self_check(folder: Path) -> None:
    source = folder / "src" / "arm1.c"
    head, rest = source.read_text().split("given[8] = {", 1)
    numbers, tail = rest.split("}", 1)
    flipped = numbers.replace("-", "") if "-" in numbers else f"-{numbers}"
    source.write_text(f"{head}given[8] = {{{flipped}}}{tail}")


MANIFEST = load_manifest(GENERATED)
DESIGN, CLAIMS = MANIFEST.identity.design, MANIFEST.identity.claims
OTHER, WORD = "0" * 64, f"0x{int(DESIGN[:8], 16) | 1:08x}u"
UMBRELLA = "src/arm_controllers.c"
MUTATIONS = {
    "another identity in a header": (replaced("include/arm1.h", DESIGN, OTHER), "include/arm1.h"),
    "another word in a header": (replaced("include/arm1.h", WORD, "0x00000001u"), "include/arm1.h"),
    "another identity everywhere": (
        all_of(
            *(replaced(f"include/arm{k}.h", DESIGN, OTHER) for k in (1, 2, 3)),
            *(replaced(f"include/arm{k}.h", WORD, "0x00000001u") for k in (1, 2, 3)),
            manifest_with(design_hash=OTHER, identity=MANIFEST.identity.model_copy(update={"design": OTHER})),
        ),
        "include/arm1.h",
    ),
    "an identity in the manifest": (
        manifest_with(identity=MANIFEST.identity.model_copy(update={"design": OTHER})), "manifest.json",
    ),
    "claims in a descriptor": (replaced(UMBRELLA, CLAIMS, OTHER), UMBRELLA),
    "claims in descriptor and manifest": (
        all_of(
            replaced(UMBRELLA, CLAIMS, OTHER),
            manifest_with(identity=MANIFEST.identity.model_copy(update={"claims": OTHER})),
        ),
        UMBRELLA,
    ),
    "a name in a descriptor": (replaced(UMBRELLA, '"arm1"', '"arm9"'), UMBRELLA),
    "an order in a descriptor": (replaced(UMBRELLA, "ARM1_PERIOD_S, 2u", "ARM1_PERIOD_S, 3u"), UMBRELLA),
    "a version in a descriptor": (replaced(UMBRELLA, "lockstep-controllers/2", "lockstep-controllers/9"), UMBRELLA),
    "a period in a descriptor": (replaced(UMBRELLA, "ARM2_PERIOD_S", "0.01f"), UMBRELLA),
    "a size in a descriptor": (replaced(UMBRELLA, "sizeof(arm3_state_t)", "sizeof(float)"), UMBRELLA),
    "code beside the descriptors": (replaced(UMBRELLA, "};", "};\nint main(void);"), UMBRELLA),
    "a type in the umbrella header": (
        replaced("include/arm_controllers.h", "#include <stdint.h>", "#include <stdint.h>\n#define float double"),
        "include/arm_controllers.h",
    ),
    "a package that sets flags": (
        replaced("cmake/arm_controllers-config.cmake", "include(", "add_compile_options(-ffast-math)\ninclude("),
        "cmake/arm_controllers-config.cmake",
    ),
    "an alias of another target": (replaced("CMakeLists.txt", "ALIAS arm_controllers", "ALIAS other"), "CMakeLists.txt"),
    "a header from elsewhere": (replaced("CMakeLists.txt", "DIRECTORY include/", "DIRECTORY src/"), "CMakeLists.txt"),
    "a flag left out": (replaced("CMakeLists.txt", "-ffp-contract=off ", ""), "CMakeLists.txt"),
    "answers to other questions": (signs_of_the_self_check, "src/arm1.c"),
    "a self-check of no steps": (replaced("src/arm1.c", "k = first; k < 3u", "k = first; k < 0u"), "src/arm1.c"),
    "a self-check that is not heeded": (replaced("src/arm1.c", "state->ready = 0u;", "state->ready = 1u;"), "src/arm1.c"),
    "a state that is always ready": (
        replaced("src/arm1.c", "state->ready == ARM1_DESIGN_WORD", "state->ready >= 0u"), "src/arm1.c",
    ),
    "messages kept in faults": (replaced("src/arm1.c", " && (status == ARM1_OK)) {", ") {"), "src/arm1.c"),
    "misses that are not counted": (replaced("src/arm1.c", "state->misses[j] += ", "state->misses[j] = "), "src/arm1.c"),
    "a neighbour's NaN let in": (
        replaced("src/arm1.c", "neighbour_y, usable, r)", "neighbour_y, received, r)"), "src/arm1.c",
    ),
    "a self-check without NaN": (
        replaced("src/arm1.c", "    differs |= (state.age[0] == 1u) ? 0u : 1u;\n", ""), "src/arm1.c",
    ),
    "copies of a step": (replaced("src/arm1.c", "noinline, noclone", "always_inline"), "src/arm1.c"),
    "contraction let in": (replaced("src/arm1.c", '"fp-contract=off"', '"fp-contract=fast"'), "src/arm1.c"),
    "excess precision let in": (replaced("src/arm1.c", "FLT_EVAL_METHOD != 16", "FLT_EVAL_METHOD > 2"), "src/arm1.c"),
    "fast math let in": (replaced("src/arm1.c", "defined(__FAST_MATH__) || ", ""), "src/arm1.c"),
    "another status for a fault": (replaced("include/arm1.h", "NOT_FINITE = 1", "NOT_FINITE = 0"), "include/arm1.h"),
    "a wider limit": (replaced("src/arm1.c", "upper[1] = {10.0f}", "upper[1] = {12.0f}"), "src/arm1.c"),
    "one limit for the other": (replaced("src/arm1.c", "state->u[k] = lower[k];", "state->u[k] = upper[k];"), "src/arm1.c"),
    "clipping that is not said": (replaced("src/arm1.c", "found = ARM1_CLIPPED;", "found = ARM1_OK;"), "src/arm1.c"),
    "no clipping": (replaced("src/arm1.c", "        status = arm1_clip(state, status);\n", ""), "src/arm1.c"),
    "a status of clipping that is none": (replaced("include/arm1.h", "CLIPPED = 8", "CLIPPED = 0"), "include/arm1.h"),
    "a neighbour taken for zero": (replaced("src/arm1.c", "*source = y;", "*source = state->x;"), "src/arm1.c"),
    "the difference the other way": (
        replaced("src/arm1.c", "y[k] - source[k]", "source[k] - y[k]"), "src/arm1.c",
    ),
    "a reset that leaves messages": (replaced("src/arm1.c", "    state->heard = 0u;\n", ""), "src/arm1.c"),
    "another name of the folder": (manifest_with(name="other_controllers"), "arm_controllers"),
    "another prefix": (manifest_with(prefix="left_"), "include/left_arm1.h is not as it is generated: there is no such file"),
    "a better rho in the manifest": (manifest_with(certificate={**MANIFEST.certificate, "rho": 0.1}), "manifest.json"),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", MUTATIONS)
def test_a_mutation_is_caught_hashes_mended(folder, name):
    change, expected = MUTATIONS[name]
    change(folder)
    reseal(folder)
    code, answer = certify(folder)
    assert code == 1
    assert not answer["ok"]
    said = [*answer.get("differences", []), answer.get("error", {}).get("message", "")]
    assert any(expected in line for line in said), said


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


@pytest.mark.parametrize("more", [" and sooner than it is computed, for any input", "\t"])
def test_a_line_that_goes_on_is_shown_where_it_does(tmp_path, more):
    line = "the caller writes u to the actuator at once after the step has returned"
    (tmp_path / "a.txt").write_text(f"{line}{more}\n")
    (told,) = differs(tmp_path, {"a.txt": f"{line}\n"})
    found, generated = told.split("`")[1::2]
    assert found != generated and found.startswith(generated) and line.endswith(generated)
    assert line.split(generated)[0].endswith(" "), "an excerpt begins with a word"


def test_an_older_generator_is_told_apart_and_to_be_generated_again(folder):
    replaced("include/arm2.h", "WHAT IT COSTS", "WHAT IT TAKES")(folder)
    reseal(folder)
    code, answer = certify(folder)
    assert code == 1
    (line,) = [line for line in answer["differences"] if line.startswith("include/arm2.h")]
    assert "WHAT IT TAKES" in line and "generate it again" in answer["error"]["message"]
    assert not answer["certified"], "a folder is what its text says, too"
    assert answer["design"]["certified"] and answer["sampled"]["certified"], (
        "what is proved of the numbers in the C still is"
    )


def test_drawings_and_measurements_are_named_and_not_proved(folder):
    files = {path: (folder / path).read_text() for path in ["manifest.json", *load_manifest(folder).files]}
    write_folder(bundle(files, FIGURES), folder)
    code, answer = certify(folder)
    assert code == 0, answer["differences"]
    assert answer["not_proved"] == ["figures/", *sorted(path for path in FIGURES if "/" not in path)]
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


@pytest.mark.slow
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


@pytest.mark.parametrize("name", ["member", "mems", "mainsail", "aborting"])
def test_names_that_begin_as_those_that_compilers_call_are_names(name, tmp_path):
    content = json.loads((GENERATED / "design.json").read_text(encoding="utf-8"))
    content["problem"]["agent"]["name"] = name
    made = lockstep.generate(Design.of(content, "the design"), tmp_path / "c")
    assert made.files
    assert lockstep.certify(tmp_path / "c").ok
