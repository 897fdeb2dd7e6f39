"""`lockstep certify DIR`: the C is what is proved, by the numbers in it."""

import json
import re
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from lockstep.cli.main import app


@pytest.fixture(scope="module")
def arms(root: Path, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("arms") / "c"
    design = root / "generated" / "flexible_joint_arms" / "design.json"
    result = CliRunner().invoke(app, ["generate", str(design), "-o", str(folder), "--json"])
    assert result.exit_code == 0, result.output
    return folder


@pytest.fixture
def folder(arms: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(arms, tmp_path / "c"))


def certify(folder: Path) -> tuple[int, dict]:
    result = CliRunner().invoke(app, ["certify", str(folder), "--json"])
    return result.exit_code, json.loads(result.stdout)


def literals(text: str) -> list[re.Match]:
    return list(re.finditer(r"(-?\d[\d.e+-]*)f \* [xr]\d", text))


def test_the_arms_are_certified_as_shipped(arms):
    code, answer = certify(arms)
    assert code == 0
    assert answer["certified"]
    assert answer["proof"] == "ball"
    assert answer["sampled"]["certified"]
    assert answer["sampled"]["period"] == 0.005
    # Spectral radius 1 at 0.0337 s, by the exponentials of the test of the lower layer.
    assert 0.033 < answer["sampled"]["max_period"] < 0.0338
    # No sampled controller of these gains can be much better than the continuous one, rho = 3.344.
    assert answer["rho"] < answer["sampled"]["rho"] < 1.1 * answer["rho"]
    assert answer["differences"] == []


def test_the_header_says_what_is_proved(arms):
    header = (arms / "include" / "arm1.h").read_text()
    assert "certified (proof: ball)" in header
    for word in ("proved = ", "assumes = ", "remains = ", "every 0.005 s", "every rounding"):
        assert word in header
    assert "not covered" not in header


def test_one_literal_off_by_one_per_cent_is_reported(folder):
    source = folder / "src" / "arm3.c"
    text = source.read_text()
    found = literals(text)[0]
    source.write_text(f"{text[: found.start(1)]}{float(found[1]) * 1.01:.9g}{text[found.end(1) :]}")
    code, answer = certify(folder)
    assert code == 1
    assert not answer["ok"]
    assert any("entry (1, 1) of [A B; C D]" in line for line in answer["differences"])
    assert any("src/arm3.c is not what manifest.json says" in line for line in answer["differences"])


@pytest.mark.parametrize("agent", [1, 2])
def test_a_sign_flipped_is_refused(folder, agent):
    source = folder / "src" / f"arm{agent}.c"
    text = source.read_text()
    found = literals(text)[0]
    flipped = found[1].removeprefix("-") if found[1].startswith("-") else f"-{found[1]}"
    source.write_text(text[: found.start(1)] + flipped + text[found.end(1) :])
    code, answer = certify(folder)
    assert code == 1
    assert not answer["certified"]
    assert answer["proof"] == "none"
    assert answer["error"]["figures"]["spectral_radius"] > 1


def test_a_period_twenty_times_longer_is_refused(folder):
    for name in ("arm1", "arm2", "arm3"):
        header = folder / "include" / f"{name}.h"
        header.write_text(header.read_text().replace("_PERIOD_S 0.005f", "_PERIOD_S 0.1f"))
    code, answer = certify(folder)
    assert code == 1
    assert not answer["certified"]
    assert answer["sampled"]["period"] == pytest.approx(0.1)


def test_a_period_changed_in_the_manifest_is_reported(folder):
    manifest = folder / "manifest.json"
    manifest.write_text(manifest.read_text().replace('"period": 0.005', '"period": 0.1'))
    code, answer = certify(folder)
    assert code == 1
    assert any("period" in line for line in answer["differences"])


def test_other_c_is_refused(folder):
    source = folder / "src" / "arm2.c"
    source.write_text(source.read_text().replace("y[k] - source[k]", "source[k] - y[k]", 1))
    code, answer = certify(folder)
    assert code == 1
    assert not answer["certified"]
    assert "src/arm2.c is not the C that is generated" in answer["error"]["message"]


def certify_design(content: dict, folder: Path) -> tuple[int, dict]:
    place = folder / "design.json"
    place.write_text(json.dumps(content))
    result = CliRunner().invoke(app, ["certify", str(place), "--json"])
    return result.exit_code, json.loads(result.stdout)


@pytest.fixture
def design(root: Path) -> dict:
    return json.loads((root / "generated" / "flexible_joint_arms" / "design.json").read_text())


def test_a_design_file_alone_is_certified_as_it_will_ship(design, tmp_path):
    code, answer = certify_design(design, tmp_path)
    assert code == 0
    assert answer["proof"] == "exact", "of the continuous controllers"
    assert answer["sampled"]["certified"]
    assert answer["sampled"]["proof"] == "ball"
    assert answer["sampled"]["period"] == 0.005
    assert 0.033 < answer["sampled"]["max_period"] < 0.0338


def test_without_its_witnesses_they_are_found_anew_and_say_more_of_noise(design, tmp_path):
    design["claims"]["sampled"] = {"certified": True, "proof": "ball", "period": 0.005, "max_period": None}
    for key in ("sampled", "sampled_rho", "max_period"):
        design["proofs"][key] = None
    code, answer = certify_design(design, tmp_path)
    assert code == 0
    # At constant slopes the gain from the errors of all differences is 48.5, and these are up to 4.9 errors long.
    assert 48.4 * 4.89 < answer["sampled"]["residual_rms_per_message_error"] < 400
    assert answer["sampled"]["residual_per_message_error"] < 1500
    assert answer["sampled"]["rho"] < 1.02 * answer["rho"]


@pytest.mark.parametrize("claimed", [True, False])
def test_a_period_too_long_fails_the_file_that_claims_it(design, tmp_path, claimed):
    design["problem"]["controller"]["period"] = 0.1
    if not claimed:
        longest = design["claims"]["sampled"]["max_period"]
        design["claims"]["sampled"] = {"certified": False, "proof": "none", "max_period": longest}
    code, answer = certify_design(design, tmp_path)
    assert code == (1 if claimed else 0)
    assert answer["ok"] is not claimed
    assert answer["certified"], "the continuous claim is untouched"
    assert not answer["sampled"]["certified"]
    assert answer["sampled"]["period"] == 0.1
    assert 0.033 < answer["sampled"]["max_period"] < 0.0338
    assert ("error" in answer) is claimed


def test_a_smaller_sampled_rho_than_is_proved_is_refused(design, tmp_path):
    design["claims"]["sampled"]["rho"] = 3.3
    code, answer = certify_design(design, tmp_path)
    assert code == 1
    assert "claims rho = 3.3 of the sampled loop" in answer["error"]["message"]
    assert answer["sampled"]["rho"] > 3.344


def test_the_longest_period_is_decided_by_its_witness_and_never_looked_for(design, tmp_path, monkeypatch):
    def searched(*_given, **_options):
        raise AssertionError("a reader looks for no period")

    monkeypatch.setattr("lockstep.codegen.sampled_design.max_period", searched)
    claims, proofs = design["claims"], design["proofs"]
    found = certify_design(design, tmp_path)[1]["sampled"]["max_period"]
    assert found == claims["sampled"]["max_period"]
    longer = claims | {"sampled": claims["sampled"] | {"max_period": 0.034}}
    for changed in ({"claims": longer}, {"proofs": proofs | {"max_period": None}}):
        code, answer = certify_design(design | changed, tmp_path)
        assert code == 1
        assert answer["sampled"]["max_period"] == 0.005, (
            "the period of the controllers is proved all the same"
        )
        assert "claims max_period = 0.03" in answer["error"]["message"]
    design["problem"]["controller"]["period"] = 0.1
    proofs["max_period"]["decay"] = 0.5
    _, answer = certify_design(design, tmp_path)
    assert answer["sampled"]["max_period"] is None


def test_gains_with_a_sign_flipped_fail_both(design, tmp_path):
    design["gains"][0]["D"][0][0] *= -1
    code, answer = certify_design(design, tmp_path)
    assert code == 1
    assert not answer["certified"]
    assert not answer["sampled"]["certified"]
