"""`lockstep certify DIR`: the C is what is proved, by the numbers in it."""

import json
import re
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from lockstep.check.__main__ import main as check_alone
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
    assert answer["sampled"]["max_period"] > 0.09, "what the defaults are to reach"
    # No sampled controller of these gains can be much better than the continuous one.
    assert answer["rho"] < answer["sampled"]["rho"] < 1.1 * answer["rho"]
    assert answer["differences"] == []
    stated = json.loads((arms / "design.json").read_text())["claims"]
    assert answer["decay"] == stated["decay"] > 0 and answer["controllers_stable"] is True
    assert answer["limits"]["radius"] == stated["sampled"]["radius"] > 1.3, "the start in the file"


def test_the_header_says_what_is_proved(arms):
    header = (arms / "include" / "arm1.h").read_text()
    assert "certified (proof: ball)" in header
    for word in ("proved: ", "assumes: ", "remains: ", "every 0.005 s", "every rounding"):
        assert word in header
    assert "THE C OF THIS FOLDER IS NOT" not in header


def test_one_literal_off_by_one_per_cent_is_reported(folder):
    source = folder / "src" / "arm3.c"
    text = source.read_text()
    found = literals(text)[0]
    source.write_text(f"{text[: found.start(1)]}{float(found[1]) * 1.01:.9g}{text[found.end(1) :]}")
    code, answer = certify(folder)
    assert code == 1
    assert not answer["ok"]
    assert answer["error"]["message"] == "arm3: not the design's gains"
    assert not answer["certified"] and not answer["sampled"]["certified"]
    assert any(
        "src/arm3.c was changed: manifest.json has another SHA-256" in line for line in answer["differences"]
    )
    (line,) = [line for line in answer["differences"] if "src/arm3.c is not what its design gives" in line]
    assert found[1] in line, "the literal that is generated"


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
    assert answer["decay"] is None and answer["limits"] is None, "said where every claim holds"
    assert answer["error"]["message"] == f"arm{agent}: not the design's gains"
    printed = CliRunner().invoke(app, ["certify", str(folder)]).stdout
    first = next(line for line in printed.splitlines() if line.startswith("certified"))
    assert first.split() == ["certified", "NO"], "not the continuous controllers' yes"


def test_a_period_twenty_times_longer_is_refused(folder):
    for name in ("arm1", "arm2", "arm3"):
        header = folder / "include" / f"{name}.h"
        text = header.read_text().replace("_PERIOD_S 0.005f", "_PERIOD_S 0.1f")
        header.write_text(text.replace("_PERIOD_US 5000u", "_PERIOD_US 100000u"))
    code, answer = certify(folder)
    assert code == 1
    assert not answer["certified"]
    assert "not the design's period" in answer["error"]["message"]
    assert any("_PERIOD_S 0.1f" in line for line in answer["differences"])


def test_a_period_changed_in_the_manifest_is_reported(folder):
    manifest = folder / "manifest.json"
    manifest.write_text(manifest.read_text().replace('"period": 0.005', '"period": 0.1'))
    code, answer = certify(folder)
    assert code == 1
    assert any("period" in line and "0.1" in line for line in answer["differences"])


def test_a_claim_changed_in_a_comment_is_certified_by_no_key(folder, capsys):
    """The C is as it was, and the checker, which reads no comment, says so; a script that reads `certified` was told yes."""
    header = folder / "include" / "arm1.h"
    text = header.read_text()
    claimed = re.search(r"rho_sampled: ([0-9.]+)", text)
    assert claimed
    header.write_text(text.replace(claimed[0], claimed[0].replace(claimed[1], "0.1"), 1))
    code, answer = certify(folder)
    assert (code, answer["ok"], answer["certified"], answer["proof"]) == (1, False, False, "none")
    assert answer["reason"] == answer["error"]["message"]
    assert "not as generated" in answer["reason"]
    assert any("include/arm1.h" in line and "0.1" in line for line in answer["differences"])
    assert answer["design"]["certified"], "the design is what it was"
    assert check_alone([str(folder), "--json"]) == 0
    code = json.loads(capsys.readouterr().out)["claims"]["code"]
    assert code["status"] == "proved"
    assert "comments, README and manifest are not read" in code["reason"]


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
    assert 0.09 < answer["sampled"]["max_period"] < 0.11


NOTHING = {"certified": False, "proof": "none"}


@pytest.fixture
def no_search(monkeypatch):
    """What looks for witnesses of the sampled loop does not exist while a file is checked."""

    def searched(*_given, **_options):
        raise AssertionError("a reader looks for nothing")

    for name in ("certify_sampled", "sampled_rho", "max_period"):
        monkeypatch.setattr(f"lockstep.codegen.sampled_design.{name}", searched)


@pytest.mark.usefixtures("no_search")
def test_what_is_not_claimed_is_not_looked_for(design, tmp_path):
    design["claims"]["sampled"] = NOTHING
    for key in ("sampled", "sampled_rho", "max_period"):
        design["proofs"][key] = None
    code, answer = certify_design(design, tmp_path)
    assert (code, answer["ok"], answer["certified"]) == (0, True, True)
    sampled = answer["sampled"]
    assert (sampled["certified"], sampled["rho"], sampled["max_period"]) == (False, None, None)
    assert sampled["reason"] == "the file does not claim it"


@pytest.mark.usefixtures("no_search")
@pytest.mark.parametrize("key", ["sampled", "sampled_rho", "max_period"])
def test_a_claim_without_its_witness_is_refused(design, tmp_path, key):
    design["proofs"][key] = None
    code, answer = certify_design(design, tmp_path)
    assert code == 1
    assert answer["certified"], "the continuous claim is untouched"
    assert answer["sampled"]["certified"] is (key != "sampled")
    assert answer["sampled"]["rho"] == (design["claims"]["sampled"]["rho"] if key == "max_period" else None)
    assert answer["error"]["message"] == answer["reason"]


@pytest.mark.usefixtures("no_search")
@pytest.mark.parametrize("claimed", [True, False])
def test_a_period_too_long_fails_the_file_that_claims_it(design, tmp_path, claimed):
    """The longest period is a claim of its own, made of gains whose controllers at the design's period are not certified."""
    design["problem"]["controller"]["period"] = 0.15
    if not claimed:
        longest = design["claims"]["sampled"]["max_period"]
        design["claims"]["sampled"] = NOTHING | {"max_period": longest}
    code, answer = certify_design(design, tmp_path)
    assert code == (1 if claimed else 0)
    assert answer["ok"] is not claimed
    assert answer["certified"], "the continuous claim is untouched"
    assert not answer["sampled"]["certified"]
    assert answer["sampled"]["period"] == 0.15
    if not claimed:
        assert 0.09 < answer["sampled"]["max_period"] < 0.11
    assert ("error" in answer) is claimed


def test_a_longest_period_is_checked_beside_controllers_that_are_not_certified(design, tmp_path):
    """Both commands refuse one that its witness does not prove; a file cannot slip it in beside `certified` = false."""
    design["claims"]["sampled"] = NOTHING | {"max_period": 10.0}
    assert certify_design(design, tmp_path)[0] == 1
    assert check_alone([str(tmp_path / "design.json"), "--json"]) == 1


@pytest.mark.usefixtures("no_search")
def test_a_smaller_sampled_rho_than_is_proved_is_refused(design, tmp_path):
    design["claims"]["sampled"]["rho"] = 3.3
    code, answer = certify_design(design, tmp_path)
    assert code == 1
    assert "it is claimed that the sampled loop has the gain 3.3" in answer["error"]["message"]
    assert answer["sampled"]["certified"]
    assert answer["sampled"]["rho"] is None, "no gain is proved, and none is looked for"


@pytest.mark.usefixtures("no_search")
def test_the_longest_period_is_decided_by_its_witness_and_never_looked_for(design, tmp_path):
    claims, proofs = design["claims"], design["proofs"]
    proved = claims["sampled"]["max_period"]
    assert certify_design(design, tmp_path)[1]["sampled"]["max_period"] == proved
    longer = {**claims, "sampled": claims["sampled"] | {"max_period": 0.034}}
    for changed in ({"claims": longer}, {"proofs": proofs | {"max_period": None}}):
        code, answer = certify_design({**design, **changed}, tmp_path)
        assert code == 1
        assert answer["sampled"]["max_period"] == 0.005, (
            "the period of the controllers is proved all the same"
        )
    design["problem"]["controller"]["period"] = 0.15
    design["proofs"]["max_period"]["decay"] = 0.5
    _, answer = certify_design(design, tmp_path)
    assert answer["sampled"]["max_period"] is None


def test_gains_with_a_sign_flipped_fail_both(design, tmp_path):
    design["gains"][0]["D"][0][0] *= -1
    code, answer = certify_design(design, tmp_path)
    assert code == 1
    assert not answer["certified"]
    assert not answer["sampled"]["certified"]
