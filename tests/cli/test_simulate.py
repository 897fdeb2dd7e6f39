"""`lockstep simulate` and `reproduce --figures`: what they print, write and refuse, and their exit status."""

import csv
import json
import math
from pathlib import Path

import pytest
from typer.testing import CliRunner

import lockstep
from lockstep.cli.main import app
from lockstep.verification.toolchain import host_compilers
from lockstep.workflow.runs.simulate_options import Many, Options, conflict

KEYS = {"ISE", "IAE", "ITSE", "ITAE"}


@pytest.fixture(scope="module")
def folder(root) -> Path:
    return root / "generated" / "flexible_joint_arms"


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return lambda *words: CliRunner().invoke(app, ["simulate", *map(str, words)])


def answer(result):
    def refuse(name):
        raise AssertionError(f"{name} is no JSON")

    return json.loads(result.stdout, parse_constant=refuse)


def changed(folder, place, change) -> Path:
    content = json.loads((folder / "design.json").read_text())
    change(content)
    path = place / "changed.json"
    path.write_text(json.dumps(content))
    return path


@pytest.mark.parametrize("controllers", ["continuous", "sampled"])
def test_the_arms_agree_and_keep_to_their_rho(controllers, folder, run):
    result = run(folder / "design.json", "--controllers", controllers, "--horizon", 16, "--json")
    found = answer(result)
    assert result.exit_code == 0, result.output
    assert found["disagreement_final"] < 1e-3 * found["disagreement_initial"]
    assert len(found["indices"]) == len(found["effort"]) == 3
    assert all(set(one) == KEYS for one in found["indices"])
    assert found["l2"]["covered"]
    assert 0.1 < found["l2"]["ratio"] < 1
    design = json.loads((folder / "design.json").read_text())["claims"]
    proved = {"continuous": design["rho"], "sampled": design["sampled"]["rho"]}
    assert found["l2"]["rho"] == proved[controllers]


@pytest.mark.skipif(not host_compilers(), reason="no C compiler")
def test_the_compiled_c_is_the_shipped_arithmetic(folder, run):
    words = ("--horizon", 0.5, "--disturbance", "noise", "--json", "--controllers")
    compiled, sampled = (answer(run(folder, *words, kind)) for kind in ("compiled", "sampled"))
    assert compiled.pop("controllers") != sampled.pop("controllers")
    assert compiled == sampled


@pytest.mark.slow
def test_the_worst_disturbance_comes_near_rho(folder, run):
    words = ("--controllers", "continuous", "--disturbance", "worst", "--horizon", 12, "--json")
    result = run(folder, *words)
    found = answer(result)
    assert result.exit_code == 0
    assert found["disagreement_initial"] == 0
    assert 0.75 < found["l2"]["ratio"] < 1
    assert found["l2"]["gain"] == pytest.approx(found["l2"]["ratio"] * found["l2"]["rho"], rel=1e-2)


@pytest.mark.slow
def test_a_run_above_a_proved_rho_fails(folder, run, monkeypatch):
    """No such run exists; a checker that said rho = 1 would be found out."""
    from lockstep.verification.closed_loop import measured_gain

    kept = measured_gain.promise

    def wrong(*given):
        from dataclasses import replace

        return replace(kept(*given), rho=1.0, P=None)

    monkeypatch.setattr(measured_gain, "promise", wrong)
    words = ("--controllers", "continuous", "--disturbance", "worst", "--horizon", 12, "--json")
    result = run(folder, *words)
    found = answer(result)
    assert result.exit_code == 1
    assert not found["ok"]
    assert found["error"]["figures"]["ratio"] > 3
    assert "exceeds" in found["error"]["message"]


def test_the_trajectory_is_written_whole(folder, run, tmp_path):
    result = run(folder, "--horizon", 0.1, "-o", "t.csv", "--json")
    assert result.exit_code == 0
    rows = list(csv.reader((tmp_path / "t.csv").read_text().splitlines()))
    assert rows[0][:3] == ["t", "disagreement", "arm1_theta_m"]
    assert len(rows) == 1 + 21
    assert float(rows[-1][1]) == answer(result)["disagreement_final"]
    assert [path.name for path in tmp_path.iterdir()] == ["t.csv"]


def test_what_diverges_is_reported_with_time_and_agent(folder, run, tmp_path):
    def change(content):
        for one in content["gains"]:
            one["D"] = [[-x for x in row] for row in one["D"]]
        content["problem"]["agent"]["limits"] = None

    result = run(changed(folder, tmp_path, change), "--json", "-o", "t.csv")
    error = answer(result)["error"]
    assert result.exit_code == 1
    assert error["kind"] == "Diverged"
    assert error["figures"]["agent"] in (1, 2, 3)
    assert math.isfinite(error["figures"]["time"])
    assert not (tmp_path / "t.csv").exists()


def test_uncertified_gains_are_simulated_and_not_held_against_anything(folder, run, tmp_path):
    def change(content):
        content["proofs"]["certificate"] = None

    result = run(changed(folder, tmp_path, change), "--horizon", 1, "--json")
    found = answer(result)
    assert result.exit_code == 0
    assert found["l2"]["rho"] is None
    assert not found["l2"]["covered"]
    assert "not certified" in found["l2"]["reason"]


def test_lost_messages_are_not_covered(folder, run, tmp_path):
    def change(content):
        content["problem"]["simulation"]["channel"] = {"drop": 0.2}

    found = answer(run(changed(folder, tmp_path, change), "--horizon", 1, "--json"))
    assert not found["l2"]["covered"]
    assert found["l2"]["reason"].startswith("rho is proved for messages that all arrive at once")


@pytest.mark.slow
def test_gain_errors_beyond_delta_are_not_covered(folder, run, tmp_path):
    def change(content):
        content["problem"]["simulation"]["perturbation"] = {"kind": "paper"}

    path = changed(folder, tmp_path, change)
    words = ("--horizon", 1, "--controllers", "continuous", "--json")
    found = answer(run(path, *words))
    assert (
        found["disagreement_final"]
        == answer(run(folder, *words, "--perturbation", "paper"))["disagreement_final"]
    )
    assert found["disagreement_final"] != answer(run(folder, *words))["disagreement_final"]
    assert not found["l2"]["covered"]
    assert "Delta" in found["l2"]["reason"]


@pytest.mark.slow
def test_the_plot_is_text(folder, run):
    result = run(folder, "--horizon", 1, "--plot")
    assert result.exit_code == 0
    assert "log10 of the disagreement of each state" in result.stdout
    assert "\x1b" not in result.stdout, "no colours where there is no terminal"
    beside = run(folder, "--horizon", 1, "--plot", "--json")
    assert answer(beside)["ok"]
    assert "log10 of the disagreement of each state" in beside.stderr


def test_without_control_agents_do_what_they_do_alone_and_nothing_is_claimed(folder, run):
    found = answer(run(folder, "--horizon", 2, "--controllers", "off", "--json"))
    assert found["ok"]
    assert found["largest_input"] == [0.0, 0.0, 0.0]
    assert (found["l2"]["covered"], found["l2"]["rho"]) == (False, None)
    assert "u = 0" in found["l2"]["reason"]
    noisy = run(folder, "--horizon", 2, "--controllers", "off", "--perturbation", "paper", "--json")
    assert noisy.exit_code == 2, "gain errors of gains that are not there"
    with_control = answer(run(folder, "--horizon", 2, "--json"))
    assert found["disagreement_final"] > with_control["disagreement_final"]


TOGETHER = [
    (["--jobs", "2"], ["`--jobs`", "`--campaign`"]),
    (["--scheduler", "tcp://host:1"], ["`--scheduler`", "`--campaign`"]),
    (["--replay", "3", "--campaign", "5", "-o", "c"], ["`--replay`", "`--campaign`"]),
    (["--replay", "3", "--jobs", "2"], ["`--jobs`", "`--replay`"]),
    (["--replay", "3", "--scheduler", "tcp://host:1"], ["`--scheduler`", "`--replay`"]),
    (["--campaign", "5", "-o", "c", "--jobs", "2", "--scheduler", "x"], ["`--jobs`", "`--scheduler`"]),
    (["--campaign", "5"], ["`--campaign`", "`-o`"]),
    *(
        ([mode, "5", "-o", "c", *option], [f"`{mode}`", f"`{option[0]}`"])
        for mode in ("--campaign", "--replay")
        for option in (
            ["--disturbance", "noise"],
            ["--perturbation", "paper"],
            ["--integrator", "adaptive"],
            ["--figures", "drawn"],
            ["--plot"],
        )
    ),
]


@pytest.mark.parametrize(("words", "named"), TOGETHER, ids=[" ".join(words) for words, _ in TOGETHER])
def test_options_that_would_be_passed_over_are_refused_by_name(words, named, folder, run, tmp_path):
    result = run(folder, *words, "--json")
    error = answer(result)["error"]
    assert result.exit_code == 2
    assert error["where"] == "lockstep simulate"
    assert all(name in error["message"] for name in named), error["message"]
    assert len(result.stderr.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("options", "many"),
    [
        (Options(plot=True, disturbance="sine", figures=Path("f")), Many()),
        (Options("sampled", 3.0, 7), Many(campaign=5, output=Path("c"), jobs=2)),
        (Options("continuous"), Many(campaign=5, output=Path("c"), scheduler="tcp://host:1")),
        (Options(), Many(replay=0)),
    ],
)
def test_what_goes_together_is_taken(options, many):
    assert conflict(options, many) is None


def test_a_campaign_longer_than_can_be_counted_is_refused(folder, run, tmp_path):
    # 1e300 s are 2e302 periods; before, the count overflowed and every run ended at once, "below rho".
    result = run(folder, "--campaign", "2", "-o", "c", "--horizon", "1e300")
    assert result.exit_code == 2
    assert "periods" in result.stderr
    assert not list(tmp_path.iterdir())


def test_a_campaign_without_a_sampled_rho_says_why_and_what_to_do(folder, run, tmp_path):
    def change(content):
        content["problem"]["controller"]["period"] = 0.2

    path = changed(folder, tmp_path, change)
    result = run(path, "--campaign", "2", "-o", "c", "--json")
    error = answer(result)["error"]
    assert result.exit_code == 1
    assert error["kind"] == "NotCertified"
    assert "no proved rho of the sampled controllers" in error["message"]
    assert "0.2 s" in error["message"], "why"
    assert "--controllers continuous" in error["message"]
    assert "period" in error["message"]
    assert "decided in" not in error["message"], "the reason of a proof that succeeded"
    assert [one.name for one in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--controllers", "analogue"], "continuous or sampled or compiled"),
        (["--disturbance", "rain"], "noise"),
        (["--integrator", "euler"], "rk4"),
        (["--horizon", "-1"], "horizon"),
        (["--horizon", "nan"], "horizon"),
        (["-o", "nowhere/t.csv"], "no such folder"),
        (["-o", "/dev/null"], "no plain file"),
        (["-o", "t" * 300], "name too long"),
        (["--figures", "f" * 300], "name too long"),
        (["--campaign", "5", "-o", "c", "--scheduler", "nobody"], "no address"),
        (["--campaign", "5"], "FOLDER"),
        (["--campaign", "5", "--plot"], "single run"),
        (["--campaign", "5", "--controllers", "compiled"], "continuous or sampled"),
        (["--perturbation", "random"], "[design.fragility]"),
        (["--perturbation", "rain"], "paper_scaled"),
    ],
)
def test_bad_input_is_one_message_and_nothing_written(words, said, folder, run, tmp_path):
    result = run(
        folder, *words, *([] if "-o" in words else ["-o", "t.csv"] if "--campaign" not in words else [])
    )
    assert result.exit_code == 2
    assert said in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_a_design_file_has_no_c(folder, run):
    result = run(folder / "design.json", "--controllers", "compiled")
    assert result.exit_code == 2
    assert "lockstep generate" in result.stderr


def test_figures_are_made_alone(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, ["reproduce", "noise", "--figures", "here"])
    assert result.exit_code == 2
    assert not Path("here").exists()


@pytest.mark.slow
def test_section_4_in_one_command(tmp_path):
    result = CliRunner().invoke(app, ["reproduce", "--figures", str(tmp_path / "figures"), "--json"])
    found = answer(result)
    assert result.exit_code == 0
    assert sorted(path.name for path in (tmp_path / "figures").iterdir()) == found["files"]
    assert all(one["disagreement_final"] < 1e-3 * one["disagreement_initial"] for one in found["runs"])


def test_the_run_is_drawn(folder, run, tmp_path):
    result = run(folder, "--horizon", 0.5, "--figures", "drawn", "--json")
    assert result.exit_code == 0, result.output
    kinds = {"png": b"\x89PNG", "pdf": b"%PDF"}
    names = {f"{name}.{kind}" for name in ("states", "disagreement", "effort") for kind in kinds}
    assert {path.name for path in (tmp_path / "drawn").iterdir()} == names
    for path in (tmp_path / "drawn").iterdir():
        assert path.read_bytes().startswith(kinds[path.suffix[1:]])


def test_figures_need_a_place(folder, run, tmp_path):
    (tmp_path / "drawn").write_text("in the way")
    result = run(folder, "--figures", "drawn")
    assert result.exit_code == 2
    assert "a folder" in result.stderr
    assert (tmp_path / "drawn").read_text() == "in the way"


def test_a_start_beyond_the_set_of_initial_states_is_said(root, run, tmp_path):
    """Two carts, one leading: they start 0.4 apart, and are proved to stay in their domain from 0.06."""
    design = root / "docs" / "gallery" / "designs" / "carts.json"
    said = " ".join(run(design, "--horizon", 0.1).stdout.split())
    assert "from 0.159 times this start" in said
    assert "this run has them" not in said
    disturbed = " ".join(run(design, "--horizon", 0.1, "--disturbance", "noise").stdout.split())
    assert "0.159 times this start without disturbances" in disturbed
    content = json.loads(design.read_text())
    for channel, has in (({"drop": 0.0, "delay": 0}, False), ({"noise": {"y1": 0.001}}, True)):
        content["problem"]["simulation"]["channel"] = channel
        (tmp_path / "channel.json").write_text(json.dumps(content))
        said = run(tmp_path / "channel.json", "--horizon", 0.1).stdout
        assert ("messages that are lost" in " ".join(said.split())) is has
    del content["problem"]["simulation"]["channel"]
    content["problem"]["simulation"]["initial"] = [[0.0] * 4, [0.01] * 4]
    near = tmp_path / "near.json"
    near.write_text(json.dumps(content))
    assert "initial states" not in run(near, "--horizon", 0.1).stdout


def test_a_leader_that_is_moved_out_of_its_range_is_said(root, run, tmp_path):
    """The claim is of a leader by itself, in its range: not of one that a reference takes out of it."""
    content = json.loads((root / "docs" / "gallery" / "designs" / "carts.json").read_text())
    content["problem"]["simulation"]["reference"] = {"a": "20.0"}
    moved = tmp_path / "moved.json"
    moved.write_text(json.dumps(content))
    said = " ".join(run(moved, "--horizon", 0.5).stdout.split())
    assert "times this start without disturbances and a leader out of its range (this run has them)" in said


def test_the_size_of_a_large_file_is_said(root, run, tmp_path):
    design = root / "docs" / "gallery" / "designs" / "carts.json"
    large, small = tmp_path / "large.csv", tmp_path / "small.csv"
    said = " ".join(run(design, "--horizon", 20.0, "-o", large).stderr.split())
    assert f"{large.name} ({large.stat().st_size / 1e6:.3g} MB)" in said
    assert "MB" not in run(design, "--horizon", 0.1, "-o", small).stderr


def test_it_says_over_what_domain_and_inputs_went(folder, root, run, tmp_path):
    """As the trajectory has it; where nothing disturbs there is no measured gain."""
    design = root / "docs" / "gallery" / "designs" / "carts.json"
    words = ("--horizon", 1.0, "--disturbance", "none", "-o", "run.csv")
    said = run(design, *words)
    with (tmp_path / "run.csv").open() as file:
        rows = list(csv.DictReader(file))
    name, (low, high) = next(iter(json.loads(design.read_text())["problem"]["agent"]["domain"].items()))
    reached = [float(row[f"cart{i}_{name}"]) for row in rows for i in (1, 2)]
    assert f"{name} from {min(reached):.4g} to {max(reached):.4g} within {low:g} to {high:g}" in said.stdout
    assert "measured gain" not in said.stdout
    assert "written: run.csv" in said.stderr
    said = run(folder, "--horizon", 0.1).stdout
    assert "within -10 to 10" in said  # the arms' limits, and no domain
    assert "\ndomain" not in said


def test_the_worst_disturbance_of_a_local_design_is_one_that_the_proof_is_about(root, run):
    """Larger ones drive the agents out of their domain, where nothing is proved to be held against."""
    design = root / "docs" / "gallery" / "designs" / "carts.json"
    found = answer(run(design, "--disturbance", "worst", "--horizon", 6, "--json"))
    claimed = json.loads(design.read_text())["claims"]["initial_set"]
    assert found["l2"]["covered"], found["l2"]["reason"]
    assert 0 < found["l2"]["disturbance"] <= math.sqrt(claimed["energy"]) * (1 + 1e-9)
    assert 0.3 < found["l2"]["ratio"] < 1


def test_where_all_of_them_go_is_said(tmp_path):
    """p' = u + xi; agent 2 hears 1 and 3, who hear it: gains that differ do not sum up to 0, and a load moves the mean."""
    gains = ", ".join(f"{{ D = [[{D}]] }}" for D in (-1.0, -3.0, -1.0))
    text = f"""
[agent]
name = "axis"
states = ["p"]
inputs = ["u"]
dynamics = {{ p = "u" }}
outputs = {{ y = "p" }}
[network]
agents = 3
topology = "path"
[design]
method = "given"
gains = [{gains}]
[simulation]
horizon = 5.0
initial = [[3.0], [0.0], [0.0]]
"""
    (tmp_path / "axes.toml").write_text(text, encoding="utf-8")
    told = lockstep.simulate(lockstep.design(tmp_path / "axes.toml")).rows()
    # The weighted mean 3/7 p_1 + 1/7 p_2 + 3/7 p_3 is what they keep: (3, 1, 3) diag(1, 3, 1) L = 0, so they meet at 9/7.
    assert told["mean"] == "p 1 at first, 1.286 in the end"


def test_a_problem_file_is_told_from_a_design(examples, run):
    result = run(examples / "flexible_joint_arms.toml")
    assert result.exit_code == 2
    assert "a problem file; expected a file written by `lockstep design`" in result.stderr


@pytest.mark.parametrize("states", [1.0, 0.5, {"omega_l": 0.5}])
def test_a_run_is_held_against_rho_in_its_scales(folder, run, tmp_path, states):
    """Part of every disturbance is less than all of it: the proof holds; rho says nothing of states without a scale."""

    def change(content):
        content["problem"]["design"]["disturbances"]["states"] = states
        content["claims"]["floor"] = content["proofs"]["floor"] = None  # of whole disturbances

    path = changed(folder, tmp_path, change)
    words = ("--horizon", 4, "--controllers", "continuous", "--json", "--disturbance")
    still, moved = (answer(run(path, *words, kind))["l2"] for kind in ("none", "noise"))
    assert still["covered"]
    assert 0 < still["ratio"] < 1
    if isinstance(states, dict):
        assert not moved["covered"]
        assert "the run disturbs others" in moved["reason"]
    else:
        assert moved["covered"]
        assert 0 < moved["ratio"] < 1
        whole = answer(run(changed(folder, tmp_path, dict), *words, "noise"))["l2"]
        assert moved["disturbance"] == pytest.approx(whole["disturbance"] / states, rel=1e-9)


def test_a_run_without_faults_says_what_runs_those_of_the_file(folder, run, tmp_path):
    def change(content):
        content["problem"]["network"]["messages"] = {"loss": 0.05, "delay": [0, 2]}

    said = " ".join(run(changed(folder, tmp_path, change), "--horizon", 0.1).stdout.split())
    assert "each arrives in time in this run" in said
    assert "--campaign 100 --faults loss=0.05,delay=0:2 -o DIR" in said
