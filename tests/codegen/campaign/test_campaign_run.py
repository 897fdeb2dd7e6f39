"""Campaigns of the arms with their committed C: resumed, replayed, held against the certificate."""

import csv
import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import lockstep
from lockstep.campaign import Guarantee, RunTable, compute, run_campaign
from lockstep.campaign import campaign as running
from lockstep.campaign.campaign import Campaign
from lockstep.campaign.compute import chunks, columns_of
from lockstep.campaign.draw import FAMILIES, draw
from lockstep.campaign.plan import CHUNK, plan_of
from lockstep.campaign.replay import replay
from lockstep.campaign.store import Store
from lockstep.check.errors import NotCertified, ProblemError
from lockstep.check.json_text import load_json
from lockstep.cli.main import app
from lockstep.lmi.document import parse
from lockstep.model.simulation.results.indices import indices
from lockstep.verification.closed_loop.measured_gain import network_of_design
from lockstep.workflow.runs.campaign import CampaignOptions, planned

DESIGN = Path("generated") / "flexible_joint_arms"
RUNS = 2 * CHUNK + 88


@pytest.fixture(scope="module")
def made(root):
    return planned(root / DESIGN, CampaignOptions(horizon=1.0, seed=5))


@pytest.mark.parametrize("period", [0.02, 0.5, 50.0])
def test_a_campaign_is_as_long_and_as_fine_as_its_plant(root, period):
    content = load_json(root / DESIGN / "design.json")
    content["problem"]["controller"]["period"], content["problem"]["simulation"]["horizon"] = period, 7.5
    stored = parse(content, "design")
    plan = plan_of(stored, None, controllers="continuous")
    A_cl = network_of_design(stored).loop(2).A_cl(stored.gains.blocks)
    hanging = [[0, 1, 0, 0], [-48.6, -1.25, 48.6, 0], [0, 0, 0, 1], [19.5, 0, -22.83, 0]]  # (38)
    fastest = max(np.abs(np.linalg.eigvals(one)).max() for one in (hanging, A_cl))
    step = plan.source.layout.step
    assert plan.horizon == 7.5
    assert step <= period / 5 * (1 + 1e-12)
    assert step * fastest <= 0.1 * (1 + 1e-12)


def test_a_long_period_beside_fast_poles_does_not_make_a_run_diverge(root):
    """Poles of 11 rad/s and a period of 50 s: steps of a hundredth of it were above what Runge-Kutta bears."""
    content = load_json(root / DESIGN / "design.json")
    content["problem"]["controller"]["period"], content["problem"]["simulation"]["horizon"] = 50.0, 100.0
    plan = plan_of(parse(content, "design"), None, controllers="continuous")
    found = dict(zip(columns_of(plan), compute(plan, 0, 16).T, strict=True))
    assert not found["diverged"].any()
    assert found["ratio"][found["covered"] > 0].max() <= 1 + 1e-6  # Runge-Kutta's own error


@pytest.fixture(scope="module")
def plan(made):
    return made[0]


@pytest.fixture(scope="module")
def whole(plan, tmp_path_factory):
    return run_campaign(plan, RUNS, tmp_path_factory.mktemp("whole"), jobs=2)


@pytest.fixture(scope="module")
def uncertain(root):
    """The arms' continuous gains with a Delta of (11), which they are not certified for: held against something else."""
    content = load_json(root / DESIGN / "design.json")
    certain = plan_of(parse(content, "design"), None, controllers="continuous")
    assert certain.guarantee.rho == content["claims"]["rho"]
    content["claims"]["fragility"] = {"A": 0.5, "B": 0.2, "C": 0.0, "D": 0.2}
    content["proofs"]["certificate"]["t"] = [1.0] * 9
    content["claims"]["decay"] = content["proofs"]["decay"] = None
    stored = parse(content, "design")
    with pytest.raises(NotCertified, match="no certified rho"):
        plan_of(stored, None)
    return plan_of(stored, None, horizon=1.0, guarantee=certain.guarantee)


def test_every_covered_run_is_below_the_bound_and_some_come_near(whole):
    ratio = whole.table["ratio"][whole.table.covered]
    assert whole.ok
    assert len(whole.table.values) == RUNS
    assert whole.table["run"].tolist() == list(range(RUNS))
    assert 0.5 < ratio.max() < 1, "one second is too short for more; ten come within 5 %"
    document = whole.document()
    assert document["worst_ratio"] == ratio.max()
    assert document["quantiles"]["ratio"]["1.0"] == ratio.max()
    assert sum(one["runs"] for one in document["families"].values()) == RUNS
    json.dumps(document, allow_nan=False)


def test_a_rho_that_is_too_small_is_refuted(plan, whole, tmp_path):
    rho = 0.9 * whole.table["gain"][whole.table["family"] == FAMILIES.index("peak")].max()
    bold = replace(plan, guarantee=Guarantee(rho, plan.guarantee.T, None))
    assert bold.identity != plan.identity
    found = run_campaign(bold, CHUNK, tmp_path)
    assert not found.ok
    assert found.document()["above"] > 0
    # Without V nothing is claimed of a run that starts in disagreement.
    starts = found.table["family"] == FAMILIES.index("start")
    assert starts.any()
    assert not found.table.covered[starts].any()


def test_where_no_run_is_covered_nothing_is_shown(plan, tmp_path, monkeypatch):
    """It was "as certified" if none of the runs that nothing is claimed of diverged, and "NOT as certified" if one did."""

    def uncovered(plan, begin, end):
        table = compute(plan, begin, end)
        table[:, columns_of(plan).index("covered")] = 0
        return table

    monkeypatch.setattr(running, "compute", uncovered)
    found = run_campaign(plan, CHUNK, tmp_path)
    assert not found.ok
    assert found.document()["covered"] == 0


def test_a_run_that_left_its_domain_is_no_failure_however_it_ends(plan, tmp_path, monkeypatch):
    def leaving(plan, begin, end):
        table = compute(plan, begin, end)
        for name, value in (("covered", 0), ("diverged", 1), ("outside", 1)):
            table[3, columns_of(plan).index(name)] = value
        return table

    monkeypatch.setattr(running, "compute", leaving)
    assert run_campaign(plan, CHUNK, tmp_path).ok


STACKS = """
[agent]
name = "stack"
states = ["T"]
inputs = ["u"]
dynamics = { T = "-0.02*(T - 75) - 1e-4*(T - 75)**2 + u" }
outputs = { y = "T" }
domain = { T = [60.0, 92.0] }
[network]
agents = 2
topology = "path"
[design]
order = 0
gain_limit = 1.0
starts = 1
[controller]
period = 1.0
"""


def test_runs_begin_in_a_domain_that_is_not_around_0(tmp_path):
    """Electrolysers between 60 and 92 degC were started about 0, and none of the runs was covered."""
    (tmp_path / "stacks.toml").write_text(STACKS)
    lockstep.design(tmp_path / "stacks.toml", output=tmp_path / "design.json")
    plan, _ = planned(tmp_path / "design.json", CampaignOptions("continuous", horizon=20.0, seed=1))
    assert all(60 < one.point[0] < 92 for one in plan.peaks)
    x = draw(plan, 0, 256).batch.rows[:, plan.source.layout.places["x"]]
    assert 60 < x.min() < 76 < x.max() < 92
    found = dict(zip(columns_of(plan), compute(plan, 0, 256).T, strict=True))
    assert found["covered"].mean() > 0.3


def test_a_run_that_diverges_is_told(plan, tmp_path, monkeypatch):
    def diverging(plan, begin, end):
        table = compute(plan, begin, end)
        table[3, columns_of(plan).index("diverged")] = 1
        return table

    assert run_campaign(plan, CHUNK, tmp_path / "sound").ok
    monkeypatch.setattr(running, "compute", diverging)
    found = run_campaign(plan, CHUNK, tmp_path)
    assert not found.ok
    assert found.document()["diverged"] == 1


def test_interrupted_and_resumed_is_the_same_as_whole(plan, whole, tmp_path, monkeypatch):
    done = []

    def interrupted(plan, begin, end):
        if done:
            raise KeyboardInterrupt
        done.append((begin, end))
        return compute(plan, begin, end)

    with monkeypatch.context() as patch:
        patch.setattr(running, "compute", interrupted)
        with pytest.raises(KeyboardInterrupt):
            run_campaign(plan, RUNS, tmp_path, jobs=1)
    store = Store(plan, tmp_path)
    assert len(store.missing(RUNS)) == len(chunks(RUNS)) - 1
    assert not list(store.folder.glob("runs.*")), "no result before all is there"
    again = []
    monkeypatch.setattr(running, "compute", lambda *given: again.append(given[1:]) or compute(*given))
    resumed = run_campaign(plan, RUNS, tmp_path, jobs=1)
    assert sorted(again + done) == chunks(RUNS), "nothing twice, nothing left out"
    assert resumed.table.values.tobytes() == whole.table.values.tobytes()
    assert resumed.computed == RUNS - CHUNK
    for name in ("worst.json", "summary.json"):
        assert (resumed.folder / name).read_bytes() == (whole.folder / name).read_bytes()
    assert run_campaign(plan, RUNS, tmp_path).computed == 0


def test_more_runs_later_add_to_those_that_are_there(plan, whole, tmp_path):
    run_campaign(plan, CHUNK, tmp_path)
    found = run_campaign(plan, RUNS, tmp_path)
    assert found.computed == RUNS - CHUNK
    assert found.table.values.tobytes() == whole.table.values.tobytes()


@pytest.mark.parametrize("damage", [b"", b"\x93NUMPY half", None])
def test_a_damaged_chunk_is_computed_again(plan, whole, tmp_path, damage):
    found = run_campaign(plan, CHUNK, tmp_path)
    path = found.folder / "chunks" / f"{0:07d}-{CHUNK:07d}.npy"
    if damage is None:
        np.save(path, whole.table.values[CHUNK : 2 * CHUNK])  # another chunk's rows
    else:
        path.write_bytes(damage)
    assert Store(plan, tmp_path).missing(CHUNK) == [(0, CHUNK)]
    assert run_campaign(plan, CHUNK, tmp_path).table.values.tobytes() == found.table.values.tobytes()


def test_a_changed_campaign_is_not_resumed_into(plan, tmp_path):
    first = run_campaign(plan, 8, tmp_path)
    text = dict(plan.source.files)
    text["arm1.c"] += "/* changed */\n"
    changes = (
        {"seed": plan.seed + 1},
        {"horizon": 2.0},
        {"source": replace(plan.source, files=tuple(sorted(text.items())))},
        {"guarantee": Guarantee(1.0, plan.guarantee.T, plan.guarantee.P)},
        {"peaks": plan.peaks[1:]},
    )
    names = {first.folder.name}
    for change in changes:
        other = replace(plan, **change)
        assert Store(other, tmp_path).missing(8) == [(0, 8)]
        names.add(Store(other, tmp_path).folder.name)
    assert len(names) == 1 + len(changes)
    (first.folder / "identity").write_text("someone else's")
    with pytest.raises(ProblemError, match="another campaign"):
        run_campaign(plan, 8, tmp_path)


def test_a_run_is_fixed_by_its_index(plan, whole):
    for run in (0, 7, CHUNK, RUNS - 1):
        assert compute(plan, run, run + 1).tobytes() == whole.table.values[run : run + 1].tobytes()
    assert compute(replace(plan, seed=6), 0, 1).tobytes() != whole.table.values[:1].tobytes()


def test_a_loop_that_is_slower_than_its_runs_is_drawn_too(plan):
    """The sines are of at least one turn in a run: four pumps whose largest gain is at standstill ended with a ValueError."""
    slow = replace(plan, peaks=tuple(replace(one, omega=1e-9) for one in plan.peaks))
    drawn = draw(slow, 0, 64)
    omega = drawn.batch.rows[:64, slow.source.layout.places["omega"]].ravel()
    turn = 2 * np.pi / plan.horizon
    sines = omega[drawn.family == FAMILIES.index("sine")]
    assert len(sines)
    assert ((sines >= turn * (1 - 1e-12)) & (sines <= 10 * turn * (1 + 1e-12))).all()


def test_the_worst_can_be_replayed(plan, made, whole):
    worst = json.loads((whole.folder / "worst.json").read_text())["runs"]
    assert [one["run"] for one in worst] == whole.table.worst(10)
    assert worst[0]["ratio"] == whole.table["ratio"][whole.table.covered].max()
    for one in (*worst[:2], {"run": int(np.argmax(whole.table["family"] == FAMILIES.index("drops")))}):
        found = replay(plan, made[1].problem.agent(), one["run"])
        assert found.row.tobytes() == whole.table.values[one["run"]].tobytes()
        run = found.trajectory
        assert run.disagreement()[-1] == pytest.approx(found["disagreement_final"], rel=1e-12, abs=1e-15)
        # The same sums in another order.
        itae = indices(run)[1].ITAE
        assert itae == pytest.approx(found["ITAE_2"], rel=1e-10)
        e = run.xi - run.xi.mean(axis=1, keepdims=True)
        if found["w_squared"] and one["run"] in (worst[0]["run"], worst[1]["run"]):
            # Hann's window leaves nothing at the ends, so the trapezoidal rule is as good as Simpson's.
            assert np.trapezoid((e**2).sum(axis=(1, 2)), run.t) == pytest.approx(found["w_squared"], rel=1e-3)
    batch = draw(plan, worst[0]["run"], worst[0]["run"] + 1).batch
    assert int(batch.seeds[0]) == worst[0]["seed"]
    assert batch.rows[0, plan.source.layout.places["x"]].tolist() == worst[0]["parameters"]["x"]
    with pytest.raises(ProblemError, match="run -1"):
        replay(plan, made[1].problem.agent(), -1)


def test_ties_and_uncovered_runs_among_the_worst():
    columns = ("run", "family", "covered", "diverged", "ratio")
    ratio = np.array([0.5, 0.9, np.inf, 0.9, np.inf, np.nan])
    covered = np.array([1, 1, 0, 1, 1, 1])
    table = RunTable(columns, np.column_stack([np.arange(6), np.zeros(6), covered, np.zeros(6), ratio]))
    assert table.worst(3) == [4, 1, 3]


def test_the_table_as_parquet_and_as_csv(plan, tmp_path, monkeypatch):
    parquet = pytest.importorskip("pyarrow.parquet")
    found = run_campaign(plan, 20, tmp_path / "parquet")
    read = parquet.read_table(found.path).to_pydict()
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "pyarrow", None)
        other = run_campaign(plan, 20, tmp_path / "csv")
    assert other.path.name == "runs.csv"
    rows = list(csv.DictReader(other.path.read_text().splitlines()))
    assert list(read) == list(rows[0]) == list(found.table.columns)
    assert [float(row["ratio"]) for row in rows] == read["ratio"] == found.table["ratio"].tolist()
    assert [row["family"] for row in rows] == read["family"]
    assert {row["covered"] for row in rows} <= {"True", "False"}


def test_delta_is_at_its_bound(uncertain):
    layout, deltas = uncertain.source.layout, uncertain.deltas
    assert [(letter, bound) for letter, bound, _ in deltas] == [("A", 0.5), ("B", 0.2), ("D", 0.2)]
    rows = draw(uncertain, 0, 40).batch.rows
    turning = 0
    for row in rows:
        even, odd = np.split(row[layout.places["delta"]], 2)
        nu = row[layout.places["nu"]][0]
        turning += nu > 0
        place = 0
        for _ in range(layout.N):
            for _, bound, shape in deltas:
                size = int(np.prod(shape))
                blocks = [part[place : place + size].reshape(shape) for part in (even, odd)]
                # |cos(nu t) E_1 + sin(nu t) E_2| over a turn
                a = np.linspace(0, 2 * np.pi, 361)[:, None, None]
                norms = np.linalg.norm(np.cos(a) * blocks[0] + np.sin(a) * blocks[1], 2, axis=(1, 2))
                assert norms.max() <= bound
                # a half degree beside the largest: 1 - cos(0.5 deg) = 4e-5
                assert (norms.max() if nu else norms[0]) == pytest.approx(bound, rel=4e-5)
                place += size
        assert place == len(even)
    assert 5 < turning < 35


def test_the_continuous_controllers_with_their_delta(uncertain, tmp_path):
    found = run_campaign(uncertain, 40, tmp_path)
    assert found.document()["controllers"] == "continuous"
    assert not (found.table["family"] == FAMILIES.index("drops")).any()
    assert np.isfinite(found.table["ratio"]).all()
    # Every run, those from disagreement too, is held against V + rho^2 |xi_d|^2.
    assert found.table.covered.all()
    starts = found.table["family"] == FAMILIES.index("start")
    assert (found.table["stored"][starts] > 0).all()
    assert (found.table["stored"][~starts] == 0).all()


@pytest.fixture(scope="module")
def files(root):
    """The committed folder: relative path -> text."""
    folder = root / DESIGN
    return {path.relative_to(folder).as_posix(): path.read_text() for path in folder.rglob("*.*")}


def test_what_cannot_be_held_against_anything_is_refused(root, plan, files, tmp_path):
    content = load_json(root / DESIGN / "design.json")
    stored = parse(content, "design")
    period = {path: text.replace("0.005", "0.05") for path, text in files.items()}
    with pytest.raises(NotCertified, match="no proved rho"):
        plan_of(stored, period, controllers="sampled")
    with pytest.raises(ProblemError, match="no emitted C"):
        plan_of(stored, None, controllers="sampled")
    with pytest.raises(ProblemError, match="horizon"):
        plan_of(stored, files, horizon=0.0)
    with pytest.raises(ProblemError, match="0 runs"):
        run_campaign(plan, 0, tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(ProblemError, match="cannot be made"):
        run_campaign(plan, 1, tmp_path / "file")


def test_a_rho_that_a_file_claims_without_proof_does_not_count(root, plan, files):
    content = load_json(root / DESIGN / "design.json")
    proved = content["claims"]["sampled"]["rho"]
    assert plan.guarantee.rho == pytest.approx(proved, rel=1e-3)
    content["claims"]["sampled"]["rho"] = claimed = 0.8 * proved
    # No proof can go below the gain of the loop linearised at an operating point.
    assert claimed < max(one.gain for one in plan.peaks) < plan.guarantee.rho
    with pytest.raises(NotCertified, match="its witness does not prove it"):
        plan_of(parse(content, "design"), files)


@pytest.fixture
def invoke(root, tmp_path):
    """`lockstep simulate --campaign N`, and `--replay N`, with more words behind."""

    def run(what: str, number: int, *words: str):
        of_each = {"campaign": tmp_path, "replay": tmp_path / "run.csv"}
        asked = ("--seed", 5, "--horizon", 1.0, "--json", f"--{what}", number, "-o", of_each[what])
        return CliRunner().invoke(app, [str(word) for word in ("simulate", root / DESIGN, *asked, *words)])

    return run


def test_the_command(invoke, whole, tmp_path):
    result = invoke("campaign", 40)
    answer = json.loads(result.stdout)
    assert result.exit_code == 0, result.output
    assert answer["ok"]
    assert answer["runs"] == 40
    assert answer["worst_ratio"] < 1
    assert Path(answer["results"]).is_file()
    again = json.loads(invoke("campaign", 40).stdout)
    assert again["computed"] == 0
    assert again["worst_ratio"] == answer["worst_ratio"]
    run = answer["worst_run"]
    result = invoke("replay", run)
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["ratio"] == answer["worst_ratio"] == whole.table["ratio"][run]
    assert len((tmp_path / "run.csv").read_text().splitlines()) == 1002


def test_the_command_refuses(invoke, monkeypatch):
    assert invoke("campaign", 8, "--controllers", "none").exit_code == 2
    result = invoke("campaign", 8, "--scheduler", "nowhere")
    assert result.exit_code == 2
    assert "nowhere" in json.loads(result.stdout)["error"]["message"]
    monkeypatch.setattr("lockstep.campaign.campaign.Campaign.ok", False)
    assert invoke("campaign", 8).exit_code == 1


def test_the_command_interrupted(invoke, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(running, "compute", interrupted)
    result = invoke("campaign", 8)
    assert result.exit_code == 130
    assert "are kept" in result.stderr


def test_a_run_with_a_fault_is_not_covered_and_not_as_certified(made, tmp_path):
    """Controllers that refuse their compiler return their resting u: what ran was another loop."""
    plan = made[0]
    found = compute(plan, 0, 4)
    columns = columns_of(plan)
    table = found.copy()
    table[1, columns.index("faults")] = 200.0
    for values, ok in ((found, True), (table, False)):
        runs = RunTable(columns, values)
        assert Campaign(plan, runs, tmp_path, tmp_path, 4, 1.0).ok is ok


UNIT = """
[agent]
name = "cart"
states = ["p", "v"]
inputs = ["u"]
dynamics = { p = "v", v = "u" }
outputs = { y1 = "p", y2 = "v" }
[network]
agents = 2
topology = "path"
[design]
method = "given"
order = 1
gains = [{ A = [[-4.0]], B = [[0.5, 0.5]], C = [[-0.4]], D = [[-1.0, -1.5]] },
         { A = [[-4.0]], B = [[0.5, 0.5]], C = [[-0.4]], D = [[-1.0, -1.5]] }]
[controller]
period = 0.01
real = "float64"
discretization = "zoh"
"""


def test_a_compiler_that_fuses_neighbours_makes_no_other_loop(tmp_path):
    """GCC 12 for processors that fuse: a x + b r beside c x - r became one fused instruction, whatever -ffp-contract says."""
    lockstep.design(lockstep.Problem.parse(UNIT), output=tmp_path / "d.json")
    plan, _ = planned(tmp_path / "d.json", CampaignOptions(horizon=1.0))
    found = dict(zip(columns_of(plan), compute(plan, 0, 24).T, strict=True))
    assert not found["faults"].any()
    assert found["covered"].any()
    assert found["ratio"][found["covered"] > 0].max() <= 1 + 1e-6  # Runge-Kutta's own error


def test_the_controllers_that_ship_are_disturbed_in_the_named_states_alone(tmp_path):
    text = UNIT.replace("order = 1\n", "order = 1\ndisturbances = { states = { v = 1.0 } }\n")
    lockstep.design(lockstep.Problem.parse(text), output=tmp_path / "d.json")
    plan, _ = planned(tmp_path / "d.json", CampaignOptions(horizon=1.0))
    assert plan.driven.tolist() == [float(name == "v") for name in ("p", "v")]
    found = dict(zip(columns_of(plan), compute(plan, 0, 24).T, strict=True))
    assert found["covered"].any()
    assert found["ratio"][found["covered"] > 0].max() <= 1 + 1e-6  # Runge-Kutta's own error


def test_a_campaign_of_a_design_whose_rho_is_a_gain_from_noise_alone_is_bad_input(tmp_path):
    text = UNIT.replace("order = 1\n", "order = 1\ndisturbances = { states = 0.0, outputs = { y1 = 1.0 } }\n")
    lockstep.design(lockstep.Problem.parse(text), output=tmp_path / "d.json")
    with pytest.raises(ProblemError, match="a scale above 0 for one state at least"):
        planned(tmp_path / "d.json", CampaignOptions(horizon=1.0))
