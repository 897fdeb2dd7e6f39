"""The wait for a design: an interrupt keeps the best gains so far, a second run takes what was proved, ranges before it."""

import json
import shutil
import signal
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

import lockstep
import lockstep.lmi.design as lmi_design
from lockstep.cli.design import proved_besides
from lockstep.cli.interrupts import keeping_the_best
from lockstep.cli.main import app
from lockstep.lmi.search.search_time import one_digit, range_of_seconds
from lockstep.lmi.search.stopping import Stop, Stopped
from lockstep.workflow import design_cache
from lockstep.workflow.design_file import Design
from lockstep.workflow.waiting.time_left import TimeLeft

SMALL = """
title = "Two scalars"
[agent]
states = ["x"]
inputs = ["u"]
dynamics = { x = "u - sin(x)" }
outputs = { y = "x" }
[network]
agents = 2
topology = "complete"
[design]
order = 0
starts = 2
[controller]
period = 0.01
"""


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch) -> Path:
    folder = tmp_path / "cache"
    monkeypatch.setattr("platformdirs.user_cache_path", lambda name, **_options: folder / name)
    return folder


@pytest.fixture
def small(tmp_path) -> Path:
    path = tmp_path / "small.toml"
    path.write_text(SMALL, encoding="utf-8")
    return path


def interrupted_at(part: float, stop: Stop):
    """Progress that interrupts the search once it has come to a part."""

    def tell(what: str, done: float) -> None:
        if "searching" in what and done >= part and not stop.asked:
            assert stop.take()

    return tell


@pytest.fixture(scope="module")
def made() -> Design:
    return lockstep.design(lockstep.Problem.parse(SMALL), jobs=1)


@pytest.mark.slow
def test_an_interrupt_keeps_the_best_certified_gains_so_far(small, made):
    with Stop.ready() as stop:
        found = lockstep.design(small, jobs=1, stop=stop, progress=interrupted_at(0.1, stop))
    assert found.certified
    assert found.document()["figures"]["interrupted"] is True
    assert lockstep.certify(found).ok
    assert "interrupted" not in made.document()["figures"]
    assert found.rho is not None
    assert made.rho is not None
    assert found.rho >= made.rho * (1 - 1e-6), "a search that goes on finds nothing worse"


def test_an_interrupt_before_any_start_has_gains_keeps_nothing(small):
    with Stop.ready() as stop, pytest.raises(KeyboardInterrupt, match="before any gains were certified"):
        lockstep.design(small, jobs=1, stop=stop, progress=interrupted_at(0.0, stop))


@pytest.mark.slow
@pytest.mark.parametrize(
    "doing", ["proving the certificate", "proving the decay", "proving the sampled controllers"]
)
def test_an_interrupt_of_what_proves_the_gains_found_keeps_them(small, doing):
    told: list[str] = []

    def tell(what: str, _part: float) -> None:
        told.append(what)
        if doing in what and not stop.asked:
            assert stop.take()

    with Stop.ready() as stop:
        found = lockstep.design(small, jobs=1, stop=stop, progress=tell)
    assert stop.asked
    assert found.certified
    assert found.document()["figures"]["interrupted"] is True
    assert not any("designing for the period" in what for what in told), "what an interrupt leaves out"
    assert not stop.found, "after the design there is nothing more to be kept by an interrupt"


@pytest.mark.slow
def test_where_no_floor_is_proved_larger_gains_are_tried_too(small, made, monkeypatch):
    """How far rho is from the least possible is not known then: only what larger gains reach tells."""
    told: list[str] = []
    monkeypatch.setattr("lockstep.lmi.by_method._floor", lambda *_: None)
    found = lockstep.design(small, jobs=1, progress=lambda what, _part: told.append(what))
    assert made.document()["floor"]
    assert any(what.startswith("attempt 2 of at most") and ": rho was " in what for what in told)
    assert found.certified
    assert "none was proved" in proved_besides(found.document())["lower bound"]


@pytest.mark.slow
def test_an_interrupt_that_nobody_takes_ends_a_later_attempt(monkeypatch):
    """Without a `Stop` of the caller's, Ctrl-C is as everywhere; with one, what the first attempt found is kept."""
    problem, found = lockstep.Problem.parse(SMALL), lmi_design.design(lockstep.Problem.parse(SMALL), jobs=1)
    given = iter([replace(found, floor=None), KeyboardInterrupt()] * 2)

    def proposed(*_):
        if isinstance(one := next(given), KeyboardInterrupt):
            raise one
        return one

    monkeypatch.setattr(lmi_design, "_proposed", proposed)
    with pytest.raises(KeyboardInterrupt):
        lmi_design.design(problem, jobs=1)
    with Stop.ready() as stop:
        assert lmi_design.design(problem, jobs=1, stop=stop).figures["interrupted"] is True


@pytest.mark.slow
def test_an_attempt_says_how_far_the_one_before_it_came():
    """x' = u + 20 sin x and u = D r, on two agents: a D within the first limit, 8, does not outweigh slopes of 20."""
    told: list[str] = []
    problem = lockstep.Problem.parse(
        SMALL.replace("u - sin(x)", "u + 20*sin(x)").replace("starts = 2", "starts = 1")
    )
    assert lockstep.design(problem, jobs=1, progress=lambda what, _part: told.append(what)).certified
    later = [what for what in told if what.startswith("attempt 2 of at most")]
    assert later
    said = (
        "(gain_limit 8: 0.",
        "(gain_limit 8: nothing of ",
        "(gain_limit 8: no loop was as stable as is searched for)",
    )
    assert all(any(one in what for one in said) for what in later)


def test_a_second_interrupt_is_not_taken_nor_is_one_outside_of_the_search():
    with Stop.ready() as stop:
        assert not stop.take(), "nothing is there yet to be kept"
        with stop.searching():
            assert stop.take()
            assert not stop.take()
        assert Path(stop.flag).exists()
        assert stop.optional(lambda: 1, otherwise=0) == 0
    assert not Path(stop.flag).exists()


def test_what_is_not_needed_ends_at_an_interrupt():
    stop = Stop()

    def work() -> int:
        stop.take()
        return 1

    assert stop.optional(work, otherwise=0) == 0
    assert issubclass(Stopped, KeyboardInterrupt), "nothing that catches exceptions may swallow it"


def test_the_command_takes_a_signal_and_hands_on_a_second_one():
    said: list[str] = []
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with keeping_the_best(said.append) as stop, stop.searching():
            signal.raise_signal(signal.SIGINT)
            assert stop.asked
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)
    (line,) = said
    assert "best gains so far" in line


@pytest.mark.parametrize("of_keyboard", [signal.default_int_handler, signal.SIG_IGN])
def test_what_ends_a_job_keeps_the_best_as_well(of_keyboard):
    """`timeout` and schedulers send SIGTERM; of a command in the background interrupts from the keyboard are ignored."""
    before = signal.signal(signal.SIGINT, of_keyboard), signal.signal(signal.SIGTERM, signal.SIG_DFL)
    try:
        with keeping_the_best(lambda _said: None) as stop:
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(signal.SIGTERM)  # before there is anything to keep it ends the command
            with stop.searching():
                signal.raise_signal(signal.SIGTERM)
                signal.raise_signal(signal.SIGTERM)  # as `timeout` does: to the command, then to its group
            assert stop.asked
        assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
        assert signal.getsignal(signal.SIGINT) is of_keyboard
    finally:
        signal.signal(signal.SIGINT, before[0])
        signal.signal(signal.SIGTERM, before[1])


def kept(folder: Path) -> list[Path]:
    return sorted(folder.rglob("*.json"))


def test_a_second_run_takes_what_was_proved_and_a_fresh_one_does_not(small, tmp_path, own_cache, monkeypatch):
    run = CliRunner()
    first = run.invoke(app, ["design", str(small), "-o", str(tmp_path / "1.json"), "--jobs", "1", "--json"])
    assert first.exit_code == 0, first.output
    (file,) = kept(own_cache)

    def no_search(*_given, **_named):
        raise AssertionError("a search")

    with monkeypatch.context() as without:
        without.setattr("lockstep.lmi.design.design", no_search)
        again = run.invoke(app, ["design", str(small), "-o", str(tmp_path / "2.json"), "--json"])
        assert again.exit_code == 0, again.output
        assert "made before" in again.stderr
        assert (tmp_path / "1.json").read_bytes() == (tmp_path / "2.json").read_bytes()
        fresh = run.invoke(app, ["design", str(small), "--fresh", "--json"])
        assert "a search" in json.loads(fresh.stdout)["error"]["message"]
        changed = small.with_name("changed.toml")
        changed.write_text(SMALL.replace("period = 0.01", "period = 0.02"), encoding="utf-8")
        other = run.invoke(app, ["design", str(changed), "--json"])
        assert "a search" in json.loads(other.stdout)["error"]["message"]
    assert kept(own_cache) == [file]


def test_a_second_run_of_a_file_without_an_order_takes_what_was_proved(made, own_cache):
    text = SMALL.replace("order = 0\n", "")
    posed = lockstep.Problem.parse(text)
    design_cache.keep(posed, made)  # of order 0, as by default
    longer = lockstep.Problem.parse(text + "[simulation]\nhorizon = 3.0\n")
    for problem in (posed, longer):
        again = design_cache.recall(problem)
        assert again is not None
        assert [D.tolist() for D in again.gains.D] == [D.tolist() for D in made.gains.D]
        assert again.problem.simulation.horizon == problem.simulation.horizon
    content = json.loads(kept(own_cache)[0].read_text(encoding="utf-8"))
    content["problem"]["design"]["starts"] = 3
    kept(own_cache)[0].write_text(json.dumps(content), encoding="utf-8")
    assert design_cache.recall(posed) is None, "what the file names is as it was asked for"


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("cc") is None, reason="build compiles the C")
def test_a_build_says_that_its_design_was_made_before(small, tmp_path, own_cache):
    lockstep.design(small, jobs=1, reuse=True)
    assert kept(own_cache)
    built = CliRunner().invoke(app, ["build", str(small), "-o", str(tmp_path / "c"), "--json"])
    assert built.exit_code == 0, built.output
    assert "made before" in built.stderr


def test_only_what_a_design_depends_on_is_in_the_key():
    def key(**changes: str) -> str:
        text = SMALL
        for old, new in changes.items():
            text = text.replace(old, new)
        return design_cache.key(lockstep.Problem.parse(text))

    assert key() == key(Two="Twelve") == key(order="# a comment\norder")
    # what is printed behind a number, and what integers are made of: asked for with `generate --fixed`, after the search
    outputs = 'outputs = { y = "x" }'
    ranged = {outputs: f"{outputs}\noutput_range = {{ y = [-1.0, 1.0] }}\nunits = {{ x = 'm' }}"}
    assert outputs in SMALL
    assert key() == key(**ranged)
    assert len({key(), key(complete="ring"), key(sin="tanh"), key(starts="seed")}) == 4


def test_initial_states_are_in_the_key_where_they_size_the_gains():
    """A file whose start alone had changed was given the gains of the start before."""

    def key(start: str, limits: str = "", asked: str = "") -> str:
        return design_cache.key(
            lockstep.Problem.parse(
                f"""
                [agent]
                states = ["x"]
                inputs = ["u"]
                dynamics = {{ x = "u" }}
                outputs = {{ y = "x" }}
                {limits}
                [network]
                agents = 2
                topology = "complete"
                [design]
                order = 0
                {asked}
                [simulation]
                initial = [[{start}], [0.0]]
                """
            )
        )

    limits = "limits = { u = [-1.0, 1.0] }"
    assert key("1.0", limits) != key("2.0", limits)
    assert key("1.0") == key("2.0"), "no actuator is limited"
    assert key("1.0", limits, "gain_limit = 2.0") == key("2.0", limits, "gain_limit = 2.0"), (
        "nothing is by default"
    )


def test_the_key_holds_the_sources_of_all_that_searches(root):
    held = {path.resolve() for path in design_cache._modules()}
    for part in ("check", "model", "lmi", "codegen"):
        own = set((root / part / "lockstep" / part).rglob("*.py"))
        assert own
        assert own <= held


@pytest.mark.parametrize(
    "damage",
    [
        lambda text: text[: len(text) // 2],
        lambda _text: "",
        lambda _text: "[1, 2]",
        lambda _text: "null",
        lambda text: text.replace('"gains"', '"gain"', 1),
        lambda text: json.dumps(better(json.loads(text))),
        lambda text: json.dumps(moved(json.loads(text))),
    ],
    ids=["cut", "empty", "a list", "null", "a key", "a smaller rho", "other gains"],
)
def test_what_is_damaged_or_not_proved_is_ignored(damage, made, own_cache):
    problem = made.problem
    design_cache.keep(made.problem, made)
    assert isinstance(design_cache.recall(problem), Design)
    (file,) = kept(own_cache)
    file.write_text(damage(file.read_text(encoding="utf-8")), encoding="utf-8")
    assert design_cache.recall(problem) is None


def better(content: dict) -> dict:
    content["claims"]["rho"] *= 0.9
    return content


def moved(content: dict) -> dict:
    content["gains"][0]["D"][0][0] += 7.0
    return content


@pytest.mark.parametrize("why", ["interrupted", "time_limit"])
def test_a_search_that_was_cut_is_not_kept(why, made, own_cache):
    content = json.loads(made.text())
    content["info"]["figures"][why] = True
    design_cache.keep(made.problem, Design.of(content, "cut"))
    assert kept(own_cache) == []


def test_a_folder_that_takes_no_files_is_no_error(made, own_cache):
    own_cache.write_text("no folder", encoding="utf-8")
    design_cache.keep(made.problem, made)
    assert design_cache.recall(made.problem) is None


def test_the_range_grows_with_what_is_searched():
    from lockstep.lmi.proposal import claim_of, proved_bound
    from lockstep.lmi.search import GainSearch
    from lockstep.model.assembly import network_of

    problem = lockstep.Problem.parse(SMALL)
    bound = proved_bound(problem)
    network = network_of(problem, bound)
    search = GainSearch.of(network.loop(0), claim_of(problem, bound), 50.0)
    low, high = range_of_seconds(search, 2, 1)
    assert 0 < low < high
    assert [one_digit(one) for one in (0.2, 89.0, 91.0, 7300.0)] == ["1 s", "90 s", "2 min", "2 h"]


def test_the_time_left_counts_down_and_begins_anew_with_a_phase():
    now = [0.0]
    left = TimeLeft(lambda: now[0])
    left.tell("searching", 0.0)
    now[0] = 2.0
    left.tell("searching", 0.5)
    assert left.text() == "", "too soon to say"
    now[0] = 20.0
    left.tell("searching", 0.5)
    assert left.text() == "about 20 s left"
    now[0] = 30.0
    assert left.text() == "about 10 s left"
    now[0] = 60.0
    assert left.text() == "soon"
    left.tell("proving", 0.95)
    assert left.text() == ""
    left.tell("comparing: host", 0.0)
    now[0] = 70.0
    left.tell("comparing: a core", 0.25)
    assert left.text() == "about 30 s left", "a detail is no phase of its own"
