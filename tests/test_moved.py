"""benchmarks/moved.py: what counts as moved, and the page beside what was kept. Nothing is measured here."""

import importlib
import json
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def moved():
    sys.path.insert(0, str(ROOT / "benchmarks"))
    yield importlib.import_module("moved")
    sys.path.remove(str(ROOT / "benchmarks"))
    for name in ("moved", "designs", "designs_table", "page"):
        del sys.modules[name]


@pytest.mark.parametrize(
    ("before", "now", "said"),
    [
        ([1.0, 1.1, 1.2], [1.0, 1.1, 1.2], None),
        ([1.0, 1.1, 1.2], [1.44, 1.5, 1.6], None),  # 1.44 / 1.1 is less than 1.2 times 1.1: within the slack
        ([1.0, 1.1, 1.2], [1.46, 1.5, 1.6], "slower: 1.5 instead of 1.1 (x 1.36)"),
        ([1.46, 1.5, 1.6], [1.0, 1.1, 1.2], "faster: 1.1 instead of 1.5 (x 0.73)"),
        ([1.0, 1.1, 9.0], [5.0, 6.0, 7.0], None),  # a noisy ratio has to move further
    ],
)
def test_moved_by_more_than_its_noise(moved, before, now, said):
    assert moved.moved(before, now) == said


def test_each_script_runs_once_a_round_and_its_figures_are_those_of_the_ratios(moved, tmp_path, monkeypatch):
    counter = tmp_path / "runs"
    script = f"""
import json, pathlib, sys
file = pathlib.Path({str(counter)!r})
turn = int(file.read_text()) + 1 if file.exists() else 1
file.write_text(str(turn))
print(json.dumps({{"ours": 4.0 - turn, "theirs": 2.0, "said": sys.argv[1:]}}))
sys.exit(1)  # as a script that misses its target
"""
    (tmp_path / "one.py").write_text(script, encoding="utf-8")
    monkeypatch.setattr(moved, "HERE", tmp_path)
    ratios = [
        moved.Ratio("a", ("one.py", "--json"), lambda said: said["ours"] / said["theirs"], "a"),
        moved.Ratio("b", ("one.py", "--json"), lambda said: len(said["said"]), "b"),
    ]
    assert moved.measured(ratios, 3) == {"a": [0.5, 1.0, 1.5], "b": [1, 1, 1]}
    assert counter.read_text() == "3"


def test_a_script_that_says_nothing_is_named(moved, tmp_path, monkeypatch):
    (tmp_path / "one.py").write_text("raise SystemExit('no compiler')", encoding="utf-8")
    monkeypatch.setattr(moved, "HERE", tmp_path)
    with pytest.raises(SystemExit, match=r"one\.py printed nothing: no compiler"):
        moved.measured([moved.Ratio("a", ("one.py",), len, "a")], 1)


def test_the_page_shows_what_was_kept(moved):
    kept = json.loads(moved.KEPT.read_text(encoding="utf-8"))
    assert set(kept["ratios"]) == {one.name for one in moved.RATIOS}
    page = moved.PAGE.read_text(encoding="utf-8")
    shown = page.split(moved.BEGIN)[1].split(moved.END)[0].strip()
    assert shown == f"{kept['machine']}\n\n{moved.table_of(moved.RATIOS, kept['ratios'])}"
