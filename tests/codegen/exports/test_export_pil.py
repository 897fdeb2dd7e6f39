"""`generate --pil`: a board's log is compared with the reference; what is no such log, or not whole, is refused."""

import json
import re
import shutil

import numpy as np
import pytest
from codegen_cases import arms, random_controller, shapes
from export_cases import folder_of, generated, log_of, needs_compiler
from typer.testing import CliRunner

from lockstep.check.errors import ProblemError
from lockstep.cli.main import app
from lockstep.codegen.emission.emit import emit
from lockstep.codegen.exports.vectors import vectors
from lockstep.codegen.manifest import load_manifest
from lockstep.verification.verify import verify_log

pytestmark = needs_compiler


@pytest.fixture(scope="module")
def folder(root, tmp_path_factory):
    return generated(root, tmp_path_factory.mktemp("pil") / "arms", "--pil")


@pytest.fixture(scope="module")
def log(folder, tmp_path_factory):
    return log_of(folder, tmp_path_factory.mktemp("log"))


def verify(folder, log):
    result = CliRunner().invoke(app, ["verify", str(folder), "--from", str(log), "--json"])
    return result.exit_code, json.loads(result.stdout)


def test_a_log_gives_the_verdict_and_the_keys_of_any_target(folder, log):
    code, answer = verify(folder, log)
    assert (code, answer["ok"], answer["problems"]) == (0, True, [])
    (target,) = answer["targets"]
    assert (target["name"], target["bitwise"], target["max_abs_error"]) == ("log log.txt", True, 0.0)
    assert (target["steps"], target["adversarial_steps"], target["ram_bytes"]) == (100, 100, 36)
    assert [agent["agent"] for agent in target["agents"]] == ["arm1", "arm2", "arm3"]
    assert CliRunner().invoke(app, ["certify", str(folder)]).exit_code == 0


def test_a_greeting_carriage_returns_and_another_order_do_not_matter(folder, log, tmp_path):
    parts = re.findall(r"lockstep-pil/1.*?end \w+\n", log.read_text(), re.DOTALL)
    other = tmp_path / "terminal.txt"
    other.write_bytes(("\xffboot\r\n" + "ok\n".join(reversed(parts)).replace("\n", "\r\n")).encode("latin-1"))
    assert verify(folder, other)[0] == 0


@pytest.mark.parametrize("column", [1, 2, 3, 5, 7, 8, 9])
def test_one_flipped_bit_is_found_with_its_place(folder, log, tmp_path, column):
    """Status, u, x, held, heard, age, misses."""
    lines = log.read_text().splitlines()
    words = lines[203 + 57].split()
    assert words[0] == "57"
    words[column] = f"{int(words[column], 16) ^ 1:0{len(words[column])}x}"
    changed = tmp_path / "log.txt"
    changed.write_text("\n".join([*lines[: 203 + 57], " ".join(words), *lines[203 + 58 :]]) + "\n")
    code, answer = verify(folder, changed)
    assert (code, answer["ok"]) == (1, False)
    (problem,) = answer["problems"]
    part = ["", "status", "u", "x", "", "held", "", "heard", "age", "misses"][column]
    assert f"arm2 differs in 1 calls; call 57: {part} is" in problem
    assert [agent["bitwise"] for agent in answer["targets"][0]["agents"]] == [True, False, True]


BROKEN = {
    "cut in a line": lambda text: text[: len(text) // 2],
    "without its last line": lambda text: text.rstrip("\n").rsplit("\n", 1)[0],
    "one agent missing": lambda text: text[: text.index("lockstep-pil/1", 20)],
    "an agent twice": lambda text: text + text,
    "a line missing": lambda text: re.sub(r"\n57 .*", "", text, count=1),
    "a number too short": lambda text: re.sub(r"(\n57 \d \w{7})\w", r"\1", text, count=1),
    "a letter that is no digit": lambda text: re.sub(r"(\n57 \d \w{7})\w", r"\1g", text, count=1),
    "fewer calls": lambda text: text.replace("200 calls", "20 calls"),
    "other C": lambda text: re.sub(r"lockstep-pil/1 \w{4}", "lockstep-pil/1 0000", text),
    "empty": lambda _: "",
    "garbage": lambda _: "\x00\xff" * 500,
    "JSON": lambda _: "{}",
}


@pytest.mark.parametrize("name", BROKEN)
def test_what_is_no_whole_log_is_refused_in_one_message(folder, log, tmp_path, name):
    broken = tmp_path / "log.txt"
    broken.write_bytes(BROKEN[name](log.read_text()).encode("latin-1"))
    code, answer = verify(folder, broken)
    assert code == 2
    assert "log.txt" in answer["error"]["message"]


def test_the_log_of_another_design_is_refused(folder, tmp_path):
    log = log_of(folder_of(tmp_path, arms(), "pil"), tmp_path)
    code, answer = verify(folder, log)
    assert code == 2
    assert "of other C" in answer["error"]["message"]


def test_no_log_and_no_runner_are_said(folder, log, root, tmp_path):
    assert verify(folder, tmp_path / "none.txt")[0] == 2
    code, answer = verify(root / "generated" / "flexible_joint_arms", log)
    assert code == 2
    assert "--pil" in answer["error"]["message"]


def test_a_changed_folder_is_not_verified_by_an_old_log(folder, log, tmp_path):
    changed = shutil.copytree(folder, tmp_path / "c")
    source = changed / "src" / "arm1.c"
    source.write_text(source.read_text() + "\n")
    code, answer = verify(changed, log)
    assert (code, answer["changed_files"]) == (1, ["src/arm1.c"])


@pytest.mark.parametrize("path", ["pil/arm1_pil.c", "pil/pil.c", "pil/pil.h", "pil/README.md"])
def test_a_changed_runner_is_refused_by_certify(folder, tmp_path, path):
    from test_folder_attacks import reseal

    changed = shutil.copytree(folder, tmp_path / "c")
    (changed / path).write_text((changed / path).read_text().replace("0", "1", 1) + "\n")
    reseal(changed)
    result = CliRunner().invoke(app, ["certify", str(changed), "--json"])
    assert result.exit_code == 1
    assert any(path in said for said in json.loads(result.stdout)["differences"])


def test_a_stranger_among_the_vectors_is_refused(folder, tmp_path):
    changed = shutil.copytree(folder, tmp_path / "c")
    (changed / "pil" / "string.h").write_text("")
    result = CliRunner().invoke(app, ["certify", str(changed), "--json"])
    assert result.exit_code == 1
    assert any("pil/string.h" in said for said in json.loads(result.stdout)["differences"])


@pytest.mark.slow
@pytest.mark.parametrize("real", ["float32", "float64"])
@pytest.mark.parametrize("optimize", ["speed", "size"])
def test_every_shape_runs(tmp_path, real, optimize):
    agents = shapes([0, 3], [1, 3], [1, 2], real=real).agents
    agents += tuple(random_controller(f"n{nn}", 1, 1, 1, neighbours=nn) for nn in (0, 32, 33, 64))
    folder = folder_of(tmp_path, arms(agents=agents, plants=(), real=real, optimize=optimize), "pil")
    report = verify_log(folder, log_of(folder, tmp_path, "-O2"))
    assert report.problems == ()


def test_a_wrong_controller_is_found(tmp_path):
    folder = folder_of(tmp_path, arms(), "pil")
    source = folder / "src" / "arm1.c"
    text = source.read_text()
    source.write_text(text.replace("0.9909511f", "0.9909512f", 1))
    log = log_of(folder, tmp_path)
    source.write_text(text)
    assert [agent.bitwise for agent in verify_log(folder, log).targets[0].agents] == [False, True, True]


def test_the_vectors_hold_what_breaks_code(folder):
    """Of each kind, and every status of the step."""
    manifest = load_manifest(folder)
    given = vectors(manifest.agents[0], manifest)
    values = np.concatenate([given.y, given.r, given.neighbour_y[:, 0]], axis=1)
    tiny = np.finfo(np.float32).tiny
    assert np.isnan(values).any() and np.isinf(values).any()
    assert ((values != 0) & (np.abs(values) < tiny)).any()
    assert (np.abs(values) > 1e38).any()
    assert (np.signbit(values) & (values == 0)).any()
    assert set(given.operation.tolist()) == {0, 1, 2, 3, 4, 5}, "their inputs have limits"
    # Step 1 of the walk, by hand from the stream: the first 24 bits of each word, less 2^23, times 2^-27.
    import hashlib

    first = int.from_bytes(hashlib.shake_256(b"lockstep vectors/1 arm1 walk").digest(8), "little") >> 40
    assert float(given.y[0, 0]) == float(np.float32((first - 2**23) / 2**27))


def test_an_unknown_export_is_refused():
    from lockstep.codegen.exports import with_exports

    with pytest.raises(ProblemError, match=r"`pli`.*expected pil"):
        with_exports(emit(arms()), ["pli"])
