"""benchmarks/designs: every problem file is sound, the arithmetic of table and summary is right. No design runs here."""

import importlib
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from lockstep.check.errors import ProblemError
from lockstep.model.checks import check_problem
from lockstep.model.problem import load_problem

ROOT = Path(__file__).parents[3]
FILES = sorted((ROOT / "benchmarks" / "designs").glob("*.toml"))


@pytest.fixture(scope="module")
def scripts() -> Iterator[dict[str, ModuleType]]:
    """The runner and its table, which are no part of the package."""
    names = ("designs", "designs_table", "page")
    sys.path.insert(0, str(ROOT / "benchmarks"))
    yield {name: importlib.import_module(name) for name in names}
    sys.path.remove(str(ROOT / "benchmarks"))
    for name in names:
        del sys.modules[name]


@pytest.fixture(scope="module")
def benchmark(scripts) -> ModuleType:
    return scripts["designs"]


@pytest.fixture(scope="module")
def table(scripts) -> ModuleType:
    return scripts["designs_table"]


@pytest.mark.slow
@pytest.mark.parametrize("file", FILES, ids=[file.stem for file in FILES])
def test_a_problem_is_valid_and_its_bound_is_proved(file):
    report = check_problem(load_problem(file))
    assert report.ok, report.problems
    assert report.document()["bound"]["proved"]


@pytest.mark.parametrize(
    ("name", "found", "instead", "expected"),
    [
        ("rooms", 'topology = "path"', "edges = [[1, 2], [3, 4]]", "no spanning tree"),
        ("van_der_pol", "x = [-2.1, 2.1]\n", "", "no finite bound"),
    ],
)
def test_a_problem_that_is_not_sound_is_found(tmp_path, name, found, instead, expected):
    text = (ROOT / "benchmarks" / "designs" / f"{name}.toml").read_text(encoding="utf-8")
    assert found in text
    file = tmp_path / "problem.toml"
    file.write_text(text.replace(found, instead), encoding="utf-8")
    with pytest.raises(ProblemError, match=expected):
        check_problem(load_problem(file))


def test_the_problems_are_as_many_and_as_varied_as_asked(table):
    cases = table.cases()
    assert len(cases) >= 25
    assert len({case.field for case in cases}) >= 10
    assert {case.problem.order for case in cases} == {0, 1, 2, 3, 4}
    assert {case.problem.graph().agents for case in cases} == {2, 3, 4, 5, 6}
    assert all("# Source: " in case.file.read_text(encoding="utf-8") for case in cases if case.file in FILES)


def test_the_first_comment_gives_the_field_and_the_reason(table, tmp_path):
    file = tmp_path / "x.toml"
    file.write_text(
        '# Field: cranes.\n# Source: a.\n# Infeasible: no force\n# at all.\n\ntitle = "x"\n', encoding="utf-8"
    )
    assert table.case_of(file) == table.Case("x", file, "cranes", "no force at all")
    assert not table.case_of(ROOT / "benchmarks" / "designs" / "rooms.toml").infeasible
    with pytest.raises(SystemExit, match=r"no such problem: boats; there are .*rooms"):
        table.cases(["boats"])


def row(table, *rhos, floor=1.0, sampled=True, infeasible="", name="rooms"):
    runs = [
        table.Run(k, rho, sampled and rho is not None, rho, floor, 10.0 + k) for k, rho in enumerate(rhos)
    ]
    file = ROOT / "benchmarks" / "designs" / "rooms.toml"
    return table.Row(table.Case(name, file, "buildings", infeasible), tuple(runs))


def test_a_row_counts_a_failed_run_as_infinite(table):
    even, failed = row(table, 2.0, 2.1, 2.0), row(table, 3.0, None, 2.0, floor=2.0)
    assert (even.certified, even.spread, even.over_floor) == (3, pytest.approx(1.05), 2.0)
    assert (failed.certified, failed.sampled) == (2, 2)
    assert failed.spread == float("inf")
    assert failed.over_floor == 1.5
    assert row(table, 3.0, None, None).over_floor == float("inf")
    assert row(table, 3.0, floor=None).over_floor == float("inf")


def test_a_row_of_the_table(table):
    lines = table.table_of(
        [row(table, 2.0, 3.0, None, floor=1.5), row(table, None, infeasible="why")]
    ).splitlines()
    assert lines[2] == "| rooms | 2 of 3 | 2 of 3 | 2 | 11 | 2 | 2.5 | 3 | 1.5 | 2 | 3 | buildings | 6 | 1 |"
    assert lines[3] == "| rooms | none exist | 0 of 1 | - | 10 | - | - | - | 1 | - | - | buildings | 6 | 1 |"
    assert {line.count("|") for line in lines} == {len(table.HEAD) + 1}


def reached(table, rows):
    return [holds for holds, _ in table.summary(rows)]


def test_the_summary_reaches_all_or_says_what_it_does_not(table):
    good = [row(table, 1.4, 1.45) for _ in range(9)]
    assert reached(table, good) == [True] * 6
    assert reached(table, [*good, row(table, 1.4, 1.6)]) == [True] * 6  # nine of ten are even
    assert reached(table, [*good[:8], row(table, 1.4, 1.6)]) == [True, False, True, True, True, True]
    assert reached(table, [*good[:8], row(table, 1.6, 1.6)]) == [True, True, False, True, True, True]
    assert reached(table, [*good, row(table, 1.4, None)]) == [False, True, True, True, True, True]
    assert reached(table, [*good, row(table, 0.9)]) == [True, True, True, False, True, True]
    assert reached(table, [*good, row(table, 1.4, infeasible="why")]) == [True, True, True, True, False, True]
    assert reached(table, [*good, row(table, None, infeasible="why")]) == [True] * 6
    assert reached(table, [*good, row(table, 1.4, sampled=False, name="x")]) == [True] * 5 + [False]
    assert "solved by no seed: x" in table.verdicts([row(table, None, name="x")])


def test_an_answer_is_read(benchmark, table):
    answer = {
        "certified": True,
        "rho": 2.0,
        "sampled": {"certified": False, "rho": 3.0, "not_designed_for_period": "no"},
    }
    assert benchmark.read(1, answer, 4.04) == table.Run(1, 2.0, False, None, None, 4.0, "no")
    answer["sampled"] = {"certified": True, "rho": 3.0}
    answer["floor"] = 1.5
    assert benchmark.read(1, answer, 4.0) == table.Run(1, 2.0, True, 3.0, 1.5, 4.0)
    refused = {"ok": False, "certified": False, "error": {"kind": "infeasible", "message": "none"}}
    assert benchmark.read(2, refused, 1.0) == table.Run(2, None, False, None, None, 1.0, "none")


def test_what_is_kept_is_run_again_only_where_it_was_stopped_earlier(benchmark):
    assert not benchmark.is_final(None, 10.0)
    assert benchmark.is_final({"stopped_after": None}, 10.0)
    assert benchmark.is_final({"stopped_after": 10.0}, 10.0)
    assert not benchmark.is_final({"stopped_after": 5.0}, 10.0)


def test_results_are_kept_and_read_again(benchmark, table, tmp_path, monkeypatch):
    asked = []

    def run_of(case, seed, _limit):
        asked.append((case.name, seed))
        return table.Run(seed, 2.0 + seed, True, 3.0, 1.0, 1.0)

    monkeypatch.setattr(benchmark, "run_of", run_of)
    kept = tmp_path / "build" / "designs.json"
    rooms, ships = table.cases(["rooms"]), table.cases(["ships"])
    first = benchmark.measure(rooms, 2, 1, 10.0, kept)
    assert [run.rho for run in first[0].runs] == [2.0, 3.0]
    assert benchmark.measure([*rooms, *ships], 3, 1, 10.0, kept)[0].runs[:2] == first[0].runs
    assert sorted(asked) == [
        ("rooms", 0),
        ("rooms", 1),
        ("rooms", 2),
        *(("ships", seed) for seed in range(3)),
    ]


def test_a_command_is_timed_and_stopped(benchmark, tmp_path):
    answer = tmp_path / "answer.json"
    seconds, late = benchmark.processor_time([sys.executable, "-c", "print('{}')"], answer, 300.0)
    assert (answer.read_text(encoding="utf-8").strip(), late) == ("{}", False)
    assert seconds > 0
    for forever in ("import time; time.sleep(1000)", "while True: pass"):
        assert benchmark.processor_time([sys.executable, "-c", forever], answer, 0.1)[1]


def test_runs_side_by_side_keep_the_results_of_each_other(benchmark, table, tmp_path, monkeypatch):
    """A second run ends while the first is at work: what it found is in the first one's file and table."""
    kept, (case,) = tmp_path / "designs.json", table.cases(["rooms"])

    def run_of(_case, seed, _limit):
        if seed == 0:
            benchmark.keep(kept, "of another run", {})
        return table.Run(seed, 2.0, True, 3.0, 1.0, 1.0)

    monkeypatch.setattr(benchmark, "run_of", run_of)
    benchmark.measure([case], 2, 1, 10.0, kept)
    found = json.loads(kept.read_text(encoding="utf-8"))
    assert "of another run" in found
    assert len(found) == 3


def test_the_page_keeps_what_is_around_the_table(benchmark, scripts):
    page = benchmark.PAGE.read_text(encoding="utf-8")
    marks = benchmark.BEGIN, benchmark.END
    new = scripts["page"].updated(page, *marks, "| new |")
    assert "| new |" in new
    assert scripts["page"].updated(new, *marks, "x") == scripts["page"].updated(page, *marks, "x")
    assert new.split(benchmark.BEGIN)[0] == page.split(benchmark.BEGIN)[0]
